# Figures 1.1 and 3.1, how the thesis hangs together; then motion of the surgeons' tool: power spectral densities of all trials,
# bandwidth by two rules with intervals.


rule outline_figures:
    input:
        checked="<results>/checked/surgeon.json",
    output:
        **published("figure_1_1", "figure_3_1"),
    log:
        "<logs>/outline_figures.log",
    benchmark:
        "<benchmarks>/outline_figures.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=130, seconds=2),
    params:
        code=library_code("outline_figures.py"),
    message:
        "Figures 1.1 and 3.1: how the thesis and its article hang together"
    script:
        "../scripts/outline_figures.py"


rule surgeon_motion:
    input:
        records=[recording(record.file) for record in settings.surgeon.records],
        checked="<results>/checked/surgeon.json",
    output:
        **published("surgeon_psd"),
        bandwidth="<results>/surgeon/bandwidth.json",
        psd="<results>/surgeon/psd.csv",
    log:
        "<logs>/surgeon_motion.log",
    benchmark:
        "<benchmarks>/surgeon_motion.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=195, seconds=7),
    params:
        code=library_code("surgeon_motion.py"),
        settings=plain(settings.surgeon),
        seed=settings.seed,
        data=DATA,
    message:
        "Bandwidth of the surgeons' motion"
    script:
        "../scripts/surgeon_motion.py"
