"""The within-subject analysis of the ratings, in which every participant rated every model.

Ratings on a few points have many ties, and many differences are zero; tables of the signed-rank statistic, and
``scipy.stats.wilcoxon(method="exact")``, are valid for neither. Here the distribution is counted for the actual ranks.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings
from lumbar.settings.runtime import SurveySettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.survey.table_3_2 import Overall, holm, pairs, reality_notes

EXACT_LIMIT = 500
"""Largest number of non-zero differences for which the distribution is counted; above, it is approximated as normal."""
ZERO_TREATMENTS = ("pratt", "wilcox")
"""Treatments of zero differences."""


@dataclass(frozen=True)
class SignedRank:
    """Result of the signed-rank test."""

    statistic: float
    """Sum of the ranks of the positive differences, T+."""
    expected: float
    """Mean of the statistic for random signs."""
    p_value: float
    """Two-sided p-value."""
    nonzero: int
    """Number of differences that are not zero."""
    exact: bool
    """True if the distribution was counted, not approximated."""


def signed_rank_test(differences: np.ndarray, zeros: str = "pratt") -> SignedRank:
    """Return the two-sided Wilcoxon signed-rank test of paired differences.

    A normal approximation (variance of tied ranks, no continuity correction) is used above `EXACT_LIMIT` non-zero differences.

    Parameters
    ----------
    differences : numpy.ndarray, shape (pairs,)
        First minus second value of each pair; p = 1 if all are zero.
    zeros : {"pratt", "wilcox"}
        ``"pratt"`` ranks zero differences with the others and then drops their ranks (J. W. Pratt, JASA 54, 1959, 655-667), so
        that many zeros are evidence of no difference; ``"wilcox"`` drops them before ranking. Splitting the ranks of the zeros
        between the signs (zsplit) gives the exact p-value of ``"pratt"``.
    """
    if zeros not in ZERO_TREATMENTS:
        raise ValueError(f"zeros is {zeros!r}; allowed are {', '.join(ZERO_TREATMENTS)}")
    differences = np.asarray(differences, dtype=float)
    if zeros == "wilcox":
        differences = differences[differences != 0]
    ranks = scipy.stats.rankdata(np.abs(differences)) if differences.size else np.zeros(0)
    ranks, positive = ranks[differences != 0], differences[differences != 0] > 0
    statistic, expected = float(ranks[positive].sum()), float(ranks.sum() / 2)
    nonzero = len(ranks)
    if nonzero <= EXACT_LIMIT:
        # Probability of a sum at least as far from its mean; the distribution is symmetric.
        probability, place = positive_rank_sum_distribution(ranks), round(2 * statistic)
        tail = float(min(probability[: place + 1].sum(), probability[place:].sum()))
        return SignedRank(statistic, expected, min(1.0, 2 * tail), nonzero, True)
    deviate = (statistic - expected) / np.sqrt((ranks**2).sum() / 4)
    return SignedRank(statistic, expected, float(2 * scipy.stats.norm.sf(abs(deviate))), nonzero, False)


def positive_rank_sum_distribution(ranks: np.ndarray) -> np.ndarray:
    """Return the probability of every value of the sum of randomly picked ranks, shape (2 * ranks.sum() + 1,).

    Whole or half ranks are picked independently with probability 1/2; entry ``s`` is the probability of the sum ``s / 2``. Sums
    of positive terms make each entry accurate to rounding even in the tails.
    """
    doubled = np.rint(2 * np.asarray(ranks)).astype(int)
    probability = np.zeros(int(doubled.sum()) + 1)
    probability[0] = 1.0
    largest = 0
    for rank in doubled:
        shifted = probability[: largest + 1] / 2
        probability[: largest + 1] = shifted
        probability[rank : largest + rank + 1] += shifted
        largest += rank
    return probability


def friedman(ratings: Ratings) -> tuple[Overall, float]:
    """Return Friedman's test with tie correction (chi-square approximation), and Kendall's coefficient of concordance.

    Kendall's W = chi2 / (participants (models − 1)) is 0 if participants rank models at random, 1 if all rank them equally.

    Raises
    ------
    NumericalError
        If there are fewer than three models, or every participant rated all models equally.
    """
    participants, models = ratings.scores.shape
    if models < 3:
        raise NumericalError(f"Friedman's test: {models} models; it needs at least 3")
    if (np.ptp(ratings.scores, axis=1) == 0).all():
        raise NumericalError(
            "Friedman's test: every participant rated all models equally; there is nothing to rank"
        )
    result = scipy.stats.friedmanchisquare(*ratings.scores.T)
    dof = models - 1
    overall = Overall(float(result.statistic), dof, float(result.pvalue))
    return overall, overall.statistic / (participants * dof)


def vargha_delaney(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the probability that a rating of the first model exceeds one of the second, ties counted half, shape (...).

    Â of A. Vargha and H. D. Delaney, J. Educ. Behav. Stat. 25 (2000) 101-132: 1/2 if neither tends to be higher. `first` and
    `second` are the counts of every point of the scale, in rising order, shape (..., points).
    """
    below = np.cumsum(second, axis=-1) - second
    return (first * (below + second / 2)).sum(axis=-1) / (first.sum(axis=-1) * second.sum(axis=-1))


def resampled_counts(ratings: Ratings, resamples: int, seed: list[int]) -> np.ndarray:
    """Return rating counts of bootstrap samples of participants, shape (resamples, models, scale_points).

    Whole participants are drawn with replacement, so that each participant's ratings remain together. Participants with equal
    answers are drawn as one class (multinomially), at a cost that does not depend on their number.
    """
    answers, frequency = np.unique(ratings.scores, axis=0, return_counts=True)
    drawn = np.random.default_rng(seed).multinomial(len(ratings), frequency / len(ratings), size=resamples)
    points = np.arange(1, ratings.scale_points + 1)
    given = (answers[:, :, None] == points).astype(float)
    return np.tensordot(drawn.astype(float), given, axes=1)


