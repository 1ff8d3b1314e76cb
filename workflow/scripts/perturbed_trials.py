"""Perturbed and unperturbed trials against the basin of the unperturbed mean, and the quality of their recordings."""

from job import run, stem


def main(input, output, params):
    """Read all trials, compare them, write table and figure."""
    from lumbar.quality.quality_table import quality_table
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
    trials, sheets = [], []
    for group in ("unperturbed", "perturbed"):
        for number, path in enumerate(input[group], start=1):
            recording, sheet = read_screened(path, settings.markers)
            trials.append(trial_of(recording, group, settings, lifting))
            sheets.append({"lift": f"{group}_{number}", **sheet.as_dict()})
    quality_table(sheets, params.data).write(stem(output.quality_of_trials))
    frame = compare_trials(trials, settings, stability)
    by_weight = inside_by_weight(trials, settings, stability)
    trials_table(frame, by_weight, trials, settings, stability, params.data).write(
        stem(output.perturbed_trials)
    )
    figure = trials_figure(trials, by_weight, settings, stability)
    save(figure, stem(output.perturbed_trials_figure), params.data)


run(main, snakemake)
