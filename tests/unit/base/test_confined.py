"""A parser of a stranger's file reads that file, answers in numbers and texts, and ends at its limits."""

import contextlib
import os
import signal
import socket
import struct
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
import pytest

from lumbar.base import child, landlock
from lumbar.base import confined as confined_module
from lumbar.base.child import LEAST, MEMORY
from lumbar.base.confined import confined
from lumbar.base.errors import InputError, NumericalError
from refusing import refusal


@dataclass(frozen=True)
class Found:
    values: np.ndarray
    names: tuple[str, ...] = ()
    more: dict = field(default_factory=dict)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "trial.bin"
    path.write_bytes(b"1 2 3")
    return path


@pytest.fixture(autouse=True)
def _without_threads(monkeypatch):
    """Tests' own functions are no request to a template; where pytest has threads, none of them computes."""
    monkeypatch.setattr(confined_module, "_has_threads", lambda: False)


def called(parse, path, **options):
    return confined(parse, path, 5, (Found,), **options)


def test_what_is_parsed_comes_back_as_it_was(path):
    values = np.arange(12.0).reshape(3, 4)
    inner = {1: [None, True, "é\ud800", -0.0, float("inf")], ("a", 2): Found(values[:, 1]), "r": range(2, 9)}
    kinds = [np.arange(5, dtype=">i2"), np.zeros((0, 3)), np.array(2.5), values.T, np.array([True, False])]
    found = called(
        lambda: Found(values[:, ::2], ("a", "b"), {"inner": inner, "kinds": kinds, "n": np.float32(2)}), path
    )
    np.testing.assert_array_equal(found.values, values[:, ::2])
    assert found.names == ("a", "b") and found.more["n"] == 2.0
    assert {key: value for key, value in found.more["inner"].items() if key != ("a", 2)} == {
        1: inner[1],
        "r": range(2, 9),
    }
    np.testing.assert_array_equal(found.more["inner"]["a", 2].values, values[:, 1])
    for one, other in zip(found.more["kinds"], kinds, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    found.values[0] = 7  # belongs to whoever asked


@pytest.mark.parametrize("error", [InputError("trial.bin: line 3"), NumericalError("trial.bin: too large")])
def test_an_error_for_the_user_comes_back_in_its_words(path, error):
    def parse():
        raise error

    with pytest.raises(type(error)) as caught:
        called(parse, path)
    assert str(caught.value) == str(error)


def test_it_reads_its_own_file_and_no_other(tmp_path, path):
    if not landlock.version():
        pytest.skip("this kernel has no Landlock")
    other = tmp_path / "secret"
    other.write_text("secret")
    assert called(lambda: path.read_text(), path) == "1 2 3"
    tries = [
        lambda: other.read_text(),
        lambda: (tmp_path / "new").write_text("x"),
        lambda: path.write_text("x"),
        lambda: path.unlink(),
        lambda: list(tmp_path.iterdir()),
        lambda: os.execv("/bin/true", ["true"]),
        lambda: os.kill(os.getppid(), signal.SIGKILL),
        lambda: socket.create_connection(("127.0.0.1", 9)).close(),
    ]
    for number, attempt in enumerate(tries):
        words = refusal(called, attempt, path)
        assert "trial.bin: broken: its reader stopped at Permission" in words
        assert "secret" not in words.replace(str(other), ""), number
    with pytest.raises(InputError, match="Permission"):
        called(lambda: path.read_text(), path, opens=False)
    assert path.read_text() == "1 2 3"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["secret", "trial.bin"]


def test_it_has_none_of_the_open_files_of_its_parent(path):
    with path.open("rb") as held:

        def parse():
            found = []
            for number in range(3, 200):
                with contextlib.suppress(OSError):
                    os.fstat(number)
                    found.append(number)
            return len(found), os.read(0, 1) == b""

        assert held.fileno() >= 3
        assert called(parse, path) == (1, True)  # the pipe of the answer; no input


def test_memory_and_time_end_at_their_limits_in_words(path, monkeypatch):
    wanted, least = MEMORY // 7, LEAST // 10
    said = r"trial\.bin: its 5e-06 MB need more memory than a reader has, 500 MB"
    with pytest.raises(InputError, match=said):
        called(lambda: np.ones(wanted).sum(), path)
    assert called(lambda: np.ones(least).sum(), path) == least

    def hidden():
        try:
            return np.ones(wanted)
        except Exception as error:
            raise InputError("broken") from error

    with pytest.raises(InputError, match="more memory than a reader has"):
        called(hidden, path)

    def told_with_no_room_left():
        held = []
        try:
            while True:
                held.append(bytes(1000))
        finally:
            raise KeyError(held)

    with pytest.raises(InputError, match="more memory than a reader has"):
        called(told_with_no_room_left, path)
    monkeypatch.setattr(child, "SECONDS", 1)

    def endless():
        while True:
            pass

    with pytest.raises(InputError, match=r"trial\.bin: its 5e-06 MB take longer than 1 s to read"):
        called(endless, path)
    monkeypatch.setattr(child, "PATIENCE_S", 0.1)
    with pytest.raises(InputError, match="longer than 1 s"):
        called(lambda: time.sleep(600), path)


def test_a_reader_that_crashes_is_told(path):
    with pytest.raises(InputError, match=r"trial\.bin: broken: its reader ended \(SIGABRT\)"):
        called(os.abort, path)
    with pytest.raises(InputError, match=r"trial\.bin: broken: its reader ended \(0\)"):
        called(lambda: os._exit(0), path)
    said = r"trial\.bin: broken: its reader stopped at KeyError \('x'; test_conf"
    with pytest.raises(InputError, match=said):
        called(lambda: {}["x"], path)


def _lie(text: bytes, arrays: bytes = b"") -> list[bytes]:
    return [struct.pack("=QQ", len(text), len(arrays)), text, arrays]


@pytest.mark.parametrize(
    "answer",
    [
        [b""],
        [b"\xff" * 100],
        _lie(b"no JSON"),
        _lie(b'["value", {"Popen": {"args": "true"}}, []]'),
        _lie(b'["value", {"Found": {"unknown": 1}}, []]'),
        _lie(b'["value", {"a": 1, "b": 2}, []]'),
        _lie(b'["value", {"array": 0}, [["O", [1], 0]]]', b"\1" * 8),
        _lie(b'["value", {"array": 0}, [["<f8", [100], 0]]]', b"\0" * 8),
        _lie(b'["value", {"array": 0}, [["<f8", [1], -900]]]', b"\0" * 8),
        _lie(b"[" * 100_000),
    ],
)
def test_an_answer_that_lies_is_refused(path, monkeypatch, answer):
    monkeypatch.setattr(child, "packed", lambda *_: answer)
    with pytest.raises(InputError, match=r"trial\.bin: broken: its reader"):
        called(lambda: 1, path)


def test_it_serves_threads_and_leaves_nothing(path):
    opened = Path("/proc/self/fd")
    before = set(opened.iterdir()) if opened.is_dir() else set()
    this = psutil.Process()
    children = set(this.children())  # of other tests
    found = []
    threads = [
        threading.Thread(target=lambda n=n: found.append(called(lambda: [n, path.read_text()], path)))
        for n in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == [[n, "1 2 3"] for n in range(8)]
    assert set(this.children()) <= children  # ended ones that nobody waited for are among them
    if before:
        assert set(opened.iterdir()) == before
