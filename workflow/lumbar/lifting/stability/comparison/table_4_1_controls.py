"""The controls of Table 4.1: what its headline rests on, a row per difference.

Null control, range when weights, damping, body mass and the sharing of the box are changed one at a time, range over the
grid, and a sentence that says whether the difference survives this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.population.contrast import Interval
from lumbar.lifting.population.percent_interval import percent_interval
from lumbar.lifting.stability.basins import COLUMNS
from lumbar.lifting.stability.comparison.compared_study import BODY_MASS_SHARE, CHANGES, Study
from lumbar.lifting.stability.comparison.grid_table import compared
from lumbar.lifting.stability.comparison.lyapunov_exponent import compared_exponents
from lumbar.lifting.stability.comparison.percent_differences import comparisons
from lumbar.lifting.stability.comparison.table_4_1_words import (
    comparison_definition,
    headline_words,
    number_or_none,
    regulator_sentence,
)
from lumbar.lifting.stability.comparison.verdicts import verdict
from lumbar.lifting.stability.model.trajectory import PLANES
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings


def controls_table(study: Study, found: dict, areas: pd.DataFrame, grid: pd.DataFrame) -> Table:
    """Return what stands behind the headline: a row per comparison, centre of mass and plane."""
    import pandas as pd

    settings = study.settings
    sides = list(comparisons(areas, study.people, settings.compare.groups))
    trajectories = study.trajectories()
    of_grid = compared(grid)
    cells_of = dict(iter(of_grid.groupby(["comparison", "com", "plane"])))
    rows = []
    for plane in PLANES:
        exponents = compared_exponents(trajectories, plane, sides)
        for index, row in enumerate(found["headline"]):
            cells = cells_of.get((row["comparison"], row["com"], plane), of_grid[:0])
            entry = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            entry |= _controls_of(index, plane, found, cells["percent"].to_numpy())
            entry["exponents"] = exponents[row["comparison"], row["com"]]
            entry["verdict"] = _verdict(index, plane, found, cells, _interval(areas, sides, row, plane))
            rows.append(entry)
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent") or name == "movement_share"]
    frame = frame.astype(dict.fromkeys(numbers, float))
    return Table(
        title="Table 4.1, the headline's controls.",
        frame=frame,
        definitions=_control_definitions(settings),
        data=study.data,
        notes=(_what_varies(settings), regulator_sentence(settings)),
        decimals=dict.fromkeys(numbers, 2),
        may_be_empty=frozenset(numbers),
        headers={
            "comparison": "Comparison",
            "com": "Centre of mass",
            "plane": "Plane",
            "percent": "Difference (%)",
            "null_percent": "Null control (%)",
            "movement_share": "Movement's share",
            "initial_percent": "At t = 0 (%)",
            "minimum_percent": "Smallest section (%)",
            "lowest_percent": "Lowest (%)",
            "highest_percent": "Highest (%)",
            "grid_lowest_percent": "Lowest of the grid (%)",
            "grid_highest_percent": "Highest of the grid (%)",
            "verdict": "Verdict",
        },
    )


def _controls_of(index: int, plane: str, found: dict, in_grid: np.ndarray) -> dict:
    def of(name):
        return number_or_none(found[name][index][plane])

    percent, null = of("headline"), of("null")
    spread = [of(name) for name in found if name in CHANGES and name != "null"]
    spread = [value for value in (percent, *spread) if value is not None]
    share = None if percent is None or null is None or not percent else (percent - null) / percent
    return {
        "percent": percent,
        "null_percent": null,
        "movement_share": share,
        "initial_percent": of("initial"),
        "minimum_percent": of("minimum"),
        "lowest_percent": min(spread, default=None),
        "highest_percent": max(spread, default=None),
        "grid_lowest_percent": in_grid.min(initial=np.inf) if in_grid.size else None,
        "grid_highest_percent": in_grid.max(initial=-np.inf) if in_grid.size else None,
    }


def _verdict(index: int, plane: str, found: dict, cells: pd.DataFrame, interval: Interval) -> str:
    row = found["headline"][index]
    percent = number_or_none(row[plane])
    if row["status"].startswith("no basin") and percent is None:
        return row["status"]
    changed = {
        words: number_or_none(found[name][index][plane])
        for name, words in CHANGES.items()
        if name in found and name != "null"
    }
    if percent:
        turned = int((cells["percent"] * percent <= 0).sum())
        if turned:
            changed[f"{turned} of the grid's {len(cells)} conventions"] = -percent
    return verdict(percent, number_or_none(found["null"][index][plane]), changed, interval)


def _interval(areas: pd.DataFrame, compared_sides: list[tuple], row: dict, plane: str) -> Interval:
    """Interval over persons of one percentage, or why there is none."""
    found = {name: (before, after) for name, before, after, _ in compared_sides}
    before, after = found[row["comparison"]]
    if before is None:
        return Interval(remark="nothing to compare")
    here = areas[(areas["com"] == row["com"]) & (areas["plane"] == plane)]
    sides = [
        here[(here["experience"] == experience) & (here["box_mass_kg"] == mass)].groupby("subject")[
            "mean_area"
        ]
        for experience, mass in (after, before)
    ]
    return percent_interval(
        *({person: values.to_numpy() for person, values in side} for side in sides),
        paired=before[0] == after[0],
        names=(after[0], before[0]),
    )


def _what_varies(settings: StabilitySettings) -> str:
    factor = settings.sensitivity_factor
    return (
        f"Lowest and highest: one at a time, Q, R or b divided or multiplied by {factor:g}, everybody's body mass "
        f"±{100 * BODY_MASS_SHARE:g} %, the box shared the other way (whole or by mass), the sine's Taylor polynomials of "
        "degree 3, 5 and 7. The grid varies sign, time, mass and pivot; neither varies the segment table (see "
        "spread.csv of a lift) nor two things of this list at once"
    )


def _control_definitions(settings: StabilitySettings) -> dict[str, str]:
    return {
        "comparison": comparison_definition(settings),
        "com": COLUMNS["com"],
        "plane": COLUMNS["plane"],
        "percent": f"percent difference, headline ({headline_words(settings)})",
        "null_percent": "null control: the same with every trajectory replaced by θ0 = 0, so that only duration, mass and "
        "length are left",
        "movement_share": "(percent − null)/percent: the share that comes from the movement",
        "initial_percent": "the same of the cross-sections at t = 0",
        "minimum_percent": "the same of the smallest cross-sections (the goal set's, equal for all, unless the basin narrows "
        "before the end)",
        "lowest_percent": "smallest under the changes named in the note",
        "highest_percent": "largest under them",
        "grid_lowest_percent": "smallest over the grid's conventions",
        "grid_highest_percent": "largest over them",
        "exponents": "maximum Lyapunov exponents of the movements compared in 1/s, before and after, where trials repeat "
        "often enough; otherwise how many there are",
        "verdict": "whether the difference survives: same sign under every change and convention, and at least half of it not "
        "in the null control",
    }
