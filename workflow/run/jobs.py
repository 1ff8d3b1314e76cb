"""Jobs of a run: the environment they inherit, what they ask of a cluster, how they start, and what a killed run leaves."""

import atexit
import ctypes
import os
import shutil
import signal
import sys
import threading
import time
from collections import defaultdict
from contextlib import suppress
from math import ceil
from pathlib import Path


def set_job_environment(workflow: Path) -> None:
    """Make the library in a folder importable without installation, and results the same bytes for any number of cores."""
    from lumbar.base.environment import use_one_thread

    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(workflow), os.environ.get("PYTHONPATH")]))
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    use_one_thread()


SNAKEMAKE_MB = 400
"""Of the two Snakemakes that stay in memory beside a job on SLURM: 160 MB each at 4 lifts, 195 MB at 6000."""
MEMORY_HEAD_ROOM = 2
TIME_HEAD_ROOM = 10
"""Recordings may be longer than those measured, processors and file systems slower."""
START_S = 60
"""Until a job's own work begins, where many jobs read the environment from one file system."""


def job_size(peak_mb: float, seconds: float) -> dict:
    """Resources of a rule, ``mem_mb`` and ``runtime`` (min): what was measured with head-room, times the number of tries.

    `peak_mb` is the largest ``max_rss`` and `seconds` the longest ``cpu_time`` of the rule's benchmarks.
    """
    memory = SNAKEMAKE_MB + MEMORY_HEAD_ROOM * ceil(peak_mb)
    minutes = ceil((START_S + TIME_HEAD_ROOM * seconds) / 60)
    return {
        "mem_mb": lambda wildcards, attempt: attempt * memory,
        "runtime": lambda wildcards, attempt: attempt * minutes,
    }


SNAKEMAKES_OWN = (100, 1)
"""Jobs and seconds, where nobody asks for another limit; a study has fewer than a hundred jobs."""


def lift_limit(scheduler) -> None:
    """Start jobs as soon as a core is free, unless the user set another limit than Snakemake's own.

    With a limit, every job that ends begins a chain of looks at all inputs of all waiting jobs, once a second until the run
    ends (`JobScheduler._schedule_reevalutation`): after twenty jobs they take a tenth of a core, and the end waits for the last.
    """
    limit = scheduler.workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == SNAKEMAKES_OWN:
        scheduler.job_rate_limiter = None


_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl(2): the signal that a process gets when its parent ends."""


def end_with_parent() -> None:
    """Let this process be killed when its parent ends, on Linux: it would go on writing beside the next call's jobs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


GRACE_S = 1.0
"""In which a job that is told to end has removed what it had begun to write."""


def end_when_told(workflow) -> None:
    """Let SIGTERM end a run on this machine with its jobs, as Ctrl-C ends one in a terminal.

    Snakemake would wait for the jobs that run, for minutes; and what a shell starts in the background ignores Ctrl-C.
    """

    def end(*_) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        threading.Thread(target=_end_jobs, daemon=True).start()
        atexit.register(_end_at_once)
        raise KeyboardInterrupt

    if workflow.local_exec:
        signal.signal(signal.SIGTERM, end)


def _end_at_once() -> None:
    """End as Snakemake does after Ctrl-C, but for taking all its objects apart, which takes three times as long as the rest."""
    atexit.unregister(_end_at_once)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(1)


def _end_jobs() -> None:
    """Tell what this process has started to end, and kill what does not, until it ends itself: a job may just be starting."""
    from multiprocessing import forkserver, resource_tracker

    import psutil

    servers = {forkserver._forkserver._forkserver_pid, resource_tracker._resource_tracker._pid}
    told: dict[int, float] = {}
    while True:
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                if process.pid in servers:  # they end with this process, and their jobs with them
                    continue
                if process.pid not in told:
                    told[process.pid] = time.monotonic()
                    process.terminate()
                elif time.monotonic() > told[process.pid] + GRACE_S:
                    process.kill()
        time.sleep(0.05)


def remove_half_written(workflow) -> None:
    """Remove what lies half written beside the outputs that the run makes: they are locked, so nobody else is writing there."""
    from lumbar.base.files import half_written

    made = defaultdict(set)
    for job in workflow.dag.needrun_jobs():
        for path in map(Path, job.output):
            made[path.parent].add(path.name)
    for folder, names in made.items():
        for name, left in half_written(folder):
            if name in names:
                shutil.rmtree(left, ignore_errors=True)