@dataclass(frozen=True)
class PairedComparison:
    """Two models rated by the same participants."""

    first: str
    second: str
    higher: int
    """Number of participants who rated the first model higher."""
    equal: int
    lower: int
    test: SignedRank
    """Wilcoxon's test of the differences, zeros ranked (Pratt)."""
    p_holm: float
    """p-value of `test` after Holm's correction over all pairs."""
    test_without_zeros: SignedRank
    """Wilcoxon's test of the differences, zeros dropped."""
    p_holm_without_zeros: float
    superiority: float
    """Vargha and Delaney's Â of the first model over the second."""
    low: float
    """Lower end of the interval of `superiority` at the required confidence."""
    high: float
    narrow_low: float
    """Lower end of the interval of `superiority` at 1 − 2 (1 − confidence), for the two one-sided tests of equivalence."""
    narrow_high: float

    def is_equivalent(self, margin: float) -> bool:
        """Return whether two one-sided tests show Â to be within `margin` of 1/2 (inclusion of the interval)."""
        return 0.5 - margin <= self.narrow_low and self.narrow_high <= 0.5 + margin


def compare_pairs(ratings: Ratings, confidence: float, resamples: int, seed: int) -> list[PairedComparison]:
    """Compare every pair of models within participants, in the order of `lumbar.tissue.survey.table_3_2.pairs`.

    Zero differences are ranked and dropped: trust a result only if both treatments agree.
    """
    differences = {pair: ratings.scores_of(pair[0]) - ratings.scores_of(pair[1]) for pair in pairs(ratings)}
    ranked, dropped = (
        [signed_rank_test(item, zeros) for item in differences.values()] for zeros in ZERO_TREATMENTS
    )
    adjusted, adjusted_dropped = (
        holm(np.array([test.p_value for test in tests])) for tests in (ranked, dropped)
    )
    counts = dict(zip(ratings.models, ratings.counts(), strict=True))
    drawn = np.moveaxis(resampled_counts(ratings, resamples, [seed, 1]), 1, 0)
    samples, tail = dict(zip(ratings.models, drawn, strict=True)), 1 - confidence
    comparisons = []
    for number, ((first, second), difference) in enumerate(differences.items()):
        # Percentiles of bootstrap samples.
        low, narrow_low, narrow_high, high = np.quantile(
            vargha_delaney(samples[first], samples[second]), [tail / 2, tail, 1 - tail, 1 - tail / 2]
        )
        comparisons.append(
            PairedComparison(
                first=first,
                second=second,
                higher=int((difference > 0).sum()),
                equal=int((difference == 0).sum()),
                lower=int((difference < 0).sum()),
                test=ranked[number],
                p_holm=float(adjusted[number]),
                test_without_zeros=dropped[number],
                p_holm_without_zeros=float(adjusted_dropped[number]),
                superiority=float(vargha_delaney(counts[first], counts[second])),
                low=float(low),
                high=float(high),
                narrow_low=float(narrow_low),
                narrow_high=float(narrow_high),
            )
        )
    return comparisons


def paired_table(
    ratings: Ratings, comparisons: list[PairedComparison], settings: SurveySettings, source_label: str
) -> Table:
    """Return the table of the within-subject analysis: one row per pair of models."""
    margin = settings.negligible_A
    rows = [
        {
            "model_a": item.first,
            "model_b": item.second,
            "a_higher": item.higher,
            "equal": item.equal,
            "a_lower": item.lower,
            "rank_sum": item.test.statistic,
            "rank_sum_expected": item.test.expected,
            "p_wilcoxon": item.test.p_value,
            "p_holm": item.p_holm,
            "p_without_zeros": item.test_without_zeros.p_value,
            "p_holm_without_zeros": item.p_holm_without_zeros,
            "distribution": "exact" if item.test.exact else "normal",
            "A": item.superiority,
            "A_low": item.low,
            "A_high": item.high,
            "equivalent": "yes" if item.is_equivalent(margin) else "not shown",
        }
        for item in comparisons
    ]
    fields = {
        "percent": 100 * settings.confidence,
        "resamples": settings.resamples,
        "margin": margin,
        "level": 1 - settings.confidence,
    }
    return table_from_schema(
        "tissue/survey",
        "survey_paired",
        rows,
        source_label,
        fields,
        notes=_notes(ratings, comparisons, margin),
    )


def _notes(ratings: Ratings, comparisons: list[PairedComparison], margin: float) -> tuple[str, ...]:
    overall, concordance = friedman(ratings)
    notes = [
        f"Friedman's test over {len(ratings.models)} models: chi-square = {overall.statistic:.2f}, {overall.dof} degrees of "
        f"freedom, p = {overall.p_value:#.2g}; Kendall's W = {concordance:.3f}; {len(ratings)} participants."
    ]
    for item in comparisons:
        if (item.p_holm < 0.05) != (item.p_holm_without_zeros < 0.05):
            notes.append(
                f"{item.first} and {item.second}: whether they differ depends on how zero differences are treated (adjusted p "
                f"{item.p_holm:#.2g} with their ranks, {item.p_holm_without_zeros:#.2g} without): not decided."
            )
        if item.test.p_value >= 0.05 and not item.is_equivalent(margin):
            notes.append(
                f"{item.first} and {item.second}: p = {item.test.p_value:#.2g} is not equivalence; A may lie anywhere from "
                f"{item.low:.2f} to {item.high:.2f}."
            )
    return (*notes, *reality_notes(ratings))
