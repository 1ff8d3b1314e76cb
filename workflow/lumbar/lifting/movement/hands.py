"""Hands that stand for a box without markers: where they lift and where they lower.

Reaching, swinging arms and small corrections also move the hands up and down, so that only great swings count: a
lift is the first rise, a deposit the last descent, of at least half the greatest one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lumbar.settings.lifting import EventSettings

GREAT = 0.5
"""Share of the greatest swing that makes another one great too."""


def turning_points(height: np.ndarray, size: float) -> list[int]:
    """Indices at which a trajectory turns, so that it goes at least `size` between any two.

    Parameters
    ----------
    height : ndarray, shape (n,)
        Finite.
    size : float
        In the unit of `height`; positive.

    Returns
    -------
    list of int
        Highest and lowest points in turn; fewer than two where it never goes that far.

    Examples
    --------
    >>> turning_points(np.array([0.0, 1.0, 0.9, 1.2, 0.2, 0.3]), 0.5)
    [0, 3, 4]
    """
    points: list[int] = []
    low = high = direction = 0
    for index, value in enumerate(height):
        low = index if direction <= 0 and value < height[low] else low
        high = index if direction >= 0 and value > height[high] else high
        if direction <= 0 and value - height[low] >= size:
            points.append(low)
            high, direction = index, 1
        elif direction >= 0 and height[high] - value >= size:
            points.append(high)
            low, direction = index, -1
    return [*points, high if direction > 0 else low] if points else []


def _swings(height: np.ndarray, size: float, sign: int) -> list[tuple[int, int]]:
    """First and last index of every great rise (`sign` 1) or descent (-1) of at least `size`."""
    swings = [
        pair
        for pair in pairwise(turning_points(height, size))
        if sign * (height[pair[1]] - height[pair[0]]) > 0
    ]
    greatest = max((abs(height[last] - height[first]) for first, last in swings), default=0.0)
    return [pair for pair in swings if abs(height[pair[1]] - height[pair[0]]) >= GREAT * greatest]


def hands_lifted(height: np.ndarray, settings: EventSettings) -> tuple[int, int] | None:
    """First and last index of the first great rise of the hands; None where they never rise by `hands_rise_m`.

    Parameters
    ----------
    height : ndarray, shape (n,)
        Of the hands in metres; finite.
    """
    swings = _swings(height, settings.hands_rise_m, 1)
    return swings[0] if swings else None


def great_rises(height: np.ndarray, settings: EventSettings) -> int:
    """Count the great rises of the hands of at least `hands_rise_m`; `height` as of `hands_lifted`."""
    return len(_swings(height, settings.hands_rise_m, 1))


def hands_lowered(height: np.ndarray, settings: EventSettings, greatest: bool) -> tuple[int, int] | None:
    """First and last index of the last descent of the hands; None where there is none of `descent_m`.

    Parameters
    ----------
    height : ndarray, shape (n,)
        Of the hands in metres, from the lift-off on; finite.
    greatest : bool
        Whether only great descents count: hands that hold nothing together may do anything besides.
    """
    if greatest:
        swings = _swings(height, settings.descent_m, -1)
        return swings[-1] if swings else None
    points = turning_points(height, settings.descent_m)
    ends = [pair for pair in pairwise(points) if height[pair[1]] < height[pair[0]]]
    return ends[-1] if ends else None
