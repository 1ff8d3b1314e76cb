"""All claims of the thesis (every number of Tables 3.1, 3.2 and 4.1, and sentences), and the rows of ``claims.csv``."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.stability.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import (
    BUILT_IN,
    BY_DEFINITION,
    CANNOT_BE_TESTED,
    DOES_NOT_HOLD,
    HOLDS,
    Claim,
    Outcome,
    Results,
    UntestableError,
)
from lumbar.publishing.reproduction.sentence_judges import MAX_RATIO, judges_of_sentences
from lumbar.settings.lifting import GROUPS
from lumbar.tables.table import Table, columns_of, table_from_schema

_UNKNOWN_SCALING = "scaling of α not stated in the thesis"
Criterion = tuple[str, Callable[[Any, float], bool | None]]
"""Criterion: text, and a function of the values in thesis and run, which returns None if they cannot be compared."""


def _tolerance(tolerance: float, text: str) -> Criterion:
    return text, lambda thesis, value: abs(value - thesis) <= tolerance


def _factor(limit: float, points: float = math.inf) -> Criterion:
    """Return the criterion of the same sign and a ratio up to a limit and, if given, a difference up to a number of points."""

    def agrees(thesis: float, value: float) -> bool:
        return (
            thesis * value > 0
            and abs(math.log(value / thesis)) <= math.log(limit)
            and abs(value - thesis) <= points
        )

    return f"within {'' if math.isinf(points) else f'{points:g} points and '}a factor of {limit:g}", agrees


TABLE_3_1: dict[str, tuple[str, Criterion]] = {
    "order": ("order of the transfer function", _tolerance(0, "equal")),
    "condition_number": ("condition number of the regressors", _factor(2)),
    "vaf_percent": ("%VAF", _factor(1.5, points=5)),
    "fit_percent": ("FIT", _factor(1.5, points=5)),
    "mru_percent": ("maximum relative uncertainty in percent", _factor(3)),
    "mean_residual_N": ("mean residual in N", _factor(1.2)),
    "nmse_train": ("NMSE on the training record", _factor(1.5)),
    "nmse_test_1": ("NMSE on the first test record", _factor(1.5)),
    "nmse_test_2": ("NMSE on the second test record", _factor(1.5)),
    "alpha": (
        "ridge coefficient α",
        ("none: α scales with samples and units, which the thesis does not state", lambda *_: None),
    ),
}
"""Meaning and criterion of each column of Table 3.1. α depends on a scaling that the thesis does not state.

The limits are so narrow that most numbers in other rows of a printed column fail them; `agreement_note` counts the others.
"""
_BUILT_IN = {"condition_number", "vaf_percent", "fit_percent", "mean_residual_N"}
"""Columns of Table 3.1 that the twin's tissue was made to reproduce."""
_FIRST_ORDER = {"MW": "Eq. 3.3", "KB": "Eq. 3.4"}
_DIGITS = _tolerance(0.051, "equal to the printed digits")


