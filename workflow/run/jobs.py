"""Jobs of a run: their environment, their size on a cluster, and the remains of a killed run."""

import ctypes
import os
import shutil
import signal
import sys
from collections import defaultdict
from collections.abc import Iterable
from math import ceil
from pathlib import Path


def set_job_environment(workflow: Path) -> None:
    """Make the library in a folder importable without installation, and results independent of the number of cores."""
    from lumbar.base.environment import use_one_thread

    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(workflow), os.environ.get("PYTHONPATH")]))
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    use_one_thread()


SNAKEMAKE_MB = 400
"""Memory of the two Snakemake processes of a job on SLURM: 160 MB each for 4 lifts, 195 MB each for 6000."""
MEMORY_HEAD_ROOM = 2
TIME_HEAD_ROOM = 10
"""Factor on the measured time, because recordings may be longer, and processors and file systems slower."""
START_S = 60
"""Time in seconds until a job's work begins, if many jobs read the environment from one file system."""


def job_size(peak_mb: float, seconds: float) -> dict:
    """Return ``mem_mb`` and ``runtime`` (min) of a rule: measured values with head-room, times the number of tries.

    `peak_mb` is the largest ``max_rss`` and `seconds` the longest ``cpu_time`` of the rule's benchmarks.
    """
    memory = SNAKEMAKE_MB + MEMORY_HEAD_ROOM * ceil(peak_mb)
    minutes = ceil((START_S + TIME_HEAD_ROOM * seconds) / 60)
    return {
        "mem_mb": lambda wildcards, attempt: attempt * memory,
        "runtime": lambda wildcards, attempt: attempt * minutes,
    }


def expected_seconds(runtime_min: float | None) -> float:
    """Return the measured seconds behind a rule's ``runtime`` of `job_size`; 0 for a rule without one, which runs nothing."""
    return max((60 * runtime_min - START_S) / TIME_HEAD_ROOM, 0.0) if runtime_min else 0.0


_PR_SET_PDEATHSIG = 1
"""Linux prctl(2): the signal that a process receives when its parent ends."""


def end_with_parent() -> None:
    """Let Linux kill this process when its parent ends. Otherwise it would go on writing next to the jobs of the next call."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def remove_half_written(jobs: Iterable) -> None:
    """Remove the temporary files that a killed run left next to the outputs of these jobs; Snakemake has locked the outputs."""
    from lumbar.base.files import leftover_temp_files

    names = defaultdict(set)
    for job in jobs:
        for path in map(Path, job.output):
            names[path.parent].add(path.name)
    for folder, outputs in names.items():
        for name, left in leftover_temp_files(folder):
            if name in outputs:
                shutil.rmtree(left, ignore_errors=True)
