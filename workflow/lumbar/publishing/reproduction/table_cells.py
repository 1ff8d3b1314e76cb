"""One claim per number of Tables 3.1, 3.2 and 4.1."""

from __future__ import annotations

import math
from collections.abc import Callable

import pandas as pd

from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import Claim, Finding, Results
from lumbar.settings.stability import GROUPS

Criterion = tuple[str, Callable[[float, float], bool]]


def _points(limit: float) -> Criterion:
    return f"within {limit:g} percentage points", lambda thesis, found: abs(found - thesis) <= limit


def _factor(limit: float) -> Criterion:
    def near(thesis: float, found: float) -> bool:
        return thesis > 0 and found > 0 and abs(math.log(found / thesis)) <= math.log(limit)

    return f"within a factor of {limit:g}", near


def _within(limit: float) -> Criterion:
    return f"within {limit:g}", lambda thesis, found: abs(found - thesis) <= limit


_EQUAL: Criterion = ("equal to the printed digits", lambda thesis, found: abs(found - thesis) <= 0.051)
_SAME_SIGN: Criterion = ("same sign", lambda thesis, found: thesis * found > 0)

TABLE_3_1: dict[str, tuple[str, Criterion, bool]] = {
    "order": ("order of the transfer function", _within(1), False),
    "condition_number": ("condition number of the regressors", _factor(5), True),
    "vaf_percent": ("%VAF", _points(10), True),
    "fit_percent": ("FIT", _points(10), True),
    "mru_percent": ("maximum relative uncertainty in percent", _factor(10), False),
    "mean_residual_N": ("mean residual in N", _factor(2), True),
    "nmse_train": ("NMSE on the training record", _factor(3), False),
    "nmse_test_1": ("NMSE on the first test record", _factor(3), False),
    "nmse_test_2": ("NMSE on the second test record", _factor(3), False),
}
"""Column: what it is, when a run agrees, whether the twin's tissue was made to show it."""


def table_3_1_claims(thesis: pd.DataFrame) -> list[Claim]:
    """Every number of Table 3.1 except α, whose size depends on a scaling the thesis does not state."""
    claims = []
    for row in thesis.itertuples(index=False):
        for column, (meaning, criterion, built) in TABLE_3_1.items():
            claims.append(_cell_3_1(row, column, meaning, criterion, built))
        claims.append(
            Claim(
                id=f"table_3_1.{row.trained_on}.{row.model}.alpha",
                location="Table 3.1",
                statement=f"{row.model} trained on {row.trained_on}: ridge coefficient α",
                thesis=float(row.alpha),
                criterion="none: α scales with samples and units, which the thesis does not state",
                needs=("table_3_1",),
                judge=_alpha(row.trained_on, row.model),
            )
        )
    return claims


def _arx_row(results: Results, trained_on: str, model: str) -> pd.Series | None:
    table = results["table_3_1"]
    found = table[(table.trained_on == trained_on) & (table.model == model) & (table.estimator == "arx")]
    return None if found.empty else found.iloc[0]


def _cell_3_1(row, column: str, meaning: str, criterion: Criterion, built: bool) -> Claim:
    text, agrees = criterion
    thesis = float(getattr(row, column))

    def judge(results: Results) -> Finding:
        found = _arx_row(results, row.trained_on, row.model)
        if found is None or column not in found.index or pd.isna(found[column]):
            return Finding(None, None, f"no {column} for {row.model} trained on {row.trained_on}")
        return Finding(float(found[column]), agrees(thesis, float(found[column])))

    return Claim(
        id=f"table_3_1.{row.trained_on}.{row.model}.{column}",
        location="Table 3.1",
        statement=f"{row.model} trained on {row.trained_on}: {meaning}",
        thesis=thesis,
        criterion=text,
        needs=("table_3_1",),
        judge=judge,
        built_into_twin=built,
    )


