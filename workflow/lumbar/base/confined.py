"""What a stranger wrote is parsed in a child process that can do nothing but parse it.

The child is a fork of this process, warm and without a program of its own: it has no open file but the pipe of its answer,
may read (`lumbar.base.landlock`) the one file and Python's libraries, and ends at its limits of memory and time. Its answer
is trusted no more than the file: numbers, texts and the classes that are expected, nothing that is unpickled.

Systems without Landlock lack the limit of files, those without ``/proc`` that of memory.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import resource
import select
import signal
import struct
import sys
import sysconfig
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.base import landlock
from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import LARGEST_FILE, LARGEST_JSON

MEMORY, SECONDS = 500_000_000, 20
"""Bytes beyond what this process holds, and seconds of a processor, that parsing one file may take."""
SHORT = 5_000_000
"""Bytes of plain text that take less than these limits, whatever they say."""
_PLACES = threading.BoundedSemaphore(2)
"""Children at a time: a page has many visitors, a machine less memory."""
_PATIENCE_S = 10 * SECONDS
"""After which a child that does nothing is given up."""
_LARGEST_TEXT, _LARGEST_ANSWER = LARGEST_JSON, 2 * LARGEST_FILE
"""Bytes of an answer without and with its arrays."""
_LIBRARIES = {Path(sysconfig.get_path(kind)) for kind in ("stdlib", "platstdlib", "purelib", "platlib")}
_LIBRARIES |= {Path(__file__).parents[1]}
_DIE_WITH_PARENT = 1


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
        Its result is made of None, numbers, texts, lists, tuples, dicts, NumPy's arrays and the dataclasses of `kinds`.
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
        What `parse` raises; where it takes more than `MEMORY` or `SECONDS`; where it fails in any other way.
    """
    if harmless and size <= SHORT:
        return parse()
    with _PLACES:
        answer, late, status = _asked(parse, [Path(source)] if opens else [])
    large = f"{source}: its {size / 1e6:.2g} MB"
    if answer is None:
        ended = signal.Signals(os.WTERMSIG(status)) if os.WIFSIGNALED(status) else None
        if ended is signal.SIGXCPU or late:
            raise InputError(f"{large} take longer than {SECONDS} s to read; save the recording by itself")
        raise InputError(f"{source}: broken: its reader ended ({ended.name if ended else status})")
    try:
        kind, value = _unpacked(answer, {item.__name__: item for item in kinds})
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(f"{source}: broken: its reader answers what no file of its kind holds") from error
    if kind == "value":
        return value
    if kind == "memory":
        raise InputError(
            f"{large} need more than {MEMORY / 1e6:.0f} MB of memory to read; save the recording by itself"
        )
    if kind == "defect":
        raise InputError(f"{source}: broken: its reader stopped at {value[0]}") from RuntimeError(value[1])
    raise next((item for item in _errors(LumbarError) if item.__name__ == kind), InputError)(value)


def _errors(kind: type[LumbarError]) -> list[type[LumbarError]]:
    return [kind, *(found for item in kind.__subclasses__() for found in _errors(item))]


def _asked(parse: Callable[[], Any], opened: list[Path]) -> tuple[bytearray | None, bool, int]:
    """What a child answers, as of `_received`, and its status."""
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        _answer(parse, theirs, opened)
    os.close(theirs)
    try:
        answer, late = _received(ours)
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


def _received(pipe: int) -> tuple[bytearray | None, bool]:
    """What the child wrote, None where that is not whole; and whether it was waited for too long."""
    answer, ends = bytearray(), time.monotonic() + _PATIENCE_S
    waiting = select.poll()
    waiting.register(pipe, select.POLLIN)
    while waiting.poll(max(ends - time.monotonic(), 0) * 1e3):
        piece = os.read(pipe, 1 << 20)
        answer += piece
        if not piece or len(answer) > _LARGEST_ANSWER + _LARGEST_TEXT:
            break
    else:
        return None, True
    whole = len(answer) >= 16 and sum(struct.unpack_from("=QQ", answer)) + 16 == len(answer)
    return (answer if whole else None), False


