"""Output error: a model that a force drives, fitted to the motion by the error of its free run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, folds, shape_bounds, unfolded
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.structure import ForwardStructure

EVALUATIONS = 20
"""Of the error, at most, to fit one model."""
_AT_ZERO = 1e-3
"""Size of a linear parameter that starts at 0, as a share of the largest that acts alike."""
_OFF_BOUND = 1e-3
_LOST = 1e3
"""Error of a motion that was not found, in sizes of the measured one."""


@dataclass(frozen=True, eq=False)
class ForwardFit(Fit):
    """A fitted model from force to motion; attributes as of `Fit`."""

    structure: ForwardStructure

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation of what the sensor of the motion reads, shape (samples,)."""
        parts = motion.parts if isinstance(motion, JoinedMotions) else (motion,)
        zeros = self.zeros if len(self.zeros) == len(parts) else [self.zero] * len(parts)
        return np.concatenate(
            [
                self.structure.simulate(part, self.linear, self.nonlinear, zero) + zero
                for part, zero in zip(parts, zeros, strict=True)
            ]
        )

    def sensitivities(self, data: FitData) -> np.ndarray:
        """Derivatives of the whitened simulation by linear parameters, logarithms of nonlinear ones, and the zeros."""
        slopes = self.structure.sensitivities(data.motion, self.linear, self.nonlinear, self.zero)
        return data.whiten(np.column_stack([slopes, data.zeros]))


def fit_forward(
    structure: ForwardStructure,
    data: FitData,
    linear: np.ndarray,
    nonlinear: np.ndarray,
    zero: float = 0.0,
    evaluations: int = EVALUATIONS,
) -> ForwardFit:
    """Fit a structure to records from one start of its parameters and of the zero of the motion's sensor.

    The motion of `data` is the force, its force the motion. The error is evaluated at most `evaluations` times.
    """
    from scipy.optimize import least_squares

    signs = np.array(structure.signs, dtype=int)
    size = np.where(linear != 0, np.abs(linear), _AT_ZERO * (np.abs(linear).max(initial=0.0) or 1.0))
    extent = float(np.std(data.force))
    count, shapes, zeros = len(linear), len(nonlinear), data.zeros.shape[1]
    low, high = shape_bounds(structure, data, nonlinear) if shapes else (np.zeros(0), np.zeros(0))
    room = (high / low) ** _OFF_BOUND if shapes else 1.0
    nonlinear = np.clip(nonlinear, low * room, high / room)
    lower = np.concatenate(
        [np.where(signs > 0, 0.0, -np.inf), folds(low, nonlinear), np.full(zeros, -np.inf)]
    )
    upper = np.concatenate([np.where(signs < 0, 0.0, np.inf), folds(high, nonlinear), np.full(zeros, np.inf)])
    start = np.concatenate([linear / size, np.ones(shapes), np.full(zeros, zero / extent)])
    start = np.clip(start, lower + 1e-9, upper - 1e-9)

    def trial(vector) -> ForwardFit:
        return ForwardFit(
            structure, vector[:count] * size, unfolded(vector[count : count + shapes], nonlinear), np.inf, True,
            vector[count + shapes :] * extent,
        )  # fmt: skip

    @lru_cache(maxsize=1)
    def error_of(numbers: bytes) -> np.ndarray:
        errors = trial(np.frombuffer(numbers)).whitened_errors(data) / extent
        # A motion that was not found lies further away than any that was.
        return errors if np.isfinite(errors).all() else np.full(len(errors), _LOST)

    def jacobian(vector):
        slopes = trial(vector).sensitivities(data)
        scale = np.concatenate([size, np.ones(shapes), np.full(zeros, extent)]) / extent
        return np.where(np.isfinite(slopes), slopes, 0.0) * scale

    found = least_squares(
        lambda vector: error_of(vector.tobytes()), start, jac=jacobian, bounds=(lower, upper), x_scale="jac",
        xtol=1e-6, ftol=1e-7, gtol=1e-15, max_nfev=evaluations,
    )  # fmt: skip
    return replace(
        trial(found.x), squared_error=2 * float(found.cost) * extent**2, converged=bool(found.status > 0)
    )
