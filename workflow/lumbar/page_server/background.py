"""Long work beside the server: in threads that end with it, that say how far they are, and that can be ended."""

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
"""Held where figures are drawn: Matplotlib draws one at a time."""
WRITING = threading.Lock()
"""Held where files are written: the server does not end in between."""
BESIDE = "beside the server"
"""Name of the threads in which work goes on."""


class Cancelled(LumbarError):
    """Work that was ended since something else was asked for."""


def page_message(error: Exception) -> str:
    """Return an error in words for the page; the details of one that the program made are printed."""
    words = user_message(error)
    if words is None:
        traceback.print_exception(error, file=sys.stderr)
        words = f"the program failed ({type(error).__name__}); the details stand where 'lumbar explore' was started"
    return words


async def in_background(function: Callable, *arguments) -> Any:
    """Return what a function returns while the server goes on; its thread does not keep the program from ending."""
    loop = asyncio.get_running_loop()
    future = loop.create_future()

    def settle(set_it: Callable, value: Any) -> None:
        if not future.done():
            set_it(value)

    def run() -> None:
        try:
            outcome = future.set_result, function(*arguments)
        except Exception as error:
            outcome = future.set_exception, error
        with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
            loop.call_soon_threadsafe(settle, *outcome)

    threading.Thread(target=run, name=BESIDE, daemon=True).start()
    return await future


class Job:
    """Work that runs once in a thread of its own; `words` say how far it is, `error` why it failed, `done` that it has ended.

    Parameters
    ----------
    work : callable
        Without arguments; tells how far it is by `lumbar.base.progress`.
    """

    def __init__(self, work: Callable[[], Any]):
        self.words, self.error = "reading the records", ""
        self._work, self._began = work, time.monotonic()
        self._cancelled, self.done = False, False
        threading.Thread(target=self._run, name=BESIDE, daemon=True).start()

    @property
    def seconds(self) -> float:
        """How long it has been going on."""
        return time.monotonic() - self._began

    def cancel(self) -> None:
        """End it at its next step."""
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
