"""Block bootstrap of regression coefficients.

Eq. 3.15 takes the residuals to be white and the regressors to be exact. Resampling whole blocks of time keeps
the correlation of the residuals and of the regressors inside each block, so the spread needs neither
assumption (Künsch, Annals of Statistics 17, 1989). A bias that every block shares, such as that of ARX with
noisy outputs, remains: the interval says how far another record of the same kind would move the estimate, not
where the truth lies.
"""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError

MOST_BLOCKS = 400
"""Very long records get longer blocks, so that the work does not grow with them."""
FEWEST_BLOCKS = 8
"""With fewer blocks a spread is not worth stating."""


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


def central_spread(draws: np.ndarray) -> np.ndarray:
    """Half the width of the central 68.27 % of the draws: σ of a normal distribution, deaf to outliers.

    Parameters
    ----------
    draws : numpy.ndarray, shape (resamples, parameters)

    Returns
    -------
    numpy.ndarray, shape (parameters,)
    """
    low, high = np.quantile(draws, [0.158655, 0.841345], axis=0)
    return (high - low) / 2.0
