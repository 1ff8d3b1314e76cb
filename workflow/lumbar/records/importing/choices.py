"""What a person says of foreign recordings instead of what would be guessed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import Asked
from lumbar.records.importing.roles import NONE, ROLES


@dataclass(frozen=True)
class Choices:
    """What a person says instead of what would be guessed, as of `lumbar.import_recordings`; None leaves it to the guess."""

    time: str | None = None
    position: str | None = None
    force: str | None = None
    time_unit: str | None = None
    position_unit: str | None = None
    force_unit: str | None = None
    rate: float | None = None
    flip_force: bool = False
    trim: tuple[float, float] | None = None
    cut: tuple[tuple[str, tuple[float, float]], ...] = ()
    cut_by: str | None = None
    table: str | None = None
    encoding: str | None = None
    clipped: bool = False

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
