"""Logger of ``snakemake --logger lumbar``: at most ten lines of progress with the time left, and every warning and error."""

import sys
import time
from logging import WARNING, LogRecord

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

_LINES = 10
"""Largest number of lines of progress."""


class LogHandler(LogHandlerBase):
    """Short log on standard error; Snakemake's own log file is complete."""

    writes_to_stream = True
    writes_to_file = False
    has_filter = False
    has_formatter = False
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.seconds: dict[int, float] = {}
        """Expected seconds of every job that is not finished."""
        self.total = self.printed = 0.0
        """Expected seconds of all jobs, and those that were finished at the last line of progress."""
        self.start = time.monotonic()

    def emit(self, record: LogRecord) -> None:
        """Print a record if a user needs it."""
        event = getattr(record, "event", None)
        if hasattr(record, "job_seconds"):
            self.seconds, self.start = dict(record.job_seconds), time.monotonic()
            self.total = sum(self.seconds.values())
        elif event == LogEvent.JOB_FINISHED:
            self.seconds.pop(record.job_id, None)
        elif event == LogEvent.PROGRESS:
            self._print_progress(record.done, record.total)
        elif event == LogEvent.JOB_ERROR:
            self._print(f"{record.rule_name} failed; its log: {', '.join(record.log) or 'none'}")
        elif (
            record.levelno >= WARNING
            or self.common_settings.dryrun
            or record.getMessage().startswith("Nothing to be done")
        ):
            self._print(self.format(record))

    def _print_progress(self, done: int, jobs: int) -> None:
        finished = self.total - sum(self.seconds.values())
        if done == jobs or not finished or finished - self.printed < self.total / _LINES:
            return
        self.printed = finished
        left = (time.monotonic() - self.start) * (self.total / finished - 1)
        self._print(f"{done} of {jobs} jobs done, about {_duration(left)} left")

    def _print(self, text: str) -> None:
        if text:
            print(text, file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
