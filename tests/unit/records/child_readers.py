"""Readers that tests have called in a child process."""

import os
import sys
import zipfile
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError


def all_kinds(source, content):
    """What a reader may return."""
    texts = ["é\ud800", None, True, -0.0, float("inf")]
    arrays = {
        "rows": np.arange(12.0).reshape(3, 4)[:, ::2],
        "big": np.arange(5, dtype=">i2"),
        "none": np.zeros((0, 3)),
    }
    return {"array": arrays, "texts": texts, "number": np.float32(2), "pair": (1, 2), "size": len(content)}


def of_a_path(path):
    return Path(path).read_text()


def refusing(path):
    raise InputError(f"{path}: line 3: force is 'x'; a number is needed")


def without_memory(_):
    return np.ones(10**9)


def hiding_it(path):
    try:
        return without_memory(path)
    except Exception as error:
        raise InputError("broken") from error


def growing(_):
    held = []
    while True:
        held.append(bytes(10_000_000))


def endless(_):
    while True:
        pass


def sleeping(_):
    import time

    time.sleep(600)


def crashing(_):
    os.abort()


def leaving(_):
    os._exit(0)


def mistaken(_):
    return {}["x"]


def of_objects(_):
    return np.array([{"a": 1}], dtype=object)


def where_modules_are_looked_for(_):
    return sys.path


def _ending_with(answer):
    sys.stdout.buffer.write(answer)
    sys.stdout.flush()
    os._exit(0)


def no_archive(_):
    _ending_with(b"\xff" * 100)


def pickled(_):
    np.savez(
        sys.stdout.buffer, np.array([os.getpid, 1], dtype=object), np.frombuffer(b'["value", 1]', np.uint8)
    )
    _ending_with(b"")


def of_texts(_):
    np.savez(sys.stdout.buffer, np.array(["a"]), np.frombuffer(b'["value", {"\\u0000": 0}]', np.uint8))
    _ending_with(b"")


def too_few_arrays(_):
    np.savez(sys.stdout.buffer, np.frombuffer(b'["value", {"\\u0000": 7}]', np.uint8))
    _ending_with(b"")


def no_json(_):
    np.savez(sys.stdout.buffer, np.frombuffer(b"[" * 100_000, np.uint8))
    _ending_with(b"")


def a_bomb(_):
    """A packed answer: 7 MB of zeros."""
    with (
        zipfile.ZipFile(sys.stdout.buffer, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a", "w") as part,
    ):
        part.write(bytes(7_000_000))
    _ending_with(b"")


def without_end(_):
    while True:
        sys.stdout.buffer.write(bytes(1_000_000))
