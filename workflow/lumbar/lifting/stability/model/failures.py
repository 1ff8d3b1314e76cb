"""Basins that could not be computed: one drops out, named and with its reason, and the others stay.

A failure is a row of ``stability/failures.csv``, never a number in another table.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.trajectories import Failure, Trajectory
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = {
    "subject": "who lifted",
    "experience": "experience of the lifter",
    "box_mass_kg": "mass of the box",
    "com": "centre of mass taken for the pendulum's",
    "plane": "plane onto which the trajectory is projected",
    "basin": "what is missing: the method with its sign of gravity and its limits, a variant of Table 4.1, or all "
    "basins of an unsound trajectory",
    "reason": "why, what was found and what is allowed",
}


def all_or_each(
    function: Callable, trajectories: list[Trajectory], *arguments, basin: str
) -> tuple[list[tuple[list[Trajectory], Any]], list[Failure]]:
    """Call ``function(trajectories, *arguments)``; where that fails, once for each trajectory by itself.

    Parameters
    ----------
    function : callable
        Of a list of trajectories and `arguments`; raises `NumericalError` where one of them has no result.
    *arguments
        Handed on.
    basin : str
        What is computed, for `Failure.basin`.

    Returns
    -------
    results : list of (list of Trajectory, Any)
        Trajectories and what `function` returned for them: all in one, or one by one without those that failed.
    failures : list of Failure
    """
    if not trajectories:
        return [], []
    try:
        return [(trajectories, function(trajectories, *arguments))], []
    except NumericalError:
        results, failures = [], []
    for item in trajectories:
        try:
            results.append(([item], function([item], *arguments)))
        except NumericalError as error:
            failures.append(Failure.of(item, basin, str(error)))
    return results, failures


def failures_frame(failures: list[Failure]) -> pd.DataFrame:
    """Return failures as the rows of ``failures.csv``."""
    import pandas as pd

    return pd.DataFrame([asdict(item) for item in failures], columns=list(COLUMNS))


def joined(frames: list[pd.DataFrame]) -> pd.DataFrame:
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


def failures_table(failures: pd.DataFrame, data: str) -> Table:
    """Return the basins that could not be computed as a published table."""
    note = "Every basin was computed" if failures.empty else "These basins are in no other table"
    return Table(
        title="Basins of attraction that could not be computed.",
        frame=failures,
        definitions=COLUMNS,
        data=data,
        notes=(note,),
    )
