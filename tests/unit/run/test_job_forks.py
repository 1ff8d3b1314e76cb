"""Scripts forked from a process that has imported their libraries end as scripts do that are started with their path."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

WORKFLOW = Path(__file__).resolve().parents[3] / "workflow"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the lines of a script, given where it may write; return what it wrote."""
    monkeypatch.syspath_prepend(str(WORKFLOW))
    from run.job_forks import execute_script

    job = SimpleNamespace(resources={"tmpdir": tmp_path}, bench_record=None)
    path, out = tmp_path / "script.py", tmp_path / "out"

    def call(*lines):
        path.write_text("\n".join(["from pathlib import Path", f"out = Path({str(out)!r})", *lines]))
        execute_script(job, str(path))
        return out.read_text()

    return call


def test_a_script_is_the_main_module_of_a_process_of_its_own(run, tmp_path):
    said = run(
        "import atexit, sys, tempfile",
        "assert __name__ == '__main__' and sys.argv == [__file__]",
        "atexit.register(lambda: out.write_text(tempfile.gettempdir()))",
        "sys.exit(0)",
    )
    assert said == str(tmp_path)


@pytest.mark.parametrize(
    ("end", "status"),
    [("import sys; sys.exit(1)", 1), ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", -9)],
)
def test_a_script_that_fails_or_is_killed_fails_its_job(run, end, status):
    with pytest.raises(subprocess.CalledProcessError) as failed:
        run(end)
    assert failed.value.returncode == status
    assert failed.value.cmd[0] == sys.executable


def test_jobs_that_start_and_end_at_once_do_not_fail_one_another(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(WORKFLOW))
    from run.job_forks import execute_script

    (tmp_path / "script.py").write_text("pass")
    job = SimpleNamespace(resources={"tmpdir": tmp_path}, bench_record=None)
    with ThreadPoolExecutor(6) as threads:
        ended = [threads.submit(execute_script, job, str(tmp_path / "script.py")) for _ in range(60)]
        assert [item.result() for item in ended] == [None] * 60
