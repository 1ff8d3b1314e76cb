"""What a person sees of a run: one line as a job starts and one as it ends, with stage, share done and minutes left.

Snakemake tells its own story in log records (`snakemake_interface_logger_plugins.common.LogEvent`). `RunLog` is a handler of
its logger that tells the same in fewer words; a filter keeps what is retold from Snakemake's default handlers. A logger
plugin would have to be installed before Snakemake starts; this works in every environment that runs the workflow.
"""

import logging
import re
import time
from dataclasses import dataclass
from pathlib import Path

from snakemake.settings.enums import Quietness
from snakemake_interface_logger_plugins.common import LogEvent

from run.timings import timings

_RETOLD = (
    LogEvent.JOB_INFO,
    LogEvent.JOB_STARTED,
    LogEvent.JOB_FINISHED,
    LogEvent.JOB_ERROR,
    LogEvent.PROGRESS,
)
_DEFAULT_HANDLERS = ("DefaultStreamHandler", "DefaultLogFileHandler")
_WARNING = "WARNING"
_ENDED_BY = re.compile(r"died with <Signals\.(\w+)")
"""In a `subprocess.CalledProcessError`."""
_CRASHES = ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL")
"""Signals that a process brings about itself."""
_UNKNOWN_S = 1.0
"""Weight of a job where no job of the run has ever been timed: all weigh alike."""
_LEARNING_S = 20.0
"""Seconds of a run after which its own speed counts as much as that of all cores at work."""


@dataclass
class Job:
    """One job of the run."""

    stage: str
    message: str
    name: str
    """Of its benchmark file below the study's folder of benchmarks."""
    log: str
    expected_s: float | None = None
    """How long it took when it last ran; None where that is not known."""
    started: float | None = None
    """On the run's clock."""


class RunLog(logging.Handler):
    """Tells the course of a run.

    `jobs` are by Snakemake's number, without rules that only collect; `say` takes one line, `clock` returns seconds.
    """

    def __init__(self, jobs: dict[int, Job], cores: int, say, clock=time.monotonic):
        super().__init__()
        self.jobs = jobs
        self.cores = cores
        self.say = say
        self.clock = clock
        self.began = clock()
        self.finished: list[Job] = []
        known = [job.expected_s for job in jobs.values() if job.expected_s is not None]
        self.timed = bool(known)
        typical = sum(known) / len(known) if known else _UNKNOWN_S
        self.weights = {
            number: typical if job.expected_s is None else job.expected_s for number, job in jobs.items()
        }
        self.total = sum(self.weights.values())

    def emit(self, record: logging.LogRecord) -> None:
        """Retell one of Snakemake's records."""
        if getattr(record, "event", None) == LogEvent.ERROR:
            self._tell_signal(record.getMessage())
        number = getattr(record, "job_id", getattr(record, "jobid", None))
        job = self.jobs.get(number)
        if job is None:
            return
        if record.event == LogEvent.JOB_INFO:
            job.started = self.clock()
            self.say(f"{job.stage}: {job.message}")
        elif record.event == LogEvent.JOB_FINISHED and job not in self.finished:
            self.finished.append(job)
            taken = self.clock() - (job.started or self.began)
            self.say(f"  {self.state()}; done in {taken:.0f} s: {job.message}")
        elif record.event == LogEvent.JOB_ERROR:
            self.say(f"FAILED: {job.message}; why stands above and in {job.log}")

    def _tell_signal(self, error: str) -> None:
        """Say of a job that a signal ended what its log cannot say."""
        found = _ENDED_BY.search(error)
        if found and found[1] in _CRASHES:
            self.say(f"A job crashed ({found[1]}) inside one of the libraries that it uses")
        elif found:
            self.say(
                f"A job was killed from outside ({found[1]}): by somebody, or by the system as memory ran out"
            )

    def work_done(self) -> float:
        """Expected seconds of the jobs that are done, and of those that run as far as they have come."""
        done = 0.0
        for number, job in self.jobs.items():
            if job in self.finished:
                done += self.weights[number]
            elif job.started is not None:
                done += min(self.clock() - job.started, self.weights[number])
        return done

    def state(self) -> str:
        """Jobs done, share of the work, and minutes left where earlier runs tell how long jobs take."""
        counted = f"{len(self.finished)} of {len(self.jobs)} jobs"
        if not self.timed:
            return counted
        done = self.work_done()
        text = f"{counted}, {100 * done / self.total:.0f} % of the work"
        if len(self.finished) == len(self.jobs):
            return text
        elapsed = self.clock() - self.began
        speed = (done + _LEARNING_S * self.cores) / (elapsed + _LEARNING_S)
        return f"{text}, {_minutes((self.total - done) / speed)} left"

    def closing(self, folder: Path) -> str:
        """Return timings and warnings of what ran, from its benchmark and log files."""
        from run.timings import summary

        told = summary(folder, {job.name for job in self.finished})
        return "\n".join([told, *(line for job in self.finished for line in warnings_in(Path(job.log)))])


def _minutes(seconds: float) -> str:
    return (
        f"about {seconds / 60:.0f} min" if seconds >= 90 else "about 1 min" if seconds > 45 else "under 1 min"
    )


def warnings_in(log: Path) -> list[str]:
    """Lines of a rule's log that begin with ``WARNING``, each with the indented lines below it."""
    found: list[str] = []
    inside = False
    for line in log.read_text(encoding="utf-8").splitlines() if log.is_file() else ():
        inside = line.startswith(_WARNING) or (inside and line.startswith(" "))
        if inside:
            found.append(line)
    return found


def _is_not_retold(record: logging.LogRecord) -> bool:
    """Filter of Snakemake's default handlers."""
    event = getattr(record, "event", None)
    if event in _RETOLD or record.getMessage() == "Select jobs to execute...":
        return False
    # That the script of a failed job ended with a status other than 0 goes without saying.
    return not (event == LogEvent.ERROR and "CalledProcessError" in record.getMessage())


def watch(workflow, stages: dict[str, str], benchmarks: Path) -> RunLog:
    """Retell the run that begins.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        With its graph of jobs.
    stages : dict of str to str
        Name of a stage by the file of its rules, without suffix.
    benchmarks : Path
        Where earlier runs left the time that each job took.
    """
    from snakemake.logging import logger

    def say(line: str) -> None:
        logger.info(f"{time.strftime('%H:%M:%S')}  {line}", extra={"quietness": Quietness.PROGRESS})

    earlier = {name: wall for name, wall, *_ in timings(benchmarks)}
    jobs = {}
    for item in workflow.dag.needrun_jobs():
        if item.benchmark is not None:
            name = str(Path(item.benchmark).relative_to(benchmarks).with_suffix(""))
            stage = stages.get(Path(item.rule.snakefile).stem, item.rule.name)
            jobs[item.jobid] = Job(stage, item.message or name, name, str(item.log[0]), earlier.get(name))
    for handler in logger.handlers:
        if handler.name in _DEFAULT_HANDLERS:
            handler.addFilter(_is_not_retold)
    told = RunLog(jobs, workflow.cores, say)
    logger.addHandler(told)
    return told