def _answer(parse: Callable[[], Any], pipe: int, opened: list[Path]) -> None:
    """Write to the pipe what the function returns or raises; this process ends here."""
    try:
        _confine(pipe, opened)
        try:
            answer = _packed("value", parse())
        except LumbarError as error:
            memory = isinstance(error.__cause__ or error.__context__, MemoryError)
            answer = _packed(*(("memory", "") if memory else (type(error).__name__, str(error))))
        except MemoryError:
            answer = _packed("memory", "")
        except Exception as error:  # a file may lead its reader to errors of many kinds
            last = traceback.extract_tb(error.__traceback__)[-1]
            told = f"{type(error).__name__} ({error}; {Path(last.filename).name}, line {last.lineno})"
            answer = _packed("defect", (told, traceback.format_exc()))
        with open(pipe, "wb") as stream:
            for part in answer:
                stream.write(part)
    finally:
        os._exit(0)


def _confine(pipe: int, opened: list[Path]) -> None:
    """Close and give up all that a parser does not need; limit the rest."""
    gc.disable()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPROF, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nowhere, stream)
    os.closerange(3, pipe)
    os.closerange(pipe + 1, os.sysconf("SC_OPEN_MAX"))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    with contextlib.suppress(FileNotFoundError):  # no /proc
        held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, held + MEMORY))
    landlock.give_up_files([*opened, *filter(Path.exists, _LIBRARIES)])


def _packed(kind: str, value: Any) -> list[bytes | memoryview]:
    """Sizes of the text and of the arrays, the text, and the arrays, each from a multiple of eight on."""
    arrays: list[np.ndarray] = []
    plain = _plain(value, arrays)
    described, place = [], 0
    for array in arrays:
        described.append([array.dtype.str, array.shape, place])
        place += array.nbytes + -array.nbytes % 8
    text = json.dumps([kind, plain, described]).encode()
    text += b" " * (-len(text) % 8)
    parts: list[bytes | memoryview] = [struct.pack("=QQ", len(text), place), text]
    for array in arrays:
        parts += [memoryview(array.reshape(-1).view(np.uint8)), b"\0" * (-array.nbytes % 8)]
    return parts


def _plain(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as JSON has it, a list as such and anything else that holds values as a dict of one key."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"an array of {value.dtype}")
        arrays.append(np.asarray(value, order="C"))
        return {"array": len(arrays) - 1}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, range):
        return {"range": [value.start, value.stop]}
    if isinstance(value, tuple):
        return {"tuple": [_plain(item, arrays) for item in value]}
    if isinstance(value, list):
        return [_plain(item, arrays) for item in value]
    if isinstance(value, dict):
        return {"dict": [[_plain(key, arrays), _plain(item, arrays)] for key, item in value.items()]}
    if is_dataclass(value):
        own = {item.name: _plain(getattr(value, item.name), arrays) for item in fields(value)}
        return {type(value).__name__: own}
    return value


def _unpacked(answer: bytearray, kinds: dict[str, type]) -> tuple[str, Any]:
    """Kind and value of an answer whose sizes are those that it states."""
    size = struct.unpack_from("=Q", answer)[0]
    if size > _LARGEST_TEXT:
        return "memory", ""
    kind, plain, described = json.loads(answer[16 : 16 + size])
    arrays = []
    for form, shape, place in described:
        dtype = np.dtype(str(form))
        if dtype.kind not in "biuf":
            raise TypeError(f"an array of {dtype}")
        count = int(np.prod(shape, dtype=int))
        arrays.append(np.frombuffer(answer, dtype, count, 16 + size + int(place)).reshape(shape))

    def made(value: Any) -> Any:
        if isinstance(value, list):
            return [made(item) for item in value]
        if not isinstance(value, dict):
            return value
        [(name, held)] = value.items()
        if name == "array":
            return arrays[held]
        if name == "range":
            return range(*held)
        if name == "tuple":
            return tuple(map(made, held))
        if name == "dict":
            return {made(key): made(item) for key, item in held}
        return kinds[name](**{key: made(item) for key, item in held.items()})

    return kind, made(plain)
