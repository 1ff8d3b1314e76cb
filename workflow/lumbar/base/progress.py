"""Progress of long work: one line at a time on standard error, and to whoever watches it, who may end it."""

import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")
_EVERY_S = 2.0
_watcher: ContextVar[Callable[[str], None] | None] = ContextVar("watcher", default=None)


@contextmanager
def watch_progress(watcher: Callable[[str], None]) -> Iterator[None]:
    """Tell `watcher` of the work in the block, often: in words where they are known, else with ""; what it raises ends it."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


def notify_progress(words: str = "") -> None:
    """Tell whoever watches that the work goes on."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher(words)


def track(items: Collection[Item], label: str) -> Iterator[Item]:
    """Yield `items`, saying on standard error how many are done and how long the rest may take, at most every two seconds."""
    total = len(items)
    last = began = time.monotonic()
    for done, item in enumerate(items):
        notify_progress(f"{label}: {done} of {total}")
        now = time.monotonic()
        if now - last >= _EVERY_S:
            left = f", about {(now - began) / done * (total - done):.0f} s left" if done else ""
            print(f"{label}: {done} of {total}{left}", file=sys.stderr, flush=True)
            last = now
        yield item
