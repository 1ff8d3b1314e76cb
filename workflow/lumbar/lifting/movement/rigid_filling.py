"""Long gaps in markers of a rigid body: filled from the body's other markers and its shape.

A spline does not know where a marker went; three others of the same box or pelvis do. The shape is that of the static
trial, or of the frames of the recording itself in which all markers of the body are seen. What the body's fit misses at
the edges of a gap is spread over it linearly, so that the trajectory does not jump.

Least-squares fit of a rotation: Kabsch, Acta Crystallographica A 32 (1976) 922–923.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.movement.cleaning import FILLED, Gap
from lumbar.lifting.quality.findings import NOTED, Legend, MarkerFinding
from lumbar.records.marker_aliases import labels_of
from lumbar.records.stretches import runs
from lumbar.settings.lifting import LiftingSettings

FEWEST = 3
"""Markers that tell where a body is."""
FLATTEST_M = 0.01
"""Least spread (root mean square) of markers across the line they lie nearest to: less tells no turning about it."""
BESIDE = 5
"""Frames on each side of a gap whose mean tells what the fit misses there: one alone carries its own noise."""
OTHER_BODY_M = 0.008
"""Difference between static trial and recording that is another body's: a pelvis in gait differs by 2 mm from its own static
trial, and by 15 mm from somebody else's."""
ALIGNMENTS = 3
"""Times that full frames are laid on their mean: it no longer moves then by a hundredth of a millimetre."""


@dataclass(frozen=True)
class BodyShape:
    """Shape of a rigid body."""

    labels: tuple[str, ...]
    points: np.ndarray
    """Shape (labels, 3): metres, in axes of its own."""
    residual_m: float
    """Root mean square by which full frames differ from the shape."""
    source: str
    """Where the shape was seen."""