def all_claims(thesis_tables: dict[str, pd.DataFrame], groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Return every claim in the thesis's order.

    `thesis_tables` are ``table_3_1``, ``table_3_2`` and ``table_4_1`` as published; `groups` are the names that
    replace the thesis's expert and novice in the study.
    """
    return [
        *sentence_claims("identification"),
        _mru_claim(thesis_tables["table_3_1"]),
        *(cell.claim() for cell in _table_3_1_cells(thesis_tables["table_3_1"])),
        *sentence_claims("survey"),
        *(cell.claim() for cell in _table_3_2_cells(thesis_tables["table_3_2"])),
        *sentence_claims("basins", groups),
        *(cell.claim() for cell in _table_4_1_cells(thesis_tables["table_4_1"], groups)),
    ]


def sentence_claims(part: str, groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Return the claims of a part of ``claims.yaml``: ``identification``, ``survey`` or ``basins``.

    `groups` replace the thesis's expert and novice in the statements.
    """
    judges = judges_of_sentences(groups)
    fields = {"first": groups[0], "second": groups[1], "within": MAX_RATIO}
    return [
        Claim(
            id=name,
            statement=entry.pop("statement").format(**fields),
            criterion=entry.pop("criterion").format(**fields),
            needs=tuple(entry.pop("needs")),
            judge=judges[name],
            **entry,
        )
        for name, entry in shipped_yaml(Path(__file__).with_name("claims.yaml"))[part].items()
    ]


@dataclass(frozen=True)
class _Cell:
    """A cell of a published table, and the corresponding cell of this run."""

    name: str
    """Name of the claim: ``<table>.<row>.<column>``."""
    statement: str
    row: dict[str, str]
    """Values by column that select the row of this run's table."""
    thesis: float | str
    criterion: Criterion
    absent: str
    """Remark if this run has no such cell."""
    on_twin: str = ""
    column: str = ""
    """Column of this run's table; if empty, the column in `name`."""
    defined: str = ""
    """Reason why no data can contradict the published value; empty if data decide."""

    def judge(self, results: Results) -> Outcome:
        """Compare this run's value with the published value."""
        table, *_, last = self.name.split(".")
        frame, column = results[table], self.column or last
        for key, value in self.row.items():
            frame = frame[frame[key] == value]
        if frame.empty or column not in frame or pd.isna(frame.iloc[0][column]):
            raise UntestableError(self.absent)
        value = float(frame.iloc[0][column])
        agrees = self.criterion[1](self.thesis, value)
        remark = self.absent if agrees is None else self.defined
        return Outcome(value, agrees, remark, by_definition=bool(self.defined))

    def claim(self) -> Claim:
        """Return the claim that this run's cell agrees with the published cell."""
        table = self.name.split(".")[0]
        location = f"Table {table.removeprefix('table_').replace('_', '.')}"
        claimed = (self.name, location, self.statement, self.thesis, self.criterion[0])
        return Claim(*claimed, (table,), self.judge, self.on_twin)


def _table_3_1_cells(thesis: pd.DataFrame) -> list[_Cell]:
    cells = []
    for row in thesis.to_dict("records"):
        record, model = row["trained_on"], row["model"]
        selected = {"trained_on": record, "model": model, "estimator": "arx"}
        for column, (meaning, criterion) in TABLE_3_1.items():
            text = f"{model} trained on {record}"
            absent = _UNKNOWN_SCALING if column == "alpha" else f"no {column} for {text}"
            compared = float(row[column]), criterion, absent, BUILT_IN if column in _BUILT_IN else ""
            name, fixed = f"table_3_1.{record}.{model}.{column}", column == "order" and model in _FIRST_ORDER
            defined = f"{_FIRST_ORDER[model]} has one pole" if fixed else ""
            cells.append(_Cell(name, f"{text}: {meaning}", selected, *compared, defined=defined))
    return cells


def _table_3_2_cells(thesis: pd.DataFrame) -> list[_Cell]:
    """Return the cells of Table 3.2, from which the survey was reconstructed."""
    cells = []
    for row in thesis.to_dict("records"):
        model = row["model"]
        for column in ("median", "mode", "mode_count", "best_percent"):
            statement = f"{model}: {column.replace('_', ' ')} of the ratings"
            compared = float(row[column]), _DIGITS, f"{model} was not rated", BUILT_IN
            cells.append(_Cell(f"table_3_2.{model}.{column}", statement, {"model": model}, *compared))
        for other in ("MW", "KB", "HO"):
            printed = str(row[f"p_vs_{other}"])
            if printed == "nan":
                continue
            if printed.startswith("<"):
                limit = float(printed[1:])
                compared = printed, ("as printed", lambda _, value, limit=limit: value < limit)
            else:
                compared = float(printed), _tolerance(0.05, "within 0.05")
            statement = f"Mann–Whitney p of {model} against {other}"
            more = f"{model} and {other} were not both rated", BUILT_IN
            cells.append(
                _Cell(f"table_3_2.{model}.p_vs_{other}", statement, {"model": model}, *compared, *more)
            )
    return cells


def _table_4_1_cells(thesis: pd.DataFrame, groups: tuple[str, str]) -> list[_Cell]:
    names, cells = comparison_names(groups), []
    absent = "this study lacks one of the two lifts compared"
    for row in thesis.to_dict("records"):
        comparison, com = names[row["comparison"]], row["com"]
        for plane in ("lateral_bending", "flexion_extension"):
            name = f"table_4_1.{row['comparison']}.{com}.{plane}"
            statement = f"{comparison}, {com}, {plane}".replace("_", " ") + ": difference in percent"
            selected, column = {"comparison": comparison, "com": com}, f"{plane}_percent"
            compared = float(row[column]), _factor(2), absent, CANNOT_BE_TESTED, column
            cells.append(_Cell(name, statement, selected, *compared))
    return cells


def _mru_claim(thesis: pd.DataFrame) -> Claim:
    """Return the claim on the printed MRU, decided by the printed table."""
    below = impossible_mru(thesis)
    values = "; ".join(f"{row} {value:g} %, at least {least:.2g} %" for row, (value, least) in below.items())
    return Claim(
        "mru_equations",
        "3.2.3.1, Table 3.1",
        "The printed relative uncertainties are those of Eqs 3.15 and 3.16",
        "Table 3.1",
        "no printed value is below the least that its condition number, NMSE and samples allow",
        ("table_3_1",),
        lambda results: Outcome(values or "none below", not below, "of the print alone"),
    )


SAMPLES = {"multisine": 10_000, "noise": 1_000, "chirp": 1_000}
"""Number of samples of the thesis's records: 100 Hz for 100 s and 10 s (Section 3.2.4.1)."""


def least_mru(condition_number: float, nmse: float, samples: int, parameters: int) -> float:
    """Return the smallest MRU in percent that is possible by Eqs 3.15 and 3.16 for any data, scaling and α.

    With columns of root mean square 1, and M rows, every diagonal element of (AᵀA)⁻¹ is at least 1/M, hence σ² ≥ NMSE/M in
    units of the output's root mean square; and ‖x‖ ≤ (1 + √NMSE)/s where s, the smallest singular value over √M, is at least
    1/κ. The printed κ may be for differently scaled columns; then it is at most √p times smaller than this κ (van der Sluis).

    References
    ----------
    A. van der Sluis, Numerische Mathematik 14 (1969) 14-23.
    """
    return 100 * math.sqrt(nmse / samples / parameters) / (condition_number * (1 + math.sqrt(nmse)))


def impossible_mru(printed: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Return by row the printed MRUs below the row's least MRU, and that least MRU, with allowance for rounded digits."""
    below = {}
    for row in printed.itertuples(index=False):
        parameters = {"MW": 2, "KB": 3}.get(row.model, 2 * int(row.order) + 1)
        nmse = max(row.nmse_train - 0.005, 0.0)
        least = least_mru(row.condition_number + 0.005, nmse, SAMPLES[row.trained_on], parameters)
        if row.mru_percent + 0.005 < least:
            below[f"{row.model} on {row.trained_on}"] = (float(row.mru_percent), least)
    return below


def examine_claims(claims: list[Claim], results: Results, synthetic: bool, source_label: str) -> pd.DataFrame:
    """Examine all claims on the results of one run.

    The rows are in the order of the `claims`; `results` are the run's results by name, `synthetic` is True for the twin,
    `source_label` is the source of the data. Columns are ``claim, location, statement, thesis_value, this_run,
    verdict, criterion, remark, evidence, data``.
    """
    rows = []
    for claim in claims:
        try:
            if missing := [name for name in claim.needs if results.get(name) is None]:
                raise UntestableError(f"this study has no {', '.join(missing)}")
            outcome = claim.judge(results)
        except UntestableError as error:
            outcome = Outcome(None, None, str(error))
        remark = outcome.remark
        if outcome.agrees is None:
            verdict = CANNOT_BE_TESTED
        elif synthetic and claim.on_twin == CANNOT_BE_TESTED:
            verdict, remark = CANNOT_BE_TESTED, "the twin's lifters are invented"
        elif not outcome.agrees:
            verdict = DOES_NOT_HOLD
        elif outcome.by_definition:
            verdict = BY_DEFINITION
        else:
            verdict = BUILT_IN if synthetic and claim.on_twin == BUILT_IN else HOLDS
        rows.append(
            {
                "claim": claim.id,
                "location": claim.location,
                "statement": claim.statement,
                "thesis_value": claim.thesis,
                "this_run": outcome.value,
                "verdict": verdict,
                "criterion": claim.criterion,
                "remark": remark,
                "evidence": " ".join(claim.needs),
                "data": source_label,
            }
        )
    return pd.DataFrame(rows)


def summary_table(claims: pd.DataFrame, source_label: str) -> Table:
    """Return the claims as a table, first the sentences, then the cells of the published tables."""
    frame = claims[columns_of("publishing/reproduction", "claims")].astype(object)
    for column in ("thesis_value", "this_run"):
        frame[column] = [
            "–" if pd.isna(value) else f"{value:.4g}" if isinstance(value, float) else str(value)
            for value in frame[column]
        ]
    verdicts = "; ".join(f"{name}: {count}" for name, count in claims.verdict.value_counts().items())
    is_sentence = ~claims.claim.str.startswith("table_")
    return table_from_schema(
        "publishing/reproduction",
        "claims",
        frame,
        source_label,
        {"count": len(claims), "verdicts": verdicts},
        notes=(*agreement_note(claims), *vaf_note(claims)),
        first_rows=tuple(is_sentence.to_numpy().nonzero()[0]),
    )


def agreement_note(claims: pd.DataFrame) -> tuple[str, ...]:
    """Return a note on the cells of Table 3.1 that agree, per column, with limit and rate of chance; none without cells.

    The rate of chance is the share of pairs of different rows of the printed column that meet the criterion.
    """
    counts = []
    for column, (meaning, (limit, agrees)) in TABLE_3_1.items():
        cells = claims[claims.claim.str.fullmatch(rf"table_3_1\..*\.{column}")]
        cells = cells[~cells.verdict.isin([CANNOT_BE_TESTED, BY_DEFINITION])]
        if len(cells) > 1:
            pairs = [agrees(*pair) for pair in permutations(cells.thesis_value.astype(float), 2)]
            number, chance = (cells.verdict != DOES_NOT_HOLD).sum(), 100 * sum(pairs) / len(pairs)
            counts.append(f"{meaning}: {number} of {len(cells)} {limit} ({chance:.0f} %)")
    head = "Numbers of Table 3.1 that agree, and within what (in brackets: share of the numbers in other rows that would)"
    return (f"{head}: {'; '.join(counts)}",) if counts else ()


def vaf_note(claims: pd.DataFrame) -> tuple[str, ...]:
    """Return a note with the printed %VAF and this run's, by training record, and whether all of a record agree."""
    cells = claims[claims.claim.str.fullmatch(r"table_3_1\..*\.vaf_percent") & claims.this_run.notna()]
    records = []
    for record, rows in cells.groupby(cells.claim.str.split(".").str[1], sort=False):
        models, agree = rows.claim.str.split(".").str[2], rows.verdict != DOES_NOT_HOLD
        printed, here = (
            ", ".join(f"{value:.2f}" for value in rows[name]) for name in ("thesis_value", "this_run")
        )
        verdict = f"{agree.sum()} of {len(agree)} agree"
        records.append(f"{record} ({', '.join(models)}) {printed} in print, {here} here: {verdict}")
    return (f"%VAF trained on {'; '.join(records)}",) if records else ()
