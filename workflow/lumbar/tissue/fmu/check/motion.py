"""Positions to play, and the ways in which an FMU can be played."""

from __future__ import annotations

import random

from lumbar.tissue.fmu.check.instance import UnzippedFmu
from lumbar.tissue.fmu.conventions import REFERENCE


class Motion:
    """Positions to play, about rest and of the reference push's size.

    Attributes
    ----------
    rest, span : float
        First position of the reference, and the largest distance from it.
    """

    def __init__(self, fmu: UnzippedFmu):
        self.push = fmu.signal(REFERENCE[0])
        self.rest = self.push[0]
        self.span = max(abs(position - self.rest) for position in self.push) or 1.0

    def random(self, samples: int, seed: int, scale: float = 0.5) -> list[float]:
        """A random walk within the push's span, mirrored at its ends."""
        generator, position, positions = random.Random(seed), 0.0, []
        for _ in range(samples):
            position += generator.gauss(0.0, 0.2)
            position = max(-2.0 - position, min(2.0 - position, position))
            positions.append(self.rest + scale * self.span * position)
        return positions


def modes(fmu: UnzippedFmu) -> list[bool]:
    """Whether with event mode: the ways in which the FMU can be played."""
    return [False, True] if fmu.version == 3 and fmu.description.coSimulation.hasEventMode else [False]


def named(event_mode: bool) -> str:
    """Say the way of playing in words."""
    return "with event mode" if event_mode else "without event mode"
