"""Jobs of the workflow: how they start, log, end and are killed, and what they ask of a cluster."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import psutil
import pytest
import yaml

from lumbar.settings.lifting import PendulumSettings, StabilitySettings
from lumbar.settings.study_settings import StudySettings
from patience import PATIENCE_S, wait_until
from run.jobs import expected_seconds, job_size, remove_half_written

WORKFLOW = Path(__file__).resolve().parents[3] / "workflow"


@pytest.fixture
def job(tmp_path, monkeypatch, capsys):
    """Run a function as a rule's script; return exit status, what the terminal shows and what the log keeps."""
    monkeypatch.syspath_prepend(str(WORKFLOW / "scripts"))
    import job as module

    from run import jobs

    monkeypatch.setattr(jobs, "end_with_parent", lambda: None)  # this process is none of Snakemake's

    def call(main, log=tmp_path / "rule.log", params=MappingProxyType({})):
        snakemake = SimpleNamespace(rule="a_rule", log=[str(log)], input=None, output=None, params=params)
        status = 0
        try:
            module.run(main, snakemake)
        except SystemExit as end:
            status = end.code
        kept = log.read_text() if log.is_file() else ""
        return status, capsys.readouterr().err, kept

    return call


def raising(error):
    def main(input, output):
        print("half way", file=sys.stderr)
        raise error

    return main


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (KeyboardInterrupt(), 130, "a_rule: interrupted"),
        (OverflowError("too large"), 1, "a_rule: numbers left the range that can be computed with ("),
        (PermissionError(13, "Permission denied", "/x/a.csv"), 1, "a_rule: /x/a.csv: Permission denied"),
    ],
)
def test_user_error_of_job_is_one_line(job, error, status, said):
    found, shown, kept = job(raising(error))
    assert found == status
    assert kept == f"half way\n{shown}"
    assert shown.startswith(said) and shown.count("\n") == 1


def test_job_parameters_have_annotated_classes(job):
    taken = []

    def main(input, output, settings: StabilitySettings, lifts: tuple[str, ...], rate: float | None):
        taken.extend([settings.pendulum, lifts, rate])

    given = {
        "settings": StabilitySettings().model_dump(mode="json", include={"pendulum"}),
        "lifts": ["a", "b"],
        "rate": 100,
    }
    assert job(main, params={**given, "code": "digest"})[0] == 0
    assert taken == [PendulumSettings(), ("a", "b"), 100.0]
    status, shown, _ = job(main, params=given | {"seed": 1})
    assert status == 1
    assert "the rule passes lifts, rate, seed, settings; the job takes lifts, rate, settings" in shown


def test_setting_that_rule_does_not_pass_is_an_error(job):
    taken = []

    def main(input, output, settings: StudySettings):
        taken.append(settings.stability.model_copy(update={"goal_level": 2.0}).knots)
        getattr(settings.stability, "pendulum", None)

    status, shown, _ = job(main, params={"settings": {"stability": {"knots": 100}}})
    assert (status, taken) == (1, [100])
    assert "the rule does not pass StabilitySettings.pendulum" in shown


def test_programming_error_keeps_traceback(job):
    status, shown, kept = job(raising(KeyError("absent")))
    assert status == 1
    assert "Traceback" in shown
    assert kept == f"half way\n{shown}"


