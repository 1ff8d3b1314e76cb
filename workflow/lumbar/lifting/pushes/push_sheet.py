"""The sheet of a perturbation experiment: one row per push done, in the order in which they were given, checked as a whole."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from lumbar.base.errors import Problems
from lumbar.lifting.pushes.dose_response import PushRecords

NEEDED = ("person", "direction", "impulse_N_s", "stepped")
KNOWN = (*NEEDED, "phase", "mass_kg")
OUTCOMES = {
    "1": True,
    "1.0": True,
    "yes": True,
    "true": True,
    "0": False,
    "0.0": False,
    "no": False,
    "false": False,
}
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
    for column in NEEDED:
        if column not in sheet:
            problems.add(
                "header", f"no column {column!r}", f"there are: {', '.join(map(str, sheet.columns))}"
            )
    problems.raise_if_any()

    def check(column: str, right, allowed: str) -> None:
        for row in np.flatnonzero(~np.asarray(right)):
            problems.add(
                f"row {row + 2}, column {column}", f"{sheet[column].iloc[row]!s:.40}", f"needed: {allowed}"
            )

    words = {column: sheet[column].astype(str).str.strip() for column in NEEDED}
    numbers = {
        column: pd.to_numeric(sheet[column], errors="coerce").to_numpy(float)
        for column in ("impulse_N_s", "phase", "mass_kg")
        if column in sheet
    }
    size, stepped = numbers["impulse_N_s"], words["stepped"].str.lower().map(OUTCOMES)
    phase = numbers.get("phase", np.full(len(sheet), 0.5))
    for column in ("person", "direction"):
        check(column, sheet[column].notna(), "a name")
    for column, values in numbers.items():
        least, most, also = (0, 1, ", a share of the movement") if column == "phase" else (1e-9, 1e9, "")
        check(
            column,
            (values >= least) & (values <= most),
            f"a number from {least:g} to {most:g}{also}, with a decimal point",
        )
    check("stepped", stepped.notna(), "1 or 0, yes or no")
    problems.raise_if_any()
    there = dict(tuple(pd.Series(size).groupby(words["direction"].to_numpy(), sort=False)))
    ranges = sizes or {direction: (float(own.min()), float(own.max())) for direction, own in there.items()}
    if not ranges:
        problems.add(
            "", "no push yet", "say the directions and sizes that may be given, e.g. --sizes forward=2:30"
        )
    for direction in there.keys() - ranges.keys():
        problems.add("sizes", f"none of direction {direction!r}", f"there are: {', '.join(ranges)}")
    for direction, (low, high) in (sizes or {}).items():
        if not 0 < low < high < np.inf:
            problems.add(
                "sizes", f"{direction} from {low:g} to {high:g}", "from above 0 N·s to a larger size"
            )
    problems.raise_if_any()
    persons = list(dict.fromkeys(words["person"]))
    return PushRecords(
        tuple(persons),
        tuple(ranges),
        np.array([persons.index(item) for item in words["person"]], dtype=int),
        np.array([list(ranges).index(item) for item in words["direction"]], dtype=int),
        phase,
        size,
        stepped.to_numpy(bool),
        np.array(list(ranges.values()), dtype=float),
        PHASES if "phase" in sheet else (0.5,),
    )
