# From the movement of the deposits to pushes against simulated bodies, and to the measure that told who must step.


if study.has("pushes"):

    rule predict_steps:
        input:
            bodies=[f"<results>/lifting/{lift}/body.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            sources=library_sources("push_prediction.py"),
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
        params:
            settings=plain(settings.pushes),
            stability=without(settings.stability, "compare"),
            seed=settings.seed,
            data=DATA,
        message:
            "Pushes against simulated bodies: which measure tells who must step"
        script:
            "../scripts/push_prediction.py"
