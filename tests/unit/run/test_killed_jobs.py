"""Jobs end with a Snakemake that is killed, and what they had half written is gone after the next run's start."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from patience import PATIENCE_S

WORKFLOW = Path(__file__).resolve().parents[3] / "workflow"
JOB = """
import os, sys, time
from pathlib import Path
from types import SimpleNamespace
sys.path.insert(0, {scripts!r})
from job import run
def main(*_):
    Path({said!r}).write_text(str(os.getpid()))
    time.sleep(3600)
run(main, SimpleNamespace(rule="a_rule", log=[{log!r}], input=None, output=None, params=None))
"""
STARTED = "import subprocess, sys; subprocess.run(['bash', '-c', f'set -euo pipefail;  {sys.executable} ' + sys.argv[1]])"
FORKED = """
import sys
from types import SimpleNamespace
from run.job_forks import execute_script
if __name__ == "__main__":
    execute_script(SimpleNamespace(resources={"tmpdir": "/tmp"}, bench_record=None), sys.argv[1])
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="other systems do not tell a process that its parent has ended"
)
@pytest.mark.parametrize("how", [STARTED, FORKED], ids=["started", "forked"])
def test_a_job_ends_with_the_process_that_runs_it(how, tmp_path):
    said, job, starter = tmp_path / "pid", tmp_path / "job.py", tmp_path / "starter.py"
    job.write_text(
        JOB.format(scripts=str(WORKFLOW / "scripts"), said=str(said), log=str(tmp_path / "job.log"))
    )
    starter.write_text(how)
    parent = subprocess.Popen(
        [sys.executable, starter, job],
        env=os.environ | {"PYTHONPATH": str(WORKFLOW)},
        stderr=subprocess.DEVNULL,
    )
    while not (said.is_file() and said.read_text()):
        assert parent.poll() is None
        time.sleep(0.01)
    worker = psutil.Process(int(said.read_text()))
    parent.kill()
    parent.wait()
    try:
        psutil.wait_procs([worker], timeout=PATIENCE_S)
        assert not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE
    finally:
        if worker.is_running():
            worker.kill()


def test_only_what_was_half_written_for_the_runs_own_outputs_is_removed(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(WORKFLOW))
    from run.killed_jobs import remove_half_written

    for name in (".table.csv.a1b2c3_d", ".others.csv.a1b2c3_d", ".table.csv.short", "table.csv.a1b2c3_d"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "table.csv").write_text("half")
    outputs = [str(tmp_path / "table.csv"), str(tmp_path / "not_yet" / "figure.svg")]
    remove_half_written(
        SimpleNamespace(dag=SimpleNamespace(needrun_jobs=lambda: [SimpleNamespace(output=outputs)]))
    )
    assert {path.name for path in tmp_path.iterdir()} == {
        ".others.csv.a1b2c3_d", ".table.csv.short", "table.csv.a1b2c3_d"
    }  # fmt: skip
