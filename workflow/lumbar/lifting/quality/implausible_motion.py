"""Motion of markers that no body makes: leaps, exchanged labels, coordinates outside any laboratory or constant to the last bit.

The line through frames k - 1 and k and the line through frames k + 1 and k + 2 are continued to the middle between k and k + 1;
their distance there is half the third difference. It is zero at constant velocity or acceleration: a fast movement causes no
leap. If two labels are exchanged, each marker leaps to the other's place; if frames are missing, most markers leap together.

`points` are positions in metres by label, shape (n_frames, 3), NaN if not seen.
"""

from collections import Counter
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.findings import ERROR, LEFT_OUT, NOTED, Legend, MarkerFinding
from lumbar.records.sampling import runs

_LIMITS = shipped_names(Path(__file__).with_name("thresholds.yaml"), "implausible_motion")

SMALLEST_M = 0.02
"""Smallest leap that differs from the noise of real markers: unchanged recordings have leaps of up to 14 mm."""
ABOVE_UNREST = 8.0
"""Least ratio of a leap to the 80th percentile of the marker's steps near the leap."""
LONGEST_GAP_S = 0.5
"""Longest gap across which positions are compared."""
LABORATORY_M = 100.0
"""Largest distance from the origin within a laboratory."""


@dataclass(frozen=True)
class Leap:
    """Sudden displacement of a marker from one seen frame to the next."""

    last: int
    """Last seen frame before the leap."""
    first: int
    """First seen frame after the leap."""
    before: np.ndarray
    """Shape (3,): position in the middle between both frames, continued from the frames before, metres."""
    after: np.ndarray
    """Shape (3,): position in the middle between both frames, continued from the frames after, metres."""

    @property
    def step(self) -> np.ndarray:
        """Displacement by the leap, shape (3,), metres."""
        return self.after - self.before

    @property
    def size(self) -> float:
        """Length of the leap, metres."""
        return float(np.linalg.norm(self.step))


def find_leaps(positions: np.ndarray, rate: float) -> tuple[list[Leap], list[slice]]:
    """Return the leaps of one marker, and its spikes (leaps away and back within a few frames).

    Parameters
    ----------
    positions : numpy.ndarray, shape (n_frames, 3)
        Positions in m, NaN if missing.
    rate : float
        Frames per second.
    """
    size = step_sizes(positions)
    threshold = np.maximum(max(SMALLEST_M, _LIMITS.jerk_m_s3 / rate**3), ABOVE_UNREST * typical_step(size))
    # No leap is shorter than the longer step next to it: a racket at 50 Hz changes its step almost as much.
    step = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1], append=positions[-1:]), axis=1)
    threshold = np.maximum(threshold, np.fmax(step[:-2], step[2:]))
    with np.errstate(invalid="ignore"):
        large = size > threshold
    # Responses to one leap are up to two steps apart.
    for cluster in list(runs(large)):
        large[cluster.stop : cluster.stop + 2] |= large[cluster.stop + 2 : cluster.stop + 4].any()
    leaps, spikes = [], []
    for cluster in runs(large):
        last, first = cluster.start, cluster.stop
        before, after = _extrapolate(positions, last, first)
        if np.linalg.norm(after - before) > threshold[cluster].min():
            at = cluster.start + int(np.nanargmax(size[cluster]))
            leaps.append(Leap(at, at + 1, before, after))
        elif first - last > 1:
            # The spike is as long as the marker is off the straight path by more than half the largest deviation.
            share = np.linspace(0, 1, first - last + 1)[:, None]
            path = positions[last] + share * (positions[first] - positions[last])
            off = np.linalg.norm(positions[last : first + 1] - path, axis=1)
            far = last + np.flatnonzero(off >= 0.5 * np.nanmax(off))
            spikes.append(slice(int(far[0]), int(far[-1]) + 1))
    # A gap between seen frames hides a leap if both continuations differ by more than a body moves meanwhile, and by more than
    # they would differ in most gaps of this length in frames in which the marker is seen.
    visible = np.isfinite(positions[:, 0])
    usual: dict[int, float] = {}
    for gap in runs(~visible):
        seconds = (gap.stop - gap.start) / rate
        sides = (
            visible[max(0, gap.start - _LIMITS.line) : gap.start],
            visible[gap.stop : gap.stop + _LIMITS.line],
        )
        if seconds <= LONGEST_GAP_S and min(side.sum() for side in sides) >= _LIMITS.line:
            before, after = _extrapolate(positions, gap.start - 1, gap.stop)
            length = gap.stop - gap.start + 1
            limit = _LIMITS.gap_m + _LIMITS.gap_m_s2 * seconds**2
            size = float(np.linalg.norm(after - before))
            if size > limit:
                usual.setdefault(length, _LIMITS.above_usual * _usual_difference(positions, length))
            if size > max(limit, usual.get(length, 0.0)):
                leaps.append(Leap(gap.start - 1, gap.stop, before, after))
    return sorted(leaps, key=lambda leap: leap.first), spikes


