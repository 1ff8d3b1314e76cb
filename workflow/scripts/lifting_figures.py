"""Events of every lift, Figure 4.1 and Figure 4.2."""

from job import run, stem


def main(input, output, params):
    """Draw from the files of the lifts."""
    import pandas as pd

    from lumbar.files import read_json
    from lumbar.reports.figures.lifting_figures import events_figure, pendulum_figure, segments_figure
    from lumbar.reports.figures.style import save

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
        save(events_figure(lift), stem([svg]), params.data)
    shown = next((lift for lift in lifts if len(lift["states"])), lifts[0])
    save(pendulum_figure(shown), stem(output.figure_4_1), params.data)
    save(segments_figure(shown), stem(output.figure_4_2), params.data)


run(main, snakemake)
