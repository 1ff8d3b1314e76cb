# The report: one page with every table and figure of the study. It works offline.


rule report_page:
    input:
        made(ARTEFACTS),
        config="<results>/run_config.yaml",
        environment="<results>/run_environment.json",
        checked=[f"<results>/checked/{chapter}.json" for chapter in RECORDED_CHAPTERS],
        facts=[
            f"<results>/lifting/{lift}/{name}"
            for lift in study.lifts
            if study.has("lifting")
            for name in ("pendulum.json", "quality.json", "body.csv")
        ],
        failures="<results>/stability/failures.csv" if study.has("stability") else [],
        sheet=source("config/artefacts.tsv"),
        captions=[source(f"workflow/report/{artefact.id}.rst") for artefact in ARTEFACTS if artefact.label],
    output:
        page="<results>/report.html",
    log:
        "<logs>/report_page.log",
    benchmark:
        "<benchmarks>/report_page.tsv"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=250, seconds=6),
    params:
        code=library_code("report.py"),
    message:
        "The study's report: one page, works offline"
    script:
        "../scripts/report.py"


rule report:
    input:
        rules.report_page.output.page,
    message:
        "report: everything is made"
