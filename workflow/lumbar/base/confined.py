"""What a stranger wrote is parsed in a child process that can do nothing but parse it.

The child is a fork, warm and without a program of its own, of this process or, where that has threads, of a template
(`lumbar.base.child_template`). It has no open file but the pipe of its answer, may read (`lumbar.base.landlock`) the one file and
Python's libraries, and ends at its limits of memory and time. Its answer is trusted no more than the file: numbers, texts and the
classes that are expected, nothing that is unpickled.

Systems without Landlock lack the limit of files, those without ``/proc`` that of memory.
"""

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lumbar.base import child
from lumbar.base.child_answer import unpacked
from lumbar.base.child_template import asked_of_template
from lumbar.base.errors import InputError, LumbarError

SHORT = 5_000_000
"""Bytes of plain text that take less than these limits, whatever they say."""


def confined(
    parse: Callable[[], Any],
    source: str | os.PathLike,
    size: int,
    kinds: tuple[type, ...] = (),
    *,
    opens: bool = True,
    harmless: bool = False,
) -> Any:
    """Return what a function returns that parses a file, called in a child process.

    What it needs of other modules should be imported before: the child cannot keep it for the next.

    Parameters
    ----------
    parse : callable
        Of a module, or a `functools.partial` of one, that can be pickled. Its result is made of None, numbers, texts, lists,
        tuples, dicts, NumPy's arrays and the dataclasses of `kinds`.
    source : path
        The file, for messages.
    size : int
        Its bytes, likewise.
    opens : bool
        Whether the child opens it: False where `parse` holds its content.
    harmless : bool
        Whether it is plain text that takes memory and time in proportion to its size: a short one is parsed in this process.

    Raises
    ------
    InputError
        What `parse` raises; where it takes more memory or time than `lumbar.base.child` allows, or fails in any other way.
    """
    if harmless and size <= SHORT:
        return parse()
    kind, value = answered(parse, [Path(source)] if opens else [], kinds)
    large = f"{source}: its {size / 1e6:.2g} MB"
    if kind == "value":
        return value
    if kind == "late":
        raise InputError(f"{large} take longer than {child.SECONDS} s to read; save the recording by itself")
    if kind == "ended":
        raise InputError(f"{source}: broken: its reader ended ({value})")
    if kind == "forged":
        raise InputError(f"{source}: broken: its reader answers what no file of its kind holds") from value
    if kind == "memory":
        raise InputError(
            f"{large} need more memory than a reader has, {child.MEMORY / 1e6:.0f} MB at most; save the recording by itself"
        )
    if kind == "defect":
        raise InputError(f"{source}: broken: its reader stopped at {value[0]}") from RuntimeError(value[1])
    raise error_named(kind)(value)


def answered(parse: Callable[[], Any], opened: list[Path], kinds: tuple[type, ...] = ()) -> tuple[str, Any]:
    """What comes of a function in a child process, which may read these files and folders alone: kind of the answer, and it.

    The kinds are "value"; the name of a `LumbarError`, with its words; "defect", an error with its place and its traceback;
    "memory"; "late"; "ended", with the name of the signal or the status; and "forged", with what is wrong with the answer.
    """
    answer, late, status = (asked_of_template if _has_threads() else child.asked_of_fork)(parse, opened)
    if answer is None:
        ended = signal.Signals(os.WTERMSIG(status)) if os.WIFSIGNALED(status) else None
        if ended is signal.SIGXCPU or late:
            return "late", None
        return "ended", ended.name if ended else status
    try:
        return unpacked(answer, {item.__name__: item for item in kinds})
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        return "forged", error


def error_named(name: str) -> type[LumbarError]:
    """The error that a child answers by its name."""

    def below(kind: type[LumbarError]) -> list[type[LumbarError]]:
        return [kind, *(found for item in kind.__subclasses__() for found in below(item))]

    return next((item for item in below(LumbarError) if item.__name__ == name), InputError)


def _has_threads() -> bool:
    """Whether this process computes elsewhere too, which a fork would break: OpenBLAS ends its threads before one."""
    return threading.active_count() > 1
