"""Progress of long work, one line at a time on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")
_EVERY_S = 2.0


def track(items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items`, saying on standard error how many are done and how long the rest may take, at most every two seconds."""
    total = len(items) if total is None else total  # type: ignore[arg-type]
    last = began = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - last >= _EVERY_S:
            left = f", about {(now - began) / done * (total - done):.0f} s left" if done else ""
            print(f"{label}: {done} of {total}{left}", file=sys.stderr, flush=True)
            last = now
        yield item
