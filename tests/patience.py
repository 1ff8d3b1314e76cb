"""How tests wait for what other threads and processes do: until it is there, however long a busy machine takes."""

import time
from collections.abc import Callable
from typing import TypeVar

Seen = TypeVar("Seen")

PATIENCE_S = 900
"""Ends a wait for what will never come; nothing is asserted of time."""


def wait_until(look: Callable[[], Seen], every_s: float = 0.02) -> Seen:
    """Return what `look` returns as soon as that is true."""
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > end:
            raise TimeoutError(f"not seen within {PATIENCE_S} s")
        time.sleep(every_s)
    return found
