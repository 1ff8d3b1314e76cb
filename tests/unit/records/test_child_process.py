"""Parsing of untrusted files in a child process with limits."""

import os
import re
import threading
from pathlib import Path

import child_readers as readers
import numpy as np
import psutil
import pytest

from lumbar.base.errors import InputError
from lumbar.records import child_process
from lumbar.records.child_process import read_in_child
from refusing import has_tokens, refusal

limited = pytest.mark.skipif(not Path("/proc").exists(), reason="only Linux has all limits")


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "trial.bin"
    path.write_text("1 2 3")
    return path


def test_child_returns_all_kinds_of_values(path):
    values = read_in_child(readers.all_kinds, path, b"12345")
    arrays = values.pop("array")
    assert values == {
        "texts": ["é\ud800", None, True, -0.0, float("inf")],
        "number": 2.0,
        "pair": [1, 2],
        "size": 5,
    }
    np.testing.assert_array_equal(arrays["rows"], [[0, 2], [4, 6], [8, 10]])
    np.testing.assert_array_equal(arrays["big"], range(5))
    assert arrays["none"].shape == (0, 3)
    arrays["rows"][0] = 7  # it is writable


def test_child_does_not_import_from_working_directory(path, monkeypatch):
    monkeypatch.chdir(path.parent)
    (path.parent / "numpy.py").write_text("raise SystemExit")
    monkeypatch.syspath_prepend("")
    monkeypatch.setenv("PYTHONPATH", str(path.parent))
    assert read_in_child(readers.read_path, Path(path.name)) == "1 2 3"
    assert "" not in read_in_child(readers.module_folders, path)


def test_input_error_of_child_is_unchanged(path):
    with pytest.raises(InputError) as caught:
        read_in_child(readers.refusing, path)
    assert str(caught.value) == f"{path}: line 3: force is 'x'; a number is needed"


@limited
@pytest.mark.parametrize("bomb", [readers.exhaust_memory, readers.hiding_it, readers.growing])
def test_memory_is_limited(path, bomb, monkeypatch):
    monkeypatch.setattr(child_process, "MEMORY", 400_000_000)
    assert has_tokens(refusal(read_in_child, bomb, path), "trial.bin: … 5e-06 MB … memory")


@limited
def test_processor_time_is_limited(path, monkeypatch):
    monkeypatch.setattr(child_process, "SECONDS", 1)
    assert has_tokens(refusal(read_in_child, readers.endless, path), "trial.bin: … 5e-06 MB … 1 s")


def test_waiting_child_is_ended(path, monkeypatch):
    before = set(psutil.Process().children())
    monkeypatch.setattr(child_process, "TIMEOUT_S", 2)
    assert has_tokens(refusal(read_in_child, readers.sleeping, path), "trial.bin: … 5e-06 MB … 2 s")
    assert set(psutil.Process().children()) <= before


@pytest.mark.parametrize(
    ("failure", "fragment"),
    [
        ("crash", r"\bSIGABRT\b"),
        ("mistake", r"\bKeyError\b.*'x'.*\bchild_readers\.py, line \d+\b"),
        ("objects", r"\bTypeError\b.*\bndarray\b"),
    ],
)
def test_failing_reader_is_reported_with_file(path, failure, fragment):
    path.write_text(failure)
    with pytest.raises(InputError, match=rf"{re.escape(str(path))}: .*{fragment}"):
        read_in_child(readers.fail, path)


@pytest.mark.parametrize("forged", readers.FORGED)
def test_forged_answer_is_rejected(path, forged, monkeypatch):
    monkeypatch.setattr(child_process, "MAX_ANSWER_BYTES", 1_000_000)
    path.write_text(forged)
    message = refusal(read_in_child, readers.forge_answer, path)
    assert has_tokens(message, "trial.bin: … reader … answer")


@limited
def test_size_of_answer_is_limited(path, monkeypatch):
    monkeypatch.setattr(child_process, "MAX_ANSWER_BYTES", 3_000_000)
    assert has_tokens(refusal(read_in_child, readers.endless_answer, path), "trial.bin: … reader … ended")


def test_pipe_is_not_opened(path):
    path.unlink()
    os.mkfifo(path)
    assert has_tokens(refusal(read_in_child, readers.read_path, path), "trial.bin: … pipe")


def test_child_works_beside_computing_threads(path):
    """A bare fork of this process would end the threads of OpenBLAS on which another waits."""
    opened, children = Path("/proc/self/fd"), set(psutil.Process().children())
    before = set(opened.iterdir()) if opened.is_dir() else set()
    done, matrix, found = threading.Event(), np.ones((300, 300)), []

    def compute():
        while not done.is_set():
            matrix @ matrix

    other = threading.Thread(target=compute)
    other.start()
    asking = [
        threading.Thread(target=lambda: found.append(read_in_child(readers.read_path, path)))
        for _ in range(4)
    ]
    try:
        for thread in asking:
            thread.start()
        for thread in asking:
            thread.join(timeout=120)
    finally:
        done.set()
        other.join(timeout=60)
    assert found == ["1 2 3"] * 4 and not other.is_alive()
    assert set(psutil.Process().children()) <= children
    assert not before or set(opened.iterdir()) == before
