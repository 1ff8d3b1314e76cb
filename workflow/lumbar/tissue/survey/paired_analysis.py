"""The within-subject analysis of the ratings: every participant rated every model, and the tests use it.

Ratings on a few points tie heavily and many differences are zero; tables of the signed-rank statistic (and
``scipy.stats.wilcoxon(method="exact")``) hold for neither. Here the distribution is counted for the ranks at
hand.
"""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings
from lumbar.settings.survey import SurveySettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.survey.table_3_2 import Overall, holm, pairs, reality_notes

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
        # Probability of a sum at least as far from its mean; the distribution is symmetric.
        probability, place = positive_rank_sum_distribution(ranks), round(2 * statistic)
        tail = float(min(probability[: place + 1].sum(), probability[place:].sum()))
        return SignedRank(statistic, expected, min(1.0, 2 * tail), nonzero, True)
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


def friedman(ratings: Ratings) -> tuple[Overall, float]:
    """Friedman's test with tie correction, and Kendall's coefficient of concordance.

    Returns
    -------
    Overall
        Chi-square approximation of Friedman's test.
    float
        Kendall's W = chi2 / (participants (models − 1)): 0 where the participants rank the models at random,
        1 where all rank them alike.

    Raises
    ------
    NumericalError
        With fewer than three models, or if no participant tells any two models apart.
    """
    from scipy.stats import friedmanchisquare

    participants, models = ratings.scores.shape
    if models < 3:
        raise NumericalError(f"Friedman's test: {models} models; it needs at least 3")
    if (np.ptp(ratings.scores, axis=1) == 0).all():
        raise NumericalError(
            "Friedman's test: every participant rated all models alike; there is nothing to rank"
        )
    result = friedmanchisquare(*ratings.scores.T)
    dof = models - 1
    overall = Overall(float(result.statistic), dof, float(result.pvalue))
    return overall, overall.statistic / (participants * dof)


