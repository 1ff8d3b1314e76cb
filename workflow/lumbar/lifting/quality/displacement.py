"""Frames in which a marker is displaced: on the wrong side of a leap, or away from its place on a rigid part.

A leap does not show which frames are wrong: a marker that drifted away for a second and leaps back is correct in the rest of the
recording, on both sides. Each distance d to another marker that the leap changes by s is therefore scaled to x = (d - d before
the leap) / s: x is about 0 in the position just before the leap, and about 1 in the position just after it.

Rigid parts (a box, a plate, a pelvis, a thorax) are detected in the recording by distances that stay constant in motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import asymmetry
from lumbar.lifting.quality.findings import LEFT_OUT, Legend, MarkerFinding
from lumbar.lifting.quality.implausible_motion import LONGEST_GAP_S, Leap
from lumbar.records.sampling import runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "displacement")
MAJORITY = "decided only by most frames"
"""Evidence if only the number of frames decides: no symmetry shows the correct side, the shorter part is not short, and the
marker does not come back soon."""


@dataclass(frozen=True)
class Displacement:
    """Frames in which a marker is displaced."""

    frames: slice
    leap: Leap
    """Leap to the wrong place, or back from it."""
    evidence: str
    """Sizes and distances, as text."""
    is_certain: bool = True
    """False if only the number of frames decides which part is displaced."""


def displacements(
    points: dict[str, np.ndarray], label: str, leaps: dict[str, list[Leap]], legend: Legend
) -> tuple[list[Displacement], list[Leap]]:
    """Return the frames in which a marker is displaced, and the leaps without a known correct side.

    If the distances do not decide, the steps of successive leaps do: frames between a leap away and a leap back are displaced.
    Nothing is compared across a gap of more than half a second.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        All markers by label in m.
    label : str
        Label of the marker.
    leaps : dict of str to list of Leap
        Leaps of all markers by label.
    legend : Legend
        Times of the frames and meanings of the labels.
    """
    visible, rate = np.isfinite(points[label][:, 0]), legend.rate

    @cache
    def distance(other: str) -> np.ndarray:
        return np.linalg.norm(points[label] - points[other], axis=1)

    # Sections between gaps that are too long to compare across.
    long = [gap for gap in runs(~visible) if gap.stop - gap.start > LONGEST_GAP_S * rate]
    edges = [0, *(edge for gap in long for edge in (gap.start, gap.stop)), len(visible)]
    near = max(_AT.back_frames, round(_AT.beside_s * rate))
    displaced: list[Displacement] = []
    undecided: list[Leap] = []
    for section in (slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=True)):
        inside = [leap for leap in leaps[label] if section.start < leap.first < section.stop]
        unknown = []
        for leap in inside:
            # Markers that leap at about the same frame do not show which one is wrong.
            leaping = {
                other
                for other, others_leaps in leaps.items()
                if any(abs(one.first - leap.first) <= _AT.same_frame for one in others_leaps)
            }
            steady = [other for other in points if other != label and other not in leaping]
            # The side that is clearly nearer to a body's symmetry, if one is.
            parts = slice(max(0, leap.last + 1 - near), leap.last + 1), slice(leap.first, leap.first + near)
            off = [
                asymmetry({name: points[name][part] for name in {*legend.named, label}}, legend.named, label)
                for part in parts
            ]
            better = int(off[0] > off[1]) if abs(off[0] - off[1]) > _AT.clearly_m else None
            # Frames up to the leaps before and after it.
            earlier = [other.first for other in inside if other.first <= leap.last]
            later = [other.last + 1 for other in inside if other.last >= leap.first]
            span = slice(max([section.start, *earlier]), min([section.stop, *later]))
            result = _displacement(distance, steady, leap, span, better, rate)
            if result is None:
                unknown.append(leap)
            else:
                displaced.append(result)
        if unknown:
            displaced += _pair_leaps(section, inside, visible)
            starts, stops = ({getattr(one.frames, end) for one in displaced} for end in ("start", "stop"))
            undecided += [leap for leap in unknown if leap.first not in starts and leap.last + 1 not in stops]
    # Without overlap, each with the evidence of its first leap.
    mask = np.zeros(len(visible), dtype=bool)
    for one in displaced:
        mask[one.frames] = True
    united = []
    for run in runs(mask):
        parts = (one for one in displaced if run.start <= one.frames.start < run.stop)
        parts = sorted(parts, key=lambda one: one.leap.first)
        ends = {frame for one in parts for frame in (one.leap.first, one.leap.last + 1)}
        is_back = {run.start, run.stop} <= ends and run.stop - run.start < len(visible) / 3
        is_certain = is_back or all(one.is_certain for one in parts)
        remark = (
            "" if is_certain else f" ({MAJORITY}: the other part may be the wrong one, nothing is left out)"
        )
        united.append(Displacement(run, parts[0].leap, parts[0].evidence + remark, is_certain))
    return united, undecided


def _displacement(
    distance: Callable[[str], np.ndarray],
    others: list[str],
    leap: Leap,
    span: slice,
    better: int | None,
    rate: float,
) -> Displacement | None:
    """Return the displaced frames of `span` by the distances that a leap changes most; None if they do not decide.

    `better` is the correct side by the symmetry of the body (0 before the leap, 1 after it); if it is None, most frames decide.
    """
    near = max(_AT.back_frames, round(_AT.beside_s * rate))
    mates = _changed_distances(distance, others, leap)
    if len(mates) < _AT.least_mates:
        return None
    # Mean of x over the mates, weighted by the inverse variance; NaN if less than half of the weight is seen.
    weights = np.array([1 / noise**2 for noise, *_ in mates])[:, None]
    each = np.array([(distance(label) - before) / change for _, label, before, change in mates])
    known = np.where(np.isfinite(each), weights, 0.0)
    total = known.sum(axis=0)
    mean = (known * np.nan_to_num(each)).sum(axis=0) / np.where(total > 0, total, np.nan)
    likeness = np.where(total >= 0.5 * weights.sum(), mean, np.nan)
    # Most frames must be like one side or the other.
    known = np.isfinite(likeness).sum()
    counts = [int((np.abs(likeness - side) < _AT.near).sum()) for side in (0, 1)]
    if sum(counts) < _AT.telling * known:
        return None
    correct = int(counts[1] > counts[0]) if better is None else better
    # A marker that moves more on the side called correct than on the other is not decided.
    parts = (
        likeness[max(0, leap.last + 1 - near) : leap.last + 1],
        likeness[leap.first : leap.first + near] - 1,
    )
    motion = [float(np.max(np.abs(part[np.isfinite(part)]), initial=0.0)) for part in parts]
    if motion[correct] > max(_AT.strayed, 2 * motion[1 - correct]):
        return None
    _, label, before, change = mates[0]
    typical = float(np.nanmedian(distance(label)[np.abs(likeness - correct) < _AT.near]))
    wrong = before if correct else before + change
    evidence = f"there {wrong * 1e3:.0f} mm from {label}, usually {typical * 1e3:.0f} mm"
    is_certain = better is not None or min(counts) <= _AT.doubtful * sum(counts)
    # Frames from the leap, away from its correct side, until the distances are normal again.
    frames = np.arange(leap.last, span.start - 1, -1) if correct else np.arange(leap.first, span.stop)
    outward = likeness[frames]
    off = np.abs(outward - correct)
    if np.mean(off[np.isfinite(off)] > _AT.near) <= _AT.telling:
        # A drift begins below what posture changes: the normal distance is taken from the frames next to it.
        count = _frames_until(off, _AT.near)
        grown = _extend_until_steady(outward, count, near)
        while abs(outward[grown - 1] - outward[count - 1]) > _AT.drifting:
            count, grown = grown, _extend_until_steady(outward, grown, near)
        frames = frames[:grown]
    return Displacement(slice(int(frames.min()), int(frames.max()) + 1), leap, evidence, is_certain)


def _changed_distances(
    distance: Callable[[str], np.ndarray], others: list[str], leap: Leap
) -> list[tuple[float, str, float, float]]:
    """Return for each clearly changed distance: noise (share of the change), label, distance before the leap, and change."""
    mates = []
    for other in others:
        # Median distance of three frames on each side.
        about = slice(max(0, leap.last - 2), leap.last + 1), slice(leap.first, leap.first + 3)
        ends = [end[np.isfinite(end)] for end in map(distance(other).__getitem__, about)]
        if not all(end.size for end in ends):
            continue
        before, after = (float(np.sort(end)[[(end.size - 1) // 2, end.size // 2]].mean()) for end in ends)
        change = after - before
        if abs(change) > _AT.clear * _AT.least_unrest_m:
            unrest = max(_AT.least_unrest_m, _spread(distance(other), leap))
            if abs(change) > _AT.clear * unrest:
                mates.append((unrest / abs(change), other, before, change))
    return sorted(mates, key=lambda mate: mate[0])[: _AT.mates]


def _spread(distance: np.ndarray, leap: Leap) -> float:
    """Return the standard deviation (estimated by quartiles) of a distance about its medians on both sides of a leap."""
    every = max(1, len(distance) // _AT.enough_frames)
    each = distance[leap.last :: -every], distance[leap.first :: every]
    sides = [side[np.isfinite(side)] for side in each]
    low, high = np.percentile(np.concatenate([side - np.median(side) for side in sides]), (25, 75))
    return float(high - low) / 1.349


def _extend_until_steady(likeness: np.ndarray, count: int, near: int) -> int:
    """Return the number of frames, at least `count`, after which x stays steady for 0.3 s."""
    following = likeness[count : count + max(2 * _AT.back_frames, near)]
    following = following[np.isfinite(following)]
    if len(following) < 2 * _AT.back_frames:
        return count
    limit = max(_AT.as_beside, _AT.noises * float(np.median(np.abs(np.diff(following)))))
    return max(count, _frames_until(np.abs(likeness - np.median(following[len(following) // 2 :])), limit))


def _frames_until(off: np.ndarray, limit: float) -> int:
    """Return the number of frames, at least one, before the first five known frames in a row with `off` below a limit."""
    known = np.flatnonzero(np.isfinite(off))
    needed = min(_AT.back_frames, len(known))
    within = (run.start for run in runs(off[known] < limit) if run.stop - run.start >= needed)
    first = next(within, None)
    return len(off) if first is None else max(1, int(known[first]))


def _pair_leaps(section: slice, leaps: list[Leap], visible: np.ndarray) -> list[Displacement]:
    """Return the intervals between a leap away and a leap back, by sums of steps; the position with most frames is correct."""
    starts = [section.start, *(leap.first for leap in leaps)]
    stops = [*(leap.last + 1 for leap in leaps), section.stop]
    frames = [slice(*pair) for pair in zip(starts, stops, strict=True)]
    offsets = np.cumsum([np.zeros(3), *(leap.step for leap in leaps)], axis=0)
    tolerance = 0.4 * min(leap.size for leap in leaps)
    near = np.linalg.norm(offsets[:, None] - offsets[None], axis=2) < tolerance
    right = near[int(np.argmax(near @ [visible[part].sum() for part in frames]))]
    return [
        Displacement(frames[index], leaps[index - 1], "and back: at another place than before and after")
        for index in range(1, len(frames) - 1)
        if not right[index] and right[:index].any() and right[index:].any()
    ]


def _rigid_parts(points: dict[str, np.ndarray], rate: float) -> dict[str, list[tuple[str, float]]]:
    """Return by marker at most `mates` markers at a distance that is constant while either moves, with its spread in metres.

    Resting markers are not compared: two feet on the ground are not one rigid body.
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
    """Return percentiles of the finite values of each row, shape (n_shares, n_rows); NaN with fewer than ten of them.

    The rows are sorted together, because NumPy's percentiles without NaN process them one by one.

    Parameters
    ----------
    values : numpy.ndarray, shape (n_rows, n)
        Values in any unit, NaN if missing.
    shares : tuple of float
        Shares from 0 to 1.
    """
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    at = np.round(np.outer(shares, np.maximum(count - 1, 0))).astype(int)
    chosen = np.take_along_axis(ordered, at.T, axis=1).T
    return np.where(count >= min(10, values.shape[1]), chosen, np.nan)


