"""Interpolation of a position that rests, then moves: one spline from corner to corner."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy

_REST_STEPS, _MAX_REST_SHARE = 4, 0.05
"""Number of steps at rest before or after a corner; their largest size, as a share of the step of the motion."""
_MIN_QUANTA, _MIN_RANGE_SHARE = 4.0, 0.02
"""Smallest step of the motion near a corner, in smallest differences of positions, because a coarse sensor in slow motion does
not rest at its levels; share of the range from which a step suffices."""


def corner_spline(time: np.ndarray, position: np.ndarray) -> Callable[..., np.ndarray]:
    """Return an interpolating quintic spline; its second derivative is accurate to the fourth order of the step.

    At a corner between rest and motion the spline begins again, at rest: a single spline would swing back and forth there,
    and a force that depends on the direction would change its sign while the tool rests.

    Parameters
    ----------
    time, position : numpy.ndarray, shape (samples,)
        Evenly spaced times in s, and positions.

    Returns
    -------
    callable
        Function of times and, optionally, the order of the derivative.
    """
    ends = [0, *_corners(position), len(position) - 1]
    if len(ends) == 2:
        return scipy.interpolate.make_interp_spline(time, position, k=5)
    free, rest = [(3, 0.0), (4, 0.0)], [(1, 0.0), (2, 0.0)]
    splines = [
        scipy.interpolate.make_interp_spline(
            time[first : last + 1],
            position[first : last + 1],
            k=5,
            bc_type=(rest if first else free, rest if last < ends[-1] else free),
        )
        for first, last in pairwise(ends)
    ]

    def interpolate(at: np.ndarray, order: int = 0) -> np.ndarray:
        number = np.searchsorted(time[ends[1:-1]], at, side="right")
        values = np.empty(np.shape(at))
        for index, spline in enumerate(splines):
            values[number == index] = spline(at[number == index], order)
        return values

    return interpolate


def _corners(position: np.ndarray) -> list[int]:
    """Return the indices of the samples at which a position abruptly leaves a rest or comes to rest."""
    steps, levels = np.abs(np.diff(position)), np.unique(position)
    if len(steps) <= 2 * _REST_STEPS or len(levels) < 2:
        return []
    least = min(_MIN_QUANTA * np.diff(levels).min(), _MIN_RANGE_SHARE * (levels[-1] - levels[0]))

    def departures(steps: np.ndarray) -> np.ndarray:
        largest = np.lib.stride_tricks.sliding_window_view(steps, _REST_STEPS).max(axis=1)
        before, at, after = (
            largest[:-_REST_STEPS],
            steps[_REST_STEPS:][: -_REST_STEPS + 1],
            largest[_REST_STEPS:],
        )
        found = np.flatnonzero((before < _MAX_REST_SHARE * at) & (after >= least)) + _REST_STEPS
        return found[np.diff(found, prepend=-len(steps)) > _REST_STEPS]

    return sorted({*departures(steps).tolist(), *(len(steps) - departures(steps[::-1])).tolist()})
