"""Long gaps in markers of a rigid body, filled from the body's other markers and its shape.

A spline does not follow a marker through a long gap; three others of the same box or pelvis show its place. The shape is that of
the static trial, or of the frames of the recording itself in which all markers of the body are seen. The error of the fit at the
edges of a gap is spread over it linearly, so that the trajectory does not jump.

Least-squares fit of a rotation: Kabsch, Acta Crystallographica A 32 (1976) 922–923.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.movement.cleaning import FILLED, Gap
from lumbar.lifting.quality.findings import NOTED, Legend, MarkerFinding
from lumbar.records.marker_aliases import labels_of
from lumbar.records.sampling import runs
from lumbar.settings.lifting import LiftingSettings

MIN_MARKERS = 3
"""Least number of markers that determine the pose of a body."""
MIN_SPREAD_M = 0.01
"""Least root mean square distance of markers from the line nearest to them, to show rotation about this line."""
EDGE_FRAMES = 5
"""Frames averaged on each side of a gap to estimate the error of the fit there: the error of a single frame is noisy."""
OTHER_BODY_M = 0.008
"""Least difference of shape in static trial and recording for two bodies: a pelvis in gait differs by 2 mm from its own static
trial, and by 15 mm from another person's."""
ALIGNMENTS = 3
"""Number of alignments of full frames with their mean: after them the mean moves by less than a hundredth of a millimetre."""


@dataclass(frozen=True)
class BodyShape:
    """Shape of a rigid body."""

    labels: tuple[str, ...]
    points: np.ndarray
    """Shape (labels, 3): markers in body axes, metres."""
    residual_m: float
    """Root mean square difference of full frames from the shape."""
    source: str
    """Label of the recording that the shape was measured in."""


