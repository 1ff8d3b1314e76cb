"""What a file holds before anything is known of its meaning: columns of numbers with names and, where stated, units.

Units are read as machines and people spell them, and told in s, mm, N, rad and N·m.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.records.number_table import ENCODINGS

COLUMNS_FOLLOW = "\n    read as "
"""What parts, in a message, the problems of a table from its columns."""


@dataclass(frozen=True)
class ReadOptions:
    """What a person says of how a file is read, before its columns are known."""

    table: str | None = None
    """Part of the file: number of a table in a text file, sheet of a workbook, variable of a MATLAB or HDF5 file."""
    encoding: str | None = None
    """Of a text, as Python names it; None recognises UTF-8, UTF-16 and western Windows-1252."""
    columns: tuple[str, ...] = ()
    """Columns that are named for a role: they choose among variables of several lengths."""

    def __post_init__(self):
        try:
            "a".encode(self.encoding or "utf-8")
        except (LookupError, ValueError) as error:
            raise InputError(
                f"--encoding {self.encoding!r}: no encoding of text that Python knows, such as {ENCODINGS}"
            ) from error


@dataclass(frozen=True)
class RawColumn:
    """One column as it stands in a file."""

    number: int
    """Counted from 1."""
    name: str
    """From the header, without the unit; a variable's path in a MATLAB or HDF5 file; empty without a header."""
    unit: str
    """As the file states it; empty where it does not."""
    values: np.ndarray
    """Shape (samples,): naN where the file has no number."""
    group: str = ""
    """Beginning of the name that says nothing of what was measured: the groups above a variable."""
    spellings: tuple[str, ...] = ()
    """Of a column of words: what its values number."""

    @property
    def own_name(self) -> str:
        """The name within its group."""
        return self.name.removeprefix(self.group)

    @property
    def label(self) -> str:
        """Number, name and unit, for messages."""
        name = f" {self.name!r}" if self.name else ""
        return f"column {self.number}{name}{f' [{self.unit}]' if self.unit else ''}"

    @property
    def sample(self) -> str:
        """First values and range, by which a person recognises the column."""
        seen = self.values[np.isfinite(self.values)]
        if not seen.size:
            return "no numbers"
        first = ", ".join(f"{value:.6g}" for value in self.values[:3])
        return f"{first}, …, from {seen.min():.6g} to {seen.max():.6g}"


@dataclass(frozen=True)
class StatedRate:
    """A sampling rate that a file states."""

    value: float
    """Hertz."""
    place: str
    """Line or variable that states it."""


@dataclass(frozen=True)
class RawTable:
    """Columns of one length."""

    source: str
    """The file, for messages."""
    form: str
    """How it was read, in words: encoding, delimiter, decimal mark, lines."""
    columns: tuple[RawColumn, ...]
    lines: Sequence[int] | None = None
    """Line of each sample in the file; None where the format has no lines."""
    rates: tuple[StatedRate, ...] = ()
    words: tuple[RawColumn, ...] = ()
    """Columns of words, which may name trials."""

    def described(self) -> str:
        """How it was read, and columns with their first values and ranges, one per line: the end of a message."""
        columns = "\n".join(f"      {column.label}: {column.sample}" for column in self.columns)
        return f"{COLUMNS_FOLLOW}{self.form}, with\n{columns}"


_SPELLED: dict[str, dict[str, float]] = shipped_yaml(Path(__file__).with_name("units.yaml"))
"""Factor to the target's unit by the spellings, by quantity."""
SPEEDS = {"length": "velocity", "angle": "angular velocity"}
"""Quantity of a velocity by that of its way."""
TARGETS = {"time": "s", "length": "mm", "angle": "rad", "force": "N", "torque": "N·m"}
"""Unit in which records are written, by quantity."""
_READINGS = "V mV uV volt volts count counts cnt cnts bit bits raw digit digits a.u. au"
"""Units of a sensor's reading, from which no force or length follows without a calibration."""


@dataclass(frozen=True)
class Unit:
    """A unit with its way to the unit of the records."""

    name: str
    """As it was spelled."""
    quantity: str
    """``time``, ``length``, ``angle``, ``force``, ``torque``, one of `SPEEDS`, or ``reading`` for what a sensor gives."""
    factor: float
    """Number in this unit times `factor` is the number in `target`."""
    target: str
    """Unit of the records."""


def _folded(spelling: str) -> str:
    word = spelling.replace("µ", "u").replace("μ", "u").replace("⋅", "·").replace(" ", "")
    return re.sub(
        r"(?:_per_|per|/)(s|sec|min)$|_(s)$|[·*.]?s(?:\^?-1|⁻¹)$", lambda per: f"/{per[1] or 's'}", word
    )