def steadiest_mate(sample: dict[str, np.ndarray], label: str) -> str | None:
    """Return the marker with the most constant distance from a marker; None if fewer than three distances are nearly constant.

    Parameters
    ----------
    sample : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m, at some frames.
    label : str
        Label of the marker.
    """
    labels = list(sample)
    distance = np.linalg.norm(np.stack([sample[other] for other in labels]) - sample[label], axis=2)
    low, middle, high = percentiles(distance, (0.05, 0.5, 0.95))
    spread = np.hypot(high - low, _AT.bends * middle)
    usable = (middle > _AT.apart_m) & (np.isfinite(distance).mean(axis=1) > _AT.seen) & (spread < _AT.loose_m)
    if usable.sum() < _AT.fewest_mates:
        return None
    return labels[int(np.argmin(np.where(usable, spread, np.inf)))]


def find_rigid_violations(points: dict[str, np.ndarray], legend: Legend) -> list[MarkerFinding]:
    """Find the intervals in which a marker is away from its place on a rigid part.

    A marker belongs to a rigid part if its distances to three markers stay within 8 mm in nine of ten frames in which either
    moves. It is displaced if most of these distances differ from their medians by more than 30 mm and six typical spreads.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    legend : Legend
        Times of the frames and meanings of the labels.
    """
    findings = []
    changes: dict[frozenset[str], np.ndarray] = {}
    for label, rigid in _rigid_parts(points, legend.rate).items():
        if len(rigid) < _AT.least_of_part:
            continue
        pairs = [frozenset((label, other)) for other, _ in rigid]
        for pair, (other, _) in zip(pairs, rigid, strict=True):
            if pair not in changes:
                distance = np.linalg.norm(points[label] - points[other], axis=1)
                # The median of the seen frames: np.nanmedian takes twice as long.
                changes[pair] = (distance - np.median(distance[np.isfinite(distance)])).astype(np.float32)
        change = np.abs([changes[pair] for pair in pairs])
        limits = np.array([max(_AT.deviation_m, _AT.spreads * spread) for _, spread in rigid])
        with np.errstate(invalid="ignore"):
            far = (change > limits[:, None]).sum(axis=0)
        together = np.isfinite(change).sum(axis=0)
        mates = ", ".join(other for other, _ in rigid)
        for frames in runs((far > _AT.majority * together) & (together >= _AT.least_of_part)):
            if frames.stop - frames.start >= _AT.shortest:
                most = np.nanmax(change[:, frames]) * 1e3
                evidence = f"up to {most:.0f} mm off its distances from {mates}, constant elsewhere"
                cause = "another marker under this label, or one that came off"
                findings.append(legend.finding("off its part", LEFT_OUT, evidence, cause, (label,), frames))
    return findings
