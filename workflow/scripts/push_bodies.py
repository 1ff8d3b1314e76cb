"""Pushes against the simulated bodies of one person's lifts, or of one lift."""

from job import run

from lumbar.settings.pushes import PushesSettings
from lumbar.settings.stability import StabilitySettings


def main(input, output, settings: PushesSettings, stability: StabilitySettings, seed: int):
    """Push at random instants of every deposit and keep how each push ended."""
    from pathlib import Path

    import pandas as pd

    from lumbar.base.files import write_csv
    from lumbar.interface.pushing import push_outcomes, push_states, saved_lift

    if hasattr(input, "states"):
        # No body could be made of any of the person's lifts: the table has no columns.
        there = Path(input.states).stat().st_size > 1
        states = pd.read_csv(input.states) if there else pd.DataFrame()
    else:
        lifts = [saved_lift(Path(input.body).parent)]
        states = push_states(lifts, stability, settings.push.height_share)
        write_csv(output.states, states)
    write_csv(output.outcomes, push_outcomes(states, settings, seed))


run(main, snakemake)
