"""HDF5, MATLAB, Excel and C3D files are parsed in a child process with limits, which answers in numbers and texts.

The child is a new program, so that threads of this process do not matter. Where the system knows limits of resources, it ends at
those of memory, of a processor's time and of its answer's size; everywhere it ends after a while. Its answer is trusted no more
than the file: nothing in it is unpickled or run.
"""

import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import MAX_FILE_BYTES, require_file

MEMORY, SECONDS = 1_000_000_000, 20
"""Bytes that the child may take, its program and the file's content among them, and seconds of a processor."""
PATIENCE_S = 10 * SECONDS
"""After which a child that does nothing is ended."""
LARGEST_ANSWER, MOST_ARRAYS = 3 * MAX_FILE_BYTES, 20_000
_ARRAY = "\0"
"""Key that stands for an array: no name in a file holds it."""
_START = "import json, sys; sys.path, asked = json.loads(sys.argv[1]); from {} import answer; answer(*asked)"


def read_in_child(read: Callable[..., Any], source: str | os.PathLike, content: bytes | None = None) -> Any:
    """Return what `read(source)` or `read(source, content)` returns, called in a child process.

    Parameters
    ----------
    read : callable
        Function of a module. What it returns is made of None, numbers, texts, lists, dicts with texts as keys, and arrays of
        numbers; a tuple comes back as a list.
    source : path
        The file, for messages; `read` opens it where its content is not given.

    Raises
    ------
    InputError
        What `read` raises; where it takes more memory or time than it may, or fails in any other way.
    """
    size = require_file(source) if content is None else len(content)
    large = f"{source}: its {size / 1e6:.2g} MB"
    paths = [str(Path(__file__).parents[2]), *filter(None, sys.path)]  # nothing that lies where one works
    called = [read.__module__, read.__name__, str(source), content is not None]
    asked = json.dumps([paths, [*called, MEMORY, SECONDS, LARGEST_ANSWER]])
    command = [sys.executable, "-I", "-S", "-c", _START.format(__name__), asked]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with TemporaryFile() as answered:
        streams: dict[str, Any] = {"stdout": answered, "stderr": subprocess.DEVNULL}
        try:
            status = subprocess.run(
                command, input=content or b"", env={**os.environ, **threads}, timeout=PATIENCE_S, **streams
            ).returncode
        except subprocess.TimeoutExpired:
            status = None
        if status is None or status == -getattr(signal, "SIGXCPU", 256):
            raise InputError(f"{large} take longer than {SECONDS} s to read; save the recording by itself")
        if status:
            ended = signal.Signals(-status).name if status < 0 else status
            raise InputError(f"{source}: broken: its reader ended ({ended}); copy or export it again")
        answered.seek(0)
        try:
            kind, value = _unpacked(answered)
        except Exception as error:  # what is no answer leads to errors of many kinds
            raise InputError(
                f"{source}: broken: its reader answers what no file of its kind holds"
            ) from error
    if kind == "memory":
        raise InputError(
            f"{large} need more memory than a reader has, {MEMORY / 1e6:.0f} MB at most; save the recording by itself"
        )
    if kind != "value":
        raise InputError(str(value))
    return value


def _unpacked(answered) -> list:
    """Kind and value of an answer."""
    with np.load(answered, allow_pickle=False) as found:
        sizes = [item.file_size for item in found.zip.infolist()]
        if sum(sizes) > LARGEST_ANSWER or len(sizes) > MOST_ARRAYS + 1:
            raise ValueError("too large")
        *arrays, told = (found[name] for name in found.files)
    if any(array.dtype.kind not in "biuf" for array in arrays):
        raise TypeError("no numbers")
    return json.loads(
        told.tobytes(), object_hook=lambda item: arrays[item[_ARRAY]] if _ARRAY in item else item
    )


def answer(module: str, name: str, source: str, given: bool, memory: int, seconds: int, largest: int) -> None:
    """Be the child: call a function within limits, and write what it returns or raises to the standard output."""
    with suppress(ImportError, OSError, ValueError):  # Windows knows no limits, macOS none of memory
        import resource

        for limit, most in {"CORE": 0, "CPU": seconds, "FSIZE": largest, "AS": memory}.items():
            number = getattr(resource, f"RLIMIT_{limit}")
            own = resource.getrlimit(number)[1]
            hard = most + 1 if own == resource.RLIM_INFINITY else min(own, most + 1)
            resource.setrlimit(number, (min(most, hard), hard))
    arrays: list[np.ndarray] = []

    def plain(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            raise TypeError(f"no numbers: {type(value).__name__}")
        if len(arrays) >= MOST_ARRAYS:
            raise InputError(f"{source}: more than {MOST_ARRAYS} variables; save the recording by itself")
        arrays.append(value)
        return {_ARRAY: len(arrays) - 1}

    try:
        read = getattr(import_module(module), name)
        value = read(source, sys.stdin.buffer.read()) if given else read(source)
        told = json.dumps(["value", value], default=plain)
    except Exception as error:  # a file may lead its reader to errors of many kinds
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{type(error).__name__} ({error}; {Path(last.filename).name}, line {last.lineno})"
        words = f"{source}: broken: its reader stopped at {place}"
        words = str(error) if isinstance(error, LumbarError) else words
        lacks = any(isinstance(e, MemoryError) for e in (error, error.__cause__, error.__context__))
        arrays, told = [], json.dumps(["memory" if lacks else "error", words])
    np.savez(sys.stdout.buffer, *arrays, np.frombuffer(told.encode(), np.uint8))
