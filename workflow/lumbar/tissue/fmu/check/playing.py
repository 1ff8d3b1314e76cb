"""Playing libraries in a process that may crash or hang, one after the other while nothing is wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.check import behaviour
from lumbar.tissue.fmu.check.behaviour import SECONDS, result_file


@contextmanager
def waiting_player() -> Iterator[subprocess.Popen]:
    """A process that makes itself ready to play while others prepare what; it ends with the block."""
    # The scripts of the workflow find this package by sys.path, which a new process does not inherit.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command, pipe = [sys.executable, "-m", behaviour.__name__], subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment
    ) as player:
        try:
            yield player
        finally:
            player.kill()


def play_libraries(
    jobs: Sequence[tuple[Path, ...]], work: Path, waiting: subprocess.Popen | None = None
) -> list[list[str]]:
    """Return the problems that the libraries of these FMUs show.

    Libraries share a process: starting one costs more than playing a library. A library with which something is wrong ends it,
    and one that failed after others is played again in a process of its own: what the others did cannot be laid at its door.

    Parameters
    ----------
    jobs : sequence of tuple of Path
        Folder of an unzipped FMU; with a second one the two are compared.
    work : Path
        Folder for what the processes find.
    waiting : subprocess.Popen, optional
        A player that nobody has asked yet.

    Returns
    -------
    list of list of str
        One sentence per problem, for each job.

    Raises
    ------
    InputError
        The check itself fails.
    """
    found: dict[int, list[str]] = {}
    for number in range(len(jobs)):
        result_file(work, number).unlink(missing_ok=True)
    while rest := [number for number in range(len(jobs)) if number not in found]:
        asked = {number: [str(folder) for folder in jobs[number]] for number in rest}
        with nullcontext(waiting) if waiting else waiting_player() as player:
            _, said = player.communicate(json.dumps([str(work), asked]))
        waiting = None
        finished = [number for number in rest if result_file(work, number).is_file()]
        for number in finished:
            found[number] = json.loads(result_file(work, number).read_text(encoding="utf-8"))
        if not finished:
            found[rest[0]] = [_failure(player.returncode, said)]
    return [found[number] for number in range(len(jobs))]


def _failure(status: int, said: str) -> str:
    """Why a process ended before its first library had been played."""
    if status < 0:
        if -status == signal.SIGKILL:  # which no library sends to itself
            raise InputError("the check was killed from outside, as where memory runs out; check again")
        return f"the library crashes with signal {-status}; it must play"
    if status and "Timeout (" in said:
        return f"the library does not come back within {SECONDS} s; it must play a push in a second"
    if status == 0:
        return "the library ends the program that plays it; it must play"
    raise InputError(f"the check itself failed:\n{said[-2000:]}")
