"""What a file holds before anything is known of its meaning: columns of numbers with names and, where stated, units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError

COLUMNS_FOLLOW = "\n    read as "
"""What parts, in a message, the problems of a table from its columns."""
ENCODINGS = "gbk (Chinese), shift_jis (Japanese), cp1251 (Cyrillic), cp1250 (Central Europe) or cp1252 (Western Europe)"
"""Examples, for messages."""


@dataclass(frozen=True)
class Asked:
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
