"""Jobs of the workflow: how they start, are forked, log, end and are killed, and what they ask of a cluster."""

import inspect
import os
import re
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import psutil
import pytest
import yaml
from snakemake.benchmark import BenchmarkRecord
from snakemake.cli import get_argument_parser
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake.settings.types import MaxJobsPerTimespan

from lumbar.settings.plain import part
from lumbar.settings.stability import PendulumSettings, StabilitySettings
from patience import PATIENCE_S, seen
from run.job_forks import execute_script
from run.jobs import job_size, lift_limit, remove_half_written

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
        (
            OverflowError("too large"),
            1,
            "a_rule: numbers left the range that can be computed with (too large)",
        ),
        (PermissionError(13, "Permission denied", "/x/a.csv"), 1, "a_rule: /x/a.csv: Permission denied"),
    ],
)
def test_what_is_no_programming_error_ends_in_one_line(job, error, status, said):
    found, shown, kept = job(raising(error))
    assert found == status
    assert shown == kept
    first, second, *rest = shown.splitlines()
    assert (first, rest) == ("half way", [])
    assert second.startswith(said)


def test_a_job_takes_the_rules_parameters_as_the_classes_that_it_names(job):
    taken = []

    def main(input, output, settings: StabilitySettings, lifts: tuple[str, ...], rate: float | None):
        taken.extend([settings.pendulum, lifts, rate])

    given = {"settings": part(StabilitySettings(), "pendulum"), "lifts": ["a", "b"], "rate": 100}
    assert job(main, params={**given, "code": "digest"})[0] == 0
    assert taken == [PendulumSettings(), ("a", "b"), 100.0]
    status, shown, _ = job(main, params=given | {"seed": 1})
    assert status == 1
    assert "the rule passes lifts, rate, seed, settings; the job takes lifts, rate, settings" in shown


@pytest.mark.parametrize("read", [float, bool, str, list, lambda value: value.sign, lambda value: value + 1])
def test_a_key_that_the_rule_does_not_pass_cannot_be_read(job, read):
    def main(input, output, settings: StabilitySettings):
        read(settings.pendulum)

    status, shown, _ = job(main, params={"settings": part(StabilitySettings(), "knots")})
    assert status == 1
    assert "the rule does not pass StabilitySettings.pendulum" in shown


def test_a_programming_error_keeps_its_traceback(job):
    status, shown, kept = job(raising(KeyError("absent")))
    assert status == 1
    assert "Traceback" in shown
    assert shown == kept


def test_a_full_disk_does_not_hide_the_error_behind_the_log(job):
    """/dev/full refuses every byte in the kernel, as a full disk does."""
    status, shown, _ = job(raising(OSError(28, "No space left on device", "/x/a.csv")), Path("/dev/full"))
    assert status == 1
    assert "Traceback" not in shown
    assert "/dev/full: No space left on device: the log ends here" in shown
    assert "a_rule: /x/a.csv: No space left on device; " in shown


def test_ctrl_c_ends_a_command_in_one_line_and_leaves_nothing(tmp_path):
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
    assert seen(lambda: parent.poll() is not None or (said.is_file() and said.read_text()))
    worker = psutil.Process(int(said.read_text()))
    parent.kill()
    parent.wait()
    try:
        psutil.wait_procs([worker], timeout=PATIENCE_S)
        assert not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE
    finally:
        if worker.is_running():
            worker.kill()


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="other systems start every script by itself")
def test_a_run_in_the_background_ends_with_its_jobs_when_it_is_told(tmp_path):
    """Snakemake waits for those that run; a shell's background job, and all that it starts, ignores Ctrl-C."""
    for kind, name in (("smk", "Snakefile"), ("job", "job.py")):
        text = Path(__file__).with_name(f"told_to_end.{kind}.txt").read_text(encoding="utf-8")
        (tmp_path / name).write_text(text.replace("WORKFLOW", str(WORKFLOW)))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        command = [sys.executable, "-m", "snakemake", "--cores", "4"]
        snakemake = subprocess.Popen(
            command, cwd=tmp_path, start_new_session=True, stderr=subprocess.PIPE, text=True
        )
    finally:
        signal.signal(signal.SIGINT, before)
    try:
        assert seen(lambda: len(list(tmp_path.glob("*.begun"))) == 4)
        started = psutil.Process(snakemake.pid).children(recursive=True)
        assert len(started) >= 4
        snakemake.terminate()
        _, said = snakemake.communicate(timeout=PATIENCE_S)
        assert psutil.wait_procs(started, timeout=PATIENCE_S)[1] == []
    finally:
        with suppress(ProcessLookupError):
            os.killpg(snakemake.pid, signal.SIGKILL)
    assert snakemake.returncode and "Traceback" not in said
    assert "one: interrupted" in said
    left = [path.name for path in tmp_path.glob(".*.txt.*")]
    assert [name[:6] for name in left] == [".0.txt"]  # which the next call removes


