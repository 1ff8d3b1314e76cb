"""A child process that parses one file: what it may, and where it ends."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import select
import signal
import sys
import sysconfig
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lumbar.base import landlock
from lumbar.base.child_answer import LARGEST_ANSWER, is_whole, packed
from lumbar.base.errors import LumbarError
from lumbar.base.files import LARGEST_FILE

MEMORY, LEAST, SECONDS = 500_000_000, 250_000_000, 20
"""Bytes of the whole process, of it for the file at least, however much it holds, and seconds of a processor."""
PATIENCE_S = 10 * SECONDS
"""After which a child that does nothing is given up."""
_LIBRARIES = {Path(sysconfig.get_path(kind)) for kind in ("stdlib", "platstdlib", "purelib", "platlib")}
_LIBRARIES |= {Path(__file__).parents[1]}
_DIE_WITH_PARENT = 1


def asked_of_fork(parse: Callable[[], Any], opened: list[Path]) -> tuple[bytearray | None, bool, int]:
    """What a child answers, as of `received`, and its status."""
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        answer_and_end(lambda: (parse, theirs), theirs, opened)
    os.close(theirs)
    try:
        answer, late = received(ours)
    finally:
        os.close(ours)
        status = _ended(child)
    return answer, late, status


def _ended(child: int) -> int:
    """Status of a child, which is ended where it has not."""
    with contextlib.suppress(ProcessLookupError, ChildProcessError):  # where the system collects them itself
        os.kill(child, signal.SIGKILL)
        return os.waitpid(child, 0)[1]
    return 0


def received(pipe: int) -> tuple[bytearray | None, bool]:
    """What the child wrote, None where that is not whole; and whether it was waited for too long."""
    answer, ends = bytearray(), time.monotonic() + PATIENCE_S
    waiting = select.poll()
    waiting.register(pipe, select.POLLIN)
    while waiting.poll(max(ends - time.monotonic(), 0) * 1e3):
        piece = os.read(pipe, 1 << 20)
        answer += piece
        if not piece or len(answer) > LARGEST_ANSWER:
            break
    else:
        return None, True
    return (answer if is_whole(answer) else None), False


def answer_and_end(asked: Callable[[], tuple[Callable[[], Any], int]], kept: int, opened: list[Path]) -> None:
    """Confine this process, then ask for a function and a pipe, and write there what it returns or raises; it ends here.

    All that stays open is the file `kept`.
    """
    try:
        memory = _confine(kept, opened)
        parse, pipe = asked()
        _limit_memory(memory)
        answer = None
        with contextlib.suppress(MemoryError):  # after which what the reader held is free
            answer = _outcome(parse)
        answer = answer or packed("memory", "")
        with os.fdopen(pipe, "wb") as stream:
            for part in answer:
                stream.write(part)
    finally:
        os._exit(0)


def _outcome(parse: Callable[[], Any]) -> list[bytes | memoryview]:
    """The answer: a value, an error for the user, or what went wrong in the reader."""
    try:
        return packed("value", parse())
    except MemoryError:
        raise
    except LumbarError as error:
        if isinstance(error.__cause__ or error.__context__, MemoryError):
            raise MemoryError from error
        return packed(type(error).__name__, str(error))
    except Exception as error:  # a file may lead its reader to errors of many kinds
        last = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__} ({error}; {Path(last.filename).name}, line {last.lineno})"
        return packed("defect", (told, traceback.format_exc()))


def _confine(kept: int, opened: list[Path]) -> int | None:
    """Give up all that a parser does not need, limit the rest; an open file that tells its memory, where there is one."""
    gc.disable()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPROF, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nowhere, stream)
    os.closerange(3, kept)
    os.closerange(kept + 1, os.sysconf("SC_OPEN_MAX"))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    memory = None
    with contextlib.suppress(FileNotFoundError):  # no /proc
        memory = os.open("/proc/self/statm", os.O_RDONLY)
    landlock.give_up_files([*opened, *filter(Path.exists, _LIBRARIES)])
    return memory


def _limit_memory(told: int | None) -> None:
    """Limit what this process may take besides what it holds, a file's content among it."""
    if told is None:
        return
    held, resident = (int(count) * resource.getpagesize() for count in os.read(told, 200).split()[:2])
    os.close(told)
    most = held + max(MEMORY - resident, LEAST)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
