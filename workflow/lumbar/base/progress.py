"""Progress of long work: lines on standard error, and calls of a function that may stop the work."""

import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")
_MIN_INTERVAL_S = 2.0
_ERASE_REST = "\x1b[K"
_watcher: ContextVar[Callable[[str], None] | None] = ContextVar("watcher", default=None)


@contextmanager
def watch_progress(watcher: Callable[[str], None]) -> Iterator[None]:
    """Call `watcher` often during the block, with a text or ""; an exception from `watcher` ends the work."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


def notify_progress(text: str = "") -> None:
    """Call the watcher of `watch_progress`, if there is one."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher(text)


def track(items: Collection[Item], label: str) -> Iterator[Item]:
    """Yield `items` and print the number done and the expected time left, at most every two seconds.

    On a terminal all items share one line, which is erased at the end.
    """
    total, is_terminal = len(items), sys.stderr.isatty()
    start, end = ("\r", _ERASE_REST) if is_terminal else ("", "\n")
    last = began = time.monotonic()
    for done, item in enumerate(items):
        notify_progress(f"{label}: {done} of {total}")
        now = time.monotonic()
        if now - last >= _MIN_INTERVAL_S:
            left = f", about {(now - began) / done * (total - done):.0f} s left" if done else ""
            text = f"{label}: {done} of {total}{left}"
            print(f"{start}{text}", end=end, file=sys.stderr, flush=True)
            last = now
        yield item
    if is_terminal and last > began:
        print(f"\r{_ERASE_REST}", end="", file=sys.stderr, flush=True)
