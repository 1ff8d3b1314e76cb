"""Memory and time that a job asks of a cluster, from what its rule was measured to need; a run on one machine heeds neither."""

from __future__ import annotations

from math import ceil

SNAKEMAKE_MB = 400
"""Of the two Snakemakes that stay in memory beside a job on SLURM: 160 MB each at 4 lifts, 195 MB at 6000."""
MEMORY_HEAD_ROOM = 2
TIME_HEAD_ROOM = 10
"""Recordings may be longer than those measured, processors and file systems slower."""
START_S = 60
"""Until a job's own work begins, where many jobs read the environment from one file system."""


def job_size(peak_mb: float, seconds: float) -> dict:
    """Resources of a rule: what was measured with head-room, as many times as the job was tried.

    Parameters
    ----------
    peak_mb : float
        Largest resident memory of the rule's jobs (``max_rss`` of their benchmarks).
    seconds : float
        Longest processor time (``cpu_time``).

    Returns
    -------
    dict
        ``mem_mb`` and ``runtime`` (min), for the rule's ``resources:``.
    """
    memory = SNAKEMAKE_MB + MEMORY_HEAD_ROOM * ceil(peak_mb)
    minutes = ceil((START_S + TIME_HEAD_ROOM * seconds) / 60)
    return {
        "mem_mb": lambda wildcards, attempt: attempt * memory,
        "runtime": lambda wildcards, attempt: attempt * minutes,
    }
