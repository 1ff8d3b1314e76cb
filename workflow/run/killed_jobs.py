"""Jobs whose Snakemake is killed: they end with it, and the next run removes what they had half written."""

from __future__ import annotations

import ctypes
import shutil
import signal
import sys
from collections import defaultdict
from pathlib import Path

_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl(2): the signal that a process gets when its parent ends."""


def end_with_parent() -> None:
    """Let this process be killed when its parent ends, on Linux: it would go on writing beside the next call's jobs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def remove_half_written(workflow) -> None:
    """Remove what lies half written beside the outputs that the run makes: they are locked, so nobody else is writing there.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        With its graph of jobs.
    """
    from lumbar.base.files import half_written

    made = defaultdict(set)
    for job in workflow.dag.needrun_jobs():
        for path in map(Path, job.output):
            made[path.parent].add(path.name)
    for folder, names in made.items():
        for name, left in half_written(folder):
            if name in names:
                shutil.rmtree(left, ignore_errors=True)
