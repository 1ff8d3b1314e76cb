"""A process with threads has its files parsed by forks of another, which ends with it."""

import os
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lumbar.base import child_template, confined, landlock
from lumbar.base.errors import InputError
from patience import seen


@pytest.fixture(autouse=True)
def _with_threads(monkeypatch):
    monkeypatch.setattr(confined, "_has_threads", lambda: True)


def read(path: Path) -> str:
    return confined.confined(partial(Path.read_text, path), path, 5)


def test_files_are_read_while_others_compute(tmp_path):
    """A fork of this process would end the threads of OpenBLAS on which the other waits."""
    (tmp_path / "a").write_text("1 2 3")
    done, matrix = threading.Event(), np.ones((300, 300))

    def compute():
        while not done.is_set():
            matrix @ matrix

    other = threading.Thread(target=compute)
    other.start()
    try:
        assert [read(tmp_path / "a") for _ in range(30)] == ["1 2 3"] * 30
    finally:
        done.set()
        other.join(timeout=60)
    assert not other.is_alive()


def test_a_path_is_meant_from_where_one_works(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a").write_text(name)
        monkeypatch.chdir(tmp_path / name)
        assert read(Path("a")) == name


@pytest.mark.parametrize("opens", [True, False])
def test_it_holds_its_forks_to_the_limits(tmp_path, opens):
    """One that opens its own file, and one that waits and opens none."""
    if not landlock.version():
        pytest.skip("this kernel has no Landlock")
    (tmp_path / "a").write_text("a")
    (tmp_path / "b").write_text("b")
    parsed = tmp_path / ("b" if opens else "a")
    with pytest.raises(InputError, match=rf"{parsed.name}: broken: its reader stopped at PermissionError"):
        confined.confined(partial(Path.read_text, tmp_path / "a"), parsed, 5, opens=opens)
    with pytest.raises(InputError, match="more memory than a reader has"):
        confined.confined(partial(np.ones, 80_000_000), tmp_path / "a", 5, opens=opens)
    with pytest.raises(InputError, match="SIGABRT"):
        confined.confined(os.abort, tmp_path / "a", 5, opens=opens)
    assert confined.confined(partial(str, b"1 2", "utf-8"), tmp_path / "a", 5, opens=opens) == "1 2"


def test_one_that_ended_is_replaced(tmp_path):
    (tmp_path / "a").write_text("a")
    assert read(tmp_path / "a") == "a"
    template = child_template._templates[os.getpid()][1]
    template.kill()
    template.wait()
    with pytest.raises(InputError, match="a: broken: its reader ended"):
        read(tmp_path / "a")
    assert read(tmp_path / "a") == "a"


def test_it_ends_with_its_process(project):
    code = "from lumbar.base import child_template as own; import os, time; own.start(); " + (
        "print(own._templates[os.getpid()][1].pid, flush=True); time.sleep(600)"
    )
    paths = {**os.environ, "PYTHONPATH": str(project / "workflow")}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=paths, stdout=subprocess.PIPE, text=True
    ) as process:
        template = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)

    def gone():
        try:
            os.kill(template, 0)
        except ProcessLookupError:
            return True
        status = Path(f"/proc/{template}/stat")  # where nobody collects it, it stays as a name
        return status.is_file() and status.read_text().split()[2] == "Z"

    assert seen(gone)


def asked_without_a_file(parse, path):
    return confined.confined(parse, path, 5, opens=False)


def forks(template: int) -> list[int]:
    found = Path(f"/proc/{template}/task/{template}/children")
    return list(map(int, found.read_text().split()))


def test_every_request_has_a_fork_of_its_own_and_one_that_was_ended_is_told_and_replaced(tmp_path):
    def own() -> int:
        return asked_without_a_file(partial(os.getpid), tmp_path / "a")

    first = own()
    template = child_template._templates[os.getpid()][1].pid
    if not Path(f"/proc/{template}/task/{template}/children").exists():
        pytest.skip("this system does not tell the children of a process")
    [waiting] = seen(lambda: set(forks(template)) - {first})
    assert own() == waiting
    [other] = seen(lambda: set(forks(template)) - {waiting})
    os.kill(other, signal.SIGKILL)
    with pytest.raises(InputError, match="its reader ended"):
        own()
    assert own() not in (first, waiting, other)


def test_what_a_request_needs_is_imported_before_it_is_confined(tmp_path, monkeypatch):
    if not landlock.version():
        pytest.skip("this kernel has no Landlock")
    (tmp_path / "own_module.py").write_text("def answer():\n    return 'imported'\n")
    monkeypatch.syspath_prepend(tmp_path)
    for template in child_template._templates.copy():  # which knows the path alone that it was started with
        child_template._templates.pop(template)[0].close()
    from own_module import answer  # type: ignore[import-not-found]

    assert asked_without_a_file(answer, tmp_path / "a") == "imported"


def test_what_a_fork_rehearses_is_what_it_does(monkeypatch):
    """A rehearsal that reads nothing would leave the first file as slow as it was, without a word."""
    from lumbar.records import matlab_file
    from lumbar.records.importing import variables

    read = []

    def counted(module, name, do):
        def call(*given, **how):
            return read.append(name) or do(*given, **how)

        monkeypatch.setattr(module, name, call)

    for module, name in ((matlab_file, "load_matlab"), (variables, "to_table")):
        counted(module, name, getattr(module, name))
    variables.rehearse()
    assert read == ["load_matlab", "to_table", "to_table"]
