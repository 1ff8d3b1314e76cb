"""Frames in which a marker is not where it belongs: about a leap, and off the rigid part that it is on.

A leap alone does not say which frames are wrong: a marker that drifted away for a second and leaps back is right in all the
rest of the recording, on both sides. Each distance d to another marker that the leap changes by s is therefore written as
x = (d - d before the leap) / s: about 0 where the marker is as just before the leap, about 1 where it is as just after it.

Rigid parts (a box, a plate, a pelvis, a thorax) are found from the recording itself, by distances that stay while they move.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import asymmetry
from lumbar.lifting.quality.leaps import LONGEST_GAP_S, Leap
from lumbar.lifting.quality.sheet import Legend
from lumbar.records.stretches import runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "displacement")


ALONE = "by most frames alone"
"""Said of a leap of which no symmetry shows the right side, and of which the shorter part is not short."""


@dataclass(frozen=True)
class Displacement:
    """Frames in which a marker is not where it belongs."""

    frames: slice
    leap: Leap
    """That leads there or back."""
    seen: str
    """What shows it, in words."""


def displacements(
    points: dict[str, np.ndarray], label: str, leaps: dict[str, list[Leap]], legend: Legend
) -> tuple[list[Displacement], list[Leap]]:
    """Return the frames in which a marker is displaced, and the leaps of which it cannot be told which side is right.

    Where the distances do not tell, the steps of successive leaps still add up: frames between a leap away and one back are
    displaced. A gap of more than half a second ends what can be compared. Points in metres, shape (n_frames, 3), and leaps
    are those of all markers, by label.
    """
    seen, rate = np.isfinite(points[label][:, 0]), legend.rate

    @cache
    def distance(other: str) -> np.ndarray:
        return np.linalg.norm(points[label] - points[other], axis=1)

    others = [other for other in points if other != label]
    found: list[Displacement] = []
    untold: list[Leap] = []
    for section in _sections(seen, rate):
        inside = [leap for leap in leaps[label] if section.start < leap.first < section.stop]
        beside = max(_AT.back_frames, round(_AT.beside_s * rate))
        better = [_better_side(points, label, leap, beside, legend.named) for leap in inside]
        sides = [
            _sides(distance, others, leap, _leaping(leaps, leap), rate, side)
            for leap, side in zip(inside, better, strict=True)
        ]
        told = [(leap, side) for leap, side in zip(inside, sides, strict=True) if side is not None]
        found += [
            Displacement(_wrong_frames(leap, likeness, right, section, inside, rate), leap, shown)
            for leap, (likeness, right, shown) in told
        ]
        if len(told) < len(inside):
            away = _away_and_back(section, inside, seen)
            found += away
            certain = [one.frames for one in found]
            untold += [
                leap
                for leap, side in zip(inside, sides, strict=True)
                if side is None
                and not any(leap.first == frames.start or leap.last + 1 == frames.stop for frames in certain)
            ]
    return _united(found, len(seen)), untold


def _better_side(
    points: dict[str, np.ndarray], label: str, leap: Leap, beside: int, named: dict[str, str]
) -> int | None:
    """0 where the marker is clearly nearer to a body's symmetry just before a leap, 1 where it is just after it."""
    parts = slice(max(0, leap.last + 1 - beside), leap.last + 1), slice(leap.first, leap.first + beside)
    off = [asymmetry({name: points[name][part] for name in {*named, label}}, named, label) for part in parts]
    return int(off[0] > off[1]) if abs(off[0] - off[1]) > _AT.clearly_m else None


def _leaping(leaps: dict[str, list[Leap]], leap: Leap) -> set[str]:
    """Labels of markers that leap at about the same frame: their distances do not tell which one is wrong."""
    return {
        label
        for label, others in leaps.items()
        if any(abs(other.first - leap.first) <= _AT.same_frame for other in others)
    }


def _sections(seen: np.ndarray, rate: float) -> list[slice]:
    long = [gap for gap in runs(~seen) if gap.stop - gap.start > LONGEST_GAP_S * rate]
    edges = [0, *(edge for gap in long for edge in (gap.start, gap.stop)), len(seen)]
    return [slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=True)]


