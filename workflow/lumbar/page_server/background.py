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
"""Lock for writing files: the server does not end in between."""
BESIDE = "beside the server"
"""Name of the background threads."""


class Cancelled(LumbarError):
    """Work that was cancelled since other work was requested."""


def page_message(error: Exception) -> str:
    """Return an error's message for the page; details of a fault of the program are printed."""
    words = user_message(error)
    if words is None:
        traceback.print_exception(error, file=sys.stderr)
        words = (
            f"the program failed ({type(error).__name__}); the details are where 'lumbar explore' was started"
        )
    return words


async def in_background(function: Callable, *arguments) -> Any:
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

    threading.Thread(target=run, name=BESIDE, daemon=True).start()
    return await future


class Job:
    """Work in a thread: `words` is its progress, `error` why it failed, `done` whether it has ended.

    Parameters
    ----------
    work : callable
        Without arguments; reports its progress by `lumbar.base.progress`.
    """

    def __init__(self, work: Callable[[], Any]):
        self.words, self.error = "reading the records", ""
        self._work, self._began = work, time.monotonic()
        self._cancelled, self.done = False, False
        threading.Thread(target=self._run, name=BESIDE, daemon=True).start()

    @property
    def seconds(self) -> float:
        """Duration so far."""
        return time.monotonic() - self._began

    def cancel(self) -> None:
        """Cancel it at its next step."""
        self._cancelled = True

    def _run(self) -> None:
        try:
            with watch_progress(self._step):
                self._work()
        except Exception as error:
            self.error = page_message(error)
        finally:
            self.done = True

    def _step(self, words: str) -> None:
        self.words = words or self.words
        if self._cancelled:
            raise Cancelled("another diagnosis was begun in its place")
