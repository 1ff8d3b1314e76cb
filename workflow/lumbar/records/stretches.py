"""Stretches of samples: where something holds without a break."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def runs(flags: np.ndarray) -> Iterator[slice]:
    """Yield the contiguous stretches in which `flags`, shape (n,), is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(flags, dtype=np.int8), [0]))))
    for start, stop in edges.reshape(-1, 2):
        yield slice(int(start), int(stop))
