"""Ridge regression of ARX models, Eqs 3.6–3.8: one factorisation serves every order and every α.

The full regressor matrix, with all lags up to the largest order of the search, is reduced once to the
triangular factor R of a QR decomposition. The regressors of a smaller structure are combinations of its
columns, so the singular values of a structure are those of a small matrix made from R, and each α costs one
product with it.

Scaling. Input and output are demeaned before; every column of A, and b, is then divided by its root mean
square, so that condition number and α do not depend on units. α enters as in Eq. 3.7, ‖Ax − b‖² + α²‖x‖²,
with these columns (norm √N).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.tissue.identification.metrics import condition_number, numerical_rank
from lumbar.tissue.models.transfer_function import ArxStructure, full_regressors


class ReducedRegression:
    """The full ARX regression of one record, reduced to its triangular factor.

    Parameters
    ----------
    inputs, outputs : numpy.ndarray, shape (samples,)
        Demeaned signals.
    lag : int
        Largest lag of any structure that will be asked for.
    """

    def __init__(self, inputs: np.ndarray, outputs: np.ndarray, lag: int):
        self.lag = lag
        regressors = full_regressors(inputs, outputs, lag)
        target = outputs[lag:]
        self.rows = len(target)
        triangular = np.linalg.qr(np.column_stack([regressors, target]), mode="r")
        self._regressors, self._target = triangular[:, :-1], triangular[:, -1]

    def path(self, structure: ArxStructure) -> "RidgePath":
        """Everything that the ridge solutions of one structure need."""
        regressors = self._regressors @ structure.combination(self.lag)
        return RidgePath.factorise(regressors, self._target, self.rows)


@dataclass(frozen=True)
class RidgePath:
    """Singular value decomposition of a standardised regression: ridge solutions for any α."""

    column_scale: np.ndarray
    """Shape (parameters,): root mean square of every column, by which it was divided."""
    target_scale: float
    """Root mean square of the target."""
    singular_values: np.ndarray
    """Shape (parameters,): of the standardised A, descending."""
    rows: int
    """Equations, N − largest lag."""
    _right: np.ndarray
    _projected_target: np.ndarray
    _target_norm_squared: float

    @classmethod
    def factorise(cls, regressors: np.ndarray, target: np.ndarray, rows: int) -> "RidgePath":
        """Standardise and decompose a regression.

        Parameters
        ----------
        regressors : numpy.ndarray, shape (any, parameters)
            A, or a matrix with the same AᵀA.
        target : numpy.ndarray
            b, or a vector with the same Aᵀb and norm.
        rows : int
            Rows of A itself.
        """
        column_scale = np.linalg.norm(regressors, axis=0) / np.sqrt(rows)
        target_scale = float(np.linalg.norm(target) / np.sqrt(rows))
        safe_scale = np.where(column_scale > 0, column_scale, 1.0)
        left, singular_values, right = np.linalg.svd(regressors / safe_scale, full_matrices=False)
        standardised_target = target / target_scale
        return cls(
            safe_scale,
            target_scale,
            singular_values,
            rows,
            right,
            left.T @ standardised_target,
            float(standardised_target @ standardised_target),
        )

    @cached_property
    def rank(self) -> int:
        """Numerical rank of A."""
        return numerical_rank(self.singular_values, self.rows)

    @cached_property
    def condition_number(self) -> float | None:
        """cond(A) of Eq. 3.14 with standardised columns; None where A is rank deficient."""
        return condition_number(self.singular_values, self.rows)

    def standardised_solution(self, alpha: float) -> np.ndarray:
        """Solution of Eq. 3.8 in standardised coefficients; of least norm where A is rank deficient."""
        kept = self.singular_values[: self.rank]
        filtered = kept / (kept**2 + alpha**2) * self._projected_target[: self.rank]
        return self._right[: self.rank].T @ filtered

    def solution(self, alpha: float) -> np.ndarray:
        """Minimiser of Eq. 3.7 with ridge coefficient α ≥ 0, the solution of Eq. 3.8, in the units of the signals."""
        return self.standardised_solution(alpha) * self.target_scale / self.column_scale

    def residual_sum_of_squares(self, alpha: float) -> float:
        """‖b − A x‖² with b standardised (its squared norm is N)."""
        rotated = self._right @ self.standardised_solution(alpha)
        inside = self._projected_target - self.singular_values * rotated
        outside = self._target_norm_squared - self._projected_target @ self._projected_target
        return float(inside @ inside + max(outside, 0.0))

    def standard_deviations(self, alpha: float) -> np.ndarray | None:
        """σ_i of Eq. 3.15 in standardised coefficients; None where AᵀA has no inverse.

        Biased where the regressors carry noise, as measured past outputs do: see `lumbar.tissue.identification.metrics`.
        """
        freedom = self.rows - self.singular_values.size
        if self.rank < self.singular_values.size or freedom <= 0:
            return None
        inverse_diagonal = np.sum((self._right / self.singular_values[:, None]) ** 2, axis=0)
        return np.sqrt(self.residual_sum_of_squares(alpha) / freedom * inverse_diagonal)


def ridge_grid(minimum: float, maximum: float, points: int) -> np.ndarray:
    """Values of α: none (0), then a geometric progression from `minimum` to `maximum`."""
    return np.concatenate([[0.0], np.geomspace(minimum, maximum, points)])
