"""Error and uncertainty measures of the thesis, Eqs 3.10–3.16, each defined once."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import NumericalError


def mean_residual(measured: np.ndarray, modelled: np.ndarray) -> float:
    """Mean of the absolute residuals, Eq. 3.10, in the output's unit."""
    return float(np.mean(np.abs(measured - modelled)))


def variance_accounted_for(measured: np.ndarray, modelled: np.ndarray) -> float:
    """%VAF, Eq. 3.12: 100 (1 − var(ŷ − y)/var(y)).

    Raises
    ------
    NumericalError
        If the measured signal is constant.
    """
    return float(100.0 * (1.0 - np.var(modelled - measured) / _variance(measured)))


def fit_ratio(measured: np.ndarray, modelled: np.ndarray) -> float:
    """FIT, Eq. 3.11, in percent: 100 (1 − rms(ŷ − y)/σ_y).

    For errors of zero mean FIT = 100 (1 − √(1 − VAF/100)), as in every row of the thesis's Table 3.1.

    Raises
    ------
    NumericalError
        If the measured signal is constant.
    """
    rms = np.sqrt(np.mean((modelled - measured) ** 2))
    return float(100.0 * (1.0 - rms / np.sqrt(_variance(measured))))


def _variance(measured: np.ndarray) -> float:
    variance = float(np.var(measured))
    if variance == 0.0:
        raise NumericalError(
            "the output does not move in the part that is evaluated: no share of its variance exists"
        )
    return variance


def normalized_mean_squared_error(measured: np.ndarray, predicted: np.ndarray) -> float:
    """NMSE, Eq. 3.13: ‖b − A x‖²/‖b‖² of the one-step-ahead prediction A x."""
    return float(np.sum((measured - predicted) ** 2) / np.sum(measured**2))


def numerical_rank(singular_values: np.ndarray, rows: int) -> int:
    """Count singular values above max(shape) · eps · σ_max, the rule of `numpy.linalg.matrix_rank`."""
    if singular_values.size == 0:
        return 0
    tolerance = max(rows, singular_values.size) * np.finfo(float).eps * singular_values.max()
    return int((singular_values > tolerance).sum())


def condition_number(singular_values: np.ndarray, rows: int) -> float | None:
    """σ_max/σ_min, Eq. 3.14; None where the matrix is rank deficient."""
    if numerical_rank(singular_values, rows) < singular_values.size:
        return None
    return float(singular_values.max() / singular_values.min())


def relative_uncertainties(coefficients: np.ndarray, standard_deviations: np.ndarray) -> np.ndarray:
    """RU, Eq. 3.16: 100 σ_i/|x_i| for every coefficient that is not zero."""
    nonzero = coefficients != 0
    return 100.0 * standard_deviations[nonzero] / np.abs(coefficients[nonzero])
