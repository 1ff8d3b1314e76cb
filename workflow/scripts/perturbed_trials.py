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
    from lumbar.lifting.pushes.trial_separation import (
        body_trial,
        measures_of_trial,
        separation_frame,
        separation_table,
    )
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

    trials, sheets, recordings = [], [], []
    for group in ("unperturbed", "perturbed"):
        for number, path in enumerate(input[group], start=1):
            recording, sheet = read_screened(path, settings.markers)
            trials.append(trial_of(recording, group, settings, lifting))
            recordings.append((recording, group))
            sheets.append({"lift": f"{group}_{number}", **sheet.as_dict()})
    quality_table(sheets, data).write(stem(output.quality_of_trials))
    frame = compare_trials(trials, settings, stability)
    by_weight = inside_by_weight(trials, settings, stability)
    trials_table(frame, by_weight, trials, settings, stability, data).write(stem(output.perturbed_trials))
    standing = frame[frame["sign"] == "inverted"].set_index("trial")["largest_value"]
    found = [{"basin": float(standing[recording.name])} for recording, _ in recordings]
    if settings.legs:
        for values, (recording, group) in zip(found, recordings, strict=True):
            values |= measures_of_trial(body_trial(recording, group, settings, lifting), settings)
    groups = [group for _, group in recordings]
    torques = [None] * len(trials)
    for number, path in enumerate(input.pushes, start=len(input.unperturbed)):
        push, start = read_record(path, settings.pushes.layout), recordings[number][0].time[0]
        # Filtered as the markers are.
        same = lifting.filter.cutoff_Hz, lifting.filter.order
        force = low_pass(push["force"], 1 / push.sampling_time, *same)
        torques[number] = (push.time - start, settings.pushes.arm_m * force)
    feedback = feedback_sentence(trials, torques, settings, stability)
    separation = separation_table(separation_frame(found, groups), groups, data, feedback)
    separation.write(stem(output.trial_separation))
    figure = trials_figure(trials, by_weight, settings, stability)
    save(figure, stem(output.perturbed_trials_figure), data)


run(main, snakemake)
