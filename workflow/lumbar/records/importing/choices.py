"""What a person says of foreign recordings instead of what would be guessed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import Asked
from lumbar.records.importing.roles import NONE, ROLES


@dataclass(frozen=True)
class Choices:
    """What a person says instead of what would be guessed; None leaves it to the guess."""

    time: str | None = None
    position: str | None = None
    force: str | None = None
    """`time`, `position`, `force`: column by name, or number counted from 1; ``none`` for a time that is not there."""
    time_unit: str | None = None
    position_unit: str | None = None
    force_unit: str | None = None
    """`time_unit`, `position_unit`, `force_unit`: unit of the file's numbers, or what one of them is: ``35.15 N``."""
    rate: float | None = None
    """Sampling rate in hertz of a table without a column of time."""
    flip_force: bool = False
    """Change the sign of the force."""
    trim: tuple[float, float] | None = None
    """Start and stop in seconds of the file's clock; only what lies between them is taken."""
    cut: tuple[tuple[str, tuple[float, float]], ...] = ()
    """Names of records, each with start and stop as of `trim`."""
    cut_by: str | None = None
    """Column whose stretches of one number or word are records."""
    table: str | None = None
    encoding: str | None = None
    """`table`, `encoding`: as of `lumbar.records.importing.raw_table.Asked`."""
    clipped: bool = False
    """Take records whose force or position is clipped."""

    def __post_init__(self):
        if bool(self.cut) + (self.cut_by is not None) + (self.trim is not None) > 1:
            raise InputError("give one of --cut, --cut-by and --trim")
        if self.rate is not None and not 0 < self.rate < np.inf:
            raise InputError(f"--rate {self.rate:g}: a positive number of hertz is needed")
        if self.trim is not None and not self.trim[0] < self.trim[1]:
            raise InputError(f"--trim {self.trim[0]:g}:{self.trim[1]:g}: the start must lie before the stop")

    @property
    def asked(self) -> Asked:
        """What is said of how a file is read."""
        columns = (column for column, _ in self.wishes().values() if column not in (None, NONE))
        return Asked(self.table, self.encoding, tuple(columns))

    def wishes(self) -> dict[str, tuple[str | None, str | None]]:
        """Column and unit that were said of each role."""
        return {role: (getattr(self, role), getattr(self, f"{role}_unit")) for role in ROLES}
