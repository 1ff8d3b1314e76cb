"""Table 4.1 by the thesis's method after one, two and four alternations: what of it its solver makes and not the lifters.

From the second alternation on ρ changes only at knots that have a multiplier again (`eqs_4_5_to_4_7_alternation`); without these
the table is that of one alternation, to the last digit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.basins import COLUMNS, decimals
from lumbar.lifting.stability.comparison.percent_differences import (
    Study,
    comparison_definition,
    percent_differences,
)
from lumbar.lifting.stability.model.trajectories import PLANES, THESIS
from lumbar.lifting.stability.programme.eqs_4_5_to_4_7_alternation import EVIDENCE, RESOLUTION
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

DECIMALS = 1
"""After the point: areas have two or three digits."""


def alternations_table(study: Study) -> Table:
    """Return the table of a study whose checks hold the thesis's method."""
    import pandas as pd

    groups, own = study.settings.compare.groups, study.areas("thesis", THESIS)
    done = study.settings.thesis_method.alternations
    columns = {f"after_{number}": f"mean_area_after_{number}" for number in EVIDENCE} | {
        "thesis": "mean_area"
    }
    found = {name: percent_differences(own, column, study.people, groups) for name, column in columns.items()}
    found["exact"] = percent_differences(study.areas("exact", THESIS), "mean_area", study.people, groups)
    printed, rows = study.printed, []
    for index, row in enumerate(found["thesis"]):
        for plane in PLANES:
            entry = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            entry["published_percent"] = printed[f"{plane}_percent"].get(
                (row["comparison"], row["com"]), np.nan
            )
            entry |= {f"{name}_percent": float(found[name][index][plane]) for name in ("exact", *columns)}
            rows.append(entry)
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent")]
    return Table(
        title="Table 4.1 by the thesis's method: one, two and four alternations.",
        frame=frame[["comparison", "com", "plane", *_definitions(done)]],
        definitions={
            "comparison": comparison_definition(study.settings),
            "com": COLUMNS["com"],
            "plane": COLUMNS["plane"],
            **_definitions(done),
        },
        data=study.data,
        notes=(
            jumps_sentence(own),
            sizes_sentence(frame, done),
            alternations_sentence(frame, done),
            *([digits_sentence(own)] if len(own) else []),
        ),
        decimals=dict.fromkeys(numbers, DECIMALS) | {"published_percent": 2},
        may_be_empty=frozenset(numbers),
    )


def _definitions(done: int) -> dict[str, str]:
    after = "percent difference by the thesis's alternation (Eqs 4.5–4.7) in the thesis's wording, after "
    return {
        "published_percent": "percent difference as the thesis prints it",
        "exact_percent": "percent difference in the thesis's wording by the exact method",
        "after_1_percent": f"{after}one: also that of any more without the knots at which ρ jumps",
        "thesis_percent": f"{after}{done} (the thesis: 2)",
        "after_4_percent": f"{after}four",
    }


def jumps_sentence(areas: pd.DataFrame) -> str:
    """Name the basins whose ρ a further alternation than the first changed, and what it does to their areas."""
    moved = areas[areas["jumped_knots"] > 0]
    if moved.empty:
        return f"In none of {len(areas)} basins a further alternation than the first has a multiplier at any knot"
    each = "; ".join(
        f"{row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane.replace('_', ' ')}: {_where(row)}, by up to "
        f"{row.largest_jump:.2g}, mean area {100 * (row.mean_area / row.mean_area_after_1 - 1):+.1f} %"
        for row in moved.itertuples()
    )
    return (
        f"In {len(moved)} of {len(areas)} basins some knots have a multiplier again after the first alternation, and there ρ "
        f"grows: {each}. All others are those of one alternation. Where the solver of step 1 stops and how many knots there are "
        "decide which they are"
    )


def _where(row) -> str:
    if row.jumped_knots == 1:
        return f"1 knot at {row.first_jump:.3f} T"
    return f"{row.jumped_knots} knots from {row.first_jump:.3f} T to {row.last_jump:.3f} T"


def digits_sentence(areas: pd.DataFrame) -> str:
    """Say what the digits of the thesis's areas leave of a difference."""
    step = max(100 * 10.0 ** -decimals(area, RESOLUTION["mean_area"]) / area for area in areas["mean_area"])
    return (
        f"Areas by the thesis's method are rounded to the digits that a solver's tolerance leaves them (boa.csv), the last of "
        f"which is up to {step:.1f} % of an area: smaller differences by that method are none"
    )


def sizes_sentence(frame: pd.DataFrame, done: int) -> str:
    """Compare the published sizes with those of one alternation and of all, plane by plane."""
    words = []
    for plane, rows in frame.groupby("plane", sort=False):
        sizes = [rows[f"{name}_percent"].abs().max() for name in ("published", "exact", "after_1", "thesis")]
        words.append(
            f"{plane.replace('_', ' ')}: {sizes[0]:.1f} % published, {sizes[1]:.1f} exact, {sizes[2]:.1f} after 1 alternation, "
            f"{sizes[3]:.1f} after {done}"
        )
    return f"Largest difference, {'; '.join(words)}"


def alternations_sentence(frame: pd.DataFrame, done: int) -> str:
    """Say whether a method that has converged stands behind the numbers: one alternation or four would then be the same."""
    other = 4 if done < 4 else 1
    change = (frame[f"after_{other}_percent"] - frame["thesis_percent"]).abs().max()
    words = f"{other} alternation{'s' if other > 1 else ''} in place of {done}"
    if not change >= 0.5 * 10**-DECIMALS:
        return f"{words}: no cell changes"
    return f"{words}: a cell changes by {change:.3g} percentage points, the alternation has not converged"
