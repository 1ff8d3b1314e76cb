# System identification: tissue models from tissue tests, by ridge ARX as in the thesis and by output error beside it.
# Reads the recordings of chapter tissue; makes Tables 2.1 and 3.1, Figures 2.4, 3.2, 3.4 and 3.5 and models.json.

import re

TISSUE_RECORDINGS = [recording(record.file) for record in settings.tissue.records]
TRAINING = settings.tissue.training


rule viscoelastic_models:
    input:
        checked=ALL_CHECKED,
    output:
        **published("table_2_1", "figure_2_4", "figure_3_2"),
    log:
        "<logs>/viscoelastic_models.log",
    benchmark:
        "<benchmarks>/viscoelastic_models.tsv"
    group:
        "tissue"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=130, seconds=3),
    params:
        code=library_code("viscoelastic_models.py"),
        data="definitions, no data",
    message:
        "Table 2.1, Figures 2.4 and 3.2: the models and their mechanical analogues"
    script:
        "../scripts/viscoelastic_models.py"


rule identify_tissue:
    input:
        recordings=TISSUE_RECORDINGS,
        effects=EFFECT_FILES,
        bases=BASE_FILES,
        checked="<results>/checked/tissue.json",
    output:
        fits="<results>/tissue/identified/{training}.json",
        grid="<results>/tissue/identified/{training}.csv",
    log:
        "<logs>/identify_tissue/{training}.log",
    benchmark:
        "<benchmarks>/identify_tissue/{training}.tsv"
    wildcard_constraints:
        training="|".join(map(re.escape, TRAINING)) or "none",
    group:
        "tissue"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=155, seconds=5),
    params:
        code=library_code("identify_tissue.py"),
        training=lambda wildcards: wildcards.training,
        settings=part(
            settings,
            "tissue",
            *(f"improvement.{key}" for key in ("base", "effects", "effect_files", "most_effects")),
            *(f"improvement.{key}" for key in ("forward", "session")),
            "stability.pendulum.gravity_m_s2",
            "perception",
            "seed",
        ),
        data=DATA,
    message:
        "Identification of the tissue models on {wildcards.training}"
    script:
        "../scripts/identify_tissue.py"


rule tissue_models:
    input:
        fits=expand("<results>/tissue/identified/{training}.json", training=TRAINING),
        grids=expand("<results>/tissue/identified/{training}.csv", training=TRAINING),
        recordings=TISSUE_RECORDINGS,
        effects=EFFECT_FILES,
        bases=BASE_FILES,
        checked="<results>/checked/tissue.json",
    output:
        **published("table_3_1", "physical_parameters", "static_or_dynamic", "figure_3_4", "figure_3_5"),
        models="<results>/tissue/models.json",
        search="<results>/tissue/search.csv",
    log:
        "<logs>/tissue_models.log",
    benchmark:
        "<benchmarks>/tissue_models.tsv"
    group:
        "tissue"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=205, seconds=7),
    params:
        code=library_code("tissue_models.py"),
        tissue=plain(settings.tissue),
        perception=plain(settings.perception),
        data=DATA,
    message:
        "Table 3.1, Figures 3.4 and 3.5: the identified tissue models"
    script:
        "../scripts/tissue_models.py"
