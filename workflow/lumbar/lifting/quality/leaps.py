"""Leaps of a marker from one frame to the next that no body makes.

Between frames k and k + 1 the line through frames k - 1 and k and that through k + 1 and k + 2 are continued to the middle; what
lies between them there is half the third difference. Constant velocity and acceleration leave it zero, so that a fast
movement is no leap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.stretches import runs

SMALLEST_M = 0.02
"""Leaps below are not told from the unrest of real markers: untouched recordings have up to 14 mm."""
_JERK_M_S3 = 2500.0
"""Half the jerk of a foot that strikes the floor: with the cube of the sampling time it moves a marker as a leap would."""
_BLOCK = 32
ABOVE_UNREST = 8.0
"""How far a leap stands out of the marker's own third differences beside it (their 80th percentile)."""
LONGEST_GAP_S = 0.5
"""Across longer gaps nothing is compared."""
_GAP_M, _GAP_M_S2 = 0.05, 4.0
"""What a marker may be off after a gap of t seconds: a constant and a share of t squared."""
_LINE = 3


@dataclass(frozen=True)
class Leap:
    """A marker is elsewhere from one seen frame to the next."""

    last: int
    first: int
    """`last`, `first`: last frame before and first frame after."""
    before: np.ndarray
    after: np.ndarray
    """`before`, `after`: shape (3,): where the movement before and the one after it put the marker in the middle between
    them, metres."""

    @property
    def step(self) -> np.ndarray:
        """Displacement, shape (3,), metres."""
        return self.after - self.before

    @property
    def size(self) -> float:
        """Metres."""
        return float(np.linalg.norm(self.step))


def find_leaps(positions: np.ndarray, rate: float) -> tuple[list[Leap], list[slice]]:
    """Return the leaps of one marker and its spikes, which come back within a few frames.

    Parameters
    ----------
    positions : ndarray, shape (n_frames, 3)
        Metres; NaN where not seen.
    rate : float
        Frames per second.

    Returns
    -------
    leaps : list of Leap
    spikes : list of slice
    """
    size = step_sizes(positions)
    threshold = _thresholds(size, rate)
    with np.errstate(invalid="ignore"):
        large = size > threshold
    # Responses to one leap are up to two steps apart.
    for cluster in list(runs(large)):
        large[cluster.stop : cluster.stop + 2] |= large[cluster.stop + 2 : cluster.stop + 4].any()
    leaps, spikes = [], []
    for cluster in runs(large):
        last, first = cluster.start, cluster.stop
        before, after = _continued(positions, last, first)
        if np.linalg.norm(after - before) > threshold[cluster].min():
            at = cluster.start + int(np.nanargmax(size[cluster]))
            leaps.append(Leap(at, at + 1, before, after))
        elif first - last > 1:
            spikes.append(_spike(positions, last, first))
    leaps += _across_gaps(positions, rate)
    return sorted(leaps, key=lambda leap: leap.first), spikes


def step_sizes(positions: np.ndarray) -> np.ndarray:
    """Distance, in metres, of both continuations between each frame and the next, shape (n_frames - 1,); NaN at the ends."""
    size = np.full(max(len(positions) - 1, 0), np.nan)
    if len(positions) > 3:
        steps = 1.5 * (positions[2:-1] - positions[1:-2]) - 0.5 * (positions[3:] - positions[:-3])
        size[1:-1] = np.linalg.norm(steps, axis=1)
    return size


def unrest(size: np.ndarray) -> np.ndarray:
    """80th percentile of the steps of a marker in each block of frames, shape of `size`."""
    blocks = -(-len(size) // _BLOCK)
    padded = np.full(blocks * _BLOCK, np.nan)
    padded[: len(size)] = size
    ordered = np.sort(padded.reshape(blocks, _BLOCK), axis=1)
    at = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0) * 4 // 5
    found = np.nan_to_num(np.take_along_axis(ordered, at[:, None], axis=1))
    return np.repeat(found, _BLOCK)[: len(size)]


def _thresholds(size: np.ndarray, rate: float) -> np.ndarray:
    """Size from which a step is a leap, by the unrest of the marker about it, shape of `size`."""
    return np.maximum(max(SMALLEST_M, _JERK_M_S3 / rate**3), ABOVE_UNREST * unrest(size))


def _line(positions: np.ndarray, frames: np.ndarray, at: float) -> np.ndarray:
    """Continue the straight line through some frames to another time, in frames."""
    known = frames[np.isfinite(positions[frames, 0])]
    if len(known) < 2:
        return positions[known[-1]] if len(known) else np.full(3, np.nan)
    centred = known - known.mean()
    slope = centred @ positions[known] / (centred @ centred)
    return positions[known].mean(axis=0) + slope * (at - known.mean())


def _continued(positions: np.ndarray, last: int, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the frames up to `last` and those from `first` on put a marker in the middle between them."""
    middle = (last + first) / 2
    before = np.arange(max(0, last - _LINE + 1), last + 1)
    after = np.arange(first, min(len(positions), first + _LINE))
    return _line(positions, before, middle), _line(positions, after, middle)


def _spike(positions: np.ndarray, last: int, first: int) -> slice:
    """Frames between two that are farther from the straight way than half the farthest."""
    share = np.linspace(0, 1, first - last + 1)[:, None]
    way = positions[last] + share * (positions[first] - positions[last])
    off = np.linalg.norm(positions[last : first + 1] - way, axis=1)
    where = np.flatnonzero(off >= 0.5 * np.nanmax(off))
    return slice(last + int(where[0]), last + int(where[-1]) + 1)


def _across_gaps(positions: np.ndarray, rate: float) -> list[Leap]:
    """Leaps between the last frame before a gap and the first after it."""
    leaps = []
    seen = np.isfinite(positions[:, 0])
    for gap in runs(~seen):
        seconds = (gap.stop - gap.start) / rate
        beside = seen[max(0, gap.start - _LINE) : gap.start], seen[gap.stop : gap.stop + _LINE]
        if seconds > LONGEST_GAP_S or min(side.sum() for side in beside) < _LINE:
            continue
        before, after = _continued(positions, gap.start - 1, gap.stop)
        if np.linalg.norm(after - before) > _GAP_M + _GAP_M_S2 * seconds**2:
            leaps.append(Leap(gap.start - 1, gap.stop, before, after))
    return leaps
