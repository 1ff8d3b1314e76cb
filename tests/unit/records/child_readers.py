"""Readers that tests have called in a child process."""

import os
import sys
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError


def all_kinds(source, content):
    """Return all kinds of values."""
    texts = ["é\ud800", None, True, -0.0, float("inf")]
    arrays = {
        "rows": np.arange(12.0).reshape(3, 4)[:, ::2],
        "big": np.arange(5, dtype=">i2"),
        "none": np.zeros((0, 3)),
    }
    return {"array": arrays, "texts": texts, "number": np.float32(2), "pair": (1, 2), "size": len(content)}


def read_path(path):
    return Path(path).read_text()


def refusing(path):
    raise InputError(f"{path}: line 3: force is 'x'; a number is needed")


def exhaust_memory(_):
    return np.ones(10**9)


def hiding_it(path):
    try:
        return exhaust_memory(path)
    except Exception as error:
        raise InputError("broken") from error


def growing(_):
    pieces = []
    while True:
        pieces.append(bytes(10_000_000))


def endless(_):
    while True:
        pass


def sleeping(_):
    import time

    time.sleep(600)


def module_folders(_):
    return sys.path


def endless_answer(_):
    while True:
        sys.stdout.buffer.write(bytes(1_000_000))


def _answer(*arrays, text: bytes):
    np.savez(sys.stdout.buffer, *arrays, np.frombuffer(text, np.uint8))


FORGED = {
    "no archive": lambda: sys.stdout.buffer.write(b"\xff" * 100),
    "pickled": lambda: _answer(np.array([os.getpid, 1], dtype=object), text=b'["value", 1]'),
    "array of texts": lambda: _answer(np.array(["a"]), text=b'["value", {"\\u0000": 0}]'),
    "too few arrays": lambda: _answer(text=b'["value", {"\\u0000": 7}]'),
    "no JSON": lambda: _answer(text=b"[" * 100_000),
    "packed zeros": lambda: np.savez_compressed(sys.stdout.buffer, np.zeros(7_000_000, np.uint8)),
    "no answer": lambda: None,
}
"""Writers of forged answers by name."""
FAILING = {
    "crash": os.abort,
    "mistake": lambda: {}["x"],
    "objects": lambda: np.array([{"a": 1}], dtype=object),
}


def forge_answer(path):
    """Write the forged answer that the file names, and end."""
    FORGED[Path(path).read_text()]()
    sys.stdout.flush()
    os._exit(0)


def fail(path):
    """Fail in the way that the file names."""
    return FAILING[Path(path).read_text()]()
