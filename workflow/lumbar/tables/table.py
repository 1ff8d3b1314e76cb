"""Published tables: CSV, LaTeX and HTML with the definition of every column, described in a package's ``tables.yaml``."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from markupsafe import Markup

from lumbar.base.errors import NumericalError
from lumbar.base.files import write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tables import table_layout

if TYPE_CHECKING:
    import pandas as pd

SYNTHETIC_TWIN = "synthetic twin"
"""Source label of everything that is made from synthetic data."""

_LIBRARY = Path(__file__).parents[1]
ROWS_SHOWN = 40
"""Largest number of rows that HTML shows without folding."""
_N_FIRST_ROWS = 12
"""Number of rows shown first in a longer table."""
_MAX_LISTED_COLUMNS = 16
LATEX_WIDTH = 52
"""Characters in ``\\footnotesize`` across a journal's column."""
PAGE_LINE = 112
"""Characters in ``\\footnotesize`` across a journal's page."""
NOTE_LINES = 2
"""Largest number of lines of the note below a table in LaTeX."""
PAGE_ROWS = 45
"""Largest number of rows on a page of LaTeX; a longer table continues in an unnumbered table."""
_MAX_TEXT_WIDTH = 30
"""Largest number of characters in a text column that LaTeX does not wrap."""
_ESCAPES = str.maketrans(shipped_yaml(Path(__file__).with_name("latex.yaml")))
_POWER = re.compile("·10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)")
_EXPONENT = re.compile(r"\b(\d+(?:\.\d+)?)e([+-]?\d+)\b")
_ASCII_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_PREAMBLE = (
    r"% needs \usepackage{array,booktabs}; compile with LuaLaTeX or XeLaTeX, which know the Greek letters"
)
_TABLE_NUMBER = re.compile(r"^Table \d+\.\d+[.:,]? *(as |the )?")


def svg_address(text: str) -> Markup:
    """Return an SVG file's text as the ``data:`` address of an image.

    Parameters
    ----------
    text : str
        Content of the file.
    """
    # Shorter than base64 by a quarter; an address within double quotes contains none.
    single = text if "'" in text else text.replace('"', "'")
    return Markup("data:image/svg+xml," + quote(single, safe=" <>=:;/'(),!*+|[]{}@$^"))


@dataclass(frozen=True, repr=False)
class Table:
    """A published table."""

    title: str
    """One sentence that describes the table."""
    frame: pd.DataFrame
    """Values; column names as in the CSV file. Cells may be ``None`` or NaN only in the columns of `may_be_empty`."""
    definitions: dict[str, str]
    """Definition of each column: formula or rule, scaling and unit."""
    source_label: str
    """Source of the data, e.g. ``"synthetic twin"``; shown in every format."""
    notes: tuple[str, ...] = ()
    """Remarks shown below the table."""
    decimals: dict[str, int] = field(default_factory=dict)
    """Largest number of digits after the point in LaTeX and HTML, which show three significant digits."""
    may_be_empty: frozenset[str] = frozenset()
    """Columns in which a cell may be empty ("not applicable")."""
    headers: dict[str, str] = field(default_factory=dict)
    """Column headers in LaTeX and HTML. Default: the column's name as text, its unit in brackets."""
    first: tuple[str, ...] = ()
    """Columns shown first, in this order; HTML shows the others on demand, LaTeX omits them. Default: all if there are
    `headers`, otherwise as many as fit the page."""
    first_rows: tuple[int, ...] = ()
    """Rows shown first; HTML shows the others on demand, LaTeX omits them. Default: all, or the first twelve of many."""
    pictures: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Pictures of the cells by column, as SVG text; HTML shows each above the cell's text."""

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
        listed = columns[:_MAX_LISTED_COLUMNS]
        if len(columns) > len(listed):
            listed.append(f"{len(columns) - len(listed)} more")
        return f"<Table: {self.title} {len(self.frame)} rows; {', '.join(listed)}>"

    def __str__(self) -> str:
        return f"{self.title}\n{self.frame.to_string(index=False)}"

    def _repr_html_(self) -> str:
        return self.frame.to_html(index=False)

    def write(self, stem: str | os.PathLike) -> None:
        """Write ``stem.csv``, ``stem.tex`` and ``stem.html``.

        The CSV file has a last column ``data`` with the source of the data; the LaTeX and HTML files contain title,
        definitions and notes.

        Parameters
        ----------
        stem : path
            Path of the files without their endings.
        """
        stem = Path(stem)
        frame = self.frame.assign(data=self.source_label)
        write_text(stem.with_name(stem.name + ".csv"), frame.to_csv(index=False, lineterminator="\n"))
        write_text(stem.with_name(stem.name + ".tex"), self.to_latex())
        write_text(stem.with_name(stem.name + ".html"), self.to_html())

    def cell(self, column: str, value) -> str:
        """Format one cell for print: an en dash if it is missing, floats rounded, names as separate words.

        Parameters
        ----------
        column : str
            Name of the column.
        value : object
            Value of the cell; None or NaN if missing.
        """
        if value is None or value != value:
            return table_layout.EMPTY
        if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b":
            return "yes" if value else "no"
        if not isinstance(value, float):
            return table_layout.value_in_words(str(value)) or table_layout.EMPTY
        if value < table_layout.SMALLEST_P and column.startswith("p_"):
            return f"< {table_layout.SMALLEST_P:f}".rstrip("0")
        return table_layout.format_cell(value, self.decimals.get(column))

    def header(self, name: str) -> str:
        """Return the header of a column.

        Parameters
        ----------
        name : str
            Name of the column.
        """
        return self.headers.get(name, table_layout.column_in_words(name))

    def _columns(self, names: Iterable[str], rows: Sequence[int]) -> list[table_layout.Column]:
        return [
            table_layout.Column(
                self.header(name),
                tuple(self.cell(name, value) for value in self.frame[name].iloc[rows]),
                tuple(svg_address(self.pictures[name][row]) for row in rows) if name in self.pictures else (),
            )
            for name in names
        ]

    def _first_shown(self) -> tuple[list[str], list[int]]:
        """Return the columns and rows shown first."""
        every = list(range(len(self.frame)))
        rows = list(self.first_rows) or (every if len(every) <= ROWS_SHOWN else every[:_N_FIRST_ROWS])
        names = [str(name) for name in self.frame.columns]
        if self.first or self.headers:
            return list(self.first or names), rows
        return names[: table_layout.count_fitting(self._columns(names, every))], rows

    def to_latex(self) -> str:
        """Return ``booktabs`` environments of the columns and rows shown first, one or two journal columns wide.

        As many sentences of the notes as fit two lines are below the table; all notes and definitions are comments.
        """
        names, rows = self._first_shown()
        definitions = [f"{self.header(name)}: {self.definitions[name]}" for name in names]
        columns = self._columns(names, rows)
        return _latex_table(self.title, columns, self.notes, definitions, self.source_label)

    def to_html(self) -> str:
        """Return a self-contained page without scripts or external resources.

        The part between ``<main>`` and ``</main>`` can be embedded elsewhere, with the style of ``tables/page.css``.
        """
        names, rows = self._first_shown()
        every = range(len(self.frame))
        folded = [str(name) for name in self.frame.columns if name not in names]
        rest: list[list[table_layout.Column]] = []
        if folded or len(rows) < len(every):
            columns = self._columns([*names, *folded], every)
            rest = table_layout.split_columns(columns, table_layout.count_key_columns(columns))
        shown = self._columns(names, rows)
        return template("tables/table.html.jinja").render(
            title=self.title,
            source_label=self.source_label,
            shown=table_layout.split_columns(shown, table_layout.count_key_columns(shown)),
            rest=rest,
            counts=(len(rows), len(every), len(names), len(names) + len(folded)),
            notes=self.notes,
            definitions=[(self.header(name), self.definitions[name]) for name in (*names, *folded)],
            split=table_layout.split_number,
        )


