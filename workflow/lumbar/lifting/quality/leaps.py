"""Leaps of a marker from one frame to the next that no body makes: of one marker, of two that change labels, of most at once.

Between frames k and k + 1 the line through frames k - 1 and k and that through k + 1 and k + 2 are continued to the middle; what
lies between them there is half the third difference. Constant velocity and acceleration leave it zero, so that a fast
movement is no leap. Two markers that exchange their labels leap each to where the other was; where frames are missing without
a gap, most markers leap together.
"""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.sheet import Finding, Legend
from lumbar.records.stretches import runs

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "leaps")

SMALLEST_M = 0.02
"""Leaps below are not told from the unrest of real markers: untouched recordings have up to 14 mm."""
ABOVE_UNREST = 8.0
"""How far a leap stands out of the marker's own third differences beside it (their 80th percentile)."""
LONGEST_GAP_S = 0.5
"""Across longer gaps nothing is compared."""


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
    """Return the leaps of one marker, shape (n_frames, 3) in metres, and its spikes, which come back within a few frames."""
    size = step_sizes(positions)
    threshold = np.maximum(max(SMALLEST_M, _AT.jerk_m_s3 / rate**3), ABOVE_UNREST * unrest(size))
    # No leap is shorter than the longer step beside it: a racket at 50 Hz changes its step almost as much.
    way = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1], append=positions[-1:]), axis=1)
    threshold = np.maximum(threshold, np.fmax(way[:-2], way[2:]))
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
    blocks = -(-len(size) // _AT.block)
    padded = np.full(blocks * _AT.block, np.nan)
    padded[: len(size)] = size
    ordered = np.sort(padded.reshape(blocks, _AT.block), axis=1)
    at = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0) * 4 // 5
    found = np.nan_to_num(np.take_along_axis(ordered, at[:, None], axis=1))
    return np.repeat(found, _AT.block)[: len(size)]


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
    before = np.arange(max(0, last - _AT.line + 1), last + 1)
    after = np.arange(first, min(len(positions), first + _AT.line))
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
        beside = seen[max(0, gap.start - _AT.line) : gap.start], seen[gap.stop : gap.stop + _AT.line]
        if seconds > LONGEST_GAP_S or min(side.sum() for side in beside) < _AT.line:
            continue
        before, after = _continued(positions, gap.start - 1, gap.stop)
        if np.linalg.norm(after - before) > _AT.gap_m + _AT.gap_m_s2 * seconds**2:
            leaps.append(Leap(gap.start - 1, gap.stop, before, after))
    return leaps


@dataclass(frozen=True)
class Exchange:
    """Two labels change places at some frames and back at others."""

    first: str
    second: str
    """`first`, `second`: labels."""
    frames: tuple[int, ...]
    """First frames after each change."""
    distance: float
    """Metres between both markers at the first change."""

    @property
    def pair(self) -> frozenset[str]:
        """Both labels."""
        return frozenset((self.first, self.second))

    def stretches(self, n_frames: int) -> tuple[list[slice], list[slice]]:
        """Stretches between odd and even changes and the others, together the recording: those of fewer frames first."""
        parts = [slice(*edges) for edges in pairwise([0, *self.frames, n_frames])]
        one, other = parts[1::2], parts[::2]
        frames = [sum(part.stop - part.start for part in each) for each in (one, other)]
        return (one, other) if frames[0] <= frames[1] else (other, one)


def take_exchanges(leaps: dict[str, list[Leap]]) -> tuple[list[Exchange], dict[str, list[Leap]]]:
    """Take the leaps that are exchanges from all leaps, by label; the leaps that no other marker explains stand second.

    Where several markers leap at once, as those of both legs, each leap belongs to the exchange that it fits best.
    """
    changes: dict[tuple[str, str], list[tuple[int, float]]] = {}
    taken: set[tuple[str, int]] = set()
    flat = [(label, leap) for label, found in leaps.items() for leap in found]
    candidates = [
        (
            float(np.linalg.norm(leap.after - other.before) + np.linalg.norm(other.after - leap.before)),
            (label, leap),
            (other_label, other),
        )
        for index, (label, leap) in enumerate(flat)
        for other_label, other in flat[index + 1 :]
        if other_label != label and _change_places(leap, other)
    ]
    for _, (label, leap), (other_label, other) in sorted(candidates, key=lambda found: found[0]):
        ends = {(label, leap.first), (other_label, other.first)}
        if taken & ends:
            continue
        taken |= ends
        distance = float(np.linalg.norm(leap.before - other.before))
        changes.setdefault((label, other_label), []).append((min(leap.first, other.first), distance))
    exchanges = [
        Exchange(*pair, tuple(sorted(frame for frame, _ in found)), found[0][1])
        for pair, found in changes.items()
    ]
    remaining = {
        label: [leap for leap in found if (label, leap.first) not in taken] for label, found in leaps.items()
    }
    return exchanges, remaining


def _change_places(one: Leap, other: Leap) -> bool:
    if one.last >= other.first or other.last >= one.first:
        return False
    tolerance = max(_AT.least_m, _AT.share * float(np.linalg.norm(one.before - other.before)))
    there = np.linalg.norm(one.after - other.before) < tolerance
    return bool(there and np.linalg.norm(other.after - one.before) < tolerance)


def lands_on(leap: Leap, label: str, points: dict[str, np.ndarray]) -> str | None:
    """Return the label of the marker that was seen, just before, where a leap ends; None where there was none."""
    best, nearest = None, max(_AT.least_m, _AT.share * leap.size)
    for other, positions in points.items():
        distance = np.linalg.norm(positions[leap.last] - leap.after)
        if other != label and distance < nearest:
            best, nearest = other, distance
    return best


def missing_frames(
    points: dict[str, np.ndarray], leaps: dict[str, list[Leap]], legend: Legend
) -> tuple[list[Finding], dict[str, list[Leap]]]:
    """Find the frames between which most markers leap, and return the other leaps by label.

    The findings are errors: which movement is missing, nobody knows. `leaps` are those without exchanges of two markers.
    """
    counted = Counter(leap.first for found in leaps.values() for leap in found)
    findings: list[Finding] = []
    taken: list[int] = []
    steps: list[tuple[np.ndarray, np.ndarray]] = []
    for frame, count in counted.most_common():
        if count < _AT.least_leaps or any(abs(frame - other) <= _AT.same_frame for other in taken):
            continue
        # Of no use to a recording in which no markers leap together, which most are.
        steps = steps or [(size, unrest(size)) for size in map(step_sizes, points.values())]
        # Markers that do not go on smoothly into the frame, of those seen about it.
        around = [
            (size[frame - 1], usual[frame - 1]) for size, usual in steps if np.isfinite(size[frame - 1])
        ]
        seen = len(around)
        leaping = sum(bool(size > max(_AT.least_step_m, ABOVE_UNREST * usual)) for size, usual in around)
        if leaping >= max(_AT.least_leaps, _AT.together * seen):
            taken.append(frame)
            findings.append(_finding(frame, leaping, seen, legend))
    remaining = {
        label: [leap for leap in found if all(abs(leap.first - frame) > _AT.same_frame for frame in taken)]
        for label, found in leaps.items()
    }
    return findings, remaining


def _finding(frame: int, leaping: int, seen: int, legend: Legend) -> Finding:
    others = "; the others hardly move" if leaping < seen else ""
    words = {"at": legend.time[frame], "leaping": leaping, "seen": seen, "others": others}
    return legend.finding("missing frames", (), slice(frame - 1, frame + 1), **words)
