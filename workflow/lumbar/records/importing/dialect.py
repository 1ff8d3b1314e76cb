"""How a text table is written: encoding, delimiter, decimal mark, and the lines that hold its rows.

All are found by one question: read so, which lines are rows of numbers? General sniffers of CSV dialects look at the
delimiter alone; with decimal commas and the headers of testing machines the decimal mark and the first row have to be
found with it.
"""

import codecs
import csv
import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import ENCODINGS

FEWEST_ROWS = 8
_LOOKED_AT = 3000
"""Lines from which the dialect is chosen."""
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
"""What stands in a cell without a value, in small letters."""
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar", None: "blanks"}
"""Delimiters in the order in which one is preferred where two read a table alike."""


_NO_ASCII = re.compile(r"[^\x00-\x7f]+")
_WESTERN = re.compile(r"[À-ÖØ-öø-ÿŒœŸ°±²³µ·×§®©€‘’“”–—…]|[äöüÄÖÜ]ß|éé|ç[ãõ]")
"""What stands between letters of ASCII in western words; two letters of other alphabets make longer or other runs."""


def decode_lines(content: bytes, source: str, encoding: str | None = None) -> tuple[list[str], str]:
    """Return lines of text, as an editor counts them, and the encoding: the one told, UTF-16, UTF-8 or western Windows-1252.

    Raises
    ------
    InputError
        Naming the first line that cannot be decoded.
    """
    text, encoding = _told(content, source, encoding) if encoding else _decoded(content, source)
    return _lines(text.replace("\N{MINUS SIGN}", "-")), encoding


def _lines(text: str) -> list[str]:
    return re.split(r"\r\n|\r|\n", text)


def _told(content: bytes, source: str, encoding: str) -> tuple[str, str]:
    try:
        return content.decode(encoding).removeprefix("\ufeff"), encoding
    except UnicodeDecodeError as error:
        before = _lines(content[: error.start].decode(encoding, "ignore"))
        found = ascii(content[error.start : error.start + 20])[1:]
        raise InputError(
            f"{source}: line {len(before)} cannot be read by --encoding {encoding} ({found})"
        ) from error


def _western(content: bytes, source: str) -> str:
    """Text of Windows-1252, if western words are all that is beside ASCII in it."""
    text = content.decode("cp1252", errors="replace")
    for run in _NO_ASCII.finditer(text):
        before, after = text[: run.start()][-1:], text[run.end() :][:1]
        if not _WESTERN.fullmatch(run[0]) or (run[0] in "°²³" and before.isalpha() and after.isalpha()):
            lines = _lines(text[: run.start()])
            start = len(text[: run.start()]) - len(lines[-1])
            line = re.split(rb"[\r\n]", content[start : start + 60])[0]
            raise InputError(
                f"{source}: line {len(lines)} is not UTF-8 ({ascii(line)[1:]}); say what it is written in, as --encoding "
                f"{ENCODINGS}"
            )
    return text


def _decoded(content: bytes, source: str) -> tuple[str, str]:
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace"), "UTF-16"
    zeros = content[:2000]
    for encoding, first in (("utf-16-le", 1), ("utf-16-be", 0)):
        if len(zeros) > 8 and zeros[first::2].count(0) > 0.4 * len(zeros):
            return content.decode(encoding, errors="replace"), encoding.upper()
    try:
        return content.decode("utf-8-sig"), "UTF-8"
    except UnicodeDecodeError:
        return _western(content, source), "Windows-1252"


@dataclass(frozen=True)
class Dialect:
    """Delimiter (None: blanks) and decimal mark of a table, its width, and its columns of text (from 0)."""

    delimiter: str | None
    decimal: str
    width: int
    text_columns: frozenset[int]

    def split(self, line: str) -> list[str]:
        """Cells of a line; quotes protect delimiters, and an empty cell at the end of rows is none."""
        return _split(line, self.delimiter)

    @cached_property
    def _all_numbers(self) -> re.Pattern:
        """What most rows are, told at once."""
        number = _NUMBER[self.decimal].pattern
        between = r"\s+" if self.delimiter is None else rf"\s*{re.escape(self.delimiter)}\s*"
        return re.compile(rf"\s*{number}(?:{between}{number}){{{self.width - 1}}}\s*")

    def is_row(self, line: str) -> bool:
        """Whether a line is a row of the table: every cell that should hold a number does, or says it has none."""
        if self._all_numbers.fullmatch(line):
            return True
        cells = self.split(line)
        if len(cells) == self.width + 1 and not cells[-1]:  # what a delimiter at the end of a row makes
            cells = cells[:-1]
        if len(cells) != self.width:
            return False
        numbers = [cell for column, cell in enumerate(cells) if column not in self.text_columns]
        told = [_is_number(cell, self.decimal) for cell in numbers]
        return any(told) and all(
            known or cell.casefold() in MISSING for known, cell in zip(told, numbers, strict=True)
        )

    def is_torn_row(self, line: str) -> bool:
        """Whether a line is a row with something in it that is no number, or with cells too few or too many."""
        return not self.is_row(line) and sum(_is_number(cell, self.decimal) for cell in self.split(line)) >= 2

    def __str__(self) -> str:
        mark = "comma" if self.decimal == "," else "point"
        return f"columns parted by {DELIMITERS[self.delimiter]}, decimal {mark}"


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 131072 characters
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _is_number(cell: str, decimal: str) -> bool:
    return bool(_NUMBER[decimal].fullmatch(cell) or CLOCK.match(cell))


def find_dialect(lines: list[str]) -> Dialect | None:
    """Return the dialect by which most cells are numbers; None where no lines are a table."""
    looked_at = [line for line in lines[:_LOOKED_AT] if line.strip()]
    best, most = None, 0
    for delimiter in DELIMITERS:
        split = [_split(line, delimiter) for line in looked_at]
        for decimal in ".,":
            if delimiter == decimal and not any('"' in line for line in looked_at):
                continue
            dialect, numbers = _as_table(split, delimiter, decimal)
            if numbers > most:
                best, most = dialect, numbers
    return best


def _as_table(split: list[list[str]], delimiter: str | None, decimal: str) -> tuple[Dialect | None, int]:
    """The table that lines split so may be, and its cells that are numbers less those that are text."""
    rows = [cells for cells in split if sum(_is_number(cell, decimal) for cell in cells) >= 2]
    if len(rows) < FEWEST_ROWS:
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
    return Dialect(delimiter, decimal, width, text), sum(numbers) - share


def find_blocks(lines: list[str], dialect: Dialect) -> list[tuple[int, int]]:
    """Return first and last line (from 0) of every run of rows with at most blank lines between them."""
    rows = [number for number, line in enumerate(lines) if line.strip() and dialect.is_row(line)]
    if not rows:
        return []
    starts, stops = [rows[0]], []
    for before, after in pairwise(rows):
        between = [line for line in lines[before + 1 : after] if line.strip()]
        # A torn row belongs to the table around it, and is told; other lines end it.
        if between and not all(dialect.is_torn_row(line) for line in between):
            stops.append(before)
            starts.append(after)
    return list(zip(starts, [*stops, rows[-1]], strict=True))
