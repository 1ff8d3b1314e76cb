"""Error and uncertainty measures of the thesis, Eqs 3.10–3.16, and coefficients resampled by blocks.

Eq. 3.15 assumes white residuals and exact regressors. Resampling whole blocks of time keeps the correlation of the residuals
and of the regressors inside each block, so the spread needs neither assumption (Künsch, Annals of Statistics 17, 1989). A bias
in every block, such as the bias of ARX with noisy outputs, remains: the interval shows the change of the estimate with another
record of the same kind, not the distance from the truth.
"""

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Record


def settling_time(record: Record, setting_s: float | None = None) -> float:
    """Return the duration in seconds of the start of a record that free-run errors omit.

    It is the setting ``tissue.settling_s``, if given; else 50 samples, or 1/200 of a record longer than 10,000 samples, but at
    most 1/20 of the record. Because these are numbers of samples, results do not depend on the unit of the clock.
    """
    if setting_s is not None:
        return setting_s
    samples = len(record)
    return min(max(50, 0.005 * samples), 0.05 * samples) * record.sampling_time


def mean_residual(measured: np.ndarray, modelled: np.ndarray) -> float:
    """Return the mean of the absolute residuals, Eq. 3.10, in the output's unit."""
    return float(np.mean(np.abs(measured - modelled)))


def variance_accounted_for(measured: np.ndarray, modelled: np.ndarray) -> float:
    """Return %VAF, Eq. 3.12: 100 (1 − var(ŷ − y)/var(y)).

    Raises
    ------
    NumericalError
        If the measured signal is constant.
    """
    return float(100.0 * (1.0 - np.var(modelled - measured) / _variance(measured)))


def fit_ratio(measured: np.ndarray, modelled: np.ndarray) -> float:
    """Return FIT, Eq. 3.11, in percent: 100 (1 − rms(ŷ − y)/σ_y).

    For errors of zero mean FIT = 100 (1 − √(1 − VAF/100)), as in every row of the thesis's Table 3.1.

    Raises
    ------
    NumericalError
        If the measured signal is constant.
    """
    rms = np.sqrt(np.mean((modelled - measured) ** 2))
    return float(100.0 * (1.0 - rms / np.sqrt(_variance(measured))))


def free_run_errors(measured: np.ndarray, modelled: np.ndarray) -> dict[str, float]:
    """Return %VAF, FIT and mean residual of a free run, Eqs 3.10–3.12, with the names of `Scores`."""
    return {
        "vaf_percent": variance_accounted_for(measured, modelled),
        "fit_percent": fit_ratio(measured, modelled),
        "mean_residual": mean_residual(measured, modelled),
    }


def _variance(measured: np.ndarray) -> float:
    variance = float(np.var(measured))
    if variance == 0.0:
        raise NumericalError(
            "the output does not move in the part that is evaluated: no share of its variance exists"
        )
    return variance


def largest_relative_uncertainty(coefficients: np.ndarray, deviations: np.ndarray | None) -> float | None:
    """Return MRU, the largest RU of Eq. 3.16, 100 σ_i/|x_i|, of the non-zero coefficients; None without σ."""
    nonzero = coefficients != 0
    if deviations is None or not nonzero.any():
        return None
    return float((100.0 * deviations[nonzero] / np.abs(coefficients[nonzero])).max())


_MAX_BLOCKS = 400
"""Largest number of blocks: very long records get longer blocks to limit the computing time."""
_MIN_BLOCKS = 8
"""Smallest number of blocks with a useful spread."""


def block_bootstrap(
    regressors: np.ndarray,
    target: np.ndarray,
    block_rows: int,
    resamples: int,
    rng: np.random.Generator,
    alpha: float = 0.0,
) -> np.ndarray:
    """Return solutions of (AᵀA + α²) x = Aᵀb over resampled blocks of rows, shape (resamples, parameters).

    Parameters
    ----------
    regressors : numpy.ndarray, shape (rows, parameters)
        A, with columns of similar size (they are not scaled here).
    target : numpy.ndarray, shape (rows,)
        b.
    block_rows : int
        Rows per block: more than the correlation length of the residuals.
    resamples : int
        Number of resamples.
    rng : numpy.random.Generator
        Source of the draws.
    alpha : float
        Ridge coefficient.

    Raises
    ------
    InputError
        If the record is shorter than `_MIN_BLOCKS` blocks.
    """
    rows, parameters = regressors.shape
    block_rows = max(block_rows, -(-rows // _MAX_BLOCKS))
    blocks = rows // block_rows
    if blocks < _MIN_BLOCKS:
        raise InputError(
            f"bootstrap: {rows} rows make {blocks} blocks of {block_rows}; at least {_MIN_BLOCKS} "
            "are needed: shorten tissue.bootstrap.block_s or record for longer"
        )
    # Normal equations of every block; those of a resample are sums of them.
    joined = np.column_stack([regressors, target])
    parts = np.split(joined, block_rows * np.arange(1, blocks))  # the last one has the remaining rows too
    grams = np.stack([part.T @ part for part in parts])
    counts = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=resamples)
    resampled = (counts @ grams.reshape(blocks, -1)).reshape(resamples, parameters + 1, parameters + 1)
    normal = resampled[:, :parameters, :parameters] + alpha**2 * np.eye(parameters)
    inverse = np.linalg.pinv(normal, hermitian=True, rcond=1e-14)
    return np.einsum("rij,rj->ri", inverse, resampled[:, :parameters, parameters])
