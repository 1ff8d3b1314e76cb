"""Layout of a table on a page: numbers aligned on the decimal sign, no wider than the page, names as text with units."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lumbar.base.formats import format_number
from lumbar.base.yaml_file import shipped_yaml

_TEXTS = shipped_yaml(Path(__file__).with_suffix(".yaml"))
UNITS: dict[str, str] = _TEXTS["units"]
"""Units by the last part of a column's name."""
_SPELLED_WORDS: dict[str, str] = _TEXTS["words"]
_VALUES = {"flexion_extension": "flexion/extension"}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NAME = re.compile(r"[a-z0-9]+(_[a-z0-9]+)+")


def column_in_words(name: str) -> str:
    """Return a column's name as a header: ``"lowest_passive_rate_Hz"`` is ``"Lowest passive rate (Hz)"``.

    Parameters
    ----------
    name : str
        Name as in the CSV file, its unit last.
    """
    parts = name.split("_")
    unit = ""
    for count in (3, 2, 1):
        if len(parts) > count and "_".join(parts[-count:]) in UNITS:
            unit = f" ({UNITS['_'.join(parts[-count:])]})"
            parts = parts[:-count]
            break
    text = " ".join(_SPELLED_WORDS.get(part, part) for part in parts)
    # A symbol keeps its case: p value, a0, α.
    is_symbol = (len(parts[0]) < 3 and parts[0] not in ("no", "at", "of", "up")) or not text.isascii()
    return (text if is_symbol else text[:1].upper() + text[1:]) + unit


def value_in_words(text: str) -> str:
    """Return a name with its words separated: ``"lateral_bending"`` is ``"lateral bending"``.

    Parameters
    ----------
    text : str
        Text of a cell.
    """
    return _VALUES.get(text, text.replace("_", " ")) if _NAME.fullmatch(text) else text


def unit_in_print(unit: str) -> str:
    """Return a unit as journals print it; a fractional exponent stays, because a raised point does not exist.

    Parameters
    ----------
    unit : str
        Plain text.

    Examples
    --------
    >>> unit_in_print("N s^2/mm^3"), unit_in_print("N/mm^1.5")
    ('N·s²/mm³', 'N/mm^1.5')
    """
    return re.sub(r"\^(-?\d+)(?![.\d])", lambda match: match[1].translate(_RAISED), unit).replace(" ", "·")


PAGE_WIDTH = 124
"""Characters across a page."""
_GAP_WIDTH = 3
_MAX_TEXT_WIDTH = 26
"""Largest number of characters in a line of a cell; longer text is wrapped."""
_MIN_TEXT_WIDTH = 14
"""Number of characters to which lines of cells are wrapped if there are many columns."""
EMPTY = "–"
DIGITS = 3
"""Significant digits of printed numbers."""
SMALLEST_P = 1e-4
"""Smallest printed p value; smaller ones are printed as ``< 0.0001``, as no tail of a distribution is known so exactly."""
_NUMBER = re.compile(r"((?:< )?[+−-]?\d+)((?:\.\d+)?(?:·10[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?)")


@dataclass(frozen=True)
class Column:
    """A printed column; widths are in characters."""

    header: str
    cells: tuple[str, ...]
    """Cells of all rows."""
    pictures: tuple[str, ...] = ()
    """Picture of each row, as the address of an image, shown above the text in HTML."""

    @cached_property
    def numeric(self) -> bool:
        """True if all cells that are not empty are numbers."""
        filled = [cell for cell in self.cells if cell != EMPTY]
        return bool(filled) and all(_NUMBER.fullmatch(cell) for cell in filled)

    @cached_property
    def fraction(self) -> int:
        """Width of the longest fraction, with its decimal sign."""
        return max((len(split_number(cell)[1]) for cell in self.cells), default=0)

    @cached_property
    def width(self) -> int:
        """Width of the column and the gap next to it."""
        word = max(map(len, re.split(r"[ /]", self.header)))
        if self.numeric:
            widest = max(len(split_number(cell)[0]) for cell in self.cells) + self.fraction
        else:
            widest = min(self.longest_cell, _MAX_TEXT_WIDTH)
        return max(word, widest) + _GAP_WIDTH

    @cached_property
    def narrowest(self) -> int:
        """Smallest width of the column: text is wrapped, numbers are not."""
        if self.numeric:
            return self.width
        words = (len(word) for cell in (self.header, *self.cells) for word in re.split(r"[ /]", cell))
        return min(self.width, max(_MIN_TEXT_WIDTH, *words) + _GAP_WIDTH)

    @cached_property
    def longest_cell(self) -> int:
        """Characters of the longest cell."""
        return max(map(len, self.cells), default=0)


