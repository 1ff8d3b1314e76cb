# System identification: tissue models from tissue tests, by ridge ARX as in the thesis and by output error.
# Reads the recordings of chapter tissue; makes Tables 2.1 and 3.1, Figures 2.4, 3.2, 3.4 and 3.5 and models.json.
# Figures 1.1 and 3.1 are drawn from definitions, as Table 2.1 and Figures 2.4 and 3.2 are, by the same job.

TISSUE_RECORDINGS = [recording(record.file) for record in settings.tissue.records]


rule definition_figures:
    input:
        checked=ALL_CHECKED,
    output:
        **published("table_2_1", "figure_1_1", "figure_2_4", "figure_3_1", "figure_3_2"),
    log:
        "<logs>/definition_figures.log",
    benchmark:
        "<benchmarks>/definition_figures.tsv"
    group:
        "tissue"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=130, seconds=3),
    params:
        code=library_code("definition_figures.py"),
        source_label="definitions, no data",
    message:
        "Table 2.1, Figures 1.1, 2.4, 3.1 and 3.2: the models and the steps of the thesis"
    script:
        "../scripts/definition_figures.py"


rule identify_tissue:
    input:
        recordings=TISSUE_RECORDINGS,
        effects=EFFECT_FILES,
        bases=BASE_FILES,
        checked=ancient("<results>/checked/tissue.json"),
    output:
        **published("table_3_1", "physical_parameters", "figure_3_4", "figure_3_5"),
        models="<results>/tissue/models.json",
        search="<results>/tissue/search.csv",
    log:
        "<logs>/identify_tissue.log",
    benchmark:
        "<benchmarks>/identify_tissue.tsv"
    group:
        "tissue"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=205, seconds=10),
    params:
        code=library_code("identify_tissue.py"),
        settings=plain(
            settings,
            {
                "tissue": True,
                "improvement": {
                    "base",
                    "effects",
                    "effect_files",
                    "most_effects",
                    "forward",
                    "session",
                    "propose_law",
                },
                "stability": {"pendulum": {"gravity_m_s2"}},
                "seed": True,
            },
        ),
        source_label=DATA,
    message:
        "Table 3.1, Figures 3.4 and 3.5: the identified tissue models"
    script:
        "../scripts/identify_tissue.py"
