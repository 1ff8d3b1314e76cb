"""Dialect of a text table: delimiter, decimal mark, columns, and the lines with its rows.

The dialect is chosen so that most lines are rows of numbers. General sniffers of CSV dialects search only the delimiter;
decimal commas and the headers of testing machines require a joint search of delimiter, decimal mark and first row. Cells outside
a table do not belong to it, and tables side by side are separate.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lumbar.records.number_table import Dialect

MIN_ROWS = 8
_MAX_DIALECT_LINES = 3000
"""Number of first lines of a file from which the dialect is chosen."""
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"),
    # A comma is a decimal mark only between digits: "0, 1, 2" is a list.
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][+-]?\d+)?"),
}
CLOCK = re.compile(r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]+)?\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?Z?")
"""A time of day, with a date or without."""
_WHOLE_CLOCK = re.compile(
    r"(?:\S+[T ]+)?(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2})(?:[.,](?P<fraction>\d{1,9}))?Z?"
)
MISSING = frozenset(
    ["", "nan", "n/a", "na", "#n/a", "-", "--", "---", "null", "none", "inf", "-inf", "#div/0!"]
)
"""Texts of cells without a value, in lower case."""
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar", None: "blanks"}
"""Delimiters with their names; the first is used if two give the same table."""
UNAMBIGUOUS = ("\t", ";", "|")
"""Delimiters that are never decimal marks: surplus cells of a row are then outside the table."""
MAX_HEADER_LINES = 4
"""Number of lines above a table that may contain names and units."""
_MIN_REPEATED_NAMES = 3
"""Smallest number of names that tables side by side share."""


@dataclass(frozen=True)
class TableDialect(Dialect):
    """Dialect with the columns of one table (from 0)."""

    width: int = 0
    text_columns: frozenset[int] = frozenset()
    """Columns of text, counted from the table's first column."""
    clock_columns: frozenset[int] = frozenset()
    """Columns of times of day, counted from the table's first column."""
    left: int = 0
    """Number of columns before the table."""
    is_cut: bool = False
    """True if columns after the table are ignored."""

    def split(self, line: str) -> list[str]:
        """Return the cells of the table in one line, without cells outside the table.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        cells = super().split(line)[self.left :]
        is_surplus = len(cells) > self.width and (self.is_cut or not cells[self.width])
        return cells[: self.width] if is_surplus else cells

    def cells_outside(self, line: str) -> list[tuple[int, str]]:
        """Return number (from 1) and text of the cells of a line that are not in the table.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        table = range(self.left, self.left + self.width)
        return [(n + 1, cell) for n, cell in enumerate(super().split(line)) if cell and n not in table]

    def number(self, cell: str) -> float:
        """Return the number in a cell, the seconds since midnight of a time of day, or NaN if the cell is marked as missing.

        A date before the time is ignored, as days and months cannot be distinguished.

        Parameters
        ----------
        cell : str
            Text of the cell.

        Raises
        ------
        ValueError
            If the text is not a number, or has a point although the decimal mark is a comma.
        """
        if ":" in cell and CLOCK.fullmatch(cell):
            return seconds_of_day(cell)
        if cell.casefold() in MISSING:
            return math.nan
        if self.decimal == "," and "." in cell:
            raise ValueError(f"{cell!r} has a decimal point")
        return super().number(cell)

    def read_clocks(self, cells: Sequence[str]) -> np.ndarray:
        """Return the numbers in the cells of a column of times of day; fast if all have the form of the first one.

        Parameters
        ----------
        cells : sequence of str
            The cells.

        Raises
        ------
        ValueError
            If `number` raises it.
        """
        form = _WHOLE_CLOCK.fullmatch(cells[0])
        if form is None or {len(cell) for cell in cells} != {len(cells[0])} or not "".join(cells).isascii():
            return np.array([self.number(cell) for cell in cells])
        signs = np.array(cells, dtype=f"S{len(cells[0])}").view(np.uint8).reshape(len(cells), -1)
        digits = signs - np.uint8(ord("0"))
        is_digit = digits < 10
        if (is_digit != is_digit[0]).any() or (signs != signs[0])[:, ~is_digit[0]].any():
            return np.array([self.number(cell) for cell in cells])
        time = np.zeros(len(cells), dtype=np.int64)
        for name, unit in (("h", 3600 * 10**9), ("m", 60 * 10**9), ("s", 10**9), ("fraction", 10**8)):
            for place, column in enumerate(range(*form.span(name))):
                exponent = place if name == "fraction" else place - len(form[name]) + 1
                time += digits[:, column].astype(np.int64) * int(unit * 10.0**-exponent)
        return time / 1e9

    @cached_property
    def _number_row(self) -> re.Pattern:
        """Pattern that matches most rows."""
        number = _NUMBER[self.decimal].pattern
        cells = [CLOCK.pattern if column in self.clock_columns else number for column in range(self.width)]
        gap = r"\s+" if self.delimiter is None else rf"\s*{re.escape(self.delimiter)}\s*"
        return re.compile(rf"\s*{gap.join(cells)}\s*")

    def is_row(self, line: str) -> bool:
        """Return whether a line is a row: every cell of a number column is a number or marked as missing.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        if not self.left and self._number_row.fullmatch(line):
            return True
        cells = self.split(line)
        if len(cells) != self.width:
            return False
        numbers = [cell for column, cell in enumerate(cells) if column not in self.text_columns]
        are_numbers = [_is_number(cell, self.decimal) for cell in numbers]
        return any(are_numbers) and all(
            is_number or cell.casefold() in MISSING
            for is_number, cell in zip(are_numbers, numbers, strict=True)
        )

    def is_faulty_row(self, line: str) -> bool:
        """Return whether a line is a faulty row: a cell is not a number, or there are too few or too many cells.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        return not self.is_row(line) and sum(_is_number(cell, self.decimal) for cell in self.split(line)) >= 2

    def __str__(self) -> str:
        mark = "comma" if self.decimal == "," else "point"
        return f"columns separated by {DELIMITERS[self.delimiter]}, decimal {mark}"


