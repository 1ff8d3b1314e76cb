"""The complete survey analysis: three tables, the models picked as the best, and all results as plain data."""

from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
import scipy

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import Ratings
from lumbar.settings.runtime import SurveySettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.survey.paired_analysis import compare_pairs, friedman, paired_table
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
    """Number of picks, shape (models,)."""
    share: np.ndarray
    """Share of the picks for each model, shape (models,)."""
    wilson: np.ndarray
    """Ends of each model's separate interval (Wilson), shape (models, 2)."""
    goodman: np.ndarray
    """Ends of the simultaneous intervals of all models (Goodman), shape (models, 2)."""

    def drop(self, model: str) -> np.ndarray:
        """Return the picks of all other models."""
        return self.picks[[other != model for other in self.models]]


def pick_shares(ratings: Ratings, confidence: float) -> PickShares:
    """Return the share of best picks of every model with two kinds of intervals at a confidence, e.g. 0.95.

    Separate intervals (E. B. Wilson, JASA 22, 1927, 209-212), and simultaneous ones (L. A. Goodman, Technometrics 7, 1965,
    247-254).
    """
    from statsmodels.stats.proportion import multinomial_proportions_confint, proportion_confint

    picks, participants = ratings.picks(), len(ratings)
    wilson = np.column_stack(proportion_confint(picks, participants, alpha=1 - confidence, method="wilson"))
    goodman = np.asarray(multinomial_proportions_confint(picks, alpha=1 - confidence, method="goodman"))
    return PickShares(ratings.models, picks, picks / participants, wilson, goodman)


def equal_shares_test(picks: np.ndarray) -> Overall:
    """Return Pearson's chi-square test that all models are picked equally often; picks of shape (models,).

    Raises
    ------
    NumericalError
        If there are no picks or fewer than two models.
    """
    if len(picks) < 2 or picks.sum() == 0:
        raise NumericalError(
            f"chi-square test of {picks.sum()} picks among {len(picks)} models: nothing to compare"
        )
    result = scipy.stats.chisquare(picks)
    return Overall(float(result.statistic), len(picks) - 1, float(result.pvalue))


def best_picks_table(
    ratings: Ratings, shares: PickShares, baseline: str, confidence: float, source_label: str
) -> Table:
    """Return the table of the best picks: one row per model."""
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
    notes = [_verdict("all models", shares.picks)]
    rest = [model for model in shares.models if model != baseline]
    if len(rest) > 1 and shares.drop(baseline).sum():
        notes.append(_verdict(f"{', '.join(rest)} (without {baseline})", shares.drop(baseline)))
    notes += reality_notes(ratings)
    fields = {"confidence": f"{100 * confidence:g} %"}
    return table_from_schema("tissue/survey", "survey_best_picks", frame, source_label, fields, notes=notes)


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
    """Tables and results of a survey."""

    tables: dict[str, Table]
    """Tables by name: ``table_3_2`` as published, ``survey_paired`` within participants, ``survey_best_picks``."""
    results: dict
    """Results as plain data, schema ``lumbar.survey/1``."""


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
    overall, concordance = friedman(ratings)
    p_values = mann_whitney(ratings)
    rest = shares.drop(baseline)
    results = {
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
            "without_baseline": asdict(equal_shares_test(rest)) if rest.sum() else None,
            "baseline": baseline,
        },
    }
    return SurveyAnalysis(tables, results)


def describe_participants(ratings: Ratings) -> dict:
    """Return the number of participants, with count and percentage of each group and each level of experience."""

    def share(count: int) -> dict:
        return {"count": count, "percent": 100 * count / len(ratings)}

    return {
        "number": len(ratings),
        "groups": {name: share(int(np.sum(answers))) for name, answers in ratings.groups.items()},
        "experience": {level: share(ratings.experience.count(level)) for level in ratings.experience_levels},
        "sources": list(ratings.sources),
    }
