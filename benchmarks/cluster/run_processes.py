"""The processes of a run of the workflow, on this machine or of a SLURM on it: what each is, and what is left of them."""

from __future__ import annotations

import os
import random
import re
from collections.abc import Iterable
from pathlib import Path

import psutil

SNAKEMAKE = "Snakemake"
EVERYTHING = "all of them"
NAMES = {
    "multiprocessing.resource_tracker": "resource tracker",
    "ziglang": "compiler",
    "/zig ": "compiler",
    ".snakemake/scripts": "job",
    "slurmstepd": "slurmstepd",
    "srun": "srun",
    "slurm_script": "batch script",
    "-m snakemake": "Snakemake of a job",
}
"""Kinds of processes, by what their command line contains."""


def living(numbers: Iterable[int]) -> list[psutil.Process]:
    """Those of these processes that have not ended."""
    found = []
    for number in numbers:
        try:
            process = psutil.Process(number)
            if process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.NoSuchProcess:
            continue
    return found


def of_session(leader: int) -> list[psutil.Process]:
    """Living processes of a session, which its own end does not end."""
    members = []
    for number in psutil.pids():
        try:
            members += [number] * (os.getsid(number) == leader)
        except ProcessLookupError:
            continue
    return living(members)


def kind(process: psutil.Process, leader: int) -> str:
    """What a process is to the run that `leader` began.

    Raises
    ------
    psutil.NoSuchProcess
        It has ended.
    """
    if process.pid == leader:
        return SNAKEMAKE
    command = " ".join(process.cmdline())
    if "multiprocessing.forkserver" in command:  # what it forks has its command line
        return "fork server" if process.ppid() == leader else "job"
    return next((name for word, name in NAMES.items() if word in command), process.name())


def work(process: psutil.Process) -> str:
    """Name of the job whose log a process holds open; empty where none."""
    folder = Path("/proc", str(process.pid), "fd")
    try:
        targets = [str(entry.readlink()) for entry in folder.iterdir()]
    except FileNotFoundError:  # it has ended, or closed a file
        return ""
    return next((log[1] for log in (re.search(r"/logs/(.+)\.log$", name) for name in targets) if log), "")


def drawn(
    processes: list[psutil.Process], leader: int, draw: random.Random
) -> tuple[str, list[psutil.Process]]:
    """Draw a kind of the processes there are, then one of that kind; or all, as when a machine loses its power.

    Returns
    -------
    str
        What is drawn; empty where all have ended.
    list of psutil.Process
    """
    kinds: dict[str, list[psutil.Process]] = {}
    for process in processes:
        try:
            kinds.setdefault(kind(process, leader), []).append(process)
        except psutil.NoSuchProcess:
            continue
    if not kinds:
        return "", []
    chosen = draw.choice([*sorted(kinds), EVERYTHING])
    if chosen == EVERYTHING:
        return chosen, [process for some in kinds.values() for process in some]
    process = draw.choice(sorted(kinds[chosen], key=lambda item: item.pid))
    return " ".join(filter(None, [chosen, work(process)])), [process]
