"""The missing force as a smooth surface over two coordinates of the motion, estimated without a formula.

What a model leaves is fitted by a tensor product of cubic B-splines with a penalty on second differences (Eilers and Marx,
Statist. Sci. 11 (1996) 89-121), together with the model's sensitivities: a force that the model's own parameters can take up is
none that is missing. The penalty and the share explained come from cross-validation over blocks of time of all records; in a
record that repeats, a block is left out in every period.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import sensitivities_over
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.operators import relaxation

_INTERVALS = {"z": 20}
_FEW_INTERVALS = 8
"""Of the splines, by coordinate and for the others: forces may repeat along the position."""
_FOLDS = 10
_BLOCK = 0.5
"""In the motion's time scale."""
_PENALTIES = np.geomspace(1e-4, 1e2, 7)
"""Relative to the size of the normal equations."""
_OUTERMOST = 0.002
"""Share of the samples at either end of a coordinate that the surface takes as at the end."""
_BRANCH_TIME = 0.1
"""Relaxation time of the internal state where the base has none, in the motion's time scale."""


@dataclass(frozen=True)
class Coordinate:
    """A coordinate of the motion."""

    symbol: str
    words: str
    unit: str
    """In terms of ``{x}``."""


COORDINATES = (
    Coordinate("z", "position", "{x}"),
    Coordinate("v", "velocity", "{x}/s"),
    Coordinate("q", "elongation of a relaxing branch", "{x}"),
    Coordinate("m", "largest distance from zero so far", "{x}"),
    Coordinate("s", "path travelled", "{x}"),
    Coordinate("t", "time", "s"),
)


@dataclass(frozen=True, eq=False)
class Surface:
    """A missing force over two coordinates."""

    first: Coordinate
    second: Coordinate
    share: float
    """Share of what the model leaves to explain that the surface explains of blocks it was not fitted to."""
    values: tuple[np.ndarray, np.ndarray]
    """Both coordinates of every sample that counts, all records together."""
    force: np.ndarray
    """Measured less simulated, of the same samples."""


def coordinate_values(motion: Motion | JoinedMotions, branch_time: float) -> dict[str, np.ndarray]:
    """Coordinates of every sample by symbol; shape (samples,) each."""
    if isinstance(motion, JoinedMotions):
        parts = [coordinate_values(part, branch_time) for part in motion.parts]
        return {symbol: np.concatenate([part[symbol] for part in parts]) for symbol in parts[0]}
    return {
        "z": motion.position,
        "v": motion.velocity,
        "q": relaxation(motion, branch_time),
        "m": np.maximum.accumulate(np.abs(motion.position)),
        "s": motion.path,
        "t": motion.time,
    }


def surfaces(fit: Fit, experiment: Experiment) -> list[Surface]:
    """Estimate the force missing from a fitted model over every pair of coordinates, most explaining pair first."""
    records = [item.without_whitening() for item in (experiment.training, *experiment.tests)]
    force = np.concatenate([-fit.errors(item) for item in records])
    tangent = sensitivities_over(fit, records)
    folds = np.concatenate([_folds(item, experiment) for item in records])
    own_time = float(fit.nonlinear[0]) if fit.structure.base.state else None
    branch_time = own_time or _BRANCH_TIME * experiment.training.scale("time")
    each = [(item, coordinate_values(item.motion, branch_time)) for item in records]
    known = {
        place.symbol: np.concatenate([item.trim(values[place.symbol]) for item, values in each])
        for place in COORDINATES
    }
    noise = experiment.noise**2
    found = []
    for first, second in combinations(COORDINATES, 2):
        values = known[first.symbol], known[second.symbol]
        counts = tuple(_INTERVALS.get(place.symbol, _FEW_INTERVALS) for place in (first, second))
        left = _cross_validated(values, counts, force, tangent, folds)
        explainable = max(float(np.mean(force**2)) - noise, 1e-300)
        share = float(np.clip(1 - (left - noise) / explainable, 0.0, 1.0))
        found.append(Surface(first, second, share, values, force))
    return sorted(found, key=lambda item: -item.share)


def _folds(data: FitData, experiment: Experiment) -> np.ndarray:
    """Number of the fold of every sample that counts: blocks of time, of the period where the record repeats."""
    time = data.trim(data.motion.time)
    if experiment.floor is not None and time[-1] > experiment.floor.period:
        time = time % experiment.floor.period
    return (time / (_BLOCK * data.scale("time"))).astype(int) % _FOLDS


def _splines(values: np.ndarray, intervals: int) -> np.ndarray:
    """Cubic B-splines over the range of a coordinate; shape (samples, functions)."""
    low, high = np.quantile(values, [_OUTERMOST, 1 - _OUTERMOST])
    high = high if high > low else low + 1.0
    knots = low + (high - low) * np.arange(-3, intervals + 4) / intervals
    return scipy.interpolate.BSpline.design_matrix(np.clip(values, knots[3], knots[-4]), knots, 3).toarray()


def _roughness(counts: tuple[int, int]) -> np.ndarray:
    """Penalty on second differences along both coordinates; shape (functions, functions)."""
    first, second = (np.diff(np.eye(count + 3), 2, axis=0) for count in counts)
    sizes = first.shape[1], second.shape[1]
    return np.kron(first.T @ first, np.eye(sizes[1])) + np.kron(np.eye(sizes[0]), second.T @ second)


def _cross_validated(values, counts, force: np.ndarray, tangent: np.ndarray, folds: np.ndarray) -> float:
    """Mean squared error of the best penalty on blocks that were left out."""
    first, second = map(_splines, values, counts)
    surface = (first[:, :, None] * second[:, None, :]).reshape(len(force), -1)
    size = np.sqrt(np.mean(tangent**2, axis=0))
    design = np.hstack([surface, tangent / np.where(size > 0, size, 1.0)])
    penalty = np.zeros((design.shape[1],) * 2)
    penalty[: surface.shape[1], : surface.shape[1]] = _roughness(counts)
    parts = [design[folds == fold] for fold in range(_FOLDS)]
    forces = [force[folds == fold] for fold in range(_FOLDS)]
    normals = [part.T @ part for part in parts]
    rights = [part.T @ own for part, own in zip(parts, forces, strict=True)]
    normal, right = sum(normals), sum(rights)
    scale = np.trace(normal) / len(normal)
    ridge = 1e-9 * scale * np.eye(len(normal))
    errors = []
    for weight in _PENALTIES:
        total = 0.0
        for part, own, held_normal, held_right in zip(parts, forces, normals, rights, strict=True):
            found = np.linalg.solve(
                normal - held_normal + weight * scale * penalty + ridge, right - held_right
            )
            total += float(np.sum((own - part @ found) ** 2))
        errors.append(total / len(force))
    return min(errors)
