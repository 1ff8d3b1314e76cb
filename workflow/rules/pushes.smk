# From the movement of the deposits to pushes against simulated bodies, and to the measure that told who must step.


if study.has("pushes"):

    # Where whole lifts are analysed one by one, their folders; where persons are, what was kept of theirs.
    if study.has("lifting"):
        PUSHED = {"bodies": [f"<results>/lifting/{lift}/body.csv" for lift in study.lifts]}
        PUSHED["pendulums"] = [
            f"<results>/lifting/{lift}/pendulum.{kind}" for lift in study.lifts for kind in ("csv", "json")
        ]
    else:
        PUSHED = {"persons": [f"<results>/pushes/persons/{person}.csv" for person in study.subjects]}

    rule predict_steps:
        input:
            **PUSHED,
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
            **measured(peak_mb=215 + 0.25 * len(study.lifts), seconds=15 + 0.5 * len(study.lifts)),
        params:
            code=library_code("push_prediction.py"),
            settings=plain(settings.pushes),
            stability=without(settings.stability, "compare"),
            seed=settings.seed,
            data=DATA,
        message:
            "Pushes against simulated bodies: which measure tells who must step"
        script:
            "../scripts/push_prediction.py"
