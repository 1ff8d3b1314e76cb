"""Dialect of a text table: delimiter, decimal mark, and the lines with its rows.

The dialect is chosen so that most lines are rows of numbers. General sniffers of CSV dialects search only the delimiter;
decimal commas and the headers of testing machines require a joint search of delimiter, decimal mark and first row.
"""

import math
import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from lumbar.records.number_table import Dialect

MIN_ROWS = 8
_MAX_DIALECT_LINES = 3000
"""Number of first lines of a file from which the dialect is chosen."""
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"),
    # A comma is a decimal mark only between digits: "0, 1, 2" is a list.
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][+-]?\d+)?"),
}
CLOCK = re.compile(r"^(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]+)?\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?Z?$")
"""A time of day, with a date or without."""
MISSING = frozenset(
    ["", "nan", "n/a", "na", "#n/a", "-", "--", "---", "null", "none", "inf", "-inf", "#div/0!"]
)
"""Texts of cells without a value, in lower case."""
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar", None: "blanks"}
"""Delimiters with their names; the first is used if two give the same table."""


@dataclass(frozen=True)
class TableDialect(Dialect):
    """Dialect with the number of columns, and the positions of text columns (from 0)."""

    width: int = 0
    text_columns: frozenset[int] = frozenset()

    def split(self, line: str) -> list[str]:
        """Return the cells of one line, without the empty cell after a delimiter at its end.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        cells = super().split(line)
        return cells[:-1] if len(cells) == self.width + 1 and not cells[-1] else cells

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
        if cell.casefold() in MISSING:
            return math.nan
        if CLOCK.match(cell):
            time = re.split(r"[T ]+", cell.replace(",", ".").rstrip("Z"))[-1]
            hours, minutes, seconds = [*time.split(":"), "0"][:3]
            whole, _, fraction = seconds.partition(".")
            whole_seconds = 3600 * int(hours) + 60 * int(minutes) + int(whole)
            return (whole_seconds * 10**9 + int(f"{fraction:0<9}"[:9])) / 1e9
        if self.decimal == "," and "." in cell:
            raise ValueError(f"{cell!r} has a decimal point")
        return super().number(cell)

    @cached_property
    def _number_row(self) -> re.Pattern:
        """Pattern that matches most rows."""
        number = _NUMBER[self.decimal].pattern
        gap = r"\s+" if self.delimiter is None else rf"\s*{re.escape(self.delimiter)}\s*"
        return re.compile(rf"\s*{number}(?:{gap}{number}){{{self.width - 1}}}\s*")

    def is_row(self, line: str) -> bool:
        """Return whether a line is a row: every cell of a number column is a number or marked as missing.

        Parameters
        ----------
        line : str
            Line without its end.
        """
        if self._number_row.fullmatch(line):
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


def _is_number(cell: str, decimal: str) -> bool:
    return bool(_NUMBER[decimal].fullmatch(cell) or CLOCK.match(cell))


def find_dialect(lines: list[str]) -> TableDialect | None:
    """Return the dialect in which most cells are numbers; None if no lines are a table.

    Parameters
    ----------
    lines : list of str
        Lines of the file.
    """
    sample = [line for line in lines[:_MAX_DIALECT_LINES] if line.strip()]
    best, most = None, 0
    for delimiter in DELIMITERS:
        split = [Dialect(delimiter).split(line) for line in sample]
        for decimal in ".,":
            if delimiter == decimal and not any('"' in line for line in sample):
                continue
            dialect, numbers = _score_dialect(split, delimiter, decimal)
            if numbers > most:
                best, most = dialect, numbers
    return best


def _score_dialect(
    split: list[list[str]], delimiter: str | None, decimal: str
) -> tuple[TableDialect | None, int]:
    """Return the dialect in which the lines are split, and its number of numeric cells minus the number of text cells."""
    rows = [cells for cells in split if sum(_is_number(cell, decimal) for cell in cells) >= 2]
    if len(rows) < MIN_ROWS:
        return None, 0
    width = Counter(map(len, rows)).most_common(1)[0][0]
    rows = [cells for cells in rows if len(cells) == width]
    if all(not cells[-1] for cells in rows):
        width, rows = width - 1, [cells[:-1] for cells in rows]
    numbers = [sum(_is_number(cells[column], decimal) for cells in rows) for column in range(width)]
    blanks = [sum(cells[column].casefold() in MISSING for cells in rows) for column in range(width)]
    text = frozenset(
        column
        for column in range(width)
        if numbers[column] + blanks[column] < 0.5 * len(rows) or not numbers[column]
    )
    share = len(rows) * len(text)
    return TableDialect(delimiter, decimal, None, False, width, text), sum(numbers) - share


def find_blocks(lines: list[str], dialect: TableDialect) -> list[tuple[int, int]]:
    """Return first and last line (from 0) of every block of rows; only blank lines and faulty rows may interrupt it.

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
    starts, stops = [rows[0]], []
    for before, after in pairwise(rows):
        between = [line for line in lines[before + 1 : after] if line.strip()]
        # A faulty row belongs to the table around it and is reported; other lines end the table.
        if between and not all(dialect.is_faulty_row(line) for line in between):
            stops.append(before)
            starts.append(after)
    return list(zip(starts, [*stops, rows[-1]], strict=True))
