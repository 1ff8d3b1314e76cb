"""The processes of a run of the workflow on this machine: what each is, and what is left of them."""

from __future__ import annotations

import os
import random
import re
from pathlib import Path

import psutil

SNAKEMAKE = "Snakemake"
EVERYTHING = "all of them"
NAMES = {
    "multiprocessing.resource_tracker": "resource tracker",
    "ziglang": "compiler",
    "zig": "compiler",
    "snakemake": "Snakemake of a job",
    "lumbar.fmu": "player of an FMU",
}
"""Kinds of processes, by what their command line contains."""


def of_session(leader: int) -> list[psutil.Process]:
    """Living processes of a session, which its own end does not end."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found


def kind(process: psutil.Process, leader: int) -> str:
    """What a process is to the run.

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
    for entry in folder.iterdir() if folder.is_dir() else ():
        try:
            log = re.search(r"/logs/(.+)\.log$", str(entry.readlink()))
        except FileNotFoundError:
            continue
        if log:
            return log[1]
    return ""


def victims(leader: int, draw: random.Random) -> tuple[str, list[psutil.Process]]:
    """Draw a kind of the processes there are, then one of that kind; or all, as when a machine loses its power.

    Returns
    -------
    str
        What is drawn.
    list of psutil.Process
    """
    kinds: dict[str, list[psutil.Process]] = {}
    for process in of_session(leader):
        try:
            kinds.setdefault(kind(process, leader), []).append(process)
        except psutil.NoSuchProcess:
            continue
    if not kinds:
        return "", []
    chosen = draw.choice([*sorted(kinds), EVERYTHING])
    if chosen == EVERYTHING:
        return chosen, [process for processes in kinds.values() for process in processes]
    process = draw.choice(sorted(kinds[chosen], key=lambda item: item.pid))
    return " ".join(filter(None, [chosen, work(process)])), [process]
