"""Synthetic hip moments of repeated lifts."""

from job import run


def main(input, output, params):
    """Make every trial of the study."""
    from lumbar.synthetic.hip_moment_recordings import write_trials

    write_trials(params.settings, params.trials, output.recordings, [params.seed, _STREAM])


_STREAM = 3
"""Keeps the trials' random numbers apart from those of the twin's other recordings."""

run(main, snakemake)
