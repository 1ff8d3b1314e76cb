"""The grid of Table 4.1: every comparison under every convention, with its null control; what survives all of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.comparison.percent_differences import LIGHTER_BOX, percent_differences
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.failures import attempts
from lumbar.lifting.stability.model.trajectories import (
    OPTIONS,
    PLANES,
    Convention,
    Failure,
    LiftStates,
    Trajectory,
    at_rest,
    conventions,
    headline,
)
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

CHOICES = tuple(OPTIONS)
_CHOICES_IN_WORDS = ("gravity", "time", "mass", "pivot", "segment ends", "start of deposit")
MOVEMENT = "movement"
"""Comparison of a lift with itself standing still."""


def grid_differences(grid: pd.DataFrame, groups: tuple[str, str]) -> pd.DataFrame:
    """Compare the areas of all lifts under every convention.

    `grid` is ``grid.csv`` of all lifts with a column ``experience``. The result, columns of the table, holds the
    comparisons of Table 4.1, then every lift against itself standing still. `groups` are the labels of the people
    compared, the first with the second.
    """
    rows = []
    for choices, part in grid.groupby(list(CHOICES), sort=False):
        computed = part["mean_area"].notna()
        known, missing = part[computed], part[~computed]
        reasons = missing.groupby(["com", "plane"])["reason"].first().to_dict()
        moving, still = (
            percent_differences(known, area, part, groups) for area in ("mean_area", "null_area")
        )
        for row, null in zip(moving, still, strict=True):
            for plane in PLANES:
                reason = reasons.get((row["com"], plane))
                status = (
                    row["status"] if reason is None or row[plane] == row[plane] else f"no basin: {reason}"
                )
                cell = dict(zip(("plane", *CHOICES), (plane, *choices), strict=True))
                names = {"comparison": row["comparison"], "com": row["com"]}
                rows.append(names | cell | _from_movement(row[plane], null[plane]) | {"status": status})
    rows += [
        {
            "comparison": f"{MOVEMENT}_{item.subject}_{item.box_mass_kg:g}kg",
            **{name: getattr(item, name) for name in ("com", "plane", *CHOICES)},
            **_from_movement(100 * (item.mean_area / item.null_area - 1), 0.0),
            "status": item.reason or "computed",
        }
        for item in grid.fillna({"reason": ""}).itertuples()
    ]
    return pd.DataFrame(rows, columns=columns_of(__file__, "table_4_1_grid"))


def _from_movement(percent: float, null: float) -> dict:
    """A difference, its null control and what the movement makes of it; NaN where it is not known."""
    return {"percent": percent, "null_percent": null, "movement_points": percent - null}


def comparison_cells(grid: pd.DataFrame) -> pd.DataFrame:
    """Return the cells of the grid that compare lifts with one another and have a number."""
    return grid[~grid["comparison"].str.startswith(f"{MOVEMENT}_") & grid["percent"].notna()]


def expressing(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the cells whose convention can express what is compared: a lighter box needs a mass in which the box counts."""
    return cells[~cells["comparison"].str.startswith(LIGHTER_BOX) | (cells["mass"] == "with_box")]


def single_changes(grid: pd.DataFrame, base: Convention) -> pd.DataFrame:
    """Return what one choice changes in a convention that the grid holds with all its neighbours.

    Columns ``comparison, com, plane, choice, percent`` (in `base`) and ``changed``, the percentage with that choice alone made
    otherwise.
    """
    names, cells = ["comparison", "com", "plane"], comparison_cells(grid)
    parts = dict(iter(cells.groupby(list(CHOICES))))
    own, *others = (
        parts.get(tuple(vars(item).values()), cells[:0])[[*names, "percent"]]
        for item in (base, *base.neighbours)
    )
    frames = []
    for convention, other in zip(base.neighbours, others, strict=True):
        pairs = zip(_CHOICES_IN_WORDS, vars(convention).values(), vars(base).values(), strict=True)
        both = own.merge(other.rename(columns={"percent": "changed"}), on=names)
        frames.append(both.assign(choice=next(words for words, value, kept in pairs if value != kept)))
    return pd.concat(frames, ignore_index=True)


def change_sentence(name: str, changes: pd.DataFrame) -> str:
    """Say which choices move the differences of `single_changes`, how far, and which most."""
    words = []
    for choice, rows in changes.groupby("choice", sort=False):
        moved = rows["changed"] - rows["percent"]
        most = rows.loc[moved.abs().idxmax()]
        where = f"{most.comparison}, {most.com}, {most.plane}".replace("_", " ")
        turned = int((rows["changed"] * rows["percent"] < 0).sum())
        words.append(
            f"{choice} turns {turned} of {len(rows)} signs, at most {moved.abs().max():.2f} points ({where})"
        )
    return f"One choice changed alone in {name}: {'; '.join(words)}" if words else ""


def survivors(grid: pd.DataFrame) -> list[tuple]:
    """Return the differences that keep their sign in all cells that express them, by comparison, COM and plane.

    `grid` is that of `grid_differences`.
    """
    cells = expressing(comparison_cells(grid)).groupby(["comparison", "com", "plane"], sort=False)["percent"]
    return [name for name, own in cells if (np.sign(own) == np.sign(own.iloc[0])).all()]


