"""Long work in the background: in daemon threads that report their progress and can be cancelled."""

import asyncio
import contextlib
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

from lumbar.base.errors import LumbarError, user_message
from lumbar.base.progress import watch_progress

DRAWING = threading.Lock()
"""Lock for drawing: Matplotlib draws one figure at a time."""
WRITING = threading.Lock()
"""Lock for writing files: the server does not end while files are written."""
THREAD_NAME = "work of the page server"
"""Name of the background threads."""


class CancelledError(LumbarError):
    """Error that ends work because other work was requested."""


def page_message(error: Exception) -> str:
    """Return an error's message for the page; details of a fault of the program are printed."""
    message = user_message(error)
    if message is None:
        traceback.print_exception(error, file=sys.stderr)
        message = (
            f"the program failed ({type(error).__name__}); see the terminal of 'lumbar explore' for details"
        )
    return message


async def run_in_background(function: Callable, *arguments) -> Any:
    """Call a function in a daemon thread while the server goes on, and return its result."""
    loop = asyncio.get_running_loop()
    future = loop.create_future()

    def run() -> None:
        try:
            settle, value = future.set_result, function(*arguments)
        except Exception as error:
            settle, value = future.set_exception, error
        with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
            loop.call_soon_threadsafe(lambda: future.done() or settle(value))

    threading.Thread(target=run, name=THREAD_NAME, daemon=True).start()
    return await future


class Job:
    """Work in a thread: `progress` describes its step, `error` its failure; `done` is True when it has ended.

    The work has no arguments and reports its progress by `lumbar.base.progress`.
    """

    def __init__(self, work: Callable[[], Any]):
        self.progress, self.error = "reading the records", ""
        self._work, self._began = work, time.monotonic()
        self._cancelled, self.done = False, False
        threading.Thread(target=self._run, name=THREAD_NAME, daemon=True).start()

    @property
    def seconds(self) -> float:
        """Time in seconds since the start of the job."""
        return time.monotonic() - self._began

    def cancel(self) -> None:
        """Cancel the job at its next step."""
        self._cancelled = True

    def _run(self) -> None:
        try:
            with watch_progress(self._step):
                self._work()
        except Exception as error:
            self.error = page_message(error)
        finally:
            self.done = True

    def _step(self, progress: str) -> None:
        self.progress = progress or self.progress
        if self._cancelled:
            raise CancelledError("another diagnosis was started in its place")
