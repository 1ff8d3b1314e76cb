"""Publishing a table as CSV, LaTeX and HTML, with the definition of every column."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.errors import NumericalError
from lumbar.files import write_text
from lumbar.templates import template

if TYPE_CHECKING:
    import pandas as pd

SYNTHETIC_TWIN = "synthetic twin"
"""The words that stand on everything made from synthetic data."""

_TEX_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
    }
)


@dataclass(frozen=True, repr=False)
class Table:
    """A table as it is published.

    Attributes
    ----------
    title : str
        One sentence that says what the table shows.
    frame : pandas.DataFrame
        The values; column names as in the CSV file. Empty cells are ``None`` or NaN only in the
        columns named in `may_be_empty`.
    definitions : dict of str to str
        Definition of each column: formula or rule, scaling and unit.
    notes : tuple of str
        Remarks shown below the table.
    data : str
        Where the data come from, e.g. ``"synthetic twin"``; shown in every format.
    decimals : dict of str to int
        Digits after the point in LaTeX and HTML (default: four significant digits).
    may_be_empty : frozenset of str
        Columns in which a cell may be empty ("not applicable").
    headers : dict of str to str
        Words that stand over the columns in LaTeX and HTML; where there are any, the columns without stand in the CSV
        file alone. Default: all columns under their own names.
    """

    title: str
    frame: pd.DataFrame
    definitions: dict[str, str]
    data: str
    notes: tuple[str, ...] = ()
    decimals: dict[str, int] = field(default_factory=dict)
    may_be_empty: frozenset[str] = frozenset()
    headers: dict[str, str] = field(default_factory=dict)

    def __post_init__(self):
        undefined = [column for column in self.frame.columns if column not in self.definitions]
        if undefined:
            raise ValueError(f"columns without a definition: {undefined}")
        for column in self.frame.columns:
            empty = self.frame[column].isna()
            if empty.any() and column not in self.may_be_empty:
                row = int(empty.argmax()) + 1
                raise NumericalError(f"{self.title}: no value in column {column}, row {row}")
            for row, value in enumerate(self.frame[column], start=1):
                if isinstance(value, float) and math.isinf(value):
                    raise NumericalError(f"{self.title}: {value} in column {column}, row {row}")

    def __repr__(self) -> str:
        columns = ", ".join(map(str, self.frame.columns))
        return f"<Table: {self.title} {len(self.frame)} rows; {columns}>"

    def __str__(self) -> str:
        """The table as a terminal shows it."""
        return f"{self.title}\n{self.frame.to_string(index=False)}"

    def _repr_html_(self) -> str:
        return self.frame.to_html(index=False)

    def write(self, stem: str | os.PathLike) -> None:
        """Write ``stem.csv``, ``stem.tex`` and ``stem.html``.

        The CSV file has a last column ``data`` that says where the data come from; the LaTeX and HTML files
        carry title, definitions and notes.
        """
        stem = Path(stem)
        frame = self.frame.assign(data=self.data)
        write_text(stem.with_name(stem.name + ".csv"), frame.to_csv(index=False, lineterminator="\n"))
        write_text(stem.with_name(stem.name + ".tex"), self.to_latex())
        write_text(stem.with_name(stem.name + ".html"), self.to_html())

    def cell(self, column: str, value) -> str:
        """Format one cell for print: missing as an en dash, floats rounded."""
        if value is None or value != value:
            return "–"
        if isinstance(value, float):
            return f"{value:.{self.decimals[column]}f}" if column in self.decimals else f"{value:.4g}"
        return str(value)

    @property
    def _shown(self) -> dict[str, str]:
        """Columns in print and the words over them."""
        return self.headers or {str(column): str(column) for column in self.frame.columns}

    def _rows(self):
        for record in self.frame[list(self._shown)].itertuples(index=False):
            yield [self.cell(column, value) for column, value in zip(self._shown, record, strict=True)]

    def _remarks(self):
        return [(self._shown[name], text) for name, text in self.definitions.items() if name in self._shown]

    def to_latex(self) -> str:
        """Return a ``booktabs`` table environment."""
        columns = [name.translate(_TEX_ESCAPES) for name in self._shown.values()]
        numeric = [self.frame[column].dtype.kind in "fi" for column in self._shown]
        body = [" & ".join(cell.translate(_TEX_ESCAPES) for cell in row) + r" \\" for row in self._rows()]
        remarks = [f"{name}: {text}" for name, text in self._remarks()]
        notes = " ".join(f"{text.rstrip('.')}." for text in (*self.notes, *remarks)).translate(_TEX_ESCAPES)
        caption = f"{self.title} Data: {self.data}.".translate(_TEX_ESCAPES)
        lines = [
            r"% needs \usepackage{booktabs}; compile with LuaLaTeX or XeLaTeX, which know the Greek letters",
            r"\begin{table}",
            rf"\caption{{{caption}}}",
            rf"\begin{{tabular}}{{{''.join('r' if flag else 'l' for flag in numeric)}}}",
            r"\toprule",
            " & ".join(columns) + r" \\",
            r"\midrule",
            *body,
            r"\bottomrule",
            r"\end{tabular}",
            r"\par\footnotesize " + notes,
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"

    def to_html(self) -> str:
        """Return a page of its own: no script, no outside resource."""
        return template("table.html.jinja").render(
            title=self.title,
            data=self.data,
            columns=list(self._shown.values()),
            rows=self._rows(),
            notes=self.notes,
            definitions=self._remarks(),
        )
