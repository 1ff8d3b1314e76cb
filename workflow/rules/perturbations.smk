# Repeated trials with and without perturbation, against the basin of the unperturbed mean.


if study.has("perturbations"):

    rule compare_perturbed_trials:
        input:
            unperturbed=[recording(path) for path in settings.perturbations.unperturbed],
            perturbed=[recording(path) for path in settings.perturbations.perturbed],
            checked="<results>/checked/perturbations.json",
            sources=library_sources("perturbed_trials.py"),
        output:
            table=multiext("<results>/tables/perturbed_trials", ".csv", ".tex"),
            table_html=report(
                "<results>/tables/perturbed_trials.html",
                caption=caption("perturbed_trials"),
                category=CATEGORIES["perturbations"],
                labels={"artefact": "Trials and the basin of the mean"},
            ),
            figure_svg=report(
                "<results>/figures/perturbed_trials.svg",
                caption=caption("perturbed_trials"),
                category=CATEGORIES["perturbations"],
                labels={"artefact": "Trials and the basin of the mean, figure"},
            ),
            figure_pdf="<results>/figures/perturbed_trials.pdf",
        log:
            "<logs>/perturbed_trials.log",
        benchmark:
            "<benchmarks>/perturbed_trials.tsv"
        conda:
            CONDA
        params:
            settings=plain(settings.perturbations),
            stability=plain(settings.stability),
            lifting={key: plain(getattr(settings.lifting, key)) for key in ("gaps", "filter")},
            data=DATA,
        message:
            "Perturbed trials against the basin of the unperturbed mean"
        script:
            "../scripts/perturbed_trials.py"
