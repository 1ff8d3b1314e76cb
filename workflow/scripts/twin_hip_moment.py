"""Synthetic hip moments of repeated lifts."""

from job import run

from lumbar.settings.twin import SyntheticLiftingSettings


def main(input, output, settings: SyntheticLiftingSettings, trials: list[str], gravity: float, seed: int):
    """Make the hip moment of every trial of the study."""
    from lumbar.twin.lifting_recordings import write_trials

    write_trials(settings, trials, output.recordings, [seed, _RANDOM_STREAM], gravity)


_RANDOM_STREAM = 3
"""Random stream of these trials, different from the streams of the twin's other recordings."""

run(main, snakemake)