def fit_shape(shape: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return `shape` moved rigidly, frame by frame, so that its first points fit best.

    The shape has (m, 3) coordinates, frames of shape (n, k, 3) say where its first k ≤ m points are; returned is (n, m, 3).
    """
    known = shape[: frames.shape[1]]
    return (shape - known.mean(axis=0)) @ _turns(known, frames) + frames.mean(axis=1, keepdims=True)


def _turns(known: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Rotations that lay points, shape (k, 3), best on each frame, shape (n, k, 3); shape (n, 3, 3)."""
    centred = frames - frames.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(np.einsum("ki,nkj->nij", known - known.mean(axis=0), centred))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right


def body_shape(points: Mapping[str, np.ndarray], labels: Collection[str], source: str) -> BodyShape | None:
    """Shape of the markers in `labels` from the frames in which all of them are seen; None where there is no such frame.

    `source` are words for where they were seen.
    """
    names = tuple(label for label in labels if label in points)
    if len(names) <= FEWEST:
        return None
    frames = np.stack([points[name] for name in names], axis=1)
    frames = frames[np.isfinite(frames).all(axis=(1, 2))]
    if not len(frames):
        return None
    shape, few = frames[0], _few(frames)
    for _ in range(ALIGNMENTS):
        # The frames laid on the shape: the rotations of the shape laid on the frames, the other way round.
        back = _turns(shape, few).transpose(0, 2, 1)
        shape = ((few - few.mean(axis=1, keepdims=True)) @ back).mean(axis=0) + shape.mean(axis=0)
    residual = float(np.sqrt(np.mean(np.sum((fit_shape(shape, frames) - frames) ** 2, axis=2))))
    return BodyShape(names, shape, residual, source)


def _misfit(shape: BodyShape, points: Mapping[str, np.ndarray]) -> float | None:
    """Root mean square by which the body in a recording differs from a shape; None where three markers are never seen together.

    Of markers that are in no frame all seen, the one seen least goes first.
    """
    seen = {label: np.isfinite(points[label]).all(axis=1) for label in shape.labels if label in points}
    names = sorted(seen, key=lambda label: -seen[label].sum())
    while len(names) >= FEWEST and not np.all([seen[name] for name in names], axis=0).any():
        names.pop()
    if len(names) < FEWEST:
        return None
    together = np.all([seen[name] for name in names], axis=0)
    frames = _few(np.stack([points[name][together] for name in names], axis=1))
    known = shape.points[[shape.labels.index(name) for name in names]]
    return float(np.sqrt(np.mean(np.sum((fit_shape(known, frames) - frames) ** 2, axis=2))))


def _few(frames: np.ndarray) -> np.ndarray:
    """At most 500 frames, spread over all: a mean needs no more."""
    return frames[:: max(1, len(frames) // 500)]


def fill_rigid(
    points: Mapping[str, np.ndarray],
    rate: float,
    start_s: float,
    shape: BodyShape,
    body: str,
    longer_than_s: float,
) -> tuple[dict[str, np.ndarray], list[Gap]]:
    """Fill gaps of the markers of a body wherever three others of it are seen; return all markers and the gaps filled.

    Parameters
    ----------
    points : mapping of str to ndarray, shape (n, 3)
        All markers by label, in metres.
    start_s : float
        Time of the first frame.
    body : str
        Its name, for the report.
    longer_than_s : float
        Gaps up to this length between seen frames are left to splines.
    """
    method = f"rigid body: {body}, shape from {shape.source}, {1e3 * shape.residual_m:.1f} mm"
    filled, gaps = dict(points), []
    for label in shape.labels:
        open_gaps = _long_gaps(points[label], rate, longer_than_s) if label in points else []
        if not open_gaps:
            continue
        estimate = _estimate_from_others(points, shape, label)
        values = points[label].copy()
        for gap in open_gaps:
            for part in runs(np.isfinite(estimate[gap]).all(axis=1)):
                piece = slice(gap.start + part.start, gap.start + part.stop)
                values[piece] = estimate[piece] + _edge_error(points[label], estimate, piece)
                frames = piece.stop - piece.start
                start = start_s + piece.start / rate
                gaps.append(Gap(label, piece.start, frames, start, frames / rate, FILLED, method))
        filled[label] = values
    return filled, gaps


def fill_from_body(markers: Mapping[str, np.ndarray]) -> tuple[Mapping[str, np.ndarray], dict[str, int]]:
    """Fill every unseen frame of a body's markers from its other markers, as far as three of them are seen.

    How many frames of each marker were filled stands second.
    """
    complete = all(np.isfinite(points).all() for points in markers.values())
    shape = None if complete else body_shape(markers, markers, "")
    if shape is None:
        return markers, {}
    filled, gaps = fill_rigid(markers, 1.0, 0.0, shape, "", 0.0)
    frames: Counter[str] = Counter()
    for gap in gaps:
        frames[gap.marker] += gap.n_frames
    return filled, dict(frames)


class BodyFilling:
    """Fills the rigid bodies of a recording while it is read (`lumbar.records.markers.read_markers`, ``mend``).

    `static` are markers of a static trial by label, in metres. What was filled is in `gaps`; bodies that the static trial has
    another shape of are in `findings`.
    """

    def __init__(self, settings: LiftingSettings, static: Mapping[str, np.ndarray] | None = None):
        self.aliases, self.rules, self.static = settings.markers.aliases, settings.gaps, static or {}
        self.gaps: list[Gap] = []
        self.findings: list[MarkerFinding] = []

    def __call__(self, points: dict[str, np.ndarray], time: np.ndarray) -> dict[str, np.ndarray]:
        """Return the markers with the long gaps of every body filled, as far as three others of it are seen."""
        rate = (len(time) - 1) / (time[-1] - time[0])
        for body, markers in self.rules.rigid.items():
            named = [label for marker in markers for label in labels_of(marker, self.aliases)]
            labels = [label for label in dict.fromkeys(named) if label in points]
            if not any(_long_gaps(points[label], rate, self.rules.maximum_s) for label in labels):
                continue
            shape = self._static_shape(body, labels, points, Legend(time, rate))
            shape = shape or body_shape(points, labels, "this recording")
            if shape is None or shape.residual_m > self.rules.rigid_tolerance_m:
                continue
            points, gaps = fill_rigid(points, rate, float(time[0]), shape, body, self.rules.maximum_s)
            self.gaps += gaps
        return points

    def _static_shape(
        self, body: str, labels: list[str], points: Mapping[str, np.ndarray], legend: Legend
    ) -> BodyShape | None:
        """Shape of a body in the static trial; None where the recording shows another one."""
        shape = body_shape(self.static, labels, "the static trial")
        misfit = None if shape is None else _misfit(shape, points)
        if misfit is None or misfit <= OTHER_BODY_M:
            return shape
        evidence = (
            f"the {body} of the static trial and of this recording differ by {1e3 * misfit:.0f} mm (root mean square); its shape "
            "fills no gap here"
        )
        cause = "the static trial of another person, markers placed again, or labels exchanged in one of both"
        self.findings.append(legend.finding("static", NOTED, evidence, cause, tuple(labels)))
        return None


def _long_gaps(points: np.ndarray, rate: float, longer_than_s: float) -> list[slice]:
    """Gaps of a marker that no spline bridges: at the ends of the recording, or longer."""
    return [
        gap
        for gap in runs(~np.isfinite(points).all(axis=1))
        if gap.start == 0 or gap.stop == len(points) or (gap.stop - gap.start) / rate > longer_than_s
    ]


def _estimate_from_others(points: Mapping[str, np.ndarray], shape: BodyShape, label: str) -> np.ndarray:
    """Where the body's other markers put one, shape (n, 3); NaN where too few of them are seen."""
    place = dict(zip(shape.labels, shape.points, strict=True))
    others = [name for name in shape.labels if name in points and name != label]
    estimate = np.full_like(points[label], np.nan)
    patterns = np.stack([np.isfinite(points[name]).all(axis=1) for name in others], axis=1)
    for pattern in np.unique(patterns, axis=0):
        names = [name for name, there in zip(others, pattern, strict=True) if there]
        known = np.array([place[name] for name in names]).reshape(-1, 3)
        if len(names) < FEWEST or np.linalg.svd(known - known.mean(axis=0), compute_uv=False)[1] < (
            FLATTEST_M * np.sqrt(len(names))
        ):
            continue
        when = (patterns == pattern).all(axis=1)
        frames = np.stack([points[name][when] for name in names], axis=1)
        estimate[when] = fit_shape(np.vstack([known, place[label]]), frames)[:, -1]
    return estimate


def _edge_error(values: np.ndarray, estimate: np.ndarray, piece: slice) -> np.ndarray:
    """What the estimate misses beside a piece, spread over it linearly, shape (frames, 3); 0 where nothing tells."""
    missed = values - estimate
    sides = missed[max(0, piece.start - BESIDE) : piece.start], missed[piece.stop : piece.stop + BESIDE]
    errors = [side[np.isfinite(side).all(axis=1)] for side in sides]
    known = [error.mean(axis=0) for error in errors if len(error)]
    if not known:
        return np.zeros((piece.stop - piece.start, 3))
    first, last = known[0], known[-1]
    before, after = piece.start - 1, piece.stop
    share = (np.arange(piece.start, piece.stop) - before)[:, None] / (after - before)
    return first + share * (last - first)
