"""Which model was picked as the best: shares with intervals, and whether the picks separate the models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings
from lumbar.tables.table import Table
from lumbar.tissue.survey.table_3_2 import Overall, reality_notes


@dataclass(frozen=True)
class PickShares:
    """Share of best picks of every model, as fractions of the participants."""

    models: tuple[str, ...]
    picks: np.ndarray
    """Shape (models,)."""
    share: np.ndarray
    """Shape (models,)."""
    wilson: np.ndarray
    """Shape (models, 2): ends of each model's own interval."""
    goodman: np.ndarray
    """Shape (models, 2): ends of the intervals that hold for all models together."""


def pick_shares(ratings: Ratings, confidence: float) -> PickShares:
    """Share of best picks of every model with two kinds of intervals.

    Parameters
    ----------
    confidence : float
        E.g. 0.95: of each Wilson interval by itself (E. B. Wilson, JASA 22, 1927, 209-212), and of all
        Goodman intervals together (L. A. Goodman, Technometrics 7, 1965, 247-254).
    """
    from statsmodels.stats.proportion import multinomial_proportions_confint, proportion_confint

    picks, participants = ratings.picks(), len(ratings)
    wilson = np.column_stack(proportion_confint(picks, participants, alpha=1 - confidence, method="wilson"))
    goodman = np.asarray(multinomial_proportions_confint(picks, alpha=1 - confidence, method="goodman"))
    return PickShares(ratings.models, picks, picks / participants, wilson, goodman)


def equal_shares_test(picks: np.ndarray) -> Overall:
    """Pearson's chi-square test that all models are picked equally often; picks of shape (models,).

    Raises
    ------
    NumericalError
        If nobody picked any of the models, or fewer than two models are compared.
    """
    from scipy.stats import chisquare

    if len(picks) < 2 or picks.sum() == 0:
        raise NumericalError(
            f"chi-square test of {picks.sum()} picks among {len(picks)} models: nothing to compare"
        )
    result = chisquare(picks)
    return Overall(float(result.statistic), len(picks) - 1, float(result.pvalue))


def without(shares: PickShares, baseline: str) -> np.ndarray:
    """Return the picks of all models but the baseline."""
    return shares.picks[[model != baseline for model in shares.models]]


def best_picks_table(
    ratings: Ratings, shares: PickShares, baseline: str, confidence: float, data: str
) -> Table:
    """Table of the best picks: one row per model."""
    import pandas as pd

    percent = f"{100 * confidence:g} %"
    frame = pd.DataFrame(
        {
            "model": shares.models,
            "picks": shares.picks,
            "percent": 100 * shares.share,
            "wilson_low": 100 * shares.wilson[:, 0],
            "wilson_high": 100 * shares.wilson[:, 1],
            "goodman_low": 100 * shares.goodman[:, 0],
            "goodman_high": 100 * shares.goodman[:, 1],
        }
    )
    return Table(
        title="Models picked as the closest to the tissue analogue.",
        frame=frame,
        definitions={
            "model": "Force-feedback model",
            "picks": "Number of participants who picked it",
            "percent": "Share of the participants, in percent",
            "wilson_low": f"Lower end of the {percent} Wilson interval of this share alone, in percent",
            "wilson_high": "Upper end of the same",
            "goodman_low": f"Lower end of the {percent} Goodman intervals, which hold for all models together, in percent",
            "goodman_high": "Upper end of the same",
        },
        data=data,
        notes=(*_notes(shares, baseline), *reality_notes(ratings)),
        decimals=dict.fromkeys(("percent", "wilson_low", "wilson_high", "goodman_low", "goodman_high"), 1),
    )


def _notes(shares: PickShares, baseline: str) -> tuple[str, ...]:
    notes = [_verdict("all models", shares.picks)]
    rest = [model for model in shares.models if model != baseline]
    if len(rest) > 1 and without(shares, baseline).sum():
        notes.append(_verdict(f"{', '.join(rest)} (without {baseline})", without(shares, baseline)))
    return tuple(notes)


def _verdict(models: str, picks: np.ndarray) -> str:
    test = equal_shares_test(picks)
    separated = "the picks separate them" if test.p_value < 0.05 else "the picks alone do not separate them"
    few = "" if picks.sum() / len(picks) >= 5 else " (expected counts below 5: a rough approximation)"
    return (
        f"Equal shares of {models}: chi-square = {test.statistic:.2f}, {test.dof} degrees of freedom, "
        f"p = {test.p_value:#.2g}{few}; at 0.05 {separated}."
    )
