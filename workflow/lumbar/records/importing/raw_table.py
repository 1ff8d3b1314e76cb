"""Content of a file before its meaning is known: columns of numbers with names and, if stated, units.

Units are read in the spellings of machines and users, and converted to s, mm, N, rad and N·m.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml

COLUMNS_FOLLOW = "\n    read as "
"""Text of a message between the problems of a table and its columns."""


@dataclass(frozen=True)
class RawColumn:
    """One column of a file."""

    number: int
    """Number of the column, from 1."""
    name: str
    """Name from the header, without the unit; a variable's path in a MATLAB or HDF5 file; empty without a header."""
    unit: str
    """Unit stated in the file; empty if it states none."""
    values: np.ndarray
    """Numbers in the column, shape (samples,); NaN if a cell has none."""
    group: str = ""
    """Beginning of the name that does not describe the quantity: the groups of a variable."""
    labels: tuple[str, ...] = ()
    """Distinct texts of a text column; `values` are indices into `labels`."""

    @property
    def name_in_group(self) -> str:
        """Name without its group."""
        return self.name.removeprefix(self.group)

    @property
    def label(self) -> str:
        """Number, name and unit, for messages."""
        name = f" {self.name!r}" if self.name else ""
        return f"column {self.number}{name}{f' [{self.unit}]' if self.unit else ''}"

    @property
    def sample(self) -> str:
        """First values and range, by which the user recognises the column."""
        finite = self.values[np.isfinite(self.values)]
        if not finite.size:
            return "no numbers"
        first = ", ".join(f"{value:.6g}" for value in self.values[:3])
        return f"{first}, …, from {finite.min():.6g} to {finite.max():.6g}"


@dataclass(frozen=True)
class StatedRate:
    """A sampling rate that is stated in a file."""

    value: float
    """Rate in hertz."""
    place: str
    """Line or variable of the file that states the rate."""


@dataclass(frozen=True)
class RawTable:
    """Columns of one length."""

    source: str
    """The file, for messages."""
    form: str
    """Description of the form that was read: encoding, delimiter, decimal mark, lines."""
    columns: tuple[RawColumn, ...]
    lines: Sequence[int] | None = None
    """Line of each sample in the file; None if the format has no lines."""
    rates: tuple[StatedRate, ...] = ()
    text_columns: tuple[RawColumn, ...] = ()
    """Columns of text, which may name trials."""
    notes: tuple[str, ...] = ()
    """Rows and cells of the file that are not in the table."""

    def with_rows(self, rows: np.ndarray) -> "RawTable":
        """Return the table with some of its rows.

        Parameters
        ----------
        rows : ndarray of int
            Indices of the rows.
        """
        columns, text_columns = (
            tuple(replace(column, values=column.values[rows]) for column in group)
            for group in (self.columns, self.text_columns)
        )
        lines = None if self.lines is None else np.asarray(self.lines)[rows]
        return replace(self, columns=columns, text_columns=text_columns, lines=lines)

    def describe(self) -> str:
        """Return the end of a message: the form, and columns with first values and ranges, one per line."""
        columns = "\n".join(f"      {column.label}: {column.sample}" for column in self.columns)
        return f"{COLUMNS_FOLLOW}{self.form}, with\n{columns}"


_SPELLINGS: dict[str, dict[str, float]] = shipped_yaml(Path(__file__).with_name("units.yaml"))
"""Factors to the target unit, by quantity and spelling."""
SPEEDS = {"length": "velocity", "angle": "angular velocity"}
"""Quantity of the velocity by the quantity of the position."""
TARGETS = {"time": "s", "length": "mm", "angle": "rad", "force": "N", "torque": "N·m"}
"""Unit in which records are written, by quantity."""
_READINGS = "V mV uV volt volts count counts cnt cnts bit bits raw digit digits a.u. au"
"""Units of raw sensor readings, which become a force or length only with a calibration."""


@dataclass(frozen=True)
class Unit:
    """A unit with its conversion to the unit of the records."""

    name: str
    """Spelling in the file."""
    quantity: str
    """``time``, ``length``, ``angle``, ``force``, ``torque``, one of `SPEEDS`, or ``reading`` for a sensor's output."""
    factor: float
    """Number in this unit times `factor` is the number in `target`."""
    target: str
    """Unit in which records are written."""


def _known_units() -> tuple[dict[str, Unit], dict[str, Unit]]:
    """Return units by spelling, and by the spellings in lower case that are unambiguous."""
    exact = {
        word: Unit(word, quantity, factor, TARGETS[quantity])
        for quantity, units in _SPELLINGS.items()
        for words, factor in units.items()
        for word in words.split()
    }
    times = [unit for unit in exact.values() if unit.name in ("s", "sec", "min")]
    paths = [unit for unit in exact.values() if unit.quantity in SPEEDS]
    for path, time in product(paths, times):
        speed, factor = f"{path.name}/{time.name}", path.factor / time.factor
        exact[speed] = Unit(speed, SPEEDS[path.quantity], factor, f"{path.target}/s")
    exact["rpm"] = Unit("rpm", *astuple(exact["rev/min"])[1:])
    exact |= {word: Unit(word, "reading", 1.0, word) for word in _READINGS.split()}
    lower: dict[str, Unit | None] = {}
    for word, unit in exact.items():
        other = lower.setdefault(word.casefold(), unit)
        if other is None or (other.quantity, other.factor) != (unit.quantity, unit.factor):
            lower[word.casefold()] = None
    return exact, {word: unit for word, unit in lower.items() if unit is not None}