def _usual_difference(positions: np.ndarray, length: int) -> float:
    """Return the 95th percentile of the distances of both continuations over `length` steps of a marker, metres."""
    middle, slope = positions[1:-1], (positions[2:] - positions[:-2]) / 2
    apart = length + _LIMITS.line - 1
    reach = middle[apart:] - middle[:-apart] - (slope[apart:] + slope[:-apart]) * apart / 2
    size = np.linalg.norm(reach, axis=1)
    size = size[np.isfinite(size)]
    return float(np.percentile(size, 95)) if len(size) >= _LIMITS.enough_places else np.inf


def step_sizes(positions: np.ndarray) -> np.ndarray:
    """Return the distance of the two continued lines between successive frames, shape (n_frames - 1,), metres; NaN at the ends.

    Parameters
    ----------
    positions : numpy.ndarray, shape (n_frames, 3)
        Positions in m, NaN if missing.
    """
    size = np.full(max(len(positions) - 1, 0), np.nan)
    if len(positions) > 3:
        steps = 1.5 * (positions[2:-1] - positions[1:-2]) - 0.5 * (positions[3:] - positions[:-3])
        size[1:-1] = np.linalg.norm(steps, axis=1)
    return size


def typical_step(size: np.ndarray) -> np.ndarray:
    """Return the 80th percentile of the steps of a marker in each block of frames, shape of `size`."""
    blocks = -(-len(size) // _LIMITS.block)
    padded = np.full(blocks * _LIMITS.block, np.nan)
    padded[: len(size)] = size
    ordered = np.sort(padded.reshape(blocks, _LIMITS.block), axis=1)
    at = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0) * 4 // 5
    chosen = np.nan_to_num(np.take_along_axis(ordered, at[:, None], axis=1))
    return np.repeat(chosen, _LIMITS.block)[: len(size)]


