# The participants' survey: Table 3.2 as published, the within-subject analysis, and what they picked as the best.


rule analyse_survey:
    input:
        ratings=recording(settings.survey.file),
        checked=ancient("<results>/checked/survey.json"),
    output:
        **published(
            "table_3_2", "survey_paired", "survey_best_picks", "survey_likert", "survey_best_picks_figure"
        ),
        results="<results>/survey/survey.json",
    log:
        "<logs>/analyse_survey.log",
    benchmark:
        "<benchmarks>/analyse_survey.tsv"
    group:
        "survey"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=155, seconds=4),
    params:
        code=library_code("analyse_survey.py"),
        settings=plain(settings.survey),
        seed=settings.seed,
        source_label=DATA,
    message:
        "Table 3.2: ratings of the models, as published and within participants"
    script:
        "../scripts/analyse_survey.py"
