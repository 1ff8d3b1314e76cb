"""Synthetic hip moments of repeated lifts."""

from job import run


def main(input, output, params):
    """Make every trial of the study."""
    from lumbar.settings.plain import typed
    from lumbar.settings.twin import SyntheticLiftingSettings
    from lumbar.twin.hip_moment_recordings import write_trials

    settings = typed(SyntheticLiftingSettings, params.settings)
    write_trials(settings, params.trials, output.recordings, [params.seed, _STREAM], params.gravity)


_STREAM = 3
"""Keeps the trials' random numbers apart from those of the twin's other recordings."""

run(main, snakemake)
