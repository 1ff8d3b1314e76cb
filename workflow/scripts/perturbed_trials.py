"""Perturbed and unperturbed trials against the basin of the unperturbed mean."""

from job import run, stem


def main(input, output, params):
    """Read all trials, compare them, write table and figure."""
    from lumbar.quality.screening import read_screened
    from lumbar.reports.figures.perturbed_trials_figure import trials_figure
    from lumbar.reports.figures.style import save
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.perturbations import PerturbationsSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
    from lumbar.stability.comparison.perturbed_trials import (
        compare_trials,
        inside_by_weight,
        trial_of,
        trials_table,
    )

    settings = typed(PerturbationsSettings, params.settings)
    stability, lifting = typed(StabilitySettings, params.stability), typed(LiftingSettings, params.lifting)
    trials = [
        trial_of(read_screened(path, settings.markers)[0], group, settings, lifting)
        for group in ("unperturbed", "perturbed")
        for path in input[group]
    ]
    frame = compare_trials(trials, settings, stability)
    by_weight = inside_by_weight(trials, settings, stability)
    trials_table(frame, by_weight, trials, settings, stability, params.data).write(
        stem(output.perturbed_trials)
    )
    figure = trials_figure(trials, by_weight, settings, stability)
    save(figure, stem(output.perturbed_trials_figure), params.data)


run(main, snakemake)
