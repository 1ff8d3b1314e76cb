"""The thesis's values beside this run's: sentences, and the cells of Tables 3.1 and 3.2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lumbar.tables.layout import scientific, split_number
from lumbar.tables.words import column_in_words

if TYPE_CHECKING:
    import pandas as pd

SHOWN_WITH = {
    "bandwidth": "surgeon_psd",
    "multisine": "signal_properties",
    "models": "figure_3_5",
    "survey": "table_3_2",
    "boa": "basin_areas",
}
"""Artefact with which a claim is shown, by the evidence that it is judged on; others stand with the table of that name."""
CELLS = {"table_3_1": 2, "table_3_2": 1}
"""How many parts of a claim's name tell the row, by table: ``table_3_1.<record>.<model>.<column>``. Table 4.1 has the
published values among its own columns."""


@dataclass(frozen=True)
class Said:
    """One claim of the thesis."""

    statement: str
    thesis: str
    run: str
    verdict: str
    criterion: str
    """`statement`, `thesis`, `run`, `verdict`, `criterion`: as in ``claims.csv``, values with four digits."""
    location: str
    """Section or table of the thesis."""


@dataclass(frozen=True)
class Beside:
    """Cells of a published table."""

    head: tuple[str, ...]
    rows: tuple[tuple, ...]
    """Names of the row, then per column ``(this run, thesis, verdict)``."""
    names: int
    """How many names a row has."""

    @property
    def fractions(self) -> list[int]:
        """Characters from the decimal sign on, by column of values."""
        columns = zip(*(row[self.names :] for row in self.rows), strict=True)
        return [max(len(split_number(text)[1]) for cell in cells for text in cell[:2]) for cells in columns]


def claims_shown_with(claims: pd.DataFrame, artefact: str) -> list[Said]:
    """Return the claims that are shown with an artefact."""
    sentences = [(row, row.evidence.split()[0]) for row in claims.itertuples() if not _is_cell(row.claim)]
    return [
        claim_sentence(row) for row, evidence in sentences if SHOWN_WITH.get(evidence, evidence) == artefact
    ]


def claim_sentence(row) -> Said:
    """Return a row of ``claims.csv`` in words."""
    values = in_digits(row.thesis_value), in_digits(row.this_run)
    return Said(row.statement, *values, row.verdict, row.criterion, row.location)


def not_holding(claims: pd.DataFrame, verdict: str) -> tuple[list[Said], list[Said]]:
    """Return the claims with a verdict: sentences, and cells of published tables."""
    rows = list(claims[claims["verdict"] == verdict].itertuples())
    return (
        [claim_sentence(row) for row in rows if not _is_cell(row.claim)],
        [claim_sentence(row) for row in rows if _is_cell(row.claim)],
    )


def beside(claims: pd.DataFrame, table: str) -> Beside | None:
    """Return the published cells of a table beside this run's; None for tables without."""
    rows = [row for row in claims.itertuples() if row.claim.startswith(f"{table}.")]
    if table not in CELLS or not rows:
        return None
    names = CELLS[table]
    cells: dict[tuple[str, ...], dict[str, tuple[str, str, str]]] = {}
    for row in rows:
        *key, column = row.claim.removeprefix(f"{table}.").split(".")
        values = in_digits(row.this_run), in_digits(row.thesis_value)
        cells.setdefault(tuple(key), {})[column] = (*values, row.verdict)
    columns = list(dict.fromkeys(column for found in cells.values() for column in found))
    empty = ("–", "–", "")
    return Beside(
        head=(*("Trained on", "Model")[-names:], *map(column_in_words, columns)),
        rows=tuple((*key, *(found.get(column, empty) for column in columns)) for key, found in cells.items()),
        names=names,
    )


def in_digits(value) -> str:
    """Return a value of ``claims.csv``: numbers with four digits, words as they are, nothing as a dash."""
    if value is None or value != value:
        return "–"
    try:
        return scientific(f"{float(value):.4g}")
    except ValueError:
        return str(value)


def count_verdicts(claims: pd.DataFrame) -> Sequence[tuple[str, int]]:
    """Return how many claims have each verdict."""
    return list(claims["verdict"].value_counts().items())


def _is_cell(claim: str) -> bool:
    return claim.startswith("table_")