def split_number(cell: str) -> tuple[str, str]:
    """Return the part of a number before the decimal sign, and the rest.

    Parameters
    ----------
    cell : str
        Text of a cell; text that is not a number is returned unchanged, with an empty rest.
    """
    match = _NUMBER.fullmatch(cell)
    return (match[1], match[2]) if match else (cell, "")


def scientific(text: str) -> str:
    """Return a number such as ``1.2e-16`` as ``1.2·10⁻¹⁶``; other texts unchanged.

    Parameters
    ----------
    text : str
        Formatted number.
    """
    mantissa, sign, exponent = text.partition("e")
    if not sign or not re.fullmatch(r"[+-]?\d+", exponent):
        return text
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


def format_cell(value: float, decimals: int | None = None) -> str:
    """Return a number with three significant digits; a whole number below a million is not rounded.

    Parameters
    ----------
    value : float
        Number of a cell.
    decimals : int, optional
        Largest number of digits after the point.

    Examples
    --------
    >>> format_cell(86.02), format_cell(2048.0), format_cell(3999.4, 2), format_cell(5.0, 2), format_cell(0.064, 2)
    ('86', '2048', '4000', '5.00', '0.06')
    """
    is_whole = value == round(value) and abs(value) < 1e6
    if decimals is None:
        return f"{value:.0f}" if is_whole else scientific(format_number(value, DIGITS))
    size = math.floor(math.log10(abs(value))) + 1 if value else 1
    rounded = value if is_whole else round(value, DIGITS - size)
    return f"{rounded:.{max(0, min(decimals, DIGITS - size))}f}"


def count_fitting(columns: Sequence[Column], width: int = PAGE_WIDTH) -> int:
    """Return the number of leading columns that fit next to each other, at least 1.

    Parameters
    ----------
    columns : sequence of Column
        Columns in their order.
    width : int
        Width of the page in characters.
    """
    if sum(column.narrowest for column in columns) <= width:
        return len(columns)
    total = 0
    for count, column in enumerate(columns):
        total += column.width
        if total > width and count:
            return count
    return len(columns)


def split_columns(columns: Sequence[Column], keys: int) -> list[list[Column]]:
    """Split columns into tables that fit the page; each begins with the key columns.

    Parameters
    ----------
    columns : sequence of Column
        Columns in their order.
    keys : int
        Number of leading columns that identify a row.
    """
    if count_fitting(columns) == len(columns):
        return [list(columns)]
    leading, others = list(columns[:keys]), list(columns[keys:])
    width = PAGE_WIDTH - sum(column.width for column in leading)
    tables = []
    while others:
        count = count_fitting(others, width)
        tables.append(leading + others[:count])
        others = others[count:]
    return tables or [leading]


def count_key_columns(columns: Sequence[Column]) -> int:
    """Return the number of leading columns that identify a row: text columns, at least one and at most three.

    Parameters
    ----------
    columns : sequence of Column
        Columns in their order.
    """
    count = 0
    for column in columns[:3]:
        if column.numeric or column.longest_cell > _MAX_TEXT_WIDTH:
            break
        count += 1
    return max(count, 1)
