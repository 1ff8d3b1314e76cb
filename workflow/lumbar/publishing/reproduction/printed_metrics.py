"""What the printed Table 3.1 allows by its own equations, and which experiments on the twin meet its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

import pandas as pd

SAMPLES = {"multisine": 10_000, "noise": 1_000, "chirp": 1_000}
"""Samples of the thesis's records: 100 Hz for 100 s and 10 s (Section 3.2.4.1)."""
MEAN_SQUARE = "mru_mean_square_percent"
"""MRU with the mean in place of the sum of squares in Eq. 3.15."""
PRINTED_AS = {MEAN_SQUARE: "mru_percent"}
"""Column of Table 3.1 that a quantity of another name answers to."""
BY_MEAN = " (mean of squares)"
_WORDS = ("quantity", "trained_on", "model", "as_printed", "closest", "data")


def agreeing(
    experiments: pd.DataFrame,
    quantity: str,
    trained_on: str,
    model: str,
    meets: Callable[[float, float], bool],
) -> dict[str, float]:
    """Return what brings a number of Table 3.1 near the print, by column of the experiments, each with its value.

    Parameters
    ----------
    experiments : pandas.DataFrame
        As `lumbar.publishing.reproduction.table_3_1_experiments` makes it.
    meets : callable
        Whether a value is near the printed one: the criterion of the claim.
    """
    found = {}
    for row in experiments.to_dict("records"):
        if (row["trained_on"], row["model"]) != (trained_on, model):
            continue
        if PRINTED_AS.get(row["quantity"], row["quantity"]) != quantity:
            continue
        how = BY_MEAN if row["quantity"] in PRINTED_AS else ""
        for name in (column for column in experiments.columns if column not in _WORDS):
            if not pd.isna(row[name]) and meets(row["as_printed"], row[name]):
                found[f"{name}{how}"] = float(row[name])
    return found


def least_mru(condition_number: float, nmse: float, samples: int, parameters: int) -> float:
    """Smallest MRU in percent that Eqs 3.15 and 3.16 can give, whatever the data, their scaling and α.

    With columns of root mean square 1, and M rows, every diagonal element of (AᵀA)⁻¹ is at least 1/M, hence σ² ≥ NMSE/M in
    units of the output's root mean square; and ‖x‖ ≤ (1 + √NMSE)/s where s, the smallest singular value over √M, is at least
    1/κ. The printed κ may be that of other columns; it is at most √p times smaller than κ of these (van der Sluis).

    References
    ----------
    A. van der Sluis, Numerische Mathematik 14 (1969) 14-23.
    """
    return 100 * math.sqrt(nmse / samples / parameters) / (condition_number * (1 + math.sqrt(nmse)))


def impossible_mru(printed: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Return printed MRUs below the least that their row allows, by row, each with that least; digits as rounded."""
    found = {}
    for row in printed.itertuples(index=False):
        parameters = {"MW": 2, "KB": 3}.get(row.model, 2 * int(row.order) + 1)
        least = least_mru(
            row.condition_number + 0.005,
            max(row.nmse_train - 0.005, 0.0),
            SAMPLES[row.trained_on],
            parameters,
        )
        if row.mru_percent + 0.005 < least:
            found[f"{row.model} on {row.trained_on}"] = (float(row.mru_percent), least)
    return found
