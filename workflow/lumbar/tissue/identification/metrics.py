"""Error and uncertainty measures of the thesis, Eqs 3.10–3.16, each defined once, and coefficients resampled by blocks.

Eq. 3.15 takes the residuals to be white and the regressors to be exact. Resampling whole blocks of time keeps
the correlation of the residuals and of the regressors inside each block, so the spread needs neither
assumption (Künsch, Annals of Statistics 17, 1989). A bias that every block shares, such as that of ARX with
noisy outputs, remains: the interval says how far another record of the same kind would move the estimate, not
where the truth lies.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record


def settling_time(record: Record, setting_s: float | None = None) -> float:
    """Seconds at the start of a record that are left out of every error of a free run.

    The setting ``tissue.settling_s``, if given; else 50 samples, a two-hundredth of a record that is longer than 10,000, never
    more than a twentieth of it. Sample counts and shares, not times: a verdict does not depend on the unit of the clock.
    """
    if setting_s is not None:
        return setting_s
    samples = len(record)
    return min(max(50, 0.005 * samples), 0.05 * samples) * record.sampling_time


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


@dataclass(frozen=True)
class FreeRunErrors:
    """%VAF, FIT and mean residual of a free run, Eqs 3.10–3.12, as `lumbar.tissue.models.model_data.Scores` names them."""

    vaf_percent: float
    fit_percent: float
    mean_residual: float

    @classmethod
    def of(cls, measured: np.ndarray, modelled: np.ndarray) -> Self:
        """Errors of what a model makes of the motion."""
        return cls(
            variance_accounted_for(measured, modelled),
            fit_ratio(measured, modelled),
            mean_residual(measured, modelled),
        )


def _variance(measured: np.ndarray) -> float:
    variance = float(np.var(measured))
    if variance == 0.0:
        raise NumericalError(
            "the output does not move in the part that is evaluated: no share of its variance exists"
        )
    return variance


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


def largest_relative_uncertainty(coefficients: np.ndarray, deviations: np.ndarray | None) -> float | None:
    """MRU, the largest RU of Eq. 3.16, 100 σ_i/|x_i|, over the coefficients that are not zero; None without any σ."""
    nonzero = coefficients != 0
    if deviations is None or not nonzero.any():
        return None
    return float((100.0 * deviations[nonzero] / np.abs(coefficients[nonzero])).max())


MOST_BLOCKS = 400
"""Very long records get longer blocks, so that the work does not grow with them."""
FEWEST_BLOCKS = 8
"""Fewer blocks give no useful spread."""


def block_bootstrap(
    regressors: np.ndarray,
    target: np.ndarray,
    block_rows: int,
    resamples: int,
    rng: np.random.Generator,
    alpha: float = 0.0,
) -> np.ndarray:
    """Solutions of (AᵀA + α²) x = Aᵀb over resampled blocks of rows, shape (resamples, parameters).

    Parameters
    ----------
    regressors : numpy.ndarray, shape (rows, parameters)
        A; columns of similar size (they are not scaled here).
    target : numpy.ndarray, shape (rows,)
        b.
    block_rows : int
        Rows per block, longer than the residuals' correlation.
    alpha : float
        Ridge coefficient.

    Raises
    ------
    InputError
        If the record is shorter than `FEWEST_BLOCKS` blocks.
    """
    rows, parameters = regressors.shape
    block_rows = max(block_rows, -(-rows // MOST_BLOCKS))
    blocks = rows // block_rows
    if blocks < FEWEST_BLOCKS:
        raise InputError(
            f"bootstrap: {rows} rows make {blocks} blocks of {block_rows}; at least {FEWEST_BLOCKS} "
            "are needed: shorten tissue.bootstrap.block_s or record for longer"
        )
    # Normal equations of every block; those of a resample are sums of them.
    joined = np.column_stack([regressors, target])
    grams = np.empty((blocks, parameters + 1, parameters + 1))
    for block in range(blocks):
        stop = rows if block == blocks - 1 else (block + 1) * block_rows
        part = joined[block * block_rows : stop]
        grams[block] = part.T @ part
    counts = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=resamples)
    resampled = (counts @ grams.reshape(blocks, -1)).reshape(resamples, parameters + 1, parameters + 1)
    normal = resampled[:, :parameters, :parameters] + alpha**2 * np.eye(parameters)
    inverse = np.linalg.pinv(normal, hermitian=True, rcond=1e-14)
    return np.einsum("rij,rj->ri", inverse, resampled[:, :parameters, parameters])
