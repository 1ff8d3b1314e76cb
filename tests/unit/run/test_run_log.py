"""What a run tells: stage, share of the work and minutes left from earlier runs, failures, warnings, what ran."""

import logging
import subprocess
import sys
from pathlib import Path

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "workflow"))
from run.run_log import Job, RunLog, warnings_in

HEADER = "s\th:m:s\tmax_rss\tmax_vms\tmax_uss\tmax_pss\tio_in\tio_out\tmean_load\tcpu_time\n"


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def run(tmp_path):
    """A run of two timed jobs (100 s and 300 s when they last ran) and one that is new, on one core."""
    said, clock = [], Clock()
    jobs = {
        1: Job("3 Identification", "models on chirp", "identify/chirp", str(tmp_path / "chirp.log"), 100.0),
        2: Job("8 Basins", "basins of a lift", "basins/a", str(tmp_path / "basins.log"), 300.0),
        3: Job("9 Claims", "claims", "claims", str(tmp_path / "claims.log")),
    }
    return RunLog(jobs, 1, said.append, clock), said, clock


def tell(log, event, number):
    record = logging.makeLogRecord({"event": event, "jobid": number, "msg": ""})
    log.emit(record)


def test_a_job_is_told_with_its_stage_share_and_minutes_left(run):
    log, said, clock = run
    tell(log, LogEvent.JOB_INFO, 1)
    clock.now = 100.0
    tell(log, LogEvent.JOB_FINISHED, 1)
    tell(log, LogEvent.JOB_INFO, 2)
    # 100 s of 600 s are done (the new job is taken to last the mean, 200 s), at the speed of one core.
    assert said == [
        "3 Identification: models on chirp",
        "  1 of 3 jobs, 17 % of the work, about 8 min left; done in 100 s: models on chirp",
        "8 Basins: basins of a lift",
    ]
    clock.now = 250.0
    assert log.state() == "1 of 3 jobs, 42 % of the work, about 6 min left"
    clock.now = 4000.0
    assert "67 % of the work" in log.state(), "a job that takes longer than before is not more than done"


def test_a_slower_machine_takes_longer(run):
    log, _, clock = run
    tell(log, LogEvent.JOB_INFO, 1)
    clock.now = 400.0
    tell(log, LogEvent.JOB_FINISHED, 1)
    minutes = 500 / ((100 + 20) / (400 + 20)) / 60
    assert f"about {minutes:.0f} min left" in log.state()


def test_without_earlier_runs_no_minutes_are_told():
    log = RunLog({1: Job("a", "b", "c", "d"), 2: Job("a", "e", "f", "g")}, 2, print, Clock())
    tell(log, LogEvent.JOB_FINISHED, 1)
    assert log.state() == "1 of 2 jobs"


def test_a_failed_job_names_its_log(run, tmp_path):
    log, said, _ = run
    tell(log, LogEvent.JOB_ERROR, 2)
    assert said == [f"FAILED: basins of a lift; why stands above and in {tmp_path / 'basins.log'}"]


def test_a_killed_job_is_said_to_be_killed(run):
    log, said, _ = run
    for status in (1, -9, -11):
        error = subprocess.CalledProcessError(status, ["python", "basins.py"])
        record = logging.LogRecord("", logging.ERROR, "", 0, f"CalledProcessError: {error}", None, None)
        record.event = LogEvent.ERROR
        log.handle(record)
    killed, crashed = said
    assert killed.startswith("A job was killed from outside (SIGKILL)")
    assert crashed.startswith("A job crashed (SIGSEGV)")


def test_the_closing_table_lists_what_ran_and_repeats_its_warnings(run, tmp_path):
    log, _, _ = run
    for name in ("identify/chirp", "basins/a", "claims"):
        path = tmp_path / "benchmarks" / f"{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(HEADER + "2.5\t0:00:02\t100\t-\t-\t-\t-\t-\t-\t3.5\n")
    (tmp_path / "chirp.log").write_text("half way\nWARNING: channel 2 drifts\n  - by 3 N\nfitted\n  deeply\n")
    (tmp_path / "basins.log").write_text("WARNING: of a job that did not run now\n")
    tell(log, LogEvent.JOB_FINISHED, 1)
    told = log.closing(tmp_path / "benchmarks").splitlines()
    assert [line.split()[0] for line in told] == ["job", "identify/chirp", "sum", "WARNING:", "-"]
    assert told[-2:] == warnings_in(tmp_path / "chirp.log") == ["WARNING: channel 2 drifts", "  - by 3 N"]
