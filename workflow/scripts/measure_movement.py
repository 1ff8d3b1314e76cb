"""Measures of all lifts that depend on the movement: balance over the feet, posture, moment about L5/S1."""

from job import run, stem

from lumbar.settings.lifting import StabilitySettings


def main(input, output, settings: StabilitySettings, labels: dict[str, str], source_label: str):
    """Measure every lift, write the measures at every instant, the long table, and the figures."""
    from lumbar.base.files import read_json, write_csv
    from lumbar.interface.movement import measure_movement
    from lumbar.lifting.measures.lift_values import long_table, write_measures
    from lumbar.publishing.figures.movement_figures import course_figure, support_figure
    from lumbar.publishing.figures.style import save

    lifts = [
        (measure_movement(body, facts=read_json(facts), settings=settings), read_json(events)["events"])
        for body, facts, events in zip(input.body, input.facts, input.events, strict=True)
    ]
    for (found, _), path in zip(lifts, output.courses, strict=True):
        write_csv(path, found.instants.assign(data=source_label))
    values = long_table(((found.values, found.facts) for found, _ in lifts), labels)
    write_measures(stem(output.movement_measures), values, source_label)
    shown = [{"course": found.instants, "facts": found.facts, "events": events} for found, events in lifts]
    share = settings.measures.functional_share
    save(course_figure(shown, share), stem(output.movement_course), source_label)
    save(support_figure(shown, share), stem(output.base_of_support), source_label)


run(main, snakemake)
