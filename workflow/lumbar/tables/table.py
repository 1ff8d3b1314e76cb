"""Publishing a table as CSV, LaTeX and HTML, with the definition of every column."""

from __future__ import annotations

import base64
import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import NumericalError
from lumbar.base.files import write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tables.layout import (
    EMPTY,
    SMALLEST_P,
    Column,
    blocks,
    column_in_words,
    fitting,
    keys_of,
    scientific,
    split_number,
    value_in_words,
)

if TYPE_CHECKING:
    import pandas as pd

SYNTHETIC_TWIN = "synthetic twin"
"""The words that stand on everything made from synthetic data."""

ROWS_SHOWN = 40
"""Rows that are shown at once; of more the first ones, the others below them on demand."""
_FIRST_ROWS = 12
_NAMED = 16
"""Columns that are named in one line."""
LATEX_WIDTH = 52
"""Characters in ``\\footnotesize`` across a journal's column."""
PAGE_ROWS = 45
"""Rows of one page of LaTeX: what is longer goes on in a table without a number of its own."""
_WORDS = 30
_ESCAPES = str.maketrans(shipped_yaml(Path(__file__).with_name("latex.yaml")))
_POWER = re.compile("·10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)")
_EXPONENT = re.compile(r"\b(\d+(?:\.\d+)?)e([+-]?\d+)\b")
_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_NUMBERED = re.compile(r"^Table \d+\.\d+[.:,]? *(as |the )?")


def svg_address(text: str) -> str:
    """Return an SVG file's text as the ``data:`` address of an image."""
    return f"data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode('ascii')}"


@dataclass(frozen=True, repr=False)
class Table:
    """A table as it is published."""

    title: str
    """One sentence that says what the table shows."""
    frame: pd.DataFrame
    """The values; column names as in the CSV file. Empty cells are ``None`` or NaN only in the columns named in
    `may_be_empty`."""
    definitions: dict[str, str]
    """Definition of each column: formula or rule, scaling and unit."""
    source_label: str
    """Where the data come from, e.g. ``"synthetic twin"``; shown in every format."""
    notes: tuple[str, ...] = ()
    """Remarks shown below the table."""
    decimals: dict[str, int] = field(default_factory=dict)
    """Digits after the point in LaTeX and HTML (default: four significant digits)."""
    may_be_empty: frozenset[str] = frozenset()
    """Columns in which a cell may be empty ("not applicable")."""
    headers: dict[str, str] = field(default_factory=dict)
    """Words that stand over columns in LaTeX and HTML. Default: the column's name in words, its unit in brackets."""
    first: tuple[str, ...] = ()
    """Columns shown first, in this order; HTML has the others on demand, LaTeX has none of them. Default: all
    where there are `headers`, otherwise as many as fit the page."""
    first_rows: tuple[int, ...] = ()
    """Rows shown first, as `first`. Default: all where they are few."""
    pictures: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By column a picture of every cell, as text of an SVG file: HTML shows it above the words, which name it elsewhere."""

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
        columns = [*map(str, self.frame.columns)]
        more = [f"{len(columns) - _NAMED} more"] if len(columns) > _NAMED else []
        return f"<Table: {self.title} {len(self.frame)} rows; {', '.join([*columns[:_NAMED], *more])}>"

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
        frame = self.frame.assign(data=self.source_label)
        write_text(stem.with_name(stem.name + ".csv"), frame.to_csv(index=False, lineterminator="\n"))
        write_text(stem.with_name(stem.name + ".tex"), self.to_latex())
        write_text(stem.with_name(stem.name + ".html"), self.to_html())

    def cell(self, column: str, value) -> str:
        """Format one cell for print: missing as an en dash, floats rounded, names with their words apart."""
        if value is None or value != value:
            return EMPTY
        if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b":
            return "yes" if value else "no"
        if isinstance(value, float):
            if value < SMALLEST_P and column.startswith("p_"):
                return f"< {SMALLEST_P:f}".rstrip("0")
            return scientific(
                f"{value:.{self.decimals[column]}f}" if column in self.decimals else f"{value:.4g}"
            )
        return value_in_words(str(value)) or EMPTY

    def header(self, name: str) -> str:
        """Words over a column."""
        return self.headers.get(name, column_in_words(name))

    def _columns(self, names: Iterable[str], rows: Sequence[int]) -> list[Column]:
        return [
            Column(
                self.header(name),
                tuple(self.cell(name, value) for value in self.frame[name].iloc[rows]),
                tuple(svg_address(self.pictures[name][row]) for row in rows) if name in self.pictures else (),
            )
            for name in names
        ]

    @property
    def _first(self) -> tuple[list[str], list[int]]:
        """Columns and rows shown first."""
        every = list(range(len(self.frame)))
        rows = list(self.first_rows) or (every if len(every) <= ROWS_SHOWN else every[:_FIRST_ROWS])
        names = [str(name) for name in self.frame.columns]
        if self.first or self.headers:
            return list(self.first or names), rows
        return names[: fitting(self._columns(names, every))], rows

    def _remarks(self, names: Iterable[str]) -> list[tuple[str, str]]:
        return [(self.header(name), self.definitions[name]) for name in names]

    def to_latex(self) -> str:
        """Return ``booktabs`` table environments of what is shown first: a journal's column, or both."""
        names, rows = self._first
        told = [f"{word}: {text}" for word, text in self._remarks(names)]
        return latex_table(self.title, self._columns(names, rows), [*self.notes, *told], self.source_label)

    def to_html(self) -> str:
        """Return a page of its own: no script, no outside resource.

        What stands between ``<main>`` and ``</main>`` is whole by itself, with the style of ``tables/page.css``.
        """
        names, rows = self._first
        every = range(len(self.frame))
        hidden = [str(name) for name in self.frame.columns if name not in names]
        rest: list[list[Column]] = []
        if hidden or len(rows) < len(every):
            columns = self._columns([*names, *hidden], every)
            rest = blocks(columns, keys_of(columns))
        shown = self._columns(names, rows)
        return template("tables/table.html.jinja").render(
            title=self.title,
            source_label=self.source_label,
            shown=blocks(shown, keys_of(shown)),
            rest=rest,
            counts=(len(rows), len(every), len(names), len(names) + len(hidden)),
            notes=self.notes,
            definitions=self._remarks([*names, *hidden]),
            split=split_number,
        )


