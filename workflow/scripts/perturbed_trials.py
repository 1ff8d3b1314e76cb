"""Perturbed and unperturbed trials against the basin of the unperturbed mean, and the quality of their recordings."""

from job import run, stem

from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.pushes import PerturbationsSettings
from lumbar.settings.stability import StabilitySettings


def main(
    input,
    output,
    settings: PerturbationsSettings,
    stability: StabilitySettings,
    lifting: LiftingSettings,
    data: str,
):
    """Read all trials, compare them, write table and figure."""
    from lumbar.lifting.movement.cleaning import low_pass
    from lumbar.lifting.pushes.feedback import feedback_sentence
    from lumbar.lifting.quality.other_trials import beside, other_trials
    from lumbar.lifting.quality.screening import read_screened
    from lumbar.lifting.quality.sheet import quality_table
    from lumbar.lifting.stability.comparison.perturbed_trials import (
        compare_trials,
        inside_by_weight,
        trial_of,
        trials_table,
    )
    from lumbar.publishing.figures.push_figures import trials_figure
    from lumbar.publishing.figures.style import save
    from lumbar.records.columns import read_record

    trials, sheets, starts = [], [], []
    known = other_trials([*input.unperturbed, *input.perturbed], settings.markers, own=True)
    for group in ("unperturbed", "perturbed"):
        for number, path in enumerate(input[group], start=1):
            recording, sheet = read_screened(path, settings.markers, others=beside(known, path))
            trials.append(trial_of(recording, group, settings, lifting))
            starts.append(recording.time[0])
            sheets.append({"lift": f"{group}_{number}", **sheet.as_dict()})
    quality_table(sheets, data).write(stem(output.quality_of_trials))
    frame = compare_trials(trials, settings, stability)
    by_weight = inside_by_weight(trials, settings, stability)
    torques = [None] * len(trials)
    for number, path in enumerate(input.pushes, start=len(input.unperturbed)):
        push, start = read_record(path, settings.pushes.layout), starts[number]
        # Filtered as the markers are.
        same = lifting.filter.cutoff_Hz, lifting.filter.order
        force = low_pass(push["force"], 1 / push.sampling_time, *same)
        torques[number] = (push.time - start, settings.pushes.arm_m * force)
    feedback = feedback_sentence(trials, torques, settings, stability)
    table = trials_table(frame, by_weight, feedback, settings, stability, data)
    table.write(stem(output.perturbed_trials))
    figure = trials_figure(trials, by_weight, settings, stability)
    save(figure, stem(output.perturbed_trials_figure), data)


run(main, snakemake)