def _tables() -> tuple[dict[str, Unit], dict[str, Unit]]:
    """Units by spelling, and those by spelling in small letters that only one unit has."""
    exact = {
        word: Unit(word, quantity, factor, TARGETS[quantity])
        for quantity, units in _SPELLED.items()
        for words, factor in units.items()
        for word in words.split()
    }
    times = [unit for unit in exact.values() if unit.name in ("s", "sec", "min")]
    ways = [unit for unit in exact.values() if unit.quantity in SPEEDS]
    for way, time in product(ways, times):
        speed, factor = f"{way.name}/{time.name}", way.factor / time.factor
        exact[speed] = Unit(speed, SPEEDS[way.quantity], factor, f"{way.target}/s")
    exact["rpm"] = replace(exact["rev/min"], name="rpm")
    exact |= {word: Unit(word, "reading", 1.0, word) for word in _READINGS.split()}
    by_small: dict[str, list[Unit]] = {}
    for word, unit in exact.items():
        by_small.setdefault(word.casefold(), []).append(unit)
    unique = {
        small: units[0]
        for small, units in by_small.items()
        if len({(unit.quantity, unit.factor) for unit in units}) == 1
    }
    return exact, unique


_EXACT, _SMALL = _tables()
_BRACKETS = re.compile(r"^[\[(<{]\s*(.*?)\s*[\])>}]$")


def find_unit(spelling: str) -> Unit | None:
    """Return the unit spelled so, in brackets or not; None where it is none that is known.

    Examples
    --------
    >>> find_unit("[µm]").factor
    0.001
    >>> find_unit("KN").quantity, find_unit("MN").factor, find_unit("furlong")
    ('force', 1000000.0, None)
    """
    bracketed = _BRACKETS.match(spelling.strip())
    word = _folded((bracketed.group(1) if bracketed else spelling).strip())
    return _EXACT.get(word) or _SMALL.get(word.casefold())


_CALIBRATED = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s/].*)$")


def parse_unit(text: str, place: str) -> Unit:
    """Return the unit that a person gave, with a factor before it or without.

    Parameters
    ----------
    text : str
        A unit, ``mm``; or what one unit of the file's numbers is, ``35.15 N`` (also ``35.15 N/V``).
    place : str
        Option it was given by, for the message.

    Raises
    ------
    InputError
        If there is no such unit, or the factor is 0.

    Examples
    --------
    >>> parse_unit("35.15 N/V", "--force-unit").factor, parse_unit("2 m/s", "--position-unit").quantity
    (35.15, 'velocity')
    """
    calibrated = _CALIBRATED.match(text.strip())
    unit = find_unit(calibrated.group(2) if calibrated else text)
    if unit is None and calibrated:
        of_one, _, reading = calibrated.group(2).rpartition("/")
        per = find_unit(reading)
        unit = None if per is not None and per.quantity == "time" else find_unit(of_one)
    factor = float(calibrated.group(1)) if calibrated else 1.0
    if unit is None or factor == 0 or not math.isfinite(factor):
        known = ", ".join(words.split()[0] for units in _SPELLED.values() for words in units)
        raise InputError(
            f"{place} {text!r} is no unit; known are {known}, {', '.join(_READINGS.split()[:3])} …, and a number before "
            "one of them for a sensor's calibration, as in '35.15 N'"
        )
    return Unit(text.strip(), unit.quantity, factor * unit.factor, unit.target)


_IN_HEADER = (
    re.compile(r"^(?P<name>.*?)\s*[\[(<{]\s*(?P<unit>[^\[\](){}<>]*?)\s*[\])>}]\s*$"),
    re.compile(r"^(?P<name>.*?)\s+in\s+(?P<unit>[^\s\d]+)$"),
    re.compile(
        r"^(?P<name>.*?[^\W_])[\s_/,:;|.-]+(?P<unit>[^\W_]+(?:/|_per_| per )(?:s|sec|min)|(?!in_)[^\W_]+_s)$"
    ),
    re.compile(r"^(?P<name>.*?)\s*[/,:;|]\s*(?P<unit>[^\s\d]+)$"),
    re.compile(r"^(?P<name>.*[^\s_.-])[\s_.-]+(?P<unit>[^\s_]+)$"),
    re.compile(r"^(?P<name>.*[a-zà-ÿ])(?P<unit>[A-Z][a-z]{0,2}|[mk]N)$"),
)


def name_and_unit(cell: str) -> tuple[str, str]:
    """Part a header's cell into name and unit; the unit is empty where the cell states none that is known.

    Examples
    --------
    >>> name_and_unit("Kraft [kN]"), name_and_unit("disp_in"), name_and_unit("Weg in mm"), name_and_unit("forceN")
    (('Kraft', 'kN'), ('disp', 'in'), ('Weg', 'mm'), ('force', 'N'))
    """
    cell = cell.strip()
    for pattern in _IN_HEADER:
        found = pattern.match(cell)
        if found and found["name"] and find_unit(found["unit"]):
            return found["name"].strip(), found["unit"]
    return cell, ""
