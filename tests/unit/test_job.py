"""What surrounds every script of the workflow: the rule's log, and how a job ends that cannot go on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from patience import PATIENCE_S

SCRIPTS = Path(__file__).resolve().parents[2] / "workflow" / "scripts"


@pytest.fixture
def job(tmp_path, monkeypatch, capsys):
    """Run a function as a rule's script; return exit status, what the terminal shows and what the log keeps."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import job as module

    from run import killed_jobs

    monkeypatch.setattr(killed_jobs, "end_with_parent", lambda: None)  # this process is none of Snakemake's

    def call(main, log=tmp_path / "rule.log"):
        snakemake = SimpleNamespace(rule="a_rule", log=[str(log)], input=None, output=None, params={})
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


def test_a_file_that_the_system_refuses_is_told_by_the_command(tmp_path):
    """The kernel refuses every file above 64 bytes, with an error that names no file."""
    out = tmp_path / "out"
    script = (
        "import resource, sys; sys.dont_write_bytecode = True  # it would be cut short, and stay\n"
        "from lumbar.cli import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64))\n"
        f"sys.exit(main(['signals', '--band', '5', '--output', {str(out)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (said,) = done.stderr.splitlines()
    assert said.startswith(f"lumbar: {out}{os.sep}")
    assert said.endswith(": File too large")
    assert not [path for path in out.rglob("*") if path.is_file()]
