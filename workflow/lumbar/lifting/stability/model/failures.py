"""Basins that could not be computed: one drops out, named and with its reason, and the others stay.

A failure is a row of ``stability/failures.csv``, never a number in another table.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.eq_4_1_pendulum import SIGNS, pendulum_label
from lumbar.lifting.stability.model.trajectories import Failure, Trajectory
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")


def compute_together(
    compute: Callable[[list[Trajectory]], Result],
    trajectories: list[Trajectory],
    basin: str,
    failures: list[Failure],
) -> list[tuple[list[Trajectory], Result]]:
    """Compute all trajectories at once; where the error's label is that of one, it is tried by itself and the others
    together again, else each by itself.

    The integration takes as many steps for one basin as for a hundred.

    `basin` says what is computed, for `Failure.basin`; `failures` grows by those that fail by themselves. Returned are
    the trajectories that were computed together, with their result.

    Examples
    --------
    >>> compute_together(len, ["thorax", "pelvis"], "exact", [])
    [(['thorax', 'pelvis'], 2)]
    """
    found = []
    left = list(trajectories)
    while left:
        try:
            return [*found, (left, compute(left))]
        except NumericalError as error:
            label = error.label
            if len(left) == 1:
                failures.append(Failure.of(left[0], basin, str(error)))
                return found
        alone = [item for item in left if label in (pendulum_label(item, sign) for sign in SIGNS)] or left
        left = [item for item in left if item not in alone]
        for item in alone:
            try:
                found.append(([item], compute([item])))
            except NumericalError as error:
                failures.append(Failure.of(item, basin, str(error)))
    return found


def failures_frame(failures: list[Failure]) -> pd.DataFrame:
    """Return failures as the rows of ``failures.csv``."""
    import pandas as pd

    return pd.DataFrame(
        [asdict(item) for item in failures], columns=columns_of("lifting/stability", "missing_basins")
    )


def join_rows(frames: list[pd.DataFrame]) -> pd.DataFrame:
    """Join the same table of several lifts; one without rows decides no type."""
    import pandas as pd

    filled = [frame for frame in frames if len(frame)]
    return pd.concat(filled, ignore_index=True) if filled else frames[0]


def announcement(path: str | os.PathLike) -> str:
    """Return a message that names every basin in a ``failures.csv``; empty where there is none."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        return ""
    count = f"{len(rows)} basin{'s' if len(rows) > 1 else ''} of attraction could not be computed ({path})"
    return "\n".join(
        [
            f"WARNING: {count}; the tables leave out and name:",
            *(
                f"  - {row['subject']} {float(row['box_mass_kg']):g} kg, {row['com']}, {row['plane']}: "
                f"{row['basin']}: {row['reason']}"
                for row in rows
            ),
        ]
    )


def failures_table(failures: pd.DataFrame, source_label: str) -> Table:
    """Return the basins that could not be computed as a published table; where none is missing, a row says so."""
    none, no_rows = failures.empty, failures_frame([])
    if none:
        failures = no_rows.astype(object)
        failures.loc[0] = dict.fromkeys(no_rows) | {"basin": "none", "reason": "every basin was computed"}
    return described(
        "lifting/stability",
        "missing_basins",
        failures,
        source_label,
        notes=("Every basin was computed" if none else "These basins are in no other table",),
        may_be_empty=frozenset(no_rows) - {"basin", "reason"} if none else frozenset(),
    )
