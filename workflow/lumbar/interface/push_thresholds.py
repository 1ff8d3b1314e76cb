"""``lumbar.push_thresholds``: after which push each person steps, from pushes done, and which push to give next."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from lumbar.base.errors import InputError, NumericalError
from lumbar.interface.verb import Result, data_label, read_table
from lumbar.lifting.pushes import threshold_tables as made
from lumbar.lifting.pushes.dose_response import Posterior, PushRecords, posterior_of
from lumbar.lifting.pushes.push_design import NextPush, next_push
from lumbar.lifting.pushes.push_sheet import records_of
from lumbar.settings.key import SEED
from lumbar.settings.pushes import ScoringSettings
from lumbar.tables.described import described
from lumbar.tables.table import Table

FEWEST_DRAWS = 50
"""Effective ones, below which no quantile is told."""
DOUBTED = 2.58
"""Of a standard normal: one in a hundred."""


def push_thresholds(
    sheet: pd.DataFrame | str | os.PathLike,
    *,
    sizes: Mapping[str, tuple[float, float]] | None = None,
    seed: int = SEED,
    data: str = "",
) -> "PushThresholds":
    """Estimate after which push each person steps, with 95 % intervals, from the pushes done so far.

    Parameters
    ----------
    sheet : pandas.DataFrame or path
        One row per push in the order given, columns ``person, direction, impulse_N_s, stepped``; where they are known
        ``phase`` of the movement (0 to 1), ``mass_kg`` and measures of the movement before the push, a column each.
    sizes : mapping of str to (float, float), optional
        Smallest and largest push in N·s that may be given, by direction; default those in the sheet.
    seed : int
        Of the draws.
    data : str
        Words for the source of the data.

    Raises
    ------
    InputError
        With the row and column of every problem of the sheet.
    NumericalError
        If the draws miss what the pushes leave open.

    Examples
    --------
    >>> import lumbar
    >>> import pandas as pd
    >>> done = [("ann", "forward", 8, 0), ("ann", "forward", 12, 1), ("bob", "forward", 8, 0), ("bob", "forward", 12, 0)]
    >>> sheet = pd.DataFrame(done, columns=["person", "direction", "impulse_N_s", "stepped"])
    >>> found = lumbar.push_thresholds(sheet, sizes={"forward": (2, 30)})
    >>> found.table.frame["person"].tolist()
    ['ann', 'bob', 'a person not pushed yet']
    >>> 8 < found.next_push("ann").impulse_N_s < 12
    True
    """
    source = os.fspath(sheet) if isinstance(sheet, str | os.PathLike) else ""
    frame = read_table(source, "pushes") if source else sheet
    records = records_of(frame, sizes, source or "pushes")
    posterior = posterior_of(records, seed)
    if posterior.effective < FEWEST_DRAWS:
        raise NumericalError(
            f"pushes: the draws miss what is open ({posterior.effective:.0f} effective ones; needed: {FEWEST_DRAWS}): try "
            "another seed, and look for a person or direction with unlike sizes"
        )
    return PushThresholds(frame, records, posterior, seed, data_label(data, [source]))


@dataclass(frozen=True, eq=False, repr=False)
class PushThresholds(Result):
    """What pushes done tell of persons."""

    sheet: pd.DataFrame
    records: PushRecords
    posterior: Posterior
    """Draws of thresholds, curve and population."""
    seed: int
    data: str

    @property
    def table(self) -> Table:
        """Thresholds by person and direction."""
        return self.tables["push_thresholds"]

    @cached_property
    def tables(self) -> dict[str, Table]:
        """``push_thresholds``, ``push_calibration`` and, where the sheet has measures, ``push_increments``."""
        records, posterior = self.records, self.posterior
        told = made.predicted(records, posterior)
        rows = {
            "push_thresholds": made.threshold_rows(records, posterior, self.seed),
            "push_calibration": made.calibration_rows(records, told),
            "push_increments": made.increment_rows(self.sheet, records, ScoringSettings(), self.seed),
        }
        notes = [*made.curve_notes(records, posterior), *self._doubts(*made.trends(records, told))]
        return {
            name: described(made.__file__, name, found, self.data, notes=notes)
            for name, found in rows.items()
            if found
        }

    def _doubts(self, drift: float, bend: float) -> list[str]:
        words = {"more": "more frequent" if drift > 0 else "rarer", "drift": drift, "bend": bend}
        twice = self.sheet.duplicated().any()
        found = {"drift": abs(drift) > DOUBTED, "bend": abs(bend) > DOUBTED, "twice": twice}
        return [made.SAID[name].format(**words) for name, true in found.items() if true]

    def next_push(self, person: str, step: float = 1.5) -> NextPush:
        """Return the push after which this person's thresholds are expected to be known best.

        It is at most `step` times the largest after which the person stood in that direction, and the smallest before that.
        """
        if not 1 < step < float("inf"):
            raise InputError(f"step is {step:g}; allowed: above 1, as 1.5 for half as large again")
        return next_push(self.records, self.posterior, person, step, self.seed)

    def files(self) -> Iterator[tuple[str, Any]]:
        """The tables."""
        yield from self.tables.items()

    def __str__(self) -> str:
        lines = [
            f"{row.person}, {row.direction}: {row.threshold_N_s:.3g} N·s ({row.low:.3g} to {row.high:.3g}), stepped after "
            f"{row.steps} of {row.pushes}"
            for row in self.table.frame.itertuples()
        ]
        return "\n".join([*lines, *self.table.notes[1:]])

    def __repr__(self) -> str:
        return f"<PushThresholds: {len(self.records.size)} pushes of {len(self.records.persons)} persons>"
