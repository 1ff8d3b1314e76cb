"""Whether a recording's rate can be that of a person: the frequency scale of the movement.

The root mean square of the acceleration over that of the velocity is a frequency and grows with the rate stated. Of lifts,
squats, gait, standing up and picking up (15 recordings of six laboratories) it lies between 0.42 and 0.79 Hz. A rate wrong
by four is seen in all of them, one wrong by two in none, and in a recording of a person who stands still no rate is.
"""

from __future__ import annotations

import numpy as np

FINE_RATE = "rate off by less than four times"
"""What the tempo does not tell."""
LOWEST_HZ, HIGHEST_HZ = 0.2, 1.6
"""Half of the lowest and twice the highest frequency scale of real movements, about."""
USUAL_HZ = 0.57
_MOVES_M = 0.15
"""How far the middle of the body must move for its tempo to say something."""
_SMOOTHED_SHARE, _ROUNDS = 0.06, 4
_FEWEST_FRAMES = 30
_MOST_MARKERS = 20
"""Markers looked at, evenly among all: a body's markers move together."""


def frequency_scale(points: dict[str, np.ndarray], rate: float) -> float | None:
    """Frequency scale in hertz of points by label, shape (n_frames, 3) in metres; None of a person who hardly moves."""
    if not tells_tempo(points):
        return None
    points = _some(points)
    n_frames = len(next(iter(points.values())))
    # Smoothed over a share of its own period, which no statement of a rate changes.
    width = n_frames // 10
    for _ in range(_ROUNDS):
        cycles = _cycles_per_frame(points, width)
        if not cycles > 0:
            return None
        width = int(np.clip(_SMOOTHED_SHARE / cycles, 3, n_frames // 10))
    return float(cycles * rate)


def tells_tempo(points: dict[str, np.ndarray]) -> bool:
    """Whether a movement is long and large enough for its tempo to say something."""
    n_frames = len(next(iter(points.values())))
    return n_frames >= _FEWEST_FRAMES and _way(_some(points)) >= _MOVES_M


def _some(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    every = -(-len(points) // _MOST_MARKERS)
    return {label: points[label] for label in list(points)[::every]}


def _way(points: dict[str, np.ndarray]) -> float:
    """Median over the markers of the longest way along one axis, metres."""
    seen = [positions[np.isfinite(positions[:, 0])] for positions in points.values()]
    return float(
        np.median([np.ptp(positions, axis=0).max() for positions in seen if len(positions)] or [0.0])
    )


def _cycles_per_frame(points: dict[str, np.ndarray], width: int) -> float:
    """Root mean square of the second over that of the first differences, both smoothed, over 2 pi."""
    first, second = [], []
    for positions in points.values():
        speed = _moving_mean(np.diff(positions, axis=0), width)
        change = _moving_mean(np.diff(speed, axis=0), width)
        first.append(speed[np.isfinite(speed)] ** 2)
        second.append(change[np.isfinite(change)] ** 2)
    speeds, changes = np.concatenate(first), np.concatenate(second)
    if not speeds.size or not changes.size or not speeds.any():
        return np.nan
    return float(np.sqrt(changes.mean() / speeds.mean()) / (2 * np.pi))


def _moving_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Mean over `width` frames, NaN where one of them is missing, shape (n_frames - width + 1, 3)."""
    sums = np.cumsum(np.vstack([np.zeros(3), np.nan_to_num(values)]), axis=0)
    missing = np.cumsum(np.concatenate([[0], ~np.isfinite(values[:, 0])]))
    means = (sums[width:] - sums[:-width]) / width
    means[(missing[width:] - missing[:-width]) > 0] = np.nan
    return means
