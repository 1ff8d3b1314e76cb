"""Wilcoxon's signed-rank test with its exact distribution under ties and zero differences.

Ratings on a few points tie heavily and many differences are zero; tables of the signed-rank statistic (and
``scipy.stats.wilcoxon(method="exact")``) hold for neither. Here the distribution is counted for the ranks at
hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

EXACT_LIMIT = 500
"""Most non-zero differences whose distribution is counted; above, the normal approximation is used."""
ZEROS = ("pratt", "wilcox")
"""Ways to treat zero differences."""


@dataclass(frozen=True)
class SignedRank:
    """Result of the test."""

    statistic: float
    """Sum of the ranks of the positive differences, T+."""
    expected: float
    """Its mean if signs were random."""
    p_value: float
    """Two-sided."""
    nonzero: int
    """Number of differences that are not zero."""
    exact: bool
    """Whether the distribution was counted, not approximated."""


def signed_rank_test(differences: np.ndarray, zeros: str = "pratt") -> SignedRank:
    """Two-sided Wilcoxon signed-rank test of paired differences.

    Parameters
    ----------
    differences : numpy.ndarray, shape (pairs,)
        First minus second value of each pair.
    zeros : {"pratt", "wilcox"}
        ``"pratt"`` ranks zero differences with the others and then drops their ranks (J. W. Pratt, JASA 54,
        1959, 655-667), so that many zeros speak for no difference; ``"wilcox"`` drops them before ranking.
        Splitting the ranks of the zeros between the signs (zsplit) shifts the statistic of ``"pratt"`` by a
        constant: its exact p-value is the same.

    Returns
    -------
    SignedRank
        p = 1 where all differences are zero. Above `EXACT_LIMIT` non-zero differences a normal approximation
        (variance of the tied ranks, no continuity correction) takes the place of the exact distribution.

    Raises
    ------
    ValueError
        If `zeros` is neither of the two ways.
    """
    from scipy.stats import norm, rankdata

    if zeros not in ZEROS:
        raise ValueError(f"zeros is {zeros!r}; allowed are {', '.join(ZEROS)}")
    differences = np.asarray(differences, dtype=float)
    if zeros == "wilcox":
        differences = differences[differences != 0]
    ranks = rankdata(np.abs(differences)) if differences.size else np.zeros(0)
    kept = differences != 0
    ranks, positive = ranks[kept], differences[kept] > 0
    statistic, expected = float(ranks[positive].sum()), float(ranks.sum() / 2)
    nonzero = len(ranks)
    if nonzero <= EXACT_LIMIT:
        return SignedRank(statistic, expected, _exact_p(ranks, statistic), nonzero, True)
    deviate = (statistic - expected) / np.sqrt((ranks**2).sum() / 4)
    return SignedRank(statistic, expected, float(2 * norm.sf(abs(deviate))), nonzero, False)


def positive_rank_sum_distribution(ranks: np.ndarray) -> np.ndarray:
    """Probability of every value of the sum of randomly picked ranks.

    Parameters
    ----------
    ranks : numpy.ndarray, shape (n,)
        Whole or half ranks; each is picked with probability 1/2, independently.

    Returns
    -------
    numpy.ndarray, shape (2 * ranks.sum() + 1,)
        Entry ``s`` is the probability of the sum ``s / 2``. Built rank by rank from sums of positive terms,
        so each entry is accurate to rounding even far out in the tails.
    """
    doubled = np.rint(2 * np.asarray(ranks)).astype(int)
    probability = np.zeros(int(doubled.sum()) + 1)
    probability[0] = 1.0
    reached = 0
    for rank in doubled:
        shifted = probability[: reached + 1] / 2
        probability[: reached + 1] = shifted
        probability[rank : reached + rank + 1] += shifted
        reached += rank
    return probability


def _exact_p(ranks: np.ndarray, statistic: float) -> float:
    """Probability of a sum at least as far from its mean; the distribution is symmetric."""
    probability = positive_rank_sum_distribution(ranks)
    place = round(2 * statistic)
    return min(1.0, 2 * float(min(probability[: place + 1].sum(), probability[place:].sum())))