def _extrapolate(positions: np.ndarray, last: int, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Continue the line up to frame `last` and the line from frame `first` to the middle between the two frames."""
    before = np.arange(max(0, last - _LIMITS.line + 1), last + 1)
    after = np.arange(first, min(len(positions), first + _LIMITS.line))
    ends = []
    for frames in (before, after):
        known = frames[np.isfinite(positions[frames, 0])]
        if len(known) < 2:
            ends.append(positions[known[-1]] if len(known) else np.full(3, np.nan))
            continue
        centred = known - known.mean()
        slope = centred @ positions[known] / (centred @ centred)
        ends.append(positions[known].mean(axis=0) + slope * ((last + first) / 2 - known.mean()))
    return ends[0], ends[1]


@dataclass(frozen=True)
class Exchange:
    """Two labels that are exchanged at some frames and exchanged back at others."""

    first: str
    second: str
    frames: tuple[int, ...]
    """First frames after each change."""
    distance: float
    """Distance of the two markers at the first change, metres."""

    @property
    def pair(self) -> frozenset[str]:
        """The two labels."""
        return frozenset((self.first, self.second))

    def intervals(self, n_frames: int) -> tuple[list[slice], list[slice]]:
        """Return the intervals after odd changes and all other intervals; first the set with fewer frames."""
        parts = [slice(*edges) for edges in pairwise([0, *self.frames, n_frames])]
        shorter, longer = sorted(
            (parts[1::2], parts[::2]), key=lambda each: sum(p.stop - p.start for p in each)
        )
        return shorter, longer


def take_exchanges(leaps: dict[str, list[Leap]]) -> tuple[list[Exchange], dict[str, list[Leap]]]:
    """Separate the leaps that are exchanges of two labels from all others, by label.

    If several markers leap simultaneously, such as those of both legs, each leap belongs to the exchange that it fits best.

    Parameters
    ----------
    leaps : dict of str to list of Leap
        Leaps by label.
    """
    flat = [(label, leap) for label, own_leaps in leaps.items() for leap in own_leaps]
    candidates = []
    for (label, leap), (other_label, other) in combinations(flat, 2):
        if other_label == label or leap.last >= other.first or other.last >= leap.first:
            continue
        # Each must land near the place of the other.
        distance = float(np.linalg.norm(leap.before - other.before))
        error = np.linalg.norm([leap.after - other.before, other.after - leap.before], axis=1)
        if (error < max(_LIMITS.least_m, _LIMITS.share * distance)).all():
            ends = {(label, leap.first), (other_label, other.first)}
            candidates.append((float(error.sum()), ends, (label, other_label), distance))
    changes: dict[tuple[str, str], list[tuple[int, float]]] = {}
    taken: set[tuple[str, int]] = set()
    for _, ends, pair, distance in sorted(candidates, key=lambda candidate: candidate[0]):
        if not taken & ends:
            taken |= ends
            changes.setdefault(pair, []).append((min(frame for _, frame in ends), distance))
    exchanges = [
        Exchange(*pair, tuple(sorted(frame for frame, _ in changed)), changed[0][1])
        for pair, changed in changes.items()
    ]
    remaining = {
        label: [leap for leap in own_leaps if (label, leap.first) not in taken]
        for label, own_leaps in leaps.items()
    }
    return exchanges, remaining


def marker_at_landing(leap: Leap, label: str, points: dict[str, np.ndarray]) -> str | None:
    """Return the label of the marker that was at the end of a leap just before it; None if there was none.

    Parameters
    ----------
    leap : Leap
        Leap of one marker.
    label : str
        Label of the marker that leaps.
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        All markers by label in m.
    """
    others = {
        other: np.linalg.norm(places[leap.last] - leap.after)
        for other, places in points.items()
        if other != label
    }
    near = {
        other: distance
        for other, distance in others.items()
        if distance < max(_LIMITS.least_m, _LIMITS.share * leap.size)
    }
    return min(near, key=near.__getitem__, default=None)


def missing_frames(
    points: dict[str, np.ndarray], leaps: dict[str, list[Leap]], legend: Legend
) -> tuple[list[MarkerFinding], dict[str, list[Leap]]]:
    """Return errors for frames between which most markers leap (their movement is unknown), and the other leaps by label.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        All markers by label in m.
    leaps : dict of str to list of Leap
        Leaps by label, without exchanges of two markers.
    legend : Legend
        Times of the frames and meanings of the labels.
    """
    counted = Counter(leap.first for own_leaps in leaps.values() for leap in own_leaps)
    findings: list[MarkerFinding] = []
    taken: list[int] = []
    steps: list[tuple[np.ndarray, np.ndarray]] = []
    for frame, count in counted.most_common():
        if count < _LIMITS.least_leaps or any(abs(frame - other) <= _LIMITS.same_frame for other in taken):
            continue
        # Not needed for a recording in which no markers leap together, as in most.
        steps = steps or [(size, typical_step(size)) for size in map(step_sizes, points.values())]
        # Markers that do not continue smoothly into the frame, among those seen near it.
        around = [
            (size[frame - 1], typical[frame - 1]) for size, typical in steps if np.isfinite(size[frame - 1])
        ]
        leaping = sum(
            bool(size > max(_LIMITS.least_step_m, ABOVE_UNREST * typical)) for size, typical in around
        )
        if leaping >= max(_LIMITS.least_leaps, _LIMITS.together * len(around)):
            taken.append(frame)
            others = "; the others hardly move" if leaping < len(around) else ""
            findings.append(
                legend.finding(
                    "missing frames",
                    ERROR,
                    f"{leaping} of {len(around)} markers leap together at {legend.time[frame]:.2f} s{others}: frames are "
                    "missing there",
                    "export the recording again with all its frames, or only the part before or after; a marker that is not "
                    "seen must be a gap, its frames must not be cut out",
                    frames=slice(frame - 1, frame + 1),
                )
            )
    remaining = {
        label: [leap for leap in own_leaps if all(abs(leap.first - at) > _LIMITS.same_frame for at in taken)]
        for label, own_leaps in leaps.items()
    }
    return findings, remaining


def find_positions_outside(points: dict[str, np.ndarray], legend: Legend) -> list[MarkerFinding]:
    """Find frames in which a marker is more than `LABORATORY_M` from the origin."""
    findings = []
    for label, positions in points.items():
        with np.errstate(invalid="ignore"):
            largest = np.abs(positions).max(axis=1)
            outside = largest > LABORATORY_M
        for part in runs(outside):
            evidence = f"coordinates up to {largest[part].max():.3g} m"
            cause = "the file holds numbers that are not positions"
            findings.append(legend.finding("beyond laboratory", LEFT_OUT, evidence, cause, (label,), part))
    return findings


def find_frozen_intervals(points: dict[str, np.ndarray], legend: Legend) -> list[MarkerFinding]:
    """Find intervals in which a marker keeps its coordinates to the last bit while others move.

    A file with coarse numbers repeats some by chance: the share of unchanged steps outside a run estimates the probability, and
    a run is reported if it is less probable than 1e-9. Nothing is reported if most of the three nearest markers rest too, as on a
    resting box, or if the marker stops and starts by steps of the file's resolution.
    """
    steady = np.array([_is_unchanged(positions) for positions in points.values()])
    findings = []
    for index, label in enumerate(points if steady.size else ()):
        for run in runs(steady[index]):
            length = run.stop - run.start
            outside = np.delete(steady[index], np.r_[run])
            chance = (outside.sum() + 1) / (len(outside) + 2)
            if length < max(_LIMITS.shortest_still, np.log(_LIMITS.still_by_chance) / np.log(chance)):
                continue
            # Smallest change that the numbers of a coordinate can express, about: of its third differences.
            third = [np.abs(np.diff(values[np.isfinite(values)], n=3)) for values in points[label].T]
            resolution = [np.min(change[change > _LIMITS.rounded_m], initial=np.inf) for change in third]
            edges = np.abs(np.diff(points[label][max(0, run.start - 1) : run.stop + 2], axis=0))
            # The nearest markers among those seen at the start.
            places = np.stack([positions[run.start] for positions in points.values()])
            distance = np.linalg.norm(places - places[index], axis=1)
            order = [one for one in np.argsort(distance) if one != index and np.isfinite(distance[one])]
            near = order[: _LIMITS.neighbours]
            still = near and np.median(steady[near, run].mean(axis=1)) > _LIMITS.others_still
            coarse = edges.any() and (edges <= _LIMITS.resolved * np.array(resolution)).all()
            if near and not still and not coarse:
                evidence = (
                    f"the same coordinates to the last digit in {length + 1} frames while nearby markers move"
                )
                cause, frames = (
                    "a gap filled with the last position seen, or a stuck channel",
                    slice(run.start, run.stop + 1),
                )
                findings.append(legend.finding("frozen", LEFT_OUT, evidence, cause, (label,), frames))
    return findings


def _is_unchanged(positions: np.ndarray) -> np.ndarray:
    """Return whether a marker keeps its exact position in each step, shape (n_frames - 1,)."""
    return (np.diff(positions, axis=0) == 0).all(axis=1)


def find_repeated_samples(
    points: dict[str, np.ndarray], legend: Legend
) -> tuple[list[MarkerFinding], set[str]]:
    """Find markers that move only in every second (third, …) frame; return findings and labels."""
    labels_by_hold: dict[int, list[str]] = {}
    for label, positions in points.items():
        if every := _hold_interval(positions):
            labels_by_hold.setdefault(every, []).append(label)
    findings = []
    for every, labels in labels_by_hold.items():
        evidence = (
            f"{len(labels)} of {len(points)} markers move in only one of {every} frames and keep their coordinates to the last "
            "digit in between"
        )
        cause = (
            f"recorded at {legend.rate / every:g} Hz and written at {legend.rate:g} Hz by repeating samples: export it again "
            "at the rate of the cameras, because its speeds are steps"
        )
        markers = tuple(labels) if 2 * len(labels) < len(points) else ()
        findings.append(legend.finding("held", NOTED, evidence, cause, markers))
    return findings, {label for labels in labels_by_hold.values() for label in labels}


def _hold_interval(positions: np.ndarray) -> int:
    """Return the number of frames, at least 2, for which a marker keeps each position; 0 if it moves in every frame."""
    visible = np.isfinite(positions[:, 0])
    known = visible[1:] & visible[:-1]
    moves = ~_is_unchanged(positions) & known
    if moves.sum() < _LIMITS.fewest_moves or moves.sum() > 0.6 * known.sum():
        return 0
    for every in range(2, _LIMITS.longest_hold + 1):
        phases = [(moves[phase::every].sum(), known[phase::every].sum()) for phase in range(every)]
        shares = sorted(moved / max(1, count) for moved, count in phases)
        if shares[-1] > _LIMITS.held_share and shares[-2] < 1 - _LIMITS.held_share:
            return every
    return 0
