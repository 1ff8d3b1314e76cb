"""The whole survey in one call: its three tables, the models picked as the best, and all results as plain data."""

from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings
from lumbar.settings.survey import SurveySettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.survey.paired_analysis import PairedComparison, compare_pairs, friedman, paired_table
from lumbar.tissue.survey.table_3_2 import (
    Overall,
    holm,
    kruskal_wallis,
    mann_whitney,
    pairs,
    reality_notes,
    table_3_2,
)


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
    ratings: Ratings, shares: PickShares, baseline: str, confidence: float, source_label: str
) -> Table:
    """Table of the best picks: one row per model."""
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
    notes = (*_notes(shares, baseline), *reality_notes(ratings))
    words = {"confidence": f"{100 * confidence:g} %"}
    return table_from_schema("tissue/survey", "survey_best_picks", frame, source_label, words, notes=notes)


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


@dataclass(frozen=True)
class SurveyAnalysis:
    """What the survey shows."""

    tables: dict[str, Table]
    """``table_3_2`` as published, ``survey_paired`` within participants, ``survey_best_picks``."""
    results: dict
    """Plain data, schema ``lumbar.survey/1``."""


def analyse_survey(
    ratings: Ratings, settings: SurveySettings, seed: int, source_label: str
) -> SurveyAnalysis:
    """Analyse the answers as the thesis did, and within participants."""
    label = ratings.label(source_label, settings.note)
    confidence, baseline = settings.confidence, settings.baseline
    comparisons = compare_pairs(ratings, confidence, settings.resamples, seed)
    shares = pick_shares(ratings, confidence)
    tables = {
        "table_3_2": table_3_2(ratings, label),
        "survey_paired": paired_table(ratings, comparisons, settings, label),
        "survey_best_picks": best_picks_table(ratings, shares, baseline, confidence, label),
    }
    return SurveyAnalysis(tables, _results(ratings, comparisons, shares, baseline, label))


def describe_participants(ratings: Ratings) -> dict:
    """Count the participants, with count and percentage of every group and level of experience."""
    total = len(ratings)

    def share(count: int) -> dict:
        return {"count": count, "percent": 100 * count / total}

    return {
        "number": total,
        "groups": {name: share(int(np.sum(answers))) for name, answers in ratings.groups.items()},
        "experience": {level: share(ratings.experience.count(level)) for level in ratings.experience_levels},
        "sources": list(ratings.sources),
    }


def _results(
    ratings: Ratings, comparisons: list[PairedComparison], shares: PickShares, baseline: str, label: str
) -> dict:
    overall, concordance = friedman(ratings)
    p_values = mann_whitney(ratings)
    rest = without(shares, baseline)
    return {
        "schema": "lumbar.survey/1",
        "data": label,
        "participants": describe_participants(ratings),
        "models": list(ratings.models),
        "rating_counts": dict(zip(ratings.models, ratings.counts(), strict=True)),
        "kruskal_wallis": asdict(kruskal_wallis(ratings)),
        "mann_whitney": [
            {"first": first, "second": second, "p_value": p_value, "p_holm": p_holm}
            for (first, second), p_value, p_holm in zip(pairs(ratings), p_values, holm(p_values), strict=True)
        ],
        "friedman": {**asdict(overall), "kendall_w": concordance},
        "wilcoxon": [asdict(comparison) for comparison in comparisons],
        "best_picks": {
            model: {
                "picks": shares.picks[row],
                "percent": 100 * shares.share[row],
                "wilson_percent": 100 * shares.wilson[row],
                "goodman_percent": 100 * shares.goodman[row],
            }
            for row, model in enumerate(shares.models)
        },
        "equal_shares": {
            "all": asdict(equal_shares_test(shares.picks)),
            # Nobody may have picked any other model than the baseline.
            "without_baseline": asdict(equal_shares_test(rest)) if rest.sum() else None,
            "baseline": baseline,
        },
    }
