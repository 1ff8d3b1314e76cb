"""The sheet of a perturbation experiment: one row per push done, in the order in which they were given, checked as a whole."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from lumbar.base.errors import Problems
from lumbar.lifting.pushes.dose_response import PushRecords

NEEDED = ("person", "direction", "impulse_N_s", "stepped")
KNOWN = (*NEEDED, "phase", "mass_kg")
YES, NO = ("1", "1.0", "yes", "true"), ("0", "0.0", "no", "false")
PHASES = (0.25, 0.5, 0.75)
"""At which pushes may be given where the sheet has phases."""


def records_of(
    sheet: pd.DataFrame, sizes: Mapping[str, tuple[float, float]] | None = None, name: str = "pushes"
) -> PushRecords:
    """Return the pushes of a sheet with columns `NEEDED`, and ``phase`` where it varied.

    `sizes` says for each direction which size may be given, from smallest to largest in N·s; default those in the sheet.

    Raises
    ------
    InputError
        With the row and column of every problem; the first row below the header is row 2.
    """
    problems = Problems(name)
    for column in [column for column in NEEDED if column not in sheet]:
        problems.add("header", f"no column {column!r}", f"there are: {', '.join(map(str, sheet.columns))}")
    problems.raise_if_any()

    def check(column: str, right, allowed: str) -> None:
        for row in np.flatnonzero(~np.asarray(right)):
            problems.add(f"row {row + 2}, column {column}", f"{sheet[column].iloc[row]!s:.40}", allowed)

    numbers = {"phase": np.full(len(sheet), 0.5)}
    for column, least, most in (("impulse_N_s", 1e-9, 1e9), ("phase", 0.0, 1.0), ("mass_kg", 1e-9, 1e9)):
        if column in sheet:
            values = numbers[column] = pd.to_numeric(sheet[column], errors="coerce").to_numpy(float)
            allowed = "0 to 1" if column == "phase" else "numbers above 0"
            check(column, (values >= least) & (values <= most), f"allowed: {allowed}, with a decimal point")
    words = {column: sheet[column].astype(str).str.strip() for column in NEEDED}
    for column in ("person", "direction"):
        check(column, sheet[column].notna(), "a name is needed")
    stepped = words["stepped"].str.lower()
    check("stepped", stepped.isin(YES + NO), "allowed: 1 or 0, yes or no")
    problems.raise_if_any()
    size, direction = numbers["impulse_N_s"], words["direction"].to_numpy()
    found = {
        name: (size[direction == name].min(), size[direction == name].max())
        for name in dict.fromkeys(direction)
    }
    ranges = sizes or found
    for name in found.keys() - ranges.keys():
        problems.add("sizes", f"none of direction {name!r}", f"there are: {', '.join(ranges)}")
    for name, (low, high) in (sizes or {}).items():
        if not 0 < low < high < np.inf:
            problems.add("sizes", f"{name} from {low:g} to {high:g}", "from above 0 N·s to a larger size")
    if not ranges:
        problems.add("", "no push yet", "say which may be given, e.g. --sizes forward=2:30")
    problems.raise_if_any()
    person, persons = pd.factorize(words["person"])
    return PushRecords(
        tuple(persons),
        tuple(ranges),
        person,
        np.array([list(ranges).index(name) for name in direction], dtype=int),
        numbers["phase"],
        size,
        stepped.isin(YES).to_numpy(bool),
        np.array(list(ranges.values()), dtype=float),
        PHASES if "phase" in sheet else (0.5,),
    )