def survival_sentence(grid: pd.DataFrame) -> str:
    """Say which differences survive the whole grid."""
    cells = expressing(comparison_cells(grid))
    if cells.empty:
        return "Nothing is compared in this study, so nothing can survive the grid"
    total = cells.groupby(["comparison", "com", "plane"]).ngroups
    counts = cells.groupby("comparison", sort=False).apply(lambda own: own.groupby(list(CHOICES)).ngroups)
    conventions = "all conventions that can express them (" + ", ".join(
        f"{name.replace('_', ' ')}: {count}" for name, count in counts.items()
    )
    conventions += "; a lighter box those in whose mass it counts)"
    same_sign = survivors(grid)
    if not same_sign:
        return f"Of {total} differences none keeps its sign under {conventions}: each hangs on the one chosen"
    kept = _name_differences(same_sign, grid)
    return f"Of {total} differences {len(same_sign)} keep their sign under {conventions}: {kept}"


def _name_differences(found: list[tuple], grid: pd.DataFrame) -> str:
    """Name differences, those of a whole comparison together."""
    size = comparison_cells(grid).drop_duplicates(["comparison", "com", "plane"]).groupby("comparison").size()
    words = []
    for comparison in dict.fromkeys(name for name, *_ in found):
        own = [", ".join(place).replace("_", " ") for name, *place in found if name == comparison]
        whole = len(own) == size[comparison]
        words.append(f"{comparison}: {'all' if whole else '; '.join(own)}".replace("_", " "))
    return "; ".join(words)


def grid_table(frame: pd.DataFrame, settings: StabilitySettings, data: str) -> Table:
    """Return the grid as a published table."""
    words = {"survival": survival_sentence(frame), "weights": settings.grid}
    return described(__file__, "table_4_1_grid", frame, data, words)


def grid_areas(lift: LiftStates, settings: StabilitySettings) -> pd.DataFrame:
    """Compute the average cross-sections of one lift, a row per convention, COM and plane; columns of ``grid.csv``.

    Knots and weights are those of the settings' section ``grid``.
    """
    rows = []
    own = headline(settings, lift.facts)
    chosen = conventions(own)
    for pivot in dict.fromkeys(convention.pivot for convention in chosen):
        here = [convention for convention in chosen if convention.pivot == pivot]
        about = settings if pivot == own.pivot else about_pivot(settings, pivot)
        rows += _rows_about({convention: lift.trajectories(convention) for convention in here}, about)
    return pd.DataFrame(rows, columns=columns_of(__file__, "grid_areas"))


def _rows_about(
    found: dict[Convention, tuple[list[Trajectory], list[Failure]]], settings: StabilitySettings
) -> list[dict]:
    """Rows of ``grid.csv`` of the conventions about one pivot."""
    sound = {convention: items for convention, (items, _) in found.items()}
    missing = {convention: list(unsound) for convention, (_, unsound) in found.items()}
    items = [item for some in sound.values() for item in some]
    signs = [convention.sign for convention, some in sound.items() for _ in some]
    areas: dict[int, np.ndarray] = {}
    # All conventions at once are five times as fast as one after the other; only where one has no basin are they taken apart.
    try:
        areas |= zip(map(id, items), areas_with_null(items, signs, settings), strict=True)
    except NumericalError:
        for convention, own in sound.items():
            for attempt in attempts(own, str(convention), missing[convention]):
                with attempt as some:
                    alike = [convention.sign] * len(some)
                    areas |= zip(map(id, some), areas_with_null(some, alike, settings), strict=True)
    rows = []
    for convention, own in sound.items():
        rows += [_row(item, convention, *areas[id(item)]) for item in own if id(item) in areas]
        rows += [_row(failure, convention) for failure in missing[convention]]
    return rows


def _row(
    item: Trajectory | Failure, convention: Convention, mean_area: float = np.nan, null_area: float = np.nan
) -> dict:
    row = {name: getattr(item, name, np.nan) for name in columns_of(__file__, "grid_areas")}
    areas = {"mean_area": mean_area, "null_area": null_area, "reason": getattr(item, "reason", "")}
    return row | {"duration_s": getattr(item, "duration", np.nan), **vars(convention), **areas}


def about_pivot(settings: StabilitySettings, pivot: str) -> StabilitySettings:
    """Return the settings with the control weight for a pivot that is not the study's own."""
    weight = getattr(settings.grid, f"{pivot}_control_weight")
    return replace(settings, regulator=replace(settings.regulator, control_weight=weight))


def areas_with_null(
    trajectories: Sequence[Trajectory], signs: Sequence[str], settings: StabilitySettings
) -> np.ndarray:
    """Return average cross-sections of trajectories and of their null controls in rad²/s, shape (trajectories, 2).

    There is one sign per trajectory, ``"hanging"`` or ``"inverted"``.

    Raises
    ------
    NumericalError
        One of them has no basin.
    """
    if not trajectories:
        return np.empty((0, 2))
    pendulums = [*trajectories, *map(at_rest, trajectories)]
    loops = close_loops(pendulums, [*signs, *signs], replace(settings, knots=settings.grid.knots))
    return exact_funnels(loops, settings.goal_level).mean_area.reshape(2, len(trajectories)).T
