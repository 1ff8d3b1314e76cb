# Repeated trials with and without perturbation, against the basin of the unperturbed mean.


if study.has("perturbations"):

    rule compare_perturbed_trials:
        input:
            unperturbed=[recording(path) for path in settings.perturbations.unperturbed],
            perturbed=[recording(path) for path in settings.perturbations.perturbed],
            pushes=[recording(path) for path in getattr(settings.perturbations.pushes, "files", ())],
            checked="<results>/checked/perturbations.json",
        output:
            **published("quality_of_trials", "perturbed_trials", "perturbed_trials_figure"),
        log:
            "<logs>/perturbed_trials.log",
        benchmark:
            "<benchmarks>/perturbed_trials.tsv"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=215, seconds=12),
        params:
            code=library_code("perturbed_trials.py"),
            settings=plain(settings.perturbations),
            stability=plain(settings.stability),
            lifting=part(settings.lifting, "gaps", "filter"),
            data=DATA,
        message:
            "Perturbed trials against the basin of the unperturbed mean"
        script:
            "../scripts/perturbed_trials.py"
