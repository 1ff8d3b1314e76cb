"""How a table stands on a page: numbers aligned on the decimal sign, no wider than the page, names in words with units."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lumbar.base.yaml_file import shipped_yaml

_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))
UNITS: dict[str, str] = _SAID["units"]
"""Unit by the end of a column's name."""
_SPELLED: dict[str, str] = _SAID["words"]
_VALUES = {"flexion_extension": "flexion/extension"}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NAME = re.compile(r"[a-z0-9]+(_[a-z0-9]+)+")


def column_in_words(name: str) -> str:
    """Return a column's name as a header: ``"lowest_passive_rate_Hz"`` is ``"Lowest passive rate (Hz)"``."""
    parts = name.split("_")
    unit = ""
    for count in (3, 2, 1):
        if len(parts) > count and "_".join(parts[-count:]) in UNITS:
            unit = f" ({UNITS['_'.join(parts[-count:])]})"
            parts = parts[:-count]
            break
    words = " ".join(_SPELLED.get(part, part) for part in parts)
    # A symbol keeps its case: p value, a0, α.
    small = (len(parts[0]) < 3 and parts[0] not in ("no", "at", "of", "up")) or not words.isascii()
    return (words if small else words[:1].upper() + words[1:]) + unit


def value_in_words(text: str) -> str:
    """Return a value that is a name with its words apart: ``"lateral_bending"`` is ``"lateral bending"``."""
    return _VALUES.get(text, text.replace("_", " ")) if _NAME.fullmatch(text) else text


def unit_in_print(unit: str) -> str:
    """Return a unit as journals print it; a broken exponent stays, as no raised signs hold it.

    >>> unit_in_print("N s^2/mm^3"), unit_in_print("N/mm^1.5")
    ('N·s²/mm³', 'N/mm^1.5')
    """
    return re.sub(r"\^(-?\d+)(?![.\d])", lambda found: found[1].translate(_RAISED), unit).replace(" ", "·")


PAGE_WIDTH = 124
"""Characters that stand side by side on a page."""
_GAP = 3
_WORDS, _FEWEST = 26, 14
"""Characters of a line of words in a cell: longer ones go on below; where columns are many, lines are shorter."""
EMPTY = "–"
SMALLEST_P = 1e-4
"""Below it a p value is printed as smaller than that: no tail of a distribution is known so far out."""
_NUMBER = re.compile(r"((?:< )?[+−-]?\d+)((?:\.\d+)?(?:·10[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?)")


@dataclass(frozen=True)
class Column:
    """One column as it is printed."""

    header: str
    cells: tuple[str, ...]
    """All rows."""
    pictures: tuple[str, ...] = ()
    """A picture for every row, as addresses of images, shown above the words in HTML."""

    @cached_property
    def numeric(self) -> bool:
        """Whether all cells that are not empty are numbers."""
        filled = [cell for cell in self.cells if cell != EMPTY]
        return bool(filled) and all(_NUMBER.fullmatch(cell) for cell in filled)

    @cached_property
    def fraction(self) -> int:
        """Characters from the decimal sign on of the cell that has most."""
        return max((len(split_number(cell)[1]) for cell in self.cells), default=0)

    @cached_property
    def width(self) -> int:
        """Characters that the column takes, the space beside it counted in."""
        word = max(map(len, re.split(r"[ /]", self.header)))
        if self.numeric:
            widest = max(len(split_number(cell)[0]) for cell in self.cells) + self.fraction
        else:
            widest = min(max(map(len, self.cells), default=0), _WORDS)
        return max(word, widest) + _GAP

    @cached_property
    def narrowest(self) -> int:
        """Characters that the column needs at least: words go on below one another, numbers do not."""
        if self.numeric:
            return self.width
        words = (len(word) for cell in (self.header, *self.cells) for word in re.split(r"[ /]", cell))
        return min(self.width, max(_FEWEST, *words) + _GAP)

    @cached_property
    def longest(self) -> int:
        """Characters of the longest cell."""
        return max(map(len, self.cells), default=0)


def split_number(cell: str) -> tuple[str, str]:
    """Return a number's part before the decimal sign, and the rest."""
    found = _NUMBER.fullmatch(cell)
    return (found[1], found[2]) if found else (cell, "")


def scientific(text: str) -> str:
    """Return a number such as ``1.2e-16`` as ``1.2·10⁻¹⁶``; others as they are."""
    mantissa, sign, exponent = text.partition("e")
    if not sign or not re.fullmatch(r"[+-]?\d+", exponent):
        return text
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


def fitting(columns: Sequence[Column], width: int = PAGE_WIDTH) -> int:
    """Return how many columns, from the first on, stand side by side."""
    if sum(column.narrowest for column in columns) <= width:
        return len(columns)
    taken = 0
    for count, column in enumerate(columns):
        taken += column.width
        if taken > width and count:
            return count
    return len(columns)


def blocks(columns: Sequence[Column], keys: int) -> list[list[Column]]:
    """Split columns into tables that fit, each beginning with the first `keys` columns."""
    if fitting(columns, PAGE_WIDTH) == len(columns):
        return [list(columns)]
    own, others = list(columns[:keys]), list(columns[keys:])
    room = PAGE_WIDTH - sum(column.width for column in own)
    found = []
    while others:
        count = fitting(others, room)
        found.append(own + others[:count])
        others = others[count:]
    return found or [own]


def keys_of(columns: Sequence[Column]) -> int:
    """Count the first columns that tell one row from another: those of words, three at most, or the first."""
    count = 0
    for column in columns[:3]:
        if column.numeric or column.longest > _WORDS:
            break
        count += 1
    return max(count, 1)
