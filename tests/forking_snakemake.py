"""Snakemake whose scripts are forked from one process that has imported their libraries: a second less for every job.

As a program it takes Snakemake's own arguments. The scripts run as they are, each in a process of its own.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import subprocess
import sys
from collections import defaultdict

FORKING = multiprocessing.get_context("forkserver")
IMPORTED_ONCE = [
    "snakemake.script",
    "pandas",
    "pandera.pandas",
    "pydantic",
    "scipy.signal",
    "scipy.integrate",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "fontTools.subset",
    "clarabel",
    "control",
    "jinja2",
    "c3d",
]


def run_script(path: str) -> None:
    """Run a script as Python would when started with its path."""
    sys.argv = [path]
    runpy.run_path(path, run_name="__main__")


def execute_script(script, fname: str, edit: bool = False) -> None:
    """In place of `snakemake.script.PythonScript.execute_script`."""
    from snakemake.benchmark import benchmarked

    process = FORKING.Process(target=run_script, args=(fname,))
    process.start()
    if script.bench_record is None:
        process.join()
    else:
        with benchmarked(process.pid, script.bench_record):
            process.join()
    if process.exitcode:
        raise subprocess.CalledProcessError(process.exitcode, [sys.executable, fname])


async def no_input_sizes(scheduler, jobs) -> None:
    """In place of `JobScheduler.update_input_sizes`, which asks for the size of every input of every waiting job.

    Sizes break ties between jobs that may start; with a library's hundreds of sources as inputs they take half a second a job.
    """
    scheduler._input_sizes = defaultdict(int)


def main() -> None:
    """Start Snakemake as ``python -m snakemake`` does."""
    from snakemake.cli import main as snakemake
    from snakemake.scheduling.job_scheduler import JobScheduler
    from snakemake.script import PythonScript

    sys.path[0] = os.getcwd()  # noqa: PTH109 - as with -m
    FORKING.set_forkserver_preload(IMPORTED_ONCE)
    PythonScript.execute_script = execute_script
    JobScheduler.update_input_sizes = no_input_sizes
    snakemake()


if __name__ == "__main__":
    main()
