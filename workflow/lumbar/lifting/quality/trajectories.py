"""Trajectories that no marker can have: outside any laboratory, standing still to the last bit, copies; a rate of no person.

`points` are positions in metres by label, shape (n_frames, 3), NaN where not seen.

The root mean square of the acceleration over that of the velocity is a frequency and grows with the rate stated. Of lifts,
squats, gait, standing up and picking up (15 recordings of six laboratories) it lies between 0.42 and 0.79 Hz. A rate wrong
by four is seen in all of them, one wrong by two in none, and in a recording of a person who stands still no rate is.
"""

from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import levels_found
from lumbar.lifting.quality.landmarks import level
from lumbar.lifting.quality.sheet import Finding, Legend
from lumbar.records.stretches import flat_tops, runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "trajectories")

LABORATORY_M = 100.0
"""Coordinates beyond this distance from the origin lie in no laboratory."""


def beyond_laboratory(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Frames in which a marker is farther from the origin than any laboratory is long."""
    findings = []
    for label, positions in points.items():
        with np.errstate(invalid="ignore"):
            largest = np.abs(positions).max(axis=1)
            far = largest > LABORATORY_M
        for stretch in runs(far):
            most = largest[stretch].max()
            findings.append(legend.finding("beyond laboratory", (label,), stretch, most=most))
    return findings


def frozen_stretches(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Stretches in which a marker keeps its coordinates to the last bit while others move.

    A file whose numbers are coarse repeats some of them by chance: the share of unchanged steps outside of a run says how
    often, and a run counts when it has a chance below 1e-9. Where most of the three nearest markers keep theirs too, as on a
    box that stands, nothing is found, nor where the marker comes and goes by the file's resolution.
    """
    steady = np.array([_unchanged(positions) for positions in points.values()])
    if not steady.size:
        return []
    findings = []
    for index, label in enumerate(points):
        for run in runs(steady[index]):
            length = run.stop - run.start
            outside = np.delete(steady[index], np.r_[run])
            chance = (outside.sum() + 1) / (len(outside) + 2)
            if length < max(_AT.shortest_still, np.log(_AT.still_by_chance) / np.log(chance)):
                continue
            beside = np.abs(np.diff(points[label][max(0, run.start - 1) : run.stop + 2], axis=0))
            coarse = [_AT.resolved * _resolution(values) for values in points[label].T]
            near = _nearest(points, index, run)
            still = near and np.median(steady[near, run].mean(axis=1)) > _AT.others_still
            if not near or still or (beside.any() and (beside <= coarse).all()):
                continue
            stretch = slice(run.start, run.stop + 1)
            findings.append(legend.finding("frozen", (label,), stretch, frames_alike=length + 1))
    return findings


def clipped_stretches(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Stretches in which a coordinate keeps its largest or smallest value to the last bit, cut off while it was moving."""
    findings = []
    for label, positions in points.items():
        for axis, values in zip("xyz", positions.T, strict=True):
            seen = values[np.isfinite(values)]
            for top in flat_tops(seen) if len(seen) else []:
                words = {"axis": axis, "level": top.level, "count": top.samples}
                findings += [
                    legend.finding("clipped", (label,), run, **words)
                    for run in runs(values == top.level)
                    if run.stop - run.start >= _AT.shortest_clip and _cut_off(values, run)
                ]
    return findings


def _resolution(values: np.ndarray) -> float:
    """The smallest change of a coordinate that its numbers can express, about: of its third differences."""
    changes = np.abs(np.diff(values[np.isfinite(values)], n=3))
    return float(np.min(changes[changes > _AT.rounded_m], initial=np.inf))


def _cut_off(values: np.ndarray, run: slice) -> bool:
    """Whether a coordinate stops, or starts, without slowing down: its last step but one is like the ten before it.

    It is also clearly larger than the file's resolution, at which a turning point is flat.
    """
    before = values[max(0, run.start - _AT.steps_beside) : run.start][::-1]
    for beside in (before, values[run.stop : run.stop + _AT.steps_beside]):
        steps = np.abs(np.diff(beside))
        steps = steps[np.isfinite(steps)]
        if len(steps) and steps[0] > max(
            _AT.like_beside * np.median(steps), _AT.resolved * _resolution(values)
        ):
            return True
    return False


def _unchanged(positions: np.ndarray) -> np.ndarray:
    """Whether each step leaves a marker exactly where it was, shape (n_frames - 1,)."""
    return (np.diff(positions, axis=0) == 0).all(axis=1)


def _nearest(points: dict[str, np.ndarray], index: int, run: slice) -> list[int]:
    """Return the markers nearest to one at the start of a run, among those seen there."""
    there = np.stack([positions[run.start] for positions in points.values()])
    distance = np.linalg.norm(there - there[index], axis=1)
    order = [other for other in np.argsort(distance) if other != index and np.isfinite(distance[other])]
    return order[: _AT.neighbours]


def held_samples(points: dict[str, np.ndarray], legend: Legend) -> tuple[list[Finding], set[str]]:
    """Find markers that move in every second (third, …) frame alone and keep their coordinates to the last bit in between.

    Their labels stand second.
    """
    held_in: dict[int, list[str]] = {}
    for label, positions in points.items():
        every = _moves_every(positions)
        if every:
            held_in.setdefault(every, []).append(label)
    findings = []
    for every, labels in held_in.items():
        words = {"count": len(labels), "of": len(points), "every": every}
        rates = {"own_rate": legend.rate / every, "rate": legend.rate}
        named = tuple(labels) if 2 * len(labels) < len(points) else ()
        findings.append(legend.finding("held", named, **words, **rates))
    return findings, {label for labels in held_in.values() for label in labels}


def _moves_every(positions: np.ndarray) -> int:
    """How many frames a marker keeps each of its positions for; 0 where there is no such number from 2 on."""
    seen = np.isfinite(positions[:, 0])
    known = seen[1:] & seen[:-1]
    moves = ~_unchanged(positions) & known
    if moves.sum() < _AT.fewest_moves or moves.sum() > 0.6 * known.sum():
        return 0
    for every in range(2, _AT.longest_hold + 1):
        phases = [(moves[phase::every].sum(), known[phase::every].sum()) for phase in range(every)]
        shares = sorted(moved / max(1, count) for moved, count in phases)
        if shares[-1] > _AT.held_share and shares[-2] < 1 - _AT.held_share:
            return every
    return 0


def copied_stretches(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Stretches in which two markers are closer than two markers can be: one is a copy of the other.

    Which of the two is the copy is told by what lies nearer to its nominal level along the trunk, or by which of them leapt
    to the other; where neither tells, both are left out.
    """
    labels = list(points)
    findings = []
    for first, second in _touching_pairs(points):
        a, b = points[labels[first]], points[labels[second]]
        with np.errstate(invalid="ignore"):
            near = np.linalg.norm(a - b, axis=1) < _AT.touching_m
        for stretch in runs(near):
            if stretch.stop - stretch.start >= min(_AT.shortest_copy, len(near)):
                findings.append(_copy(points, (labels[first], labels[second]), stretch, legend))
    return findings


def _touching_pairs(points: dict[str, np.ndarray]) -> list[tuple[int, int]]:
    """Pairs of markers that touch in some frame: neighbours in order of one coordinate, up to two places apart.

    Every third frame is looked at: shorter copies are not told anyway.
    """
    every = min(_AT.shortest_copy, len(next(iter(points.values()))))
    points = {label: positions[::every] for label, positions in points.items()}
    n_frames = len(next(iter(points.values())))
    pairs: set[tuple[int, int]] = set()
    for start in range(0, n_frames, _AT.frames_at_once):
        frames = slice(start, start + _AT.frames_at_once)
        stacked = np.stack([positions[frames] for positions in points.values()], axis=1)
        order = np.argsort(stacked[:, :, 0], axis=1)
        ordered = np.take_along_axis(stacked, order[:, :, None], axis=1)
        for places in range(1, min(3, len(points))):
            with np.errstate(invalid="ignore"):
                near = (np.abs(ordered[:, places:] - ordered[:, :-places]) < _AT.touching_m).all(axis=2)
            frame, place = np.nonzero(near)
            found = np.sort(np.stack([order[frame, place], order[frame, place + places]]), axis=0)
            pairs |= {(int(one), int(other)) for one, other in np.unique(found, axis=1).T}
    return sorted(pairs)


def _copy(points: dict[str, np.ndarray], pair: tuple[str, str], stretch: slice, legend: Legend) -> Finding:
    first, second = pair
    distance = np.linalg.norm(points[first][stretch] - points[second][stretch], axis=1).max() * 1e3
    copies = _which_leapt(points, pair, stretch) or _which_is_off_level(points, legend.named, pair, stretch)
    words = {"first": first, "second": second, "distance": distance}
    if not copies:
        return legend.finding("copied, not seen which", pair, stretch, **words)
    words |= {"copy": copies[0], "other": second if copies[0] == first else first}
    return legend.finding("copied", copies, stretch, **words)


def _which_leapt(points, pair: tuple[str, str], stretch: slice) -> tuple[str, ...]:
    """Return the marker of a pair that moved more at the ends of a stretch."""
    leaps = []
    for label in pair:
        edges = [frame for frame in (stretch.start, stretch.stop) if 0 < frame < len(points[label])]
        steps = [np.linalg.norm(points[label][frame] - points[label][frame - 1]) for frame in edges]
        leaps.append(np.nanmax(steps) if np.isfinite(steps).any() else 0.0)
    larger, smaller = max(leaps), min(leaps)
    return (pair[int(np.argmax(leaps))],) if larger > 0.02 and larger > 3 * smaller else ()


def _which_is_off_level(
    points, named: dict[str, str], pair: tuple[str, str], stretch: slice
) -> tuple[str, ...]:
    """Return the marker of a pair that lies farther from its level along the trunk."""
    if not all(label in named and level(named[label]) is not None for label in pair):
        return ()
    found = levels_found({label: positions[stretch] for label, positions in points.items()}, named, pair)
    if not set(pair) <= set(found):
        return ()
    off = [abs(found[label] - level(named[label])) for label in pair]
    return (pair[int(np.argmax(off))],) if abs(off[0] - off[1]) > 0.1 else ()


LOWEST_HZ, HIGHEST_HZ = 0.2, 2.0
"""Half of the lowest frequency scale of real lifts, and more than that of a dance, 1.7."""
USUAL_HZ = 0.57


def frequency_scale(points: dict[str, np.ndarray], rate: float) -> float | None:
    """Frequency scale in hertz of points by label, shape (n_frames, 3) in metres; None of a person who hardly moves."""
    if not tells_tempo(points):
        return None
    points = _some(points)
    n_frames = len(next(iter(points.values())))
    # Smoothed over a share of its own period, which no statement of a rate changes.
    width = n_frames // 10
    for _ in range(_AT.rounds):
        cycles = _cycles_per_frame(points, width)
        if not cycles > 0:
            return None
        width = int(np.clip(_AT.smoothed_share / cycles, 3, n_frames // 10))
    return float(cycles * rate)


def tells_tempo(points: dict[str, np.ndarray]) -> bool:
    """Whether a movement is long and large enough for its tempo to say something."""
    n_frames = len(next(iter(points.values())))
    return n_frames >= _AT.fewest_frames and _way(_some(points)) >= _AT.moves_m


def _some(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    every = -(-len(points) // _AT.most_markers)
    return {label: points[label] for label in list(points)[::every]}


def _way(points: dict[str, np.ndarray]) -> float:
    """Median over the markers of the longest way along one axis, metres."""
    seen = [positions[np.isfinite(positions[:, 0])] for positions in points.values()]
    return float(
        np.median([np.ptp(positions, axis=0).max() for positions in seen if len(positions)] or [0.0])
    )


def _cycles_per_frame(points: dict[str, np.ndarray], width: int) -> float:
    """Root mean square of the second over that of the first differences, both smoothed, over 2 pi."""
    sums, counts = np.zeros(2), np.zeros(2)
    for positions in points.values():
        speed = _moving_mean(np.diff(positions, axis=0), width)
        change = _moving_mean(np.diff(speed, axis=0), width)
        for order, values in enumerate((speed, change)):
            known = values[np.isfinite(values)]
            sums[order] += (known**2).sum()
            counts[order] += len(known)
    if not counts.all() or not sums[0]:
        return np.nan
    speeds, changes = sums / counts
    return float(np.sqrt(changes / speeds) / (2 * np.pi))


def _moving_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Mean over `width` frames, NaN where one of them is missing, shape (n_frames - width + 1, 3)."""
    sums = np.cumsum(np.vstack([np.zeros(3), np.nan_to_num(values)]), axis=0)
    missing = np.cumsum(np.concatenate([[0], ~np.isfinite(values[:, 0])]))
    means = (sums[width:] - sums[:-width]) / width
    means[(missing[width:] - missing[:-width]) > 0] = np.nan
    return means
