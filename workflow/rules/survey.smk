# The participants' survey: Table 3.2 as published, the within-subject analysis, and what they picked as the best.


rule survey_tables:
    input:
        ratings=recording(settings.survey.file),
        checked="<results>/checked/survey.json",
    output:
        **published("table_3_2", "survey_paired", "survey_best_picks"),
        results="<results>/survey/survey.json",
    log:
        "<logs>/survey_tables.log",
    benchmark:
        "<benchmarks>/survey_tables.tsv"
    group:
        "survey"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=155, seconds=4),
    params:
        code=library_code("survey_tables.py"),
        settings=plain(settings.survey),
        seed=settings.seed,
        data=DATA,
    message:
        "Table 3.2: ratings of the models, as published and within participants"
    script:
        "../scripts/survey_tables.py"


rule survey_figures:
    input:
        results="<results>/survey/survey.json",
    output:
        **published("survey_likert", "survey_best_picks_figure"),
    log:
        "<logs>/survey_figures.log",
    benchmark:
        "<benchmarks>/survey_figures.tsv"
    group:
        "survey"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=95, seconds=3),
    params:
        code=library_code("survey_figures.py"),
        scale_labels=lambda wildcards: plain(settings.survey.scale_labels),
        statement=lambda wildcards: settings.survey.statement,
        confidence=settings.survey.confidence,
    message:
        "Ratings and best picks of the models as pictures"
    script:
        "../scripts/survey_figures.py"


if "survey_felt" in {artefact.id for artefact in ARTEFACTS}:

    rule felt_ratings:
        input:
            ratings=recording(settings.survey.file),
            models="<results>/tissue/models.json",
            recordings=[recording(record.file) for record in settings.tissue.records],
            effects=EFFECT_FILES,
            checked=["<results>/checked/survey.json", "<results>/checked/tissue.json"],
        output:
            **published("survey_felt", "survey_power"),
        log:
            "<logs>/felt_ratings.log",
        benchmark:
            "<benchmarks>/felt_ratings.tsv"
        group:
            "survey"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=200, seconds=4),
        params:
            code=library_code("felt_ratings.py"),
            settings=plain(settings.survey),
            tissue=plain(settings.tissue),
            perception=plain(settings.perception),
            estimator=settings.runtime.estimator,
            training=settings.tissue.training[0],
            seed=settings.seed,
            data=DATA,
        message:
            "The rated models as a hand would tell them, and what a survey would need"
        script:
            "../scripts/felt_ratings.py"
