"""Progress of long work, one line at a time on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


def track(items: Iterable[Item], label: str, total: int | None = None, every: float = 2.0) -> Iterator[Item]:
    """Yield `items`, saying on standard error how many are done, at most every `every` seconds."""
    total = len(items) if total is None else total  # type: ignore[arg-type]
    last = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - last >= every:
            print(f"{label}: {done} of {total}", file=sys.stderr, flush=True)
            last = now
        yield item
