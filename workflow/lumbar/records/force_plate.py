"""What one force plate measured: the force of the ground on the person, its centre of pressure and its free moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNLOADED_N = 20.0
"""Vertical force below which a plate counts as unloaded: the centre of pressure is a ratio of noise there."""


@dataclass(frozen=True, repr=False)
class ForcePlate:
    """What one force plate measured."""

    name: str
    """E.g. ``"plate 1"``."""
    time: np.ndarray
    """Shape (n,): seconds on the clock of the markers."""
    force: np.ndarray
    """Shape (n, 3): force of the ground on the person in newtons: lateral (right), forward, up."""
    centre_of_pressure: np.ndarray
    """Shape (n, 3): metres; NaN where less than `UNLOADED_N` press on the plate."""
    free_moment: np.ndarray
    """Shape (n,): moment about the vertical through the centre of pressure, in N·m; NaN as above."""
    rate: float
    """Samples per second."""
    corners: np.ndarray | None = None
    """Shape (4, 3), or None: metres; None where a file states none."""
    notes: tuple[str, ...] = ()
    """What was taken for granted or changed: a reversed sign, a baseline that was subtracted, a unit."""

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        largest = self.force[:, 2].max() if len(self) else 0
        return f"<ForcePlate {self.name}: {len(self)} samples at {self.rate:g} Hz, up to {largest:.0f} N>"
