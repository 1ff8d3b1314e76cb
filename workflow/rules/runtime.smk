# Haptic runtime: the identified models as FMUs for FMI 2.0 and 3.0 (Eqs 3.17 and 3.18, moving average on the position), for a
# fast loop and, by the name <model>-thesis, as the thesis ran them.
# In: tissue/models.json, effects of the user's own. Out: fmu/<model>_fmi{2,3}.fmu, their checks, the forces they give to one push,
# and what the models ask of the device and the hand of the study.

RENDERING = set(type(settings.runtime).model_fields) - {"check_samples", "targets"}
FMUS = [f"<results>/fmu/{model}_fmi{version}.fmu" for model in settings.runtime.models for version in (2, 3)]


rule warm_compiler:
    input:
        checked=ALL_CHECKED,
    output:
        targets="<results>/runtime/targets.json",
    log:
        "<logs>/warm_compiler.log",
    benchmark:
        "<benchmarks>/warm_compiler.tsv"
    # The first time it takes as long as a chapter, and the FMUs wait for it.
    priority: 1
    group:
        "runtime"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=30, seconds=1),
    params:
        code=library_code("warm_compiler.py"),
        targets=list(settings.runtime.targets),
        compiler_cache=lambda wildcards: settings.runtime.compiler_cache,
    message:
        "What the C compiler needs of each platform, once"
    script:
        "../scripts/warm_compiler.py"


rule export_fmus:
    input:
        models="<results>/tissue/models.json",
        effects=EFFECT_FILES,
        targets="<results>/runtime/targets.json",
    output:
        **published("fmu_check", "fmu_force"),
        fmus=FMUS,
        checks="<results>/runtime/fmu_check.csv",
    log:
        "<logs>/export_fmus.log",
    benchmark:
        "<benchmarks>/export_fmus.tsv"
    group:
        "runtime"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=270, seconds=8),
    params:
        code=library_code("export_fmus.py"),
        settings=plain(settings.runtime),
        seed=settings.seed,
        source_label=DATA,
    message:
        "FMUs of the identified models, checked against the identified transfer functions"
    script:
        "../scripts/export_fmus.py"


rule render_models:
    input:
        models="<results>/tissue/models.json",
        recordings=TISSUE_RECORDINGS,
        checked=ancient("<results>/checked/tissue.json"),
        effects=EFFECT_FILES,
        targets="<results>/runtime/targets.json",
    output:
        **published("rendering", "passive_fits", "closed_loop", "z_width"),
        models="<results>/runtime/passive_models.json",
    log:
        "<logs>/render_models.log",
    benchmark:
        "<benchmarks>/render_models.tsv"
    group:
        "runtime"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=225, seconds=7),
    params:
        code=library_code("render_models.py"),
        settings=plain(settings.runtime, RENDERING),
        tissue=plain(settings.tissue, {"records", "layout", "rate_Hz", "settling_s"}),
        source_label=DATA,
    message:
        "The models in a person's hand: what they ask of the device, and passive fits"
    script:
        "../scripts/render_models.py"