def vargha_delaney(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Probability that a rating of the first model exceeds one of the second, ties counted half.

    Parameters
    ----------
    first, second : numpy.ndarray, shape (..., points)
        How often each point of the scale was given, in rising order.

    Returns
    -------
    numpy.ndarray, shape (...)
        Â of A. Vargha and H. D. Delaney, J. Educ. Behav. Stat. 25 (2000) 101-132: 1/2 where neither tends to
        be rated higher.
    """
    below = np.cumsum(second, axis=-1) - second
    return (first * (below + second / 2)).sum(axis=-1) / (first.sum(axis=-1) * second.sum(axis=-1))


def resampled_counts(ratings: Ratings, resamples: int, seed: list[int]) -> np.ndarray:
    """Rating counts of bootstrap samples of participants, shape (resamples, models, scale_points).

    Each sample draws whole participants with replacement, so ratings of one person stay together.
    Participants with the same answers are drawn as one class (multinomially), which costs the same for 45
    participants as for 45 000.

    Parameters
    ----------
    seed : list of int
        Seed of `numpy.random.default_rng`.
    """
    answers, frequency = np.unique(ratings.scores, axis=0, return_counts=True)
    drawn = np.random.default_rng(seed).multinomial(len(ratings), frequency / len(ratings), size=resamples)
    points = np.arange(1, ratings.scale_points + 1)
    given = (answers[:, :, None] == points).astype(float)
    return np.tensordot(drawn.astype(float), given, axes=1)


def superiority_interval(first: np.ndarray, second: np.ndarray, confidence: float) -> np.ndarray:
    """Percentile bootstrap intervals of Vargha and Delaney's Â.

    Parameters
    ----------
    first, second : numpy.ndarray, shape (resamples, points)
        Rating counts of the two models in the same bootstrap samples.

    Returns
    -------
    numpy.ndarray, shape (4,)
        In rising order: the outer two are the interval, the inner two that of confidence 1 − 2 (1 −
        confidence), which serves the two one-sided tests of equivalence.
    """
    tail = 1 - confidence
    return np.quantile(vargha_delaney(first, second), [tail / 2, tail, 1 - tail, 1 - tail / 2])


@dataclass(frozen=True)
class PairedComparison:
    """Two models rated by the same participants."""

    first: str
    second: str
    """`first`, `second`: the models."""
    higher: int
    equal: int
    lower: int
    """`higher`, `equal`, `lower`: participants who rated the first model higher than, like, or lower than the second."""
    test: SignedRank
    """Wilcoxon's test of the differences, the zeros among them ranked (Pratt)."""
    p_holm: float
    """Its p-value after Holm's correction over all pairs."""
    test_without_zeros: SignedRank
    """The same with zero differences dropped first (Wilcoxon)."""
    p_holm_without_zeros: float
    superiority: float
    """Vargha and Delaney's Â of the first model over the second."""
    low: float
    high: float
    """`low`, `high`: interval of Â at the confidence asked for."""
    narrow_low: float
    narrow_high: float
    """`narrow_low`, `narrow_high`: interval that serves the two one-sided tests of equivalence, of confidence 1 − 2 (1 −
    confidence)."""

    def equivalent(self, margin: float) -> bool:
        """Whether two one-sided tests show Â to lie within `margin` of 1/2 (inclusion of the interval)."""
        return 0.5 - margin <= self.narrow_low and self.narrow_high <= 0.5 + margin


def compare_pairs(ratings: Ratings, confidence: float, resamples: int, seed: int) -> list[PairedComparison]:
    """Compare every pair of models within participants, in the order of `lumbar.tissue.survey.table_3_2.pairs`.

    Both ways to treat zero differences are computed: none is wrong, and a result that hangs on one is none.
    """
    differences = {pair: ratings.scores_of(pair[0]) - ratings.scores_of(pair[1]) for pair in pairs(ratings)}
    ranked, dropped = ([signed_rank_test(item, zeros) for item in differences.values()] for zeros in ZEROS)
    adjusted, adjusted_dropped = (
        holm(np.array([test.p_value for test in tests])) for tests in (ranked, dropped)
    )
    counts = dict(zip(ratings.models, ratings.counts(), strict=True))
    drawn = np.moveaxis(resampled_counts(ratings, resamples, [seed, 1]), 1, 0)
    samples = dict(zip(ratings.models, drawn, strict=True))
    comparisons = []
    for number, (pair, difference) in enumerate(differences.items()):
        low, narrow_low, narrow_high, high = superiority_interval(
            samples[pair[0]], samples[pair[1]], confidence
        )
        comparisons.append(
            PairedComparison(
                first=pair[0],
                second=pair[1],
                higher=int((difference > 0).sum()),
                equal=int((difference == 0).sum()),
                lower=int((difference < 0).sum()),
                test=ranked[number],
                p_holm=float(adjusted[number]),
                test_without_zeros=dropped[number],
                p_holm_without_zeros=float(adjusted_dropped[number]),
                superiority=float(vargha_delaney(counts[pair[0]], counts[pair[1]])),
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
    """Table of the within-subject analysis: one row per pair of models."""
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
            "equivalent": "yes" if item.equivalent(margin) else "not shown",
        }
        for item in comparisons
    ]
    words = {
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
        words,
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
                f"{item.first} and {item.second}: whether they differ hangs on how zero differences are treated (adjusted p "
                f"{item.p_holm:#.2g} with their ranks, {item.p_holm_without_zeros:#.2g} without): not decided."
            )
        if item.test.p_value >= 0.05 and not item.equivalent(margin):
            notes.append(
                f"{item.first} and {item.second}: p = {item.test.p_value:#.2g} is not equivalence; A may lie anywhere from "
                f"{item.low:.2f} to {item.high:.2f}."
            )
    return (*notes, *reality_notes(ratings))
