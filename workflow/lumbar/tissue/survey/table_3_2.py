"""Table 3.2 as the thesis computed it: medians, modes, Kruskal-Wallis, Mann-Whitney, Holm.

The tests treat the ratings of two models as independent samples, although every participant rated all models; see
`lumbar.tissue.survey.paired_analysis`.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
import scipy

from lumbar.base.errors import NumericalError
from lumbar.records.ratings import NOT_REAL, Ratings
from lumbar.tables.table import Table, table_from_schema


@dataclass(frozen=True)
class Overall:
    """A test of all models together."""

    statistic: float
    """Test statistic, corrected for ties."""
    dof: int
    """Degrees of freedom of its chi-square approximation."""
    p_value: float
    """Probability of a statistic at least as large if all models were rated equally."""


def reality_notes(ratings: Ratings) -> tuple[str, ...]:
    """Return a remark for tables of reconstructed answers; empty for real answers."""
    if NOT_REAL not in ratings.sources:
        return ()
    return (
        "The answers are reconstructed: their margins (how often each rating and each pick was given) fit the published "
        "table, but which answers belong to one participant is not known. Results that use the pairing are a demonstration "
        "here, not evidence.",
    )


def pairs(ratings: Ratings) -> list[tuple[str, str]]:
    """Return all pairs of models in the order of the table."""
    return list(combinations(ratings.models, 2))


def holm(p_values: np.ndarray) -> np.ndarray:
    """Return p-values after Holm's step-down adjustment (S. Holm, Scand. J. Stat. 6, 1979, 65-70)."""
    from statsmodels.stats.multitest import multipletests

    return multipletests(p_values, method="holm")[1]


def kruskal_wallis(ratings: Ratings) -> Overall:
    """Return the Kruskal-Wallis H-test with tie correction (section 3.2.3.2 of the thesis).

    Raises
    ------
    NumericalError
        If every participant gave every model the same rating.
    """
    if np.ptp(ratings.scores) == 0:
        raise NumericalError("Kruskal-Wallis test: all ratings are equal, so there is nothing to compare")
    result = scipy.stats.kruskal(*ratings.scores.T)
    return Overall(float(result.statistic), len(ratings.models) - 1, float(result.pvalue))


def mann_whitney(ratings: Ratings) -> np.ndarray:
    """Return the two-sided Mann-Whitney p-value of every pair of models, shape (pairs,), in the order of `pairs`.

    Normal approximation with correction for ties and for continuity, because the exact distribution is not valid for ties. If
    all ratings of two models are equal, p = 1.
    """
    p_values = []
    for a, b in pairs(ratings):
        both = ratings.scores_of(a), ratings.scores_of(b)
        are_equal = np.ptp(np.concatenate(both)) == 0
        p_values.append(
            1.0 if are_equal else float(scipy.stats.mannwhitneyu(*both, method="asymptotic").pvalue)
        )
    return np.array(p_values)


def modes(counts: np.ndarray) -> str:
    """Return the most frequent ratings, e.g. ``"4"``, or ``"3/4"`` for two modes."""
    return "/".join(str(point) for point in np.flatnonzero(counts == counts.max()) + 1)


def table_3_2(ratings: Ratings, source_label: str) -> Table:
    """Return Table 3.2 of the thesis, one row per model; the p-value of a pair is in the row of its first model."""
    counts, participants = ratings.counts(), len(ratings)
    columns: dict[str, list] = {
        "model": list(ratings.models),
        "median": [float(np.median(ratings.scores_of(model))) for model in ratings.models],
        "mode": [modes(row) for row in counts],
        "mode_count": counts.max(axis=1).tolist(),
        "best_percent": (100 * ratings.picks() / participants).tolist(),
    }
    p_values = mann_whitney(ratings)
    adjusted = holm(p_values)
    # The thesis's format: one decimal, here two digits from 0.05 to 0.1.
    printed = [
        "<0.001" if p < 0.001 else "<0.05" if p < 0.05 else f"{p:.1f}" if p >= 0.1 else f"{p:.2g}"
        for p in p_values
    ]
    for prefix, values in (
        ("p", p_values.tolist()),
        ("p_holm", adjusted.tolist()),
        ("printed", printed),
    ):
        by_pair = dict(zip(pairs(ratings), values, strict=True))
        for second in ratings.models[1:]:
            columns[f"{prefix}_vs_{second}"] = [by_pair.get((first, second)) for first in ratings.models]
    fields = {"points": ratings.scale_points, "pairs": len(pairs(ratings))}
    first = tuple(name for name in columns if not name.startswith("p_"))  # the thesis's columns
    overall = kruskal_wallis(ratings)
    tested = zip(pairs(ratings), p_values, adjusted, strict=True)
    changed = [f"{a} and {b}" for (a, b), p, p_holm in tested if p < 0.05 <= p_holm]
    notes = (
        f"Kruskal-Wallis over {len(ratings.models)} models: H = {overall.statistic:.2f}, {overall.dof} degrees of freedom, "
        f"p = {overall.p_value:#.2g}; {len(ratings)} participants.",
        "Pairs that lose significance at 0.05 by Holm's correction: " + (", ".join(changed) or "none") + ".",
        "Every participant rated all models, so the ratings are not independent samples as these tests assume: see the "
        "within-subject analysis (survey_paired).",
        "A large p-value does not prove that two models are rated equally.",
        *reality_notes(ratings),
    )
    return table_from_schema(
        "tissue/survey", "table_3_2", pd.DataFrame(columns), source_label, fields, notes=notes, first=first
    )
