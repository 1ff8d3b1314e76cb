"""Parsing of HDF5, MATLAB, Excel and C3D files in a child process with limits, which returns numbers and texts.

The child is a new program, independent of the threads of this process. Memory, processor time and the size of the answer are
limited if the system supports it; the elapsed time is always limited. The answer is not trusted: no part is unpickled or run.
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
"""Limits of the child: memory in bytes, with its program and the file's content, and processor time in seconds."""
TIMEOUT_S = 10 * SECONDS
"""Elapsed time in seconds after which the child is ended."""
MAX_ANSWER_BYTES, MAX_ARRAYS = 3 * MAX_FILE_BYTES, 20_000
_ARRAY_KEY = "\0"
"""Key that marks a reference to an array; no name in a file has it."""
_START_COMMAND = (
    "import json, sys; sys.path, request = json.loads(sys.argv[1]); from {} import answer; answer(*request)"
)


def read_in_child(read: Callable[..., Any], source: str | os.PathLike, content: bytes | None = None) -> Any:
    """Return what `read(source)` or `read(source, content)` returns, called in a child process.

    Parameters
    ----------
    read : callable
        Function of a module. Its result may contain None, numbers, texts, lists, dicts with texts as keys, and arrays of
        numbers; tuples are returned as lists.
    source : path
        The file, for messages; `read` opens it unless `content` is given.
    content : bytes, optional
        The file's content.

    Raises
    ------
    InputError
        If `read` raises it, needs more memory or time than allowed, or fails in any other way.
    """
    size = require_file(source) if content is None else len(content)
    large = f"{source}: its {size / 1e6:.2g} MB"
    paths = [str(Path(__file__).parents[2]), *filter(None, sys.path)]  # not the working directory
    call = [read.__module__, read.__name__, str(source), content is not None]
    request = json.dumps([paths, [call, [MEMORY, SECONDS, MAX_ANSWER_BYTES]]])
    command = [sys.executable, "-I", "-S", "-c", _START_COMMAND.format(__name__), request]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with TemporaryFile() as output:
        streams: dict[str, Any] = {"stdout": output, "stderr": subprocess.DEVNULL}
        try:
            status = subprocess.run(
                command, input=content or b"", env={**os.environ, **threads}, timeout=TIMEOUT_S, **streams
            ).returncode
            limit_s = SECONDS if status == -getattr(signal, "SIGXCPU", 256) else None
        except subprocess.TimeoutExpired:
            limit_s = TIMEOUT_S
        if limit_s is not None:
            raise InputError(f"{large} take longer than {limit_s} s to read; save the recording by itself")
        if status:
            reason = signal.Signals(-status).name if status < 0 else status
            raise InputError(f"{source}: broken: its reader ended ({reason}); copy or export it again")
        output.seek(0)
        try:
            kind, value = _load_answer(output)
        except Exception as error:  # an invalid answer causes errors of many kinds
            raise InputError(f"{source}: broken: its reader returned an invalid answer") from error
    if kind == "memory":
        raise InputError(
            f"{large} need more memory than a reader has, {MEMORY / 1e6:.0f} MB at most; save the recording by itself"
        )
    if kind != "value":
        raise InputError(str(value))
    return value


def _load_answer(output) -> list:
    """Return kind and value of an answer."""
    with np.load(output, allow_pickle=False) as archive:
        sizes = [item.file_size for item in archive.zip.infolist()]
        if sum(sizes) > MAX_ANSWER_BYTES or len(sizes) > MAX_ARRAYS + 1:
            raise ValueError("too large")
        *arrays, text = (archive[name] for name in archive.files)
    if any(array.dtype.kind not in "biuf" for array in arrays):
        raise TypeError("no numbers")
    return json.loads(
        text.tobytes(), object_hook=lambda item: arrays[item[_ARRAY_KEY]] if _ARRAY_KEY in item else item
    )


def answer(call: tuple[str, str, str, bool], limits: tuple[int, int, int]) -> None:
    """Run as the child: call a function within limits, and write its result or error to the standard output.

    Parameters
    ----------
    call : tuple
        Module and name of the function, the file, and whether its content is on the standard input.
    limits : tuple of int
        Limits: bytes of memory, seconds of processor time and bytes of the answer.
    """
    module, name, source, has_content = call
    memory, seconds, max_bytes = limits
    with suppress(ImportError, OSError, ValueError):  # Windows has no limits, macOS none of memory
        import resource

        for limit, value in {"CORE": 0, "CPU": seconds, "FSIZE": max_bytes, "AS": memory}.items():
            number = getattr(resource, f"RLIMIT_{limit}")
            current = resource.getrlimit(number)[1]
            hard = value + 1 if current == resource.RLIM_INFINITY else min(current, value + 1)
            resource.setrlimit(number, (min(value, hard), hard))
    arrays: list[np.ndarray] = []

    def to_json(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            raise TypeError(f"no numbers: {type(value).__name__}")
        if len(arrays) >= MAX_ARRAYS:
            raise InputError(f"{source}: more than {MAX_ARRAYS} variables; save the recording by itself")
        arrays.append(value)
        return {_ARRAY_KEY: len(arrays) - 1}

    try:
        read = getattr(import_module(module), name)
        result = read(source, sys.stdin.buffer.read()) if has_content else read(source)
        text = json.dumps(["value", result], default=to_json)
    except Exception as error:  # a broken file causes errors of many kinds
        message = str(error)
        if not isinstance(error, LumbarError):
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{type(error).__name__} ({error}; {Path(last.filename).name}, line {last.lineno})"
            message = f"{source}: broken: its reader stopped at {place}"
        lacks_memory = any(isinstance(e, MemoryError) for e in (error, error.__cause__, error.__context__))
        arrays, text = [], json.dumps(["memory" if lacks_memory else "error", message])
    np.savez(sys.stdout.buffer, *arrays, np.frombuffer(text.encode(), np.uint8))
