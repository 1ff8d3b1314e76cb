"""How a pendulum is made of a lift: the four choices that Eq. 4.1 and its text leave open, and those of the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

SIGN = ("hanging", "inverted")
TIME = ("real", "unit")
MASS = ("with_box", "without_box")
PIVOT = ("mid_ankle", "hip")


@dataclass(frozen=True, order=True)
class Convention:
    """One way to make a pendulum of a recorded deposit."""

    sign: str
    """Sign of gravity in Eq. 4.1."""
    time: str
    """Whether the movement lasts as long as it was recorded or one second."""
    mass: str
    """Whether the box counts to the pendulum's mass."""
    pivot: str
    """Point about which the pendulum turns (or another of `lumbar.lifting.movement.pendulum_states.PIVOTS`)."""

    def __str__(self) -> str:
        time = {"real": "real time", "unit": "unit time"}[self.time]
        return ", ".join([self.sign, time, *(part.replace("_", " ") for part in (self.mass, self.pivot))])


THESIS = Convention("hanging", "unit", "without_box", "mid_ankle")
"""The thesis's own wording: + in Eq. 4.1, trajectories interpolated "to non-dimensionalize time", "subject mass"; of the
pivot it shows only Figure 4.1, a pendulum over the feet."""
GRID = tuple(Convention(*choice) for choice in product(SIGN, TIME, MASS, PIVOT))
"""Every way, in the order of Table 4.1's grid."""