@cache
def _read_schemas(package: str) -> dict[str, Any]:
    """Read the ``tables.yaml`` of a package."""
    return shipped_yaml(_LIBRARY / package / "tables.yaml")


def columns_of(package: str, name: str) -> list[str]:
    """Return the columns of a described table in their order.

    Parameters
    ----------
    package : str
        Package or module, see `table_from_schema`.
    name : str
        Name of the table.
    """
    return list(_read_schemas(package)[name]["columns"])


def table_from_schema(
    package: str,
    name: str,
    values: pd.DataFrame | Sequence[Mapping],
    source_label: str,
    fields: Mapping[str, Any] | None = None,
    **options: Any,
) -> Table:
    """Make a table from its description in ``tables.yaml``.

    Parameters
    ----------
    package : str
        Folder of the ``tables.yaml`` below ``lumbar``, e.g. ``"lifting/stability"``.
    name : str
        Name of the table there. A column has its definition ``is``, and optionally ``header``, ``decimals`` (then its
        values are floats) and ``empty`` (cells may be empty); ``*`` in its name matches any text. ``folded`` lists the
        columns that HTML shows on demand and LaTeX omits; all others are shown. A table without ``folded`` or headers
        shows as many columns as fit the page.
    values : pandas.DataFrame or sequence of mapping
        The frame, or rows, which get the columns of the description in its order.
    source_label : str
        Source of the data.
    fields : mapping, optional
        Values of the ``{…}`` in the description's texts.
    **options
        Further fields of `Table`; notes and decimals are added to the description's.
    """
    import pandas as pd

    schema, fields = _read_schemas(package)[name], fields or {}
    if not isinstance(values, pd.DataFrame):
        names = list(schema["columns"])
        floats = [column for column in names if "decimals" in schema["columns"][column]]
        values = pd.DataFrame(values, columns=names).astype(dict.fromkeys(floats, float))
    columns = {column: _find_column_schema(schema["columns"], column) for column in values.columns}

    def entries(key: str) -> dict[str, Any]:
        return {column: item[key] for column, item in columns.items() if key in item}

    described = {
        "notes": (*(note.format(**fields) for note in schema.get("notes", ())), *options.pop("notes", ())),
        "decimals": entries("decimals") | options.pop("decimals", {}),
        "may_be_empty": frozenset(entries("empty")),
        "headers": {column: text.format(**fields) for column, text in entries("header").items()},
    }
    if "folded" in schema:
        described["first"] = tuple(
            column
            for column in columns
            if not any(fnmatchcase(column, pattern) for pattern in schema["folded"])
        )
    definitions = {column: text.format(**fields) for column, text in entries("is").items()}
    return Table(schema["title"].format(**fields), values, definitions, source_label, **described | options)


