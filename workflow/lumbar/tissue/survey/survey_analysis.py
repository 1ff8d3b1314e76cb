"""The whole survey in one call: its three tables and all results as plain data."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.records.ratings import Ratings
from lumbar.tables.table import Table
from lumbar.tissue.survey.best_picks import (
    PickShares,
    best_picks_table,
    equal_shares_test,
    pick_shares,
    without,
)
from lumbar.tissue.survey.paired_analysis import PairedComparison, compare_pairs, friedman, paired_table
from lumbar.tissue.survey.table_3_2 import holm, kruskal_wallis, mann_whitney, pairs, table_3_2

if TYPE_CHECKING:
    from lumbar.settings.survey import SurveySettings


@dataclass(frozen=True)
class SurveyAnalysis:
    """What the survey shows."""

    tables: dict[str, Table]
    """``table_3_2`` as published, ``survey_paired`` within participants, ``survey_best_picks``."""
    results: dict
    """Plain data, schema ``lumbar.survey/1``."""


def analyse_survey(ratings: Ratings, settings: SurveySettings, seed: int, data: str) -> SurveyAnalysis:
    """Analyse the answers as the thesis did, and within participants.

    Raises
    ------
    NumericalError
        If the answers do not differ at all.
    """
    label = ratings.label(data, settings.note)
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