def seconds_of_day(clock: str) -> float:
    """Return the seconds since midnight of a time of day, exactly rounded.

    Parameters
    ----------
    clock : str
        Text that matches `CLOCK`.
    """
    time = clock.replace("T", " ").replace(",", ".").rstrip("Z").rpartition(" ")[2]
    hours, minutes, seconds = [*time.split(":"), "0"][:3]
    whole, _, fraction = seconds.partition(".")
    whole_seconds = 3600 * int(hours) + 60 * int(minutes) + int(whole)
    return (whole_seconds * 10**9 + int(f"{fraction:0<9}"[:9])) / 1e9


def _is_number(cell: str, decimal: str) -> bool:
    return bool(_NUMBER[decimal].fullmatch(cell) or CLOCK.fullmatch(cell))


def find_dialects(lines: list[str], is_sheet: bool = False) -> list[TableDialect]:
    """Return the dialect in which most cells are numbers, once for each of the tables side by side; empty without a table.

    Parameters
    ----------
    lines : list of str
        Lines of the file.
    is_sheet : bool
        Whether the lines are rows of a sheet: tabs separate the cells, and every row has the same number of cells.
    """
    sample = [line for line in lines[:_MAX_DIALECT_LINES] if line.strip()]
    best, most = [], 0
    for delimiter in ["\t"] if is_sheet else DELIMITERS:
        split = [Dialect(delimiter).split(line) for line in sample]
        for decimal in ".,":
            if delimiter == decimal and not any('"' in line for line in sample):
                continue
            dialects, numbers = _score_dialect(split, delimiter, decimal)
            if numbers > most:
                best, most = dialects, numbers
    return best


def _score_dialect(
    split: list[list[str]], delimiter: str | None, decimal: str
) -> tuple[list[TableDialect], int]:
    """Return the dialects in which the lines are split, and the number of numeric cells minus the number of text cells."""
    numeric = [sum(_is_number(cell, decimal) for cell in cells) >= 2 for cells in split]
    rows = [cells for cells, is_numeric in zip(split, numeric, strict=True) if is_numeric]
    if len(rows) < MIN_ROWS:
        return [], 0
    usual = width = Counter(map(len, rows)).most_common(1)[0][0]
    rows = [cells for cells in rows if len(cells) == width]
    if all(not cells[-1] for cells in rows):
        width, rows = width - 1, [cells[:-1] for cells in rows]
    columns = [_ColumnCounts.count_cells([cells[n] for cells in rows], decimal) for n in range(width)]
    above = [cells for cells in split[: numeric.index(True)] if sum(map(bool, cells)) > 1][-MAX_HEADER_LINES:]
    dialects = [
        TableDialect(
            delimiter,
            decimal,
            None,
            False,
            stop - first,
            frozenset(n - first for n in range(first, stop) if columns[n].is_text),
            frozenset(n - first for n in range(first, stop) if columns[n].is_clock),
            first,
            stop < min(usual, width) or delimiter in UNAMBIGUOUS,
        )
        for first, stop in _find_tables(columns, above)
    ]
    return dialects, sum(column.numbers - column.texts for column in columns)