def _find_column_schema(columns: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the description of a column; ``*`` in a pattern and its texts is replaced by the matching part."""
    for pattern, schema in columns.items():
        before, star, after = pattern.partition("*")
        if name == pattern or (star and name.startswith(before) and name.endswith(after)):
            item = {"is": schema} if isinstance(schema, str) else schema
            part = name[len(before) : len(name) - len(after)]
            return {
                key: text.replace("*", part) if star and isinstance(text, str) else text
                for key, text in item.items()
            }
    return {}


def escape_latex(text: str) -> str:
    """Return a text escaped for LaTeX, numbers such as ``1.9e-06`` with a power of ten.

    Parameters
    ----------
    text : str
        Plain text.
    """
    escaped = _EXPONENT.sub(
        lambda match: (
            rf"$10^{{{int(match[2])}}}$" if match[1] == "1" else rf"{match[1]}$\cdot10^{{{int(match[2])}}}$"
        ),
        text.translate(_ESCAPES),
    )
    return _POWER.sub(lambda match: rf"$\cdot10^{{{match[1].translate(_ASCII_DIGITS)}}}$", escaped)


def _latex_table(
    title: str,
    columns: Sequence[table_layout.Column],
    notes: Sequence[str],
    definitions: Sequence[str],
    source_label: str,
) -> str:
    """Return ``booktabs`` table environments; LaTeX numbers the table."""
    wide = sum(column.width for column in columns) > LATEX_WIDTH
    environment = "table*" if wide else "table"
    rows = len(columns[0].cells) if columns else 0
    parts = [range(start, min(start + PAGE_ROWS, rows)) for start in range(0, rows, PAGE_ROWS)] or [range(0)]
    lines = [_PREAMBLE, *(f"% {' '.join(remark.split())}" for remark in (*notes, *definitions))]
    unnumbered = _TABLE_NUMBER.sub("", title) or title
    alignments = "".join(
        "r"
        if column.numeric
        else "l"
        if column.longest_cell <= _MAX_TEXT_WIDTH
        else rf">{{\raggedright\arraybackslash}}p{{{_MAX_TEXT_WIDTH / 2:g}em}}"
        for column in columns
    )
    for number, part in enumerate(parts):
        caption = "(continued)"
        if number == 0:
            caption = f"{unnumbered[:1].upper()}{unnumbered[1:]} Data: {source_label}."
        lines += [
            rf"\begin{{{environment}}}",
            *([r"\addtocounter{table}{-1}"] if number else []),
            r"\footnotesize",
            rf"\caption{{{escape_latex(caption)}}}",
            rf"\begin{{tabular}}{{@{{}}{alignments}@{{}}}}",
            r"\toprule",
            " & ".join(map(_latex_header, columns)) + r" \\",
            r"\midrule",
            *(" & ".join(_latex_cell(column, row) for column in columns) + r" \\" for row in part),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        text = escape_latex(_shorten_notes(notes, NOTE_LINES * (PAGE_LINE if wide else LATEX_WIDTH)))
        if part is parts[-1] and text:
            lines.append(rf"\par\smallskip\parbox{{\linewidth}}{{\raggedright {text}}}")
        lines.append(rf"\end{{{environment}}}")
    return "\n".join(lines) + "\n"


def _shorten_notes(notes: Sequence[str], longest: int) -> str:
    """Return the first whole sentences of the notes, with at most `longest` characters."""
    text = ""
    for sentence in re.split(r"(?<=[.;]) (?=[A-Z])", " ".join(f"{note.rstrip('.')}." for note in notes)):
        if len(text) + len(sentence) >= longest:
            break
        text = f"{text} {sentence}".strip()
    return text


def _latex_header(column: table_layout.Column) -> str:
    """Return a header, wrapped to several lines if the header is wider than the cells."""
    lines, width = [""], max(column.width, 8)
    for word in column.header.split():
        if lines[-1] and len(lines[-1]) + len(word) >= width:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    if len(lines) == 1:
        return escape_latex(lines[0])
    side = "r" if column.numeric else "l"
    stacked = r" \\ ".join(map(escape_latex, lines))
    return rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stacked}\end{{tabular}}"


def _latex_cell(column: table_layout.Column, row: int) -> str:
    """Return a cell, padded with invisible digits so that decimal signs are aligned."""
    text = column.cells[row]
    if not column.numeric or text == table_layout.EMPTY or "·" in text:
        return escape_latex(text)
    missing = column.fraction - len(table_layout.split_number(text)[1])
    fill = "." + "0" * (missing - 1) if missing == column.fraction else "0" * missing
    return escape_latex(text).replace("-", "$-$", 1) + (rf"\phantom{{{fill}}}" if missing else "")
