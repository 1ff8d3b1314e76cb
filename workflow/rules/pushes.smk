# From the movement of the deposits to pushes against simulated bodies, one job per person or lift, and to the measure that told
# who must step.


PUSHED_BY = ("body", "controller", "spread", "push", "outcome")

if study.has("pushes"):

    # Where whole lifts are analysed one by one, they are pushed so; where persons are, all lifts of each.
    if study.has("lifting"):

        PUSHED = study.lifts

        rule push_lift:
            input:
                body="<results>/lifting/{lift}/body.csv",
                pendulum=expand("<results>/lifting/{{lift}}/pendulum.{kind}", kind=["csv", "json"]),
            output:
                states="<results>/pushes/states/{lift}.csv",
                outcomes="<results>/pushes/outcomes/{lift}.csv",
            log:
                "<logs>/push_lift/{lift}.log",
            benchmark:
                "<benchmarks>/push_lift/{lift}.tsv"
            group:
                "lift"
            conda:
                CONDA
            resources:
                **job_size(peak_mb=210, seconds=4),
            params:
                code=library_code("push_bodies.py"),
                settings=part(settings.pushes, *PUSHED_BY),
                stability=part(settings.stability, *MEASURED),
                seed=settings.seed,
            message:
                "{wildcards.lift}: pushes against a simulated body"
            script:
                "../scripts/push_bodies.py"

    else:
        PUSHED = study.subjects

        rule push_person:
            input:
                states="<results>/pushes/states/{person}.csv",
            output:
                outcomes="<results>/pushes/outcomes/{person}.csv",
            log:
                "<logs>/push_person/{person}.log",
            benchmark:
                "<benchmarks>/push_person/{person}.tsv"
            group:
                "person"
            conda:
                CONDA
            resources:
                **job_size(peak_mb=185, seconds=2),
            params:
                code=library_code("push_bodies.py"),
                settings=part(settings.pushes, *PUSHED_BY),
                stability={},  # the states are there
                seed=settings.seed,
            message:
                "{wildcards.person}: pushes against simulated bodies"
            script:
                "../scripts/push_bodies.py"

    rule predict_steps:
        input:
            outcomes=[f"<results>/pushes/outcomes/{name}.csv" for name in PUSHED],
            states=[f"<results>/pushes/states/{name}.csv" for name in PUSHED],
        output:
            **published("push_prediction", "push_sensitivity", "push_figure"),
            pushes="<results>/pushes/pushes.csv",
            winner="<results>/pushes/winner.json",
        log:
            "<logs>/predict_steps.log",
        benchmark:
            "<benchmarks>/predict_steps.tsv"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=210 + 0.04 * len(study.lifts), seconds=30 + 0.04 * len(study.lifts)),
        params:
            code=library_code("push_prediction.py"),
            settings=plain(settings.pushes),
            seed=settings.seed,
            data=DATA,
        message:
            "Pushes of all people: which measure tells who must step"
        script:
            "../scripts/push_prediction.py"