def _sides(
    distance: Callable,
    others: list[str],
    leap: Leap,
    without: Collection[str],
    rate: float,
    better: int | None,
) -> tuple[np.ndarray, int, str] | None:
    """Tell the sides of a leap by the distances, a function of the other label, it changes most; None where they do not tell.

    First comes x, shape (n_frames,), NaN where it cannot be told, then 0 where the marker is right before the leap and 1 where
    it is after it, then what shows it.
    Right is the side that the body says is `better`; where it says none, the one of most frames.
    """
    mates = []
    for other in others:
        if other in without:
            continue
        about = slice(max(0, leap.last - 2), leap.last + 1), slice(leap.first, leap.first + 3)
        ends = [end[np.isfinite(end)] for end in map(distance(other).__getitem__, about)]
        if all(end.size for end in ends):
            before, after = (float(np.sort(end)[[(end.size - 1) // 2, end.size // 2]].mean()) for end in ends)
            if abs(after - before) <= _AT.clear * _AT.least_unrest_m:
                continue
            unrest = max(_AT.least_unrest_m, _spread(distance(other), leap))
            if abs(after - before) > _AT.clear * unrest:
                mates.append((unrest / abs(after - before), other, before, after - before))
    mates = sorted(mates, key=lambda mate: mate[0])[: _AT.mates]
    if len(mates) < _AT.least_mates:
        return None
    mates = [(share, other, distance(other), before, step) for share, other, before, step in mates]
    likeness = _likeness(mates)
    known = np.isfinite(likeness).sum()
    near = [int((np.abs(likeness - side) < _AT.near).sum()) for side in (0, 1)]
    if sum(near) < _AT.telling * known:
        return None
    right = int(near[1] > near[0]) if better is None else better
    beside = max(_AT.back_frames, round(_AT.beside_s * rate))
    strayed = (
        _largest(likeness[max(0, leap.last + 1 - beside) : leap.last + 1]),
        _largest(likeness[leap.first : leap.first + beside] - 1),
    )
    if strayed[right] > max(_AT.strayed, 2 * strayed[1 - right]):
        return None
    _, mate, distance, before, step = mates[0]
    usual = float(np.nanmedian(distance[np.abs(likeness - right) < _AT.near]))
    there = before if right else before + step
    shown = f"there {there * 1e3:.0f} mm from {mate}, usually {usual * 1e3:.0f} mm"
    if better is None and min(near) > _AT.doubtful * sum(near):
        shown += f" ({ALONE}: the other part may be the wrong one)"
    return likeness, right, shown


def _largest(values: np.ndarray) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else 0.0


def _spread(distance: np.ndarray, leap: Leap) -> float:
    """Standard deviation, by the quartiles, of the distance of two markers about its median on each side of a leap."""
    every = max(1, len(distance) // _AT.enough_frames)
    each = distance[leap.last :: -every], distance[leap.first :: every]
    sides = [side[np.isfinite(side)] for side in each]
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


def _wrong_frames(
    leap: Leap, likeness: np.ndarray, right: int, section: slice, leaps: list[Leap], rate: float
) -> slice:
    """Frames from a leap on, away from the side that is right, until the distances are what they are usually."""
    if right:
        edges = [section.start, *(other.first for other in leaps if other.first <= leap.last)]
        frames = np.arange(leap.last, max(edges) - 1, -1)
    else:
        edges = [section.stop, *(other.last + 1 for other in leaps if other.last >= leap.first)]
        frames = np.arange(leap.first, min(edges))
    likeness = likeness[frames]
    off = np.abs(likeness - right)
    if np.mean(off[np.isfinite(off)] > _AT.near) > _AT.telling:
        count = len(frames)
    else:
        # A drift begins below what posture changes: what is usual is taken from the frames beside it.
        count = _until_usual(off, _AT.near)
        grown = _until_as_beside(likeness, count, rate)
        while abs(likeness[grown - 1] - likeness[count - 1]) > _AT.drifting:
            count, grown = grown, _until_as_beside(likeness, grown, rate)
        count = grown
    wrong = frames[:count]
    return slice(int(wrong.min()), int(wrong.max()) + 1)


def _until_as_beside(likeness: np.ndarray, count: int, rate: float) -> int:
    """Count of frames, not below `count`, until x is what it is in the 0.3 s that follow."""
    beside = likeness[count : count + max(2 * _AT.back_frames, round(_AT.beside_s * rate))]
    beside = beside[np.isfinite(beside)]
    if len(beside) < 2 * _AT.back_frames:
        return count
    limit = max(_AT.as_beside, _AT.noises * float(np.median(np.abs(np.diff(beside)))))
    return max(count, _until_usual(np.abs(likeness - np.median(beside[len(beside) // 2 :])), limit))


def _until_usual(off: np.ndarray, limit: float) -> int:
    """Count of frames before the first five known ones in a row that are nearer to usual than a limit; at least one."""
    known = np.flatnonzero(np.isfinite(off))
    usual = off[known] < limit
    for run in runs(usual):
        if run.stop - run.start >= min(_AT.back_frames, len(usual)):
            return max(1, int(known[run.start]))
    return len(off)


def _away_and_back(section: slice, leaps: list[Leap], seen: np.ndarray) -> list[Displacement]:
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
        Displacement(frames[index], leaps[index - 1], words)
        for index in range(1, len(frames) - 1)
        if not right[index] and right[:index].any() and right[index:].any()
    ]


def _united(found: list[Displacement], n_frames: int) -> list[Displacement]:
    """Stretches without overlap, each with what was seen at the first leap of its own."""
    mask = np.zeros(n_frames, dtype=bool)
    for one in found:
        mask[one.frames] = True
    united = []
    for run in runs(mask):
        inside = [one for one in found if run.start <= one.frames.start < run.stop]
        first = min(inside, key=lambda one: one.leap.first)
        united.append(Displacement(run, first.leap, first.seen))
    return united


def _rigid_parts(points: dict[str, np.ndarray], rate: float) -> dict[str, list[tuple[str, float]]]:
    """Mates whose distance from a marker is constant while either moves, with its spread in metres; at most `mates`.

    What rests tells nothing: two feet on the ground are not one body.
    """
    labels = list(points)
    every = max(1, round(_AT.moving_s * rate / 8))
    lag = max(1, round(_AT.moving_s * rate / every))
    spreads = np.full((len(labels), len(labels)), np.nan)
    for index, label in enumerate(labels):
        places = points[label][::every]
        with np.errstate(invalid="ignore"):
            frames = np.flatnonzero(np.linalg.norm(places[lag:] - places[:-lag], axis=1) > _AT.moving_m)
        if len(frames) * every >= _AT.moving_s * rate:
            chosen = frames[np.linspace(0, len(frames) - 1, min(len(frames), _AT.samples)).astype(int)]
            sample = np.stack([points[other][chosen * every] for other in labels])
            low, middle, high = percentiles(np.linalg.norm(sample - sample[index], axis=2), (0.05, 0.5, 0.95))
            spreads[:, index] = np.where(middle > _AT.apart_m, high - low, np.nan)
    spreads = np.maximum(spreads, spreads.T)
    return {
        label: [
            (labels[other], float(row[other]))
            for other in np.argsort(row)[: _AT.mates]
            if row[other] < _AT.rigid_m
        ]
        for label, row in zip(labels, spreads, strict=True)
    }


def percentiles(values: np.ndarray, shares: tuple[float, ...]) -> np.ndarray:
    """Of each row over what is finite, shape (n_shares, n_rows); NaN with fewer than ten finite values.

    By one sorting: NumPy's own percentiles without NaN go through the rows one by one.
    """
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    at = np.round(np.outer(shares, np.maximum(count - 1, 0))).astype(int)
    found = np.take_along_axis(ordered, at.T, axis=1).T
    return np.where(count >= min(10, values.shape[1]), found, np.nan)


def steadiest_mate(sample: dict[str, np.ndarray], label: str) -> str | None:
    """Return the marker at the most constant distance from one; None if fewer than three are at a nearly constant distance."""
    labels = list(sample)
    distance = np.linalg.norm(np.stack([sample[other] for other in labels]) - sample[label], axis=2)
    low, middle, high = percentiles(distance, (0.05, 0.5, 0.95))
    spread = np.hypot(high - low, _AT.bends * middle)
    usable = (middle > _AT.apart_m) & (np.isfinite(distance).mean(axis=1) > _AT.seen) & (spread < _AT.loose_m)
    if usable.sum() < _AT.fewest_mates:
        return None
    return labels[int(np.argmin(np.where(usable, spread, np.inf)))]


def length(points: dict[str, np.ndarray], one: str, other: str, frames: slice | np.ndarray) -> float:
    """Median distance of two markers over some frames, metres; NaN where they were not seen together."""
    distance = np.linalg.norm(points[one][frames] - points[other][frames], axis=1)
    return float(np.nanmedian(distance)) if np.isfinite(distance).any() else np.nan


def off_its_part(points: dict[str, np.ndarray], rate: float) -> list[tuple[str, slice, str]]:
    """Stretches in which a marker is not where the rigid part that it belongs to has it.

    A marker counts as part of a rigid one by three mates at distances that stay within 8 mm in nine of ten frames in which either
    moves. It is off where most of these differ by more than 30 mm, and by six times their usual spread, from their medians.

    Each stretch has its label, its frames and what was seen.
    """
    found = []
    known: dict[frozenset[str], np.ndarray] = {}
    for label, rigid in _rigid_parts(points, rate).items():
        if len(rigid) >= _AT.least_of_part:
            for other, _ in rigid:
                if frozenset((label, other)) not in known:
                    distance = np.linalg.norm(points[label] - points[other], axis=1)
                    # The median of the seen frames: np.nanmedian takes twice as long.
                    change = distance - np.median(distance[np.isfinite(distance)])
                    known[frozenset((label, other))] = change.astype(np.float32)
            changes = {other: known[frozenset((label, other))] for other, _ in rigid}
            limits = [max(_AT.deviation_m, _AT.spreads * spread) for _, spread in rigid]
            found += _stretches_off(label, changes, limits)
    return found


def _stretches_off(
    label: str, changes: dict[str, np.ndarray], limits: list[float]
) -> list[tuple[str, slice, str]]:
    change = np.abs(list(changes.values()))
    with np.errstate(invalid="ignore"):
        far = (change > np.array(limits)[:, None]).sum(axis=0)
    together = np.isfinite(change).sum(axis=0)
    stretches = runs((far > _AT.majority * together) & (together >= _AT.least_of_part))
    mates = ", ".join(changes)
    return [
        (
            label,
            stretch,
            f"up to {np.nanmax(change[:, stretch]) * 1e3:.0f} mm off its distances from {mates}, constant elsewhere",
        )
        for stretch in stretches
        if stretch.stop - stretch.start >= _AT.shortest
    ]
