"""Which frames about a leap are wrong: those in which the distances to other markers are not what they usually are.

A leap alone does not say it: a marker that drifted away for a second and leaps back is right in all the rest of the
recording, on both sides. Each distance d to another marker that the leap changes by s is therefore written as
x = (d - d before the leap) / s: about 0 where the marker is as just before the leap, about 1 where it is as just after it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.quality.leaps import LONGEST_GAP_S, Leap
from lumbar.records.stretches import runs

_MATES, _LEAST_MATES = 6, 2
_CLEAR = 4.0
"""How far the leap changes a distance, against the usual unrest of the distance, for it to tell."""
_LEAST_UNREST_M = 1e-3
_NEAR = 0.35
_TELLING = 0.7
"""Share of the frames that are like one side of the leap or the other for the distances to tell."""
_AS_BESIDE, _NOISES = 0.08, 3.0
_BACK_FRAMES = 5
_DRIFTING = 0.15
"""Change of x while the frames beside are looked at again: posture changes it more slowly."""
_STRAYED = 0.4
"""Change of x in 0.3 s on the right side of a leap: where it is more, and twice that on the other side, that one may be right."""
_BESIDE_S = 0.3
_ENOUGH_FRAMES = 2000
"""Frames, spread over a recording, from which the unrest of a distance is told."""
_SAME_FRAME = 3


@dataclass(frozen=True)
class Displaced:
    """Frames in which a marker is not where it belongs."""

    frames: slice
    leap: Leap
    """That leads there or back."""
    seen: str
    """What shows it, in words."""


@dataclass(frozen=True)
class _Sides:
    """The frames of a marker between both sides of one of its leaps.

    `likeness` is x, shape (n_frames,), NaN where it cannot be told; `right` is 0 where the marker is right before the leap and
    1 where it is after it; `seen` is what shows it.
    """

    likeness: np.ndarray
    right: int
    seen: str


def displaced(
    points: dict[str, np.ndarray], label: str, leaps: dict[str, list[Leap]], rate: float
) -> tuple[list[Displaced], list[Leap]]:
    """Return the frames in which a marker is displaced, and the leaps of which it cannot be told which side is right.

    Where the distances do not tell, the steps of successive leaps still add up: frames between a leap away and one back are
    displaced. A gap of more than half a second ends what can be compared.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Metres; NaN where not seen.
    leaps : dict of str to list of Leap
        By label.
    rate : float
        Frames per second.
    """
    seen = np.isfinite(points[label][:, 0])
    found: list[Displaced] = []
    untold: list[Leap] = []
    for section in _sections(seen, rate):
        inside = [leap for leap in leaps[label] if section.start < leap.first < section.stop]
        sides = [_sides(points, label, leap, _leaping(leaps, leap), rate) for leap in inside]
        told = [(leap, side) for leap, side in zip(inside, sides, strict=True) if side is not None]
        found += [
            Displaced(_wrong_frames(leap, side, section, inside, rate), leap, side.seen)
            for leap, side in told
        ]
        if len(told) < len(inside):
            away = _away_and_back(section, inside, seen)
            found += away
            certain = [one.frames for one in found]
            untold += [
                leap
                for leap, side in zip(inside, sides, strict=True)
                if side is None and not any(_bounds(leap, frames) for frames in certain)
            ]
    return _united(found, len(seen)), untold


def _leaping(leaps: dict[str, list[Leap]], leap: Leap) -> set[str]:
    """Labels of markers that leap at about the same frame: their distances do not tell which one is wrong."""
    return {
        label
        for label, others in leaps.items()
        if any(abs(other.first - leap.first) <= _SAME_FRAME for other in others)
    }


def _sections(seen: np.ndarray, rate: float) -> list[slice]:
    long = [gap for gap in runs(~seen) if gap.stop - gap.start > LONGEST_GAP_S * rate]
    edges = [0, *(edge for gap in long for edge in (gap.start, gap.stop)), len(seen)]
    return [slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=True)]


def _sides(
    points: dict[str, np.ndarray], label: str, leap: Leap, without: Collection[str], rate: float
) -> _Sides | None:
    """Tell the sides of a leap by the distances it changes most; None where they do not tell."""
    mates = []
    for other, positions in points.items():
        if other in without or other == label:
            continue
        ends = [
            np.linalg.norm(points[label][frames] - positions[frames], axis=1)
            for frames in (slice(max(0, leap.last - 2), leap.last + 1), slice(leap.first, leap.first + 3))
        ]
        if all(np.isfinite(end).any() for end in ends):
            before, after = (float(np.nanmedian(end)) for end in ends)
            if abs(after - before) <= _CLEAR * _LEAST_UNREST_M:
                continue
            unrest = max(_LEAST_UNREST_M, _spread(points[label], positions, leap))
            if abs(after - before) > _CLEAR * unrest:
                mates.append((unrest / abs(after - before), other, before, after - before))
    mates = sorted(mates, key=lambda mate: mate[0])[:_MATES]
    if len(mates) < _LEAST_MATES:
        return None
    mates = [
        (share, other, np.linalg.norm(points[label] - points[other], axis=1), before, step)
        for share, other, before, step in mates
    ]
    likeness = _likeness(mates)
    known = np.isfinite(likeness).sum()
    near = [int((np.abs(likeness - side) < _NEAR).sum()) for side in (0, 1)]
    if sum(near) < _TELLING * known:
        return None
    right = int(near[1] > near[0])
    beside = max(_BACK_FRAMES, round(_BESIDE_S * rate))
    strayed = (
        _largest(likeness[max(0, leap.last + 1 - beside) : leap.last + 1]),
        _largest(likeness[leap.first : leap.first + beside] - 1),
    )
    if strayed[right] > max(_STRAYED, 2 * strayed[1 - right]):
        return None
    _, mate, distance, before, step = mates[0]
    usual = float(np.nanmedian(distance[np.abs(likeness - right) < _NEAR]))
    there = before if right else before + step
    return _Sides(likeness, right, f"there {there * 1e3:.0f} mm from {mate}, usually {usual * 1e3:.0f} mm")


def _largest(values: np.ndarray) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else 0.0


def _spread(one: np.ndarray, other: np.ndarray, leap: Leap) -> float:
    """Standard deviation, by the quartiles, of the distance of two markers about its median on each side of a leap."""
    every = max(1, len(one) // _ENOUGH_FRAMES)
    distances = (
        np.linalg.norm(one[frames] - other[frames], axis=1)
        for frames in (slice(leap.last, None, -every), slice(leap.first, None, every))
    )
    sides = [side[np.isfinite(side)] for side in distances]
    low, high = np.percentile(np.concatenate([side - np.median(side) for side in sides]), (25, 75))
    return float(high - low) / 1.349


def _likeness(mates: list[tuple[float, str, np.ndarray, float, float]]) -> np.ndarray:
    """Mean of x over some mates, weighted by the inverse variance; NaN where less than half of the weight is seen."""
    weights = np.array([1 / share**2 for share, *_ in mates])[:, None]
    each = np.array([(distance - before) / step for _, _, distance, before, step in mates])
    known = np.where(np.isfinite(each), weights, 0.0)
    total = known.sum(axis=0)
    mean = (known * np.nan_to_num(each)).sum(axis=0) / np.where(total > 0, total, np.nan)
    return np.where(total >= 0.5 * weights.sum(), mean, np.nan)


def _wrong_frames(leap: Leap, sides: _Sides, section: slice, leaps: list[Leap], rate: float) -> slice:
    """Frames from a leap on, away from the side that is right, until the distances are what they are usually."""
    if sides.right:
        edges = [section.start, *(other.first for other in leaps if other.first <= leap.last)]
        frames = np.arange(leap.last, max(edges) - 1, -1)
    else:
        edges = [section.stop, *(other.last + 1 for other in leaps if other.last >= leap.first)]
        frames = np.arange(leap.first, min(edges))
    likeness = sides.likeness[frames]
    off = np.abs(likeness - sides.right)
    if np.mean(off[np.isfinite(off)] > _NEAR) > _TELLING:
        count = len(frames)
    else:
        # A drift begins below what posture changes: what is usual is taken from the frames beside it.
        count = _until_usual(off, _NEAR)
        grown = _until_as_beside(likeness, count, rate)
        while abs(likeness[grown - 1] - likeness[count - 1]) > _DRIFTING:
            count, grown = grown, _until_as_beside(likeness, grown, rate)
        count = grown
    wrong = frames[:count]
    return slice(int(wrong.min()), int(wrong.max()) + 1)


def _until_as_beside(likeness: np.ndarray, count: int, rate: float) -> int:
    """Count of frames, not below `count`, until x is what it is in the 0.3 s that follow."""
    beside = likeness[count : count + max(2 * _BACK_FRAMES, round(_BESIDE_S * rate))]
    beside = beside[np.isfinite(beside)]
    if len(beside) < 2 * _BACK_FRAMES:
        return count
    limit = max(_AS_BESIDE, _NOISES * float(np.median(np.abs(np.diff(beside)))))
    return max(count, _until_usual(np.abs(likeness - np.median(beside[len(beside) // 2 :])), limit))


def _until_usual(off: np.ndarray, limit: float) -> int:
    """Count of frames before the first five known ones in a row that are nearer to usual than a limit; at least one."""
    known = np.flatnonzero(np.isfinite(off))
    usual = off[known] < limit
    for run in runs(usual):
        if run.stop - run.start >= min(_BACK_FRAMES, len(usual)):
            return max(1, int(known[run.start]))
    return len(off)


def _away_and_back(section: slice, leaps: list[Leap], seen: np.ndarray) -> list[Displaced]:
    """Stretches between a leap away and one back, by the sums of their steps; those with most frames are right."""
    starts = [section.start, *(leap.first for leap in leaps)]
    stops = [*(leap.last + 1 for leap in leaps), section.stop]
    frames = [slice(*pair) for pair in zip(starts, stops, strict=True)]
    offsets = np.cumsum([np.zeros(3), *(leap.step for leap in leaps)], axis=0)
    tolerance = 0.4 * min(leap.size for leap in leaps)
    near = np.linalg.norm(offsets[:, None] - offsets[None], axis=2) < tolerance
    right = near[int(np.argmax(near @ [seen[part].sum() for part in frames]))]
    words = "and back: elsewhere than before and after"
    return [
        Displaced(frames[index], leaps[index - 1], words)
        for index in range(1, len(frames) - 1)
        if not right[index] and right[:index].any() and right[index:].any()
    ]


def _bounds(leap: Leap, frames: slice) -> bool:
    return leap.first == frames.start or leap.last + 1 == frames.stop


def _united(found: list[Displaced], n_frames: int) -> list[Displaced]:
    """Stretches without overlap, each with what was seen at the first leap of its own."""
    mask = np.zeros(n_frames, dtype=bool)
    for one in found:
        mask[one.frames] = True
    united = []
    for run in runs(mask):
        inside = [one for one in found if run.start <= one.frames.start < run.stop]
        first = min(inside, key=lambda one: one.leap.first)
        united.append(Displaced(run, first.leap, first.seen))
    return united