def fit_shape(shape: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return a shape, shape (n, m, 3) in m, moved rigidly in each frame so that its first points fit best.

    Parameters
    ----------
    shape : numpy.ndarray, shape (m, 3)
        Points of the shape in m.
    frames : numpy.ndarray, shape (n, k, 3)
        Positions of its first k ≤ m points in m.
    """
    known = shape[: frames.shape[1]]
    return (shape - known.mean(axis=0)) @ _rotations(known, frames) + frames.mean(axis=1, keepdims=True)


def _rotations(known: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return the rotations, shape (n, 3, 3), that align points, shape (k, 3), best with each frame, shape (n, k, 3)."""
    centred = frames - frames.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(np.einsum("ki,nkj->nij", known - known.mean(axis=0), centred))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right


def body_shape(points: Mapping[str, np.ndarray], labels: Collection[str], source: str) -> BodyShape | None:
    """Return the shape of some markers from the frames in which all of them are seen; None if there is no such frame.

    Parameters
    ----------
    points : mapping of str to numpy.ndarray, shape (n, 3)
        Markers by label in m.
    labels : collection of str
        Markers of the body.
    source : str
        Label of the recording, for messages.
    """
    names = tuple(label for label in labels if label in points)
    if len(names) <= MIN_MARKERS:
        return None
    frames = np.stack([points[name] for name in names], axis=1)
    frames = frames[np.isfinite(frames).all(axis=(1, 2))]
    if not len(frames):
        return None
    shape, few = frames[0], _sample(frames)
    for _ in range(ALIGNMENTS):
        # The inverse rotations align the frames with the shape.
        back = _rotations(shape, few).transpose(0, 2, 1)
        shape = ((few - few.mean(axis=1, keepdims=True)) @ back).mean(axis=0) + shape.mean(axis=0)
    return BodyShape(names, shape, _rms_distance(shape, frames), source)


def _misfit(shape: BodyShape, points: Mapping[str, np.ndarray]) -> float | None:
    """Return the root mean square difference of a recorded body from a shape; None if three markers are never seen together.

    If no frame has all markers, markers are omitted, the least seen first.
    """
    visible = {label: np.isfinite(points[label]).all(axis=1) for label in shape.labels if label in points}
    names = sorted(visible, key=lambda label: -visible[label].sum())
    while len(names) >= MIN_MARKERS and not np.all([visible[name] for name in names], axis=0).any():
        names.pop()
    if len(names) < MIN_MARKERS:
        return None
    together = np.all([visible[name] for name in names], axis=0)
    frames = _sample(np.stack([points[name][together] for name in names], axis=1))
    known = shape.points[[shape.labels.index(name) for name in names]]
    return _rms_distance(known, frames)


def _rms_distance(shape: np.ndarray, frames: np.ndarray) -> float:
    """Return the root mean square distance in metres of frames, shape (n, k, 3), from a shape fitted to each."""
    return float(np.sqrt(np.mean(np.sum((fit_shape(shape, frames) - frames) ** 2, axis=2))))


def _sample(frames: np.ndarray) -> np.ndarray:
    """Return at most 500 frames, spread over all: a mean needs no more."""
    return frames[:: max(1, len(frames) // 500)]


def fill_rigid(
    points: Mapping[str, np.ndarray],
    rate: float,
    start_s: float,
    shape: BodyShape,
    body: str,
    longer_than_s: float,
) -> tuple[dict[str, np.ndarray], list[Gap]]:
    """Fill gaps of a body's markers if three other markers of the body are seen; return all markers and the filled gaps.

    Parameters
    ----------
    points : mapping of str to numpy.ndarray, shape (n, 3)
        All markers by label, in metres.
    rate, start_s : float
        Frames per second; time of the first frame.
    shape : BodyShape
        Shape of the body.
    body : str
        Name of the body, for the report.
    longer_than_s : float
        Gaps between seen frames up to this length are not filled here, but by splines.
    """
    method = f"rigid body: {body}, shape from {shape.source}, {1e3 * shape.residual_m:.1f} mm"
    filled, gaps = dict(points), []
    for label in shape.labels:
        open_gaps = _long_gaps(points[label], rate, longer_than_s) if label in points else []
        if not open_gaps:
            continue
        estimate = _estimate_from_others(points, shape, label)
        filled[label] = points[label].copy()
        for gap in open_gaps:
            for part in runs(np.isfinite(estimate[gap]).all(axis=1)):
                piece, frames = slice(gap.start + part.start, gap.start + part.stop), part.stop - part.start
                # The error next to the piece is spread over it linearly, so that the trajectory does not jump.
                error = points[label] - estimate
                sides = (
                    error[max(0, piece.start - EDGE_FRAMES) : piece.start],
                    error[piece.stop : piece.stop + EDGE_FRAMES],
                )
                known = [side[np.isfinite(side).all(axis=1)] for side in sides]
                means = [side.mean(axis=0) for side in known if len(side)] or [np.zeros(3)]
                share = np.arange(1, frames + 1)[:, None] / (frames + 1)
                filled[label][piece] = estimate[piece] + (means[0] + share * (means[-1] - means[0]))
                start = start_s + piece.start / rate
                gaps.append(Gap(label, piece.start, frames, start, frames / rate, FILLED, method))
    return filled, gaps


def fill_from_body(markers: Mapping[str, np.ndarray]) -> tuple[Mapping[str, np.ndarray], dict[str, int]]:
    """Fill unseen frames of a body's markers from three others; return the markers and the number of filled frames by marker.

    Parameters
    ----------
    markers : mapping of str to numpy.ndarray, shape (n, 3)
        Markers of the body by label in m.
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
    """Fills the rigid bodies of a recording while `lumbar.records.markers.read_markers` reads it.

    Filled gaps are in `gaps`; bodies with another shape in the static trial are in `findings`.

    Parameters
    ----------
    settings : LiftingSettings
        Settings with the rigid bodies, and the aliases of their markers.
    static : mapping of str to numpy.ndarray, shape (n, 3), optional
        Markers of a static trial by label in m.
    """

    def __init__(self, settings: LiftingSettings, static: Mapping[str, np.ndarray] | None = None):
        self.aliases, self.rules, self.static = settings.markers.aliases, settings.gaps, static or {}
        self.gaps: list[Gap] = []
        self.findings: list[MarkerFinding] = []

    def __call__(self, points: dict[str, np.ndarray], time: np.ndarray) -> dict[str, np.ndarray]:
        """Return the markers with the long gaps of every body filled, if three of its other markers are seen."""
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
        """Return the shape of a body in the static trial; None if the recording shows another shape."""
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
    """Return the gaps that no spline bridges: gaps at an end of the recording, and gaps longer than `longer_than_s`."""
    return [
        gap
        for gap in runs(~np.isfinite(points).all(axis=1))
        if gap.start == 0 or gap.stop == len(points) or (gap.stop - gap.start) / rate > longer_than_s
    ]


def _estimate_from_others(points: Mapping[str, np.ndarray], shape: BodyShape, label: str) -> np.ndarray:
    """Return the position of a marker by the body's other markers, shape (n, 3); NaN if too few of them are seen."""
    place = dict(zip(shape.labels, shape.points, strict=True))
    others = [name for name in shape.labels if name in points and name != label]
    estimate = np.full_like(points[label], np.nan)
    patterns = np.stack([np.isfinite(points[name]).all(axis=1) for name in others], axis=1)
    for pattern in np.unique(patterns, axis=0):
        names = [name for name, is_visible in zip(others, pattern, strict=True) if is_visible]
        known = np.array([place[name] for name in names]).reshape(-1, 3)
        # Markers on one line do not show the rotation about it.
        least = MIN_SPREAD_M * np.sqrt(len(names))
        if len(names) < MIN_MARKERS or np.linalg.svd(known - known.mean(axis=0), compute_uv=False)[1] < least:
            continue
        when = (patterns == pattern).all(axis=1)
        frames = np.stack([points[name][when] for name in names], axis=1)
        estimate[when] = fit_shape(np.vstack([known, place[label]]), frames)[:, -1]
    return estimate