_EXACT, _LOWER = _known_units()
_PER_TIME = re.compile(r"(?:_per_|per|/)(s|sec|min)$|_(s)$|[·*.]?s(?:\^?-1|⁻¹)$")
_BRACKETS = re.compile(r"^[\[(<{]\s*(.*?)\s*[\])>}]$")


def find_unit(spelling: str) -> Unit | None:
    """Return the unit with a spelling, in brackets or not; None if it is unknown.

    Parameters
    ----------
    spelling : str
        Unit as in the file, e.g. ``"[kN]"``.

    Examples
    --------
    >>> find_unit("[µm]").factor
    0.001
    >>> find_unit("KN").quantity, find_unit("MN").factor, find_unit("furlong")
    ('force', 1000000.0, None)
    """
    bracketed = _BRACKETS.match(spelling.strip())
    word = bracketed[1] if bracketed else spelling
    for sign, plain in (("µ", "u"), ("μ", "u"), ("⋅", "·"), (" ", "")):
        word = word.strip().replace(sign, plain)
    word = _PER_TIME.sub(lambda per: f"/{per[1] or 's'}", word)
    return _EXACT.get(word) or _LOWER.get(word.casefold())


_CALIBRATED_UNIT = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s/].*)$")


def parse_unit(text: str, place: str) -> Unit:
    """Return the unit that an option gives, optionally with a factor before it.

    Parameters
    ----------
    text : str
        A unit, ``mm``; or the value of the number 1 in the file, ``35.15 N`` (also ``35.15 N/V``).
    place : str
        The option, for the message.

    Raises
    ------
    InputError
        If the unit is unknown, or the factor is 0.

    Examples
    --------
    >>> parse_unit("35.15 N/V", "--force-unit").factor, parse_unit("2 m/s", "--position-unit").quantity
    (35.15, 'velocity')
    """
    calibrated = _CALIBRATED_UNIT.match(text.strip())
    unit = find_unit(calibrated.group(2) if calibrated else text)
    if unit is None and calibrated:
        of_one, _, reading = calibrated.group(2).rpartition("/")
        per = find_unit(reading)
        unit = None if per is not None and per.quantity == "time" else find_unit(of_one)
    factor = float(calibrated.group(1)) if calibrated else 1.0
    if unit is None or factor == 0 or not math.isfinite(factor):
        known = ", ".join(words.split()[0] for units in _SPELLINGS.values() for words in units)
        raise InputError(
            f"{place} {text!r} is not a unit; known are {known}, {', '.join(_READINGS.split()[:3])} …, and a number before "
            "one of them for a sensor's calibration, as in '35.15 N'"
        )
    return Unit(text.strip(), unit.quantity, factor * unit.factor, unit.target)


_HEADER_UNIT_PATTERNS = (
    re.compile(r"^(?P<name>.*?)\s*[\[(<{]\s*(?P<unit>[^\[\](){}<>]*?)\s*[\])>}]\s*$"),
    re.compile(r"^(?P<name>.*?)\s+in\s+(?P<unit>[^\s\d]+)$"),
    re.compile(
        r"^(?P<name>.*?[^\W_])[\s_/,:;|.-]+(?P<unit>[^\W_]+(?:/|_per_| per )(?:s|sec|min)|(?!in_)[^\W_]+_s)$"
    ),
    re.compile(r"^(?P<name>.*?)\s*[/,:;|]\s*(?P<unit>[^\s\d]+)$"),
    re.compile(r"^(?P<name>.*[^\s_.-])[\s_.-]+(?P<unit>[^\s_]+)$"),
    re.compile(r"^(?P<name>.*[a-zà-ÿ])(?P<unit>[A-Z][a-z]{0,2}|[mk]N)$"),
)


def split_name_and_unit(cell: str) -> tuple[str, str]:
    """Split a header's cell into name and unit; the unit is empty if the cell states no known one.

    Parameters
    ----------
    cell : str
        Text of the cell.

    Examples
    --------
    >>> [split_name_and_unit(cell) for cell in ("Kraft [kN]", "disp_in", "Weg in mm", "forceN", "millis")]
    [('Kraft', 'kN'), ('disp', 'in'), ('Weg', 'mm'), ('force', 'N'), ('millis', 'millis')]
    """
    cell = cell.strip()
    for pattern in _HEADER_UNIT_PATTERNS:
        match = pattern.match(cell)
        if match and match["name"] and find_unit(match["unit"]):
            return match["name"].strip(), match["unit"]
    unit = find_unit(cell)  # a column of time may be named by its unit: "seconds", Arduino's "millis"
    return cell, cell if unit is not None and unit.quantity == "time" and len(cell) > 3 else ""