def test_failed_import_of_script_is_in_log(tmp_path):
    log, script = tmp_path / "rule.log", tmp_path / "script.py"
    given = f"from types import SimpleNamespace\nsnakemake = SimpleNamespace(log=[{str(log)!r}])\n"
    script.write_text(f"{given}from job import run\nimport no_such_package\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(WORKFLOW / "scripts")}
    run = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    assert "No module named 'no_such_package'" in log.read_text(encoding="utf-8")
    assert run.stderr == log.read_text(encoding="utf-8")


def test_full_disk_does_not_hide_error_of_job(job):
    """/dev/full refuses every byte in the kernel, as a full disk does."""
    status, shown, _ = job(raising(OSError(28, "No space left on device", "/x/a.csv")), Path("/dev/full"))
    assert status == 1
    assert "Traceback" not in shown
    assert "/dev/full: No space left on device: the log ends here" in shown
    assert "a_rule: /x/a.csv: No space left on device; " in shown


def test_ctrl_c_ends_command_with_one_line(tmp_path):
    (tmp_path / "old.txt").write_text("old")
    script = (
        "import signal, sys, time; from lumbar.cli import command; from lumbar.base.files import replacing\n"
        # A shell that runs its jobs behind ignores the signal for them.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def run(options):\n"
        f"    with replacing({str(tmp_path / 'old.txt')!r}) as path:\n"
        "        path.write_text('half of the new'); print('ready', flush=True); time.sleep(3600)\n"
        "class Parser:\n"
        "    def parse_args(self, arguments): return type('Options', (), {'run': staticmethod(run)})\n"
        "command.build_parser = Parser\n"
        "sys.exit(command.main([]))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, said) == (130, "lumbar: interrupted\n")
    assert (tmp_path / "old.txt").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]


JOB = """
import os, sys, time
from pathlib import Path
from types import SimpleNamespace
sys.path.insert(0, {scripts!r})
from job import run
def main(input, output):
    Path({said!r}).write_text(str(os.getpid()))
    time.sleep(3600)
run(main, SimpleNamespace(rule="a_rule", log=[{log!r}], input=None, output=None, params={{}}))
"""
STARTED = "import subprocess, sys; subprocess.run(['bash', '-c', f'set -euo pipefail;  {sys.executable} ' + sys.argv[1]])"


@pytest.mark.skipif(
    sys.platform != "linux", reason="other systems do not tell a process that its parent has ended"
)
def test_job_ends_with_its_parent(tmp_path):
    said, job, starter = tmp_path / "pid", tmp_path / "job.py", tmp_path / "starter.py"
    job.write_text(
        JOB.format(scripts=str(WORKFLOW / "scripts"), said=str(said), log=str(tmp_path / "job.log"))
    )
    starter.write_text(STARTED)
    parent = subprocess.Popen(
        [sys.executable, starter, job],
        env=os.environ | {"PYTHONPATH": str(WORKFLOW)},
        stderr=subprocess.DEVNULL,
    )
    assert wait_until(lambda: parent.poll() is not None or (said.is_file() and said.read_text()))
    worker = psutil.Process(int(said.read_text()))
    parent.kill()
    parent.wait()
    try:
        psutil.wait_procs([worker], timeout=PATIENCE_S)
        assert not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE
    finally:
        if worker.is_running():
            worker.kill()


def test_only_leftovers_of_own_outputs_are_removed(tmp_path):
    for name in (".table.csv.a1b2c3_d", ".others.csv.a1b2c3_d", ".table.csv.short", "table.csv.a1b2c3_d"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "table.csv").write_text("half")
    outputs = [str(tmp_path / "table.csv"), str(tmp_path / "not_yet" / "figure.svg")]
    remove_half_written([SimpleNamespace(output=outputs)])
    assert {path.name for path in tmp_path.iterdir()} == {
        ".others.csv.a1b2c3_d", ".table.csv.short", "table.csv.a1b2c3_d"
    }  # fmt: skip


def test_job_size_grows_with_attempts():
    resources = job_size(peak_mb=100.5, seconds=12)
    # 400 MB of two Snakemakes and twice 101; 60 s to begin and ten times 12.
    assert [resources["mem_mb"](None, attempt=attempt) for attempt in (1, 2, 3)] == [602, 1204, 1806]
    assert [resources["runtime"](None, attempt=attempt) for attempt in (1, 2)] == [3, 6]
    assert (expected_seconds(3), expected_seconds(None)) == (12, 0)


def test_rules_state_resources_and_existing_groups(project):
    rules = [path.read_text(encoding="utf-8") for path in (project / "workflow" / "rules").glob("*.smk")]
    for text in rules:
        assert text.count("**job_size(") == len(re.findall(r"^ +script:", text, flags=re.M))
    groups = set(re.findall(r'group:\n +"(\w+)"', "\n".join(rules)))
    for profile in ("slurm", "kubernetes"):
        settings = yaml.safe_load(
            (project / "profiles" / profile / "config.yaml").read_text(encoding="utf-8")
        )
        assert {entry.split("=")[0] for entry in settings["group-components"]} <= groups
