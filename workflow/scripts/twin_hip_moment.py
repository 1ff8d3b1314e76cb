"""Synthetic hip moments of repeated lifts."""

from job import run

from lumbar.settings.twin import SyntheticLiftingSettings


def main(input, output, settings: SyntheticLiftingSettings, trials: list[str], gravity: float, seed: int):
    """Make every trial of the study."""
    from lumbar.twin.lifting_recordings import write_trials

    write_trials(settings, trials, output.recordings, [seed, _STREAM], gravity)


_STREAM = 3
"""Keeps the trials' random numbers apart from those of the twin's other recordings."""

run(main, snakemake)
