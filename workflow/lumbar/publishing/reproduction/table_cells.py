"""One claim per number of Tables 3.1, 3.2 and 4.1; what the printed Table 3.1 allows by its own equations."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import Claim, Finding, Results
from lumbar.settings.stability import GROUPS

Criterion = tuple[str, Callable[..., bool]]
"""In words, and as a function of the thesis's and this run's value."""


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
_BELOW: Criterion = ("as printed", lambda printed, found: found < float(printed[1:]))
_NEAR: Criterion = ("within 0.05", lambda printed, found: abs(found - float(printed)) <= 0.05)
_NONE: Criterion = (
    "none: α scales with samples and units, which the thesis does not state",
    lambda thesis, found: False,
)
_SCALED = "scaling of α not stated in the thesis"

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
    """Every number of Table 3.1; of α, whose size depends on a scaling the thesis does not state, nothing is judged."""
    claims = [_mru_claim(thesis)]
    for row in thesis.itertuples(index=False):
        name, words = f"table_3_1.{row.trained_on}.{row.model}", f"{row.model} trained on {row.trained_on}"
        where = {"trained_on": row.trained_on, "model": row.model, "estimator": "arx"}
        for column, (meaning, criterion, built) in TABLE_3_1.items():
            cell = _Cell(where, column, f"no {column} for {words}")
            thesis_value = float(getattr(row, column))
            claims.append(
                _claim(f"{name}.{column}", f"{words}: {meaning}", thesis_value, criterion, cell, built)
            )
        cell = _Cell(where, "alpha", _SCALED, _SCALED)
        claims.append(_claim(f"{name}.alpha", f"{words}: ridge coefficient α", float(row.alpha), _NONE, cell))
    return claims


def _mru_claim(thesis: pd.DataFrame) -> Claim:
    """The print against itself: no data are needed to see that its MRU are not those of its equations."""
    below = impossible_mru(thesis)
    said = "; ".join(f"{row} {value:g} %, at least {least:.2g} %" for row, (value, least) in below.items())
    return Claim(
        "mru_equations",
        "3.2.3.1, Table 3.1",
        "The printed relative uncertainties are those of Eqs 3.15 and 3.16",
        "Table 3.1",
        "no printed value is below the least that condition number, NMSE and samples beside it allow",
        ("table_3_1",),
        lambda results: Finding(said or "none below", not below, "of the print alone"),
    )


def table_3_2_claims(thesis: pd.DataFrame) -> list[Claim]:
    """Every number of Table 3.2; the survey was reconstructed from this very table."""
    claims = []
    for row in thesis.itertuples(index=False):
        name, where = f"table_3_2.{row.model}", {"model": row.model}
        for column in ("median", "mode", "mode_count", "best_percent"):
            words = f"{row.model}: {column.replace('_', ' ')} of the ratings"
            cell = _Cell(where, column, f"{row.model} was not rated")
            claims.append(_claim(f"{name}.{column}", words, float(getattr(row, column)), _EQUAL, cell, True))
        for other in ("MW", "KB", "HO"):
            column = f"p_vs_{other}"
            printed = getattr(row, column)
            if isinstance(printed, str) or not math.isnan(printed):
                words = f"Mann–Whitney p of {row.model} against {other}"
                criterion = _BELOW if str(printed).startswith("<") else _NEAR
                cell = _Cell(where, column, f"{row.model} and {other} were not both rated")
                claims.append(_claim(f"{name}.{column}", words, str(printed), criterion, cell, True))
    return claims


def table_4_1_claims(thesis: pd.DataFrame, synthetic: bool, groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Every percentage of Table 4.1; on invented lifters the number is shown, but proves nothing."""
    names, claims = comparison_names(groups), []
    untested = "the twin's lifters are invented" if synthetic else ""
    for row in thesis.itertuples(index=False):
        comparison = names[row.comparison]
        where = {"comparison": comparison, "com": row.com}
        for plane in ("lateral_bending", "flexion_extension"):
            place = f"{comparison.replace('_', ' ')}, {row.com}, {plane.replace('_', ' ')}"
            cell = _Cell(
                where, f"{plane}_percent", "this study lacks one of the two lifts compared", untested
            )
            name, value = f"table_4_1.{row.comparison}.{row.com}.{plane}", float(getattr(row, cell.column))
            claims.append(_claim(name, f"{place}: difference in percent", value, _SAME_SIGN, cell))
    return claims


@dataclass(frozen=True)
class _Cell:
    """Where this run's counterpart of a number stands."""

    where: dict[str, str]
    """What tells the row of the run's table, by column."""
    column: str
    absent: str
    """What is said where the run has no such number."""
    untested: str = ""
    """Why a number that is there proves nothing; empty where it is judged."""

    def value(self, table: pd.DataFrame) -> float | None:
        """Number of this run; None where there is none."""
        for key, value in self.where.items():
            table = table[table[key] == value]
        missing = table.empty or self.column not in table or pd.isna(table.iloc[0][self.column])
        return None if missing else float(table.iloc[0][self.column])


def _claim(
    name: str, statement: str, thesis: float | str, criterion: Criterion, cell: _Cell, built: bool = False
) -> Claim:
    """The claim that a number of a published table is this run's too; its name begins with the table's."""
    table = name.split(".")[0]
    words, agrees = criterion

    def judge(results: Results) -> Finding:
        found = cell.value(results[table])
        if found is None:
            return Finding(None, None, cell.absent)
        if cell.untested:
            return Finding(found, None, cell.untested)
        return Finding(found, agrees(thesis, found))

    location = f"Table {table.removeprefix('table_').replace('_', '.')}"
    return Claim(name, location, statement, thesis, words, (table,), judge, built)


SAMPLES = {"multisine": 10_000, "noise": 1_000, "chirp": 1_000}
"""Samples of the thesis's records: 100 Hz for 100 s and 10 s (Section 3.2.4.1)."""


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