class _ColumnCounts(NamedTuple):
    """Numbers of cells of each kind in a column."""

    rows: int
    numbers: int
    texts: int
    clocks: int

    @classmethod
    def count_cells(cls, cells: list[str], decimal: str) -> "_ColumnCounts":
        numbers = sum(_is_number(cell, decimal) for cell in cells)
        blanks = sum(cell.casefold() in MISSING for cell in cells)
        return cls(len(cells), numbers, len(cells) - numbers - blanks, sum(":" in cell for cell in cells))

    @property
    def is_text(self) -> bool:
        """True of a column without numbers, with more texts than numbers, or of a few notes."""
        is_dense = self.numbers + self.texts >= 0.5 * self.rows
        return not self.numbers or self.texts > (self.numbers if is_dense else 0)

    @property
    def is_clock(self) -> bool:
        return not self.is_text and self.clocks > 0.5 * self.numbers


def _find_tables(columns: list[_ColumnCounts], above: list[list[str]]) -> list[tuple[int, int]]:
    """Return first column and stop of every table; `above` are the lines before the first row."""
    width = len(columns)
    names = [[cells[n].casefold() if n < len(cells) else "" for n in range(width)] for cells in above]
    # Names that repeat side by side without an empty column between.
    for size in range(_MIN_REPEATED_NAMES, width // 2 + 1):
        if width % size == 0 and any(
            all(row[:size]) and row == row[:size] * (width // size) for row in names
        ):
            return [(first, first + size) for first in range(0, width, size)]
    filled = [column.numbers + column.texts for column in columns]
    edges = [-1, *(n for n in range(width) if not filled[n]), width]
    spans = [(before + 1, stop) for before, stop in pairwise(edges) if stop - before > 1]
    tables = [
        span
        for span in spans
        if sum(not column.is_text and column.numbers >= MIN_ROWS for column in columns[slice(*span)]) > 1
    ]
    if len(tables) > 1:
        sizes = {max(filled[slice(*span)]) for span in tables}
        heads = [[row[slice(*span)] for row in names if any(row[slice(*span)])][-2:] for span in tables]
        if len(sizes) > 1 or (heads[0] and all(head == heads[0] for head in heads)):
            return tables
    # One table, from its first to its last column with a cell in most rows; a column next to it needs a name.
    dense = [n for n in range(width) if filled[n] >= 0.5 * columns[n].rows] or [0, width - 1]
    first, stop = dense[0], dense[-1] + 1

    def is_named(column: int) -> bool:
        return bool(filled[column]) and any(row[column] for row in names)

    while first > 0 and is_named(first - 1):
        first -= 1
    while stop < width and is_named(stop):
        stop += 1
    return [(first, stop)]


class Block(NamedTuple):
    """First and last line (from 0) of rows of one table, and the lines between that are comments."""

    first: int
    last: int
    comments: tuple[int, ...] = ()


def find_blocks(lines: list[str], dialect: TableDialect) -> list[Block]:
    """Return every block of rows; only blank lines, faulty rows and comments may interrupt it.

    After a comment, or a repeated header, a column grows on as before. A few rows after a blank line at the end are a block of
    their own: sums and means.

    Parameters
    ----------
    lines : list of str
        Lines of the file.
    dialect : TableDialect
        Form of the rows.
    """
    rows = [number for number, line in enumerate(lines) if line.strip() and dialect.is_row(line)]
    if not rows:
        return []
    blocks, first, comments = [], 0, []
    for index in range(1, len(rows)):
        before, after = rows[index - 1], rows[index]
        if after == before + 1:
            continue
        between = [number for number in range(before + 1, after) if any(dialect.split(lines[number]))]
        # A faulty row belongs to the table around it and is reported.
        others = [number for number in between if not dialect.is_faulty_row(lines[number])]
        is_whole = index - first >= MIN_ROWS > before - rows[index - MIN_ROWS]
        is_end = not between and is_whole and len(rows) - index < MIN_ROWS
        around = rows[max(first, index - MIN_ROWS) : index], rows[index : index + MIN_ROWS]
        if 0 < len(others) <= MAX_HEADER_LINES and _is_comment(lines, around, dialect):
            comments += others
        elif others or is_end:
            blocks.append(Block(rows[first], before, tuple(comments)))
            first, comments = index, []
    return [*blocks, Block(rows[first], rows[-1], tuple(comments))]


def _is_comment(lines: list[str], rows: tuple[list[int], list[int]], dialect: TableDialect) -> bool:
    """Return whether a column grows on between rows as before and after, so that what is between is a comment."""
    before, after = rows
    cells = [dialect.split(lines[row]) for row in before + after]
    for column in set(range(dialect.width)) - dialect.text_columns:
        numbers = [dialect.number(row[column]) for row in cells]
        steps = [late - early for early, late in pairwise(numbers)]
        gap = steps.pop(len(before) - 1)
        if steps and min(gap, *steps) > 0 and gap <= 3 * max(steps):
            return True
    return False
