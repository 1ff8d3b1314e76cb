"""The model of one trial: its parts, points and constants, where everything stands in state and constants, and what ties them.

Pelvis, thorax and box are free rigid parts of six coordinates, points of the limbs have three; soft joints couple them.
Constants are places in the axes of a part (landmarks, markers without a name, joint centres, hands on the box) and
lengths. The abdomen is the line between the joints L5/S1 and T12/L1. Markers, soft joints and constant lengths are
measurements of these unknowns (`Measurement`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from lumbar.lifting.body_model.information import Noise


def exponential(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices, shape (..., 3, 3), of rotation vectors, shape (..., 3)."""
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)


def logarithm(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors, shape (..., 3), of rotation matrices, shape (..., 3, 3)."""
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec().reshape(matrices.shape[:-1])


def cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Matrices of the cross product with vectors from the left, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def fast_noise(points: np.ndarray) -> float:
    """Return the standard deviation per axis of the white noise of a point's positions, shape (n, 3), evenly in time.

    Above a quarter of the rate nobody moves: there the spectrum of second differences, (2 - 2 cos ω)² σ² of white noise, is noise
    alone. The median over frequencies leaves out lines, as of a lamp. A point that the body model lets move freely follows its
    marker, so that no residual tells the noise.
    """
    from scipy.stats import chi2

    bend = np.diff(points, 2, axis=0)
    power = np.square(np.abs(np.fft.rfft(bend * np.hanning(len(bend))[:, None], axis=0))).sum(axis=1)
    turn = 2 * np.pi * np.fft.rfftfreq(len(bend))
    fast = turn > np.pi / 2
    white = power[fast] / (2 - 2 * np.cos(turn[fast])) ** 2 / np.square(np.hanning(len(bend))).sum()
    # Each is σ²/2 of chi-square with two degrees of freedom for each axis.
    return float(np.sqrt(2 * np.median(white) / chi2.median(2 * points.shape[1])))


def weighted_poses(
    shape: np.ndarray, frames: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift that lay a shape on frames (Kabsch, Acta Crystallogr. A 32 (1976) 922-923).

    A shape of (m, 3) is laid on frames of (n, m, 3), finite wherever the weight, shape (n, m), is positive. Returned are arrays
    of shapes (n, 3, 3) and (n, 3), NaN where the weighted points tell no turning: too few, or on a line.
    """
    total = weights.sum(axis=1)
    share = weights / np.where(total > 0, total, 1.0)[:, None]
    seen = np.where(weights[..., None] > 0, frames, 0.0)
    middle, centre = share @ shape, np.einsum("nm,nmi->ni", share, seen)
    apart = shape[None] - middle[:, None]
    covariance = np.einsum("nm,nmi,nmj->nij", share, seen - centre[:, None], apart)
    left, _, right = np.linalg.svd(covariance)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    rotations = left @ right
    spread = np.linalg.svd(np.sqrt(share)[..., None] * apart, compute_uv=False)
    blind = (np.count_nonzero(weights > 1e-3, axis=1) < 3) | (spread[:, 1] < FLATTEST_M)
    rotations[blind] = np.nan
    return rotations, centre - np.einsum("nij,nj->ni", rotations, middle)


FLATTEST_M = 0.015
"""Least spread across the line that points lie nearest to: less tells no turning about it."""


def interpolate_poses(
    time: np.ndarray, rotations: np.ndarray, shifts: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fill unknown poses from the nearest known ones, evenly in time; None where none is known."""
    known = np.isfinite(rotations).all(axis=(1, 2))
    if not known.any():
        return None
    if known.sum() == 1:
        return np.repeat(rotations[known], len(time), axis=0), np.repeat(shifts[known], len(time), axis=0)
    inside = np.clip(time, time[known][0], time[known][-1])
    turned = Slerp(time[known], Rotation.from_matrix(rotations[known]))(inside).as_matrix()
    moved = np.stack([np.interp(time, time[known], axis) for axis in shifts[known].T], axis=1)
    return turned, moved


@dataclass(frozen=True)
class Structure:
    """What the unknowns are."""

    parts: tuple[str, ...]
    """Rigid ones."""
    points: tuple[str, ...]
    """Of the limbs."""
    places: tuple[tuple[str, str], ...]
    """Part and name of every constant place."""
    lengths: tuple[tuple[str, str], ...]
    """Pairs whose distance is a constant."""
    _place_index: dict[tuple[str, str], int] = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "_place_index", {place: i for i, place in enumerate(self.places)})

    @property
    def size(self) -> int:
        """Number of coordinates at one instant."""
        return 6 * len(self.parts) + 3 * len(self.points)

    @property
    def constants(self) -> int:
        """Number of constants."""
        return 3 * len(self.places) + len(self.lengths)

    def of_part(self, part: str) -> slice:
        """Shift and turning of a part within the state."""
        start = 6 * self.parts.index(part)
        return slice(start, start + 6)

    def of_point(self, point: str) -> slice:
        """Coordinates of a point within the state."""
        start = 6 * len(self.parts) + 3 * self.points.index(point)
        return slice(start, start + 3)

    def of_place(self, part: str, name: str) -> slice:
        """Coordinates of a place within the constants."""
        start = 3 * self._place_index[part, name]
        return slice(start, start + 3)

    def of_length(self, pair: tuple[str, str]) -> slice:
        """A length within the constants."""
        start = 3 * len(self.places) + self.lengths.index(pair)
        return slice(start, start + 1)

    def names_of(self, part: str) -> list[str]:
        """Names of the constant places of a part."""
        return [name for owner, name in self.places if owner == part]


@dataclass(frozen=True)
class Unknowns:
    """Values of all unknowns."""

    rotations: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3, 3): axes of each part as columns."""
    shifts: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3): origin of each part, metres."""
    points: Mapping[str, np.ndarray]
    """Dict of str to ndarray, shape (n, 3)."""
    constants: np.ndarray
    """Shape (structure.constants,)."""

    def advance(self, structure: Structure, states: np.ndarray, constants: np.ndarray) -> Unknowns:
        """Return the unknowns after steps of shapes (n, size) and (constants,); parts are turned from the left."""
        rotations, shifts = {}, {}
        for part in structure.parts:
            step = states[:, structure.of_part(part)]
            shifts[part] = self.shifts[part] + step[:, :3]
            rotations[part] = exponential(step[:, 3:]) @ self.rotations[part]
        points = {name: self.points[name] + states[:, structure.of_point(name)] for name in structure.points}
        return Unknowns(rotations, shifts, points, self.constants + constants)

    def place(self, structure: Structure, part: str, name: str) -> np.ndarray:
        """Trajectory of a place of a part, shape (n, 3) in metres."""
        return self.shifts[part] + self.rotations[part] @ self.constants[structure.of_place(part, name)]


@dataclass(frozen=True)
class Position:
    """A trajectory with its derivatives."""

    value: np.ndarray
    """Shape (n, 3)."""
    states: list[tuple[slice, np.ndarray]]
    """Columns of the state and the derivative by them, shape (n, 3, k)."""
    constants: list[tuple[slice, np.ndarray]]
    """Columns of the constants and the derivative by them, shape (n, 3, k)."""


def position(structure: Structure, unknowns: Unknowns, part: str | None, name: str) -> Position:
    """Where a place of a part, or a point (part None), is."""
    if part is None:
        value = unknowns.points[name]
        return Position(
            value, [(structure.of_point(name), np.broadcast_to(np.eye(3), (len(value), 3, 3)))], []
        )
    turn, where = unknowns.rotations[part], structure.of_place(part, name)
    arm = turn @ unknowns.constants[where]
    moving = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), -cross_matrix(arm)], axis=2)
    return Position(unknowns.shifts[part] + arm, [(structure.of_part(part), moving)], [(where, turn)])


Where = tuple[str | None, str]
"""Part and place, or None and a point."""
ROBUST_DEGREES = 4.0
"""Degrees of freedom of Student's t, by which residuals are weighted before outliers are known."""
OUTLIER = 6.0
"""Standard deviations, as a distance in space, from which a marker is another one or elsewhere."""
OUTLIER_M = 0.025
"""Nothing nearer than this is left out."""
LEAST_NOISE_M = 0.0002
"""Of a limb's marker: what no laboratory's cameras go below."""
LAG_S = 0.1
"""Lag at which the correlation of a residual is read: noise of single frames has gone, skin is still displaced."""
PRIOR_SAMPLES = 6.0
"""Independent samples that the declared standard deviation counts as much as."""


@dataclass(frozen=True)
class Measurement:
    """One marker, soft joint or constant length, at every instant."""

    name: str
    first: Where
    """What is measured."""
    second: Where | None
    """What its place or distance is measured from; None for a marker."""
    observed: np.ndarray | None
    """Shape (n, 3), or None: of a marker, metres."""
    length: tuple[str, str] | None
    """The constant length, of a distance."""
    seen: np.ndarray
    """Shape (n,)."""
    sd: float
    """Declared standard deviation per axis, metres."""
    correlation_s: float
    """Declared time over which its error stays; 0 for none."""
    estimated: bool
    """Whether the residuals tell its standard deviation too."""

    @property
    def axes(self) -> int:
        """Number of values at one instant."""
        return 1 if self.length else 3

    def residual(self, structure: Structure, unknowns: Unknowns) -> tuple[np.ndarray, Position]:
        """Measured less predicted, shape (n, m), and the prediction's derivatives."""
        first = position(structure, unknowns, *self.first)
        if self.second is None:
            return self.observed - first.value, first
        second = position(structure, unknowns, *self.second)
        apart = first.value - second.value
        states = first.states + [(where, -values) for where, values in second.states]
        constants = first.constants + [(where, -values) for where, values in second.constants]
        if self.length is None:
            return -apart, Position(apart, states, constants)
        distance = np.linalg.norm(apart, axis=1, keepdims=True)
        along = (apart / distance)[:, None, :]
        where = structure.of_length(self.length)
        states = [(at, along @ values) for at, values in states]
        constants = [(at, along @ values) for at, values in constants]
        constants.append((where, np.full((len(distance), 1, 1), -1.0)))
        return unknowns.constants[where] - distance, Position(distance, states, constants)

    def robust_weight(self, residual: np.ndarray) -> np.ndarray:
        """Weights of Student's t, shape (n,); 0 where nothing is measured."""
        size = np.sum(np.where(self.seen[:, None], residual, 0.0) ** 2, axis=1) / self.sd**2
        weight = (ROBUST_DEGREES + self.axes) / (ROBUST_DEGREES + size)
        return np.where(self.seen, np.minimum(weight, 1.0), 0.0)

    def declared_noise(self, step: float) -> Noise:
        """Noise as declared, at a time step in seconds."""
        phi = float(np.exp(-step / self.correlation_s)) if self.correlation_s else 0.0
        return Noise(self.sd, phi)

    def noise(self, residual: np.ndarray, kept: np.ndarray, step: float, freedom: float) -> Noise:
        """Noise from residuals and the declared one, weighed by the independent samples there are.

        The residual has shape (n, m), `kept` are frames that count, `step` is in seconds, `freedom` the share of the measured
        values that the poses do not follow.
        """
        declared = self.declared_noise(step)
        if kept.sum() < 10:
            return declared
        if self.observed is not None and self.first[0] is None:
            return Noise(max(LEAST_NOISE_M, fast_noise(self.observed[kept])))
        if not self.estimated:
            return declared
        values = residual[kept]
        variance = np.mean(values**2) / freedom
        lag = max(1, round(LAG_S / step))
        both = kept[lag:] & kept[:-lag]
        power = np.mean(values**2)
        alike = np.mean(residual[lag:][both] * residual[:-lag][both]) / power if both.any() and power else 0.0
        phi = float(np.clip(alike, 0.0, 0.98)) ** (1 / lag) if alike > 0.05 else 0.0
        phi = min(phi, float(np.exp(-step / 2.0)))
        samples = len(values) * (1 - phi) / (1 + phi)
        pooled = (samples * variance + PRIOR_SAMPLES * self.sd**2) / (samples + PRIOR_SAMPLES)
        return Noise(float(np.sqrt(pooled)), phi)

    def inliers(self, residual: np.ndarray, sd: float) -> np.ndarray:
        """Frames of a marker that are seen and no outliers, one frame beside them left out too."""
        far = np.linalg.norm(np.where(self.seen[:, None], residual, 0.0), axis=1)
        out = far > max(OUTLIER * sd, OUTLIER_M)
        out[1:] |= out[:-1].copy()
        out[:-1] |= out[1:].copy()
        return self.seen & ~out
