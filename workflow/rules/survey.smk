# The participants' survey: Table 3.2 as published, the within-subject analysis, and what they picked as the best.


rule survey_tables:
    input:
        ratings=recording(settings.survey.file),
        checked="<results>/checked/survey.json",
        sources=library_sources("survey_tables.py"),
    output:
        table_3_2_csv="<results>/tables/table_3_2.csv",
        table_3_2_tex="<results>/tables/table_3_2.tex",
        table_3_2_html=report(
            "<results>/tables/table_3_2.html",
            caption=caption("table_3_2"),
            category=CATEGORIES["survey"],
            labels={"artefact": "Table 3.2"},
        ),
        survey_paired_csv="<results>/tables/survey_paired.csv",
        survey_paired_tex="<results>/tables/survey_paired.tex",
        survey_paired_html=report(
            "<results>/tables/survey_paired.html",
            caption=caption("survey_paired"),
            category=CATEGORIES["survey"],
            labels={"artefact": "Ratings within participants"},
        ),
        survey_best_picks_csv="<results>/tables/survey_best_picks.csv",
        survey_best_picks_tex="<results>/tables/survey_best_picks.tex",
        survey_best_picks_html=report(
            "<results>/tables/survey_best_picks.html",
            caption=caption("survey_best_picks"),
            category=CATEGORIES["survey"],
            labels={"artefact": "Best picks"},
        ),
        results="<results>/survey/survey.json",
    log:
        "<logs>/survey_tables.log",
    benchmark:
        "<benchmarks>/survey_tables.tsv"
    conda:
        CONDA
    params:
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
        sources=library_sources("survey_figures.py"),
    output:
        likert_svg=report(
            "<results>/figures/survey_likert.svg",
            caption=caption("survey_likert"),
            category=CATEGORIES["survey"],
            labels={"artefact": "Ratings of the models"},
        ),
        likert_pdf="<results>/figures/survey_likert.pdf",
        picks_svg=report(
            "<results>/figures/survey_best_picks.svg",
            caption=caption("survey_best_picks_figure"),
            category=CATEGORIES["survey"],
            labels={"artefact": "Best picks (figure)"},
        ),
        picks_pdf="<results>/figures/survey_best_picks.pdf",
    log:
        "<logs>/survey_figures.log",
    benchmark:
        "<benchmarks>/survey_figures.tsv"
    conda:
        CONDA
    params:
        scale_labels=plain(settings.survey.scale_labels),
        statement=settings.survey.statement,
        confidence=settings.survey.confidence,
    message:
        "Ratings and best picks of the models as pictures"
    script:
        "../scripts/survey_figures.py"