def escape_latex(text: str) -> str:
    """Return a text as LaTeX prints it, numbers such as ``1.9e-06`` with a power of ten."""

    def power_of_ten(found: re.Match) -> str:
        power = f"10^{{{int(found[2])}}}"
        return f"${power}$" if found[1] == "1" else rf"{found[1]}$\cdot{power}$"

    written = _EXPONENT.sub(power_of_ten, text.translate(_ESCAPES))
    return _POWER.sub(lambda found: rf"$\cdot10^{{{found[1].translate(_PLAIN)}}}$", written)


def latex_table(title: str, columns: Sequence[Column], remarks: Sequence[str], source_label: str) -> str:
    """Return ``booktabs`` table environments; the number in the title is left to LaTeX."""
    wide = sum(column.width for column in columns) > LATEX_WIDTH
    environment = "table*" if wide else "table"
    rows = len(columns[0].cells) if columns else 0
    parts = [range(start, min(start + PAGE_ROWS, rows)) for start in range(0, rows, PAGE_ROWS)] or [range(0)]
    lines = [
        r"% needs \usepackage{array,booktabs}; compile with LuaLaTeX or XeLaTeX, which know the Greek letters"
    ]
    unnumbered = _NUMBERED.sub("", title) or title
    alignments = "".join(
        "r"
        if column.numeric
        else "l"
        if column.longest <= _WORDS
        else rf">{{\raggedright\arraybackslash}}p{{{_WORDS / 2:g}em}}"
        for column in columns
    )
    for number, part in enumerate(parts):
        caption = (
            f"{unnumbered[:1].upper()}{unnumbered[1:]} Data: {source_label}."
            if number == 0
            else "(continued)"
        )
        lines += [
            rf"\begin{{{environment}}}",
            *([] if number == 0 else [r"\addtocounter{table}{-1}"]),
            r"\footnotesize",
            rf"\caption{{{escape_latex(caption)}}}",
            rf"\begin{{tabular}}{{@{{}}{alignments}@{{}}}}",
            r"\toprule",
            " & ".join(_head(column) for column in columns) + r" \\",
            r"\midrule",
            *(" & ".join(_cell(column, row) for column in columns) + r" \\" for row in part),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        if part is parts[-1]:
            told = " ".join(f"{text.rstrip('.')}." for text in remarks)
            lines.append(rf"\par\smallskip\parbox{{\linewidth}}{{\raggedright {escape_latex(told)}}}")
        lines.append(rf"\end{{{environment}}}")
    return "\n".join(lines) + "\n"


def _head(column: Column) -> str:
    """Header with its words below one another where they are wider than the cells."""
    lines, room = [""], max(column.width, 8)
    for word in column.header.split():
        if lines[-1] and len(lines[-1]) + len(word) >= room:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    if len(lines) == 1:
        return escape_latex(lines[0])
    side = "r" if column.numeric else "l"
    stacked = r" \\ ".join(map(escape_latex, lines))
    return rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stacked}\end{{tabular}}"


def _cell(column: Column, row: int) -> str:
    """Cell, filled up with invisible digits behind the decimal sign so that the signs stand below one another."""
    text = column.cells[row]
    if not column.numeric or text == EMPTY or "·" in text:
        return escape_latex(text)
    missing = column.fraction - len(split_number(text)[1])
    fill = "." + "0" * (missing - 1) if missing == column.fraction else "0" * missing
    return escape_latex(text).replace("-", "$-$", 1) + (rf"\phantom{{{fill}}}" if missing else "")