def _alpha(trained_on: str, model: str) -> Callable[[Results], Finding]:
    def judge(results: Results) -> Finding:
        found = _arx_row(results, trained_on, model)
        return Finding(
            None if found is None else float(found["alpha"]), None, "scaling of α not stated in the thesis"
        )

    return judge


def table_3_2_claims(thesis: pd.DataFrame) -> list[Claim]:
    """Every number of Table 3.2; the survey was reconstructed from this very table."""
    claims = []
    for row in thesis.itertuples(index=False):
        for column in ("median", "mode", "mode_count", "best_percent"):
            claims.append(_cell_3_2(row.model, column, float(getattr(row, column)), _EQUAL))
        for other in ("MW", "KB", "HO"):
            printed = getattr(row, f"p_vs_{other}")
            if isinstance(printed, str) or not math.isnan(printed):
                claims.append(_p_value(row.model, other, str(printed)))
    return claims


def _cell_3_2(model: str, column: str, thesis: float, criterion: Criterion) -> Claim:
    text, agrees = criterion

    def judge(results: Results) -> Finding:
        table = results["table_3_2"].set_index("model")
        if model not in table.index:
            return Finding(None, None, f"{model} was not rated")
        found = float(table.at[model, column])
        return Finding(found, agrees(thesis, found))

    return Claim(
        id=f"table_3_2.{model}.{column}",
        location="Table 3.2",
        statement=f"{model}: {column.replace('_', ' ')} of the ratings",
        thesis=thesis,
        criterion=text,
        needs=("table_3_2",),
        judge=judge,
        built_into_twin=True,
    )


def _p_value(model: str, other: str, printed: str) -> Claim:
    def judge(results: Results) -> Finding:
        table = results["table_3_2"].set_index("model")
        if model not in table.index or pd.isna(table.at[model, f"p_vs_{other}"]):
            return Finding(None, None, f"{model} and {other} were not both rated")
        found = float(table.at[model, f"p_vs_{other}"])
        agrees = (
            found < float(printed[1:]) if printed.startswith("<") else abs(found - float(printed)) <= 0.05
        )
        return Finding(found, agrees)

    return Claim(
        id=f"table_3_2.{model}.p_vs_{other}",
        location="Table 3.2",
        statement=f"Mann–Whitney p of {model} against {other}",
        thesis=printed,
        criterion="as printed" if printed.startswith("<") else "within 0.05",
        needs=("table_3_2",),
        judge=judge,
        built_into_twin=True,
    )


def table_4_1_claims(thesis: pd.DataFrame, synthetic: bool, groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Every percentage of Table 4.1; on invented lifters the number is shown, but proves nothing."""
    names = comparison_names(groups)
    return [
        _cell_4_1(row, plane, synthetic, names[row.comparison])
        for row in thesis.itertuples(index=False)
        for plane in ("lateral_bending", "flexion_extension")
    ]


def _cell_4_1(row, plane: str, synthetic: bool, comparison: str) -> Claim:
    text, agrees = _SAME_SIGN
    thesis = float(getattr(row, f"{plane}_percent"))

    def judge(results: Results) -> Finding:
        table = results["table_4_1"]
        found = table[(table.comparison == comparison) & (table.com == row.com)]
        if found.empty or pd.isna(found.iloc[0][f"{plane}_percent"]):
            return Finding(None, None, "this study lacks one of the two lifts compared")
        value = float(found.iloc[0][f"{plane}_percent"])
        if synthetic:
            return Finding(value, None, "the twin's lifters are invented")
        return Finding(value, agrees(thesis, value))

    return Claim(
        id=f"table_4_1.{row.comparison}.{row.com}.{plane}",
        location="Table 4.1",
        statement=f"{comparison.replace('_', ' ')}, {row.com}, {plane.replace('_', ' ')}: difference in percent",
        thesis=thesis,
        criterion=text,
        needs=("table_4_1",),
        judge=judge,
    )
