"""Quality of the recordings, events of every lift, Figure 4.1 and Figure 4.2."""

from job import run, stem

from lumbar.settings.lifting import PendulumSettings


def main(input, output, pendulum: PendulumSettings, source_label: str):
    """Tabulate and draw from the files of the lifts."""
    import pandas as pd

    from lumbar.base.files import read_json
    from lumbar.lifting.quality.screening import quality_table
    from lumbar.publishing.figures.lifting_figures import events_figure, pendulum_figure, segments_figure
    from lumbar.publishing.figures.style import person_and_box, save

    sheets = [read_json(path) for path in input.quality]
    quality_table(sheets, source_label).write(stem(output.quality))
    lifts = [
        {
            "motion": pd.read_csv(motion),
            "centres": pd.read_csv(centres),
            "states": pd.read_csv(states),
            "landmarks": pd.read_csv(landmarks),
            "events": read_json(events)["events"],
            "summary": read_json(summary),
        }
        for motion, centres, states, landmarks, events, summary in zip(
            input.motion,
            input.centres,
            input.states,
            input.landmarks,
            input.events,
            input.summary,
            strict=True,
        )
    ]
    for lift, svg in zip(lifts, output.lifting_events[::2], strict=True):
        save(events_figure(lift), stem([svg]), source_label, who=person_and_box(lift["summary"]))
    number = next((place for place, lift in enumerate(lifts) if len(lift["states"])), 0)
    shown = lifts[number] | {"body": pd.read_csv(input.body[number])}
    who = person_and_box(shown["summary"])
    save(pendulum_figure(shown, pendulum), stem(output.figure_4_1), source_label, who=who)
    save(segments_figure(shown), stem(output.figure_4_2), source_label, who=who)


run(main, snakemake)