def test_only_what_was_half_written_for_the_runs_own_outputs_is_removed(tmp_path):
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


@pytest.fixture
def forked(tmp_path):
    """Run the lines of a script, given where it may write; return what it wrote."""
    job = SimpleNamespace(resources={"tmpdir": tmp_path}, bench_record=None)
    path, out = tmp_path / "script.py", tmp_path / "out"

    def call(*lines):
        path.write_text("\n".join(["from pathlib import Path", f"out = Path({str(out)!r})", *lines]))
        execute_script(job, str(path))
        return out.read_text()

    return call


def test_a_script_is_the_main_module_of_a_process_of_its_own(forked, tmp_path):
    said = forked(
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
def test_a_script_that_fails_or_is_killed_fails_its_job(forked, end, status):
    with pytest.raises(subprocess.CalledProcessError) as failed:
        forked(end)
    assert failed.value.returncode == status
    assert failed.value.cmd[0] == sys.executable


def test_a_record_holds_all_processor_time_of_a_job_and_of_what_it_started(tmp_path):
    """More often than every half minute nobody looks at a job that has run for a while."""
    burn = "import time\nwhile time.process_time() < {}: pass"
    lines = ["import subprocess, sys", f"subprocess.run([sys.executable, '-c', {burn.format(0.3)!r}])"]
    (tmp_path / "script.py").write_text("\n".join([*lines, burn.format(0.5)]))
    record = BenchmarkRecord()
    execute_script(
        SimpleNamespace(resources={"tmpdir": tmp_path}, bench_record=record), str(tmp_path / "script.py")
    )
    assert 0.8 <= record.cpu_time < 5
    assert record.get_benchmarks()[-1] == record.cpu_time
    assert record.mean_load() == pytest.approx(100 * record.cpu_time / record.running_time)


def test_jobs_that_start_and_end_at_once_do_not_fail_one_another(tmp_path):
    (tmp_path / "script.py").write_text("pass")
    job = SimpleNamespace(resources={"tmpdir": tmp_path}, bench_record=None)
    with ThreadPoolExecutor(6) as threads:
        ended = [threads.submit(execute_script, job, str(tmp_path / "script.py")) for _ in range(60)]
        assert [item.result() for item in ended] == [None] * 60


def scheduler(limit):
    settings = SimpleNamespace(max_jobs_per_timespan=limit)
    return SimpleNamespace(job_rate_limiter=limit, workflow=SimpleNamespace(scheduling_settings=settings))


def test_snakemakes_own_limit_is_lifted():
    own = get_argument_parser().parse_args([]).max_jobs_per_timespan
    begun = scheduler(own if isinstance(own, MaxJobsPerTimespan) else MaxJobsPerTimespan.parse_choice(own))
    lift_limit(begun)
    assert begun.job_rate_limiter is None
    assert "if self.job_rate_limiter is not None:" in inspect.getsource(JobScheduler.schedule)


@pytest.mark.parametrize("asked", ["100/1m", "5/1s", None])
def test_a_limit_of_the_user_stays(asked):
    limit = asked and MaxJobsPerTimespan.parse_choice(asked)
    begun = scheduler(limit)
    lift_limit(begun)
    assert begun.job_rate_limiter is limit


def test_a_job_asks_for_head_room_and_for_more_with_every_attempt():
    resources = job_size(peak_mb=100.5, seconds=12)
    # 400 MB of two Snakemakes and twice 101; 60 s to begin and ten times 12.
    assert [resources["mem_mb"](None, attempt=attempt) for attempt in (1, 2, 3)] == [602, 1204, 1806]
    assert [resources["runtime"](None, attempt=attempt) for attempt in (1, 2)] == [3, 6]


def test_every_rule_with_a_script_says_what_it_needs_and_groups_in_profiles_exist(project):
    rules = [path.read_text(encoding="utf-8") for path in (project / "workflow" / "rules").glob("*.smk")]
    for text in rules:
        assert text.count("**job_size(") == len(re.findall(r"^ +script:", text, flags=re.M))
    groups = set(re.findall(r'group:\n +"(\w+)"', "\n".join(rules)))
    for profile in ("slurm", "kubernetes"):
        settings = yaml.safe_load(
            (project / "profiles" / profile / "config.yaml").read_text(encoding="utf-8")
        )
        assert {entry.split("=")[0] for entry in settings["group-components"]} <= groups
