"""Table 4.1: percent differences of average cross-sections, published, in the thesis's wording, and as people stand.

The first table holds the published percentages beside those of this study under the thesis's own convention
(`convention.THESIS`) and under the headline's. The second holds what the headline rests on, a row per difference: its null
control, its range when weights, damping, body mass and the sharing of the box are changed one at a time, and a sentence
that says whether it survives this and the grid. A basin that could not be computed is named in place of its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import NumericalError
from lumbar.population.contrast import Interval
from lumbar.population.percent_interval import percent_interval
from lumbar.settings.plain import plain
from lumbar.stability.basins import COLUMNS
from lumbar.stability.comparison.grid import headline
from lumbar.stability.comparison.grid_table import compared, grid_differences, survival_sentence
from lumbar.stability.comparison.lyapunov_exponent import compared_exponents
from lumbar.stability.comparison.percent_differences import (
    TAYLOR_DEGREES,
    VARIANTS,
    comparison_names,
    comparisons,
    percent_differences,
    taylor_areas,
    varied_areas,
)
from lumbar.stability.comparison.verdicts import verdict
from lumbar.stability.model.convention import THESIS, Convention
from lumbar.stability.model.failures import Failure, all_or_each, failures_frame, joined
from lumbar.stability.model.lift_trajectories import LiftStates
from lumbar.stability.model.trajectory import PLANES, Trajectory
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

THESIS_DECIMALS = 1
"""Digits after the point that the thesis's engine has in a percentage: with areas of the digits they have
(`bilinear_alternation.RESOLUTION`) it may be off by some tenths."""
BODY_MASS_SHARE = 0.1
"""By how much of it everybody's body mass is raised and lowered."""

_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")
TAYLOR = {f"taylor_{degree}": degree for degree in TAYLOR_DEGREES}
"""Degree of the sine's polynomial by change."""
_CHANGES = {
    "null": "null control",
    "lighter": "lighter bodies",
    "heavier": "heavier bodies",
    "box_share": "the box shared the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
    **{name: f"Taylor degree {degree}" for name, degree in TAYLOR.items()},
}
_LABELS = {"lateral_bending": "Lateral", "flexion_extension": "Flexion"}


@dataclass(frozen=True)
class Study:
    """What the tables of a study are made of.

    Attributes
    ----------
    lifts : list of LiftStates
        With ``experience`` among their facts.
    boa, grid : pandas.DataFrame
        ``boa.csv`` and ``grid.csv`` of all lifts, with a column ``experience``.
    settings : StabilitySettings
    published : pandas.DataFrame
        The thesis's Table 4.1.
    data : str
        Where the data come from.
    """

    lifts: Sequence[LiftStates]
    boa: pd.DataFrame
    grid: pd.DataFrame
    settings: StabilitySettings
    published: pd.DataFrame
    data: str

    @property
    def people(self) -> pd.DataFrame:
        """Label and box of every lift: it counts also where all its basins are missing."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"experience": lift.facts["experience"], "box_mass_kg": lift.facts["box_mass_kg"]}
                for lift in self.lifts
            ]
        )

    def trajectories(self, mass=None) -> list[Trajectory]:
        """Sound trajectories of the headline, of all lifts; `mass` changes their masses (of the facts)."""
        lifts = self.lifts if mass is None else [replace(lift, facts=mass(lift.facts)) for lift in self.lifts]
        return [
            item
            for lift in lifts
            for item in lift.trajectories(headline(self.settings, lift.facts["pivot"]))[0]
        ]

    def areas(self, method: str, convention: Convention) -> pd.DataFrame:
        """Rows of `boa` of one method and convention (its pivot is the study's own)."""
        boa = self.boa
        return boa[
            (boa["method"] == method)
            & (boa["sign"] == convention.sign)
            & (boa["time"] == convention.time)
            & (boa["mass"] == convention.mass)
        ]


def _body_mass(factor: float):
    """Return what changes the masses of a lift's facts as if everybody weighed `factor` times as much."""

    def changed(facts):
        masses = {
            com: {"without_box": factor * own["without_box"]}
            | {"with_box": own["with_box"] + (factor - 1) * own["without_box"]}
            for com, own in facts["mass_kg"].items()
        }
        return {**facts, "mass_kg": masses}

    return changed


def _box_share(facts):
    """Share the box the other way: whole to every centre of mass instead of in proportion, or the reverse."""
    box, own = (
        float(facts["box_mass_kg"]),
        {com: item["without_box"] for com, item in facts["mass_kg"].items()},
    )
    whole = facts["box"]["share"] == "by_mass"
    masses = {
        com: {"without_box": mass, "with_box": mass + (box if whole else box * mass / sum(own.values()))}
        for com, mass in own.items()
    }
    return {**facts, "mass_kg": masses}


OTHER_MASSES = {
    "lighter": _body_mass(1 - BODY_MASS_SHARE),
    "heavier": _body_mass(1 + BODY_MASS_SHARE),
    "box_share": _box_share,
}


def variants(study: Study) -> tuple[dict[str, pd.DataFrame], list[Failure]]:
    """Return average cross-sections under every change that the headline is examined with.

    Returns
    -------
    areas : dict of str to pandas.DataFrame
        By change: ``subject, experience, box_mass_kg, com, plane, mean_area``.
    failures : list of Failure
        Areas that could not be computed: they have no row.
    """
    trajectories, settings = study.trajectories(), study.settings
    # All changes of weights at once are fastest; only where one has no basin is each computed by itself.
    try:
        at_once = varied_areas(trajectories, settings) if trajectories else {}
    except NumericalError:
        at_once = {}
    areas, failures = {}, []
    for name in (*VARIANTS, *TAYLOR, *OTHER_MASSES):
        items = study.trajectories(OTHER_MASSES[name]) if name in OTHER_MASSES else trajectories
        if name in at_once:
            results = [(items, at_once[name])]
        else:
            results, failed = all_or_each(
                variant_areas, items, name, settings, basin=f"Table 4.1, {_CHANGES.get(name, 'exact')}"
            )
            failures += failed
        areas[name] = _areas_frame(results)
    return areas, failures


def variant_areas(trajectories: list[Trajectory], name: str, settings: StabilitySettings) -> np.ndarray:
    """Average cross-sections of some trajectories under one change."""
    if name in TAYLOR:
        return taylor_areas(trajectories, settings, TAYLOR[name])
    return varied_areas(trajectories, settings, ["base" if name in OTHER_MASSES else name]).popitem()[1]


def _areas_frame(results: list[tuple[list[Trajectory], np.ndarray]]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {name: getattr(item, name) for name in _KEYS} | {"mean_area": area}
        for items, areas in results
        for item, area in zip(items, areas, strict=True)
    ]
    return pd.DataFrame(rows, columns=[*_KEYS, "mean_area"])


def tables_4_1(
    study: Study, failures: pd.DataFrame | None = None
) -> tuple[Table, Table, pd.DataFrame, pd.DataFrame]:
    """Return Table 4.1, the table of its controls, the differences of its grid, and all basins that are missing.

    Parameters
    ----------
    study : Study
    failures : pandas.DataFrame, optional
        Basins of the lifts that could not be computed, columns `failures.COLUMNS`.

    Returns
    -------
    table, controls : Table
    grid : pandas.DataFrame
        Of `grid_differences`.
    failures : pandas.DataFrame
        Those given and those of the controls.
    """
    groups = study.settings.compare.groups
    varied, failed = variants(study)
    missing = joined([*([] if failures is None else [failures]), failures_frame(failed)])
    shown = headline(study.settings, THESIS.pivot)
    areas = {
        "": study.areas("exact", THESIS),
        "headline": study.areas("exact", shown),
        "thesis_method": study.areas("thesis", THESIS),
        **varied,
    }
    found = {
        name: percent_differences(frame, missing=study.people, groups=groups) for name, frame in areas.items()
    }
    for name in ("initial", "minimum"):
        found[name] = percent_differences(areas["headline"], f"{name}_area", study.people, groups)
    grid = grid_differences(study.grid, groups)
    table = _first_table(study, found, grid, missing)
    return table, _controls(study, found, areas["headline"], grid), grid, missing


def _first_table(study: Study, found: dict, grid: pd.DataFrame, missing: pd.DataFrame) -> Table:
    import pandas as pd

    settings = study.settings
    engine = "thesis_method" in settings.checks
    names = comparison_names(settings.compare.groups)
    printed = study.published.assign(comparison=study.published["comparison"].map(names))
    printed = printed.set_index(["comparison", "com"])
    rows = []
    for index, row in enumerate(found["headline"]):
        entry = {"comparison": row["comparison"], "com": row["com"]}
        entry |= {f"{plane}_percent": found[""][index][plane] for plane in PLANES}
        for plane in PLANES:
            here = (row["comparison"], row["com"])
            entry[f"{plane}_published_percent"] = printed[f"{plane}_percent"].get(here, np.nan)
            if engine:
                value = _number(found["thesis_method"][index][plane])
                entry[f"{plane}_thesis_method_percent"] = (
                    None if value is None else round(value, THESIS_DECIMALS)
                )
            entry[f"{plane}_headline_percent"] = row[plane]
        rows.append(entry | {"status": row["status"]})
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent")]
    frame = frame.astype(dict.fromkeys(numbers, float))
    headers = {"comparison": "Comparison", "com": "Centre of mass"}
    for plane, label in _LABELS.items():
        headers[f"{plane}_published_percent"] = f"{label}, published (%)"
        headers[f"{plane}_percent"] = f"{label}, thesis's wording (%)"
        headers[f"{plane}_headline_percent"] = f"{label}, {_shown_as(settings)} (%)"
    if (frame["status"] != "computed").any():
        headers["status"] = "Status"
    return Table(
        title="Table 4.1: percent difference in average cross-sectional area of the basin of attraction.",
        frame=frame,
        definitions=_definitions(settings),
        data=study.data,
        notes=(
            survival_sentence(grid),
            published_sentence(study.published),
            *_null_notes(grid, settings, [lift.facts["pivot"] for lift in study.lifts]),
            _regulator(settings),
            *_missing_notes(missing),
        ),
        decimals=dict.fromkeys(numbers, 2)
        | {f"{plane}_thesis_method_percent": THESIS_DECIMALS for plane in PLANES},
        may_be_empty=frozenset(numbers),
        headers=headers,
    )


def _shown_as(settings: StabilitySettings) -> str:
    pendulum = settings.pendulum
    sign = {"inverted": "as people stand", "hanging": "hanging"}[pendulum.sign]
    return ", ".join([sign, f"{pendulum.time} time", pendulum.mass.replace("_", " ")])


def published_sentence(published: pd.DataFrame) -> str:
    """Say how the two published columns agree with one another, computed from them."""
    lateral, forward = (published[f"{plane}_percent"].to_numpy(float) for plane in PLANES)
    opposite = int((lateral * forward < 0).sum())
    return (
        f"The published columns correlate {np.corrcoef(lateral, forward)[0, 1]:+.2f} with one another, and {opposite} of "
        f"{len(lateral)} rows have opposite signs in the two planes. Mass and duration are the same in both planes and the "
        "length nearly so: no effect of mass, length and duration alone makes such columns"
    )


def _null_notes(grid: pd.DataFrame, settings: StabilitySettings, pivots: list[str]) -> list[str]:
    """Say for both signs what the differences owe to the movement, in the headline's time and mass about its pivot."""
    cells, notes = compared(grid), []
    pendulum = settings.pendulum
    here = (cells["time"] == pendulum.time) & (cells["mass"] == pendulum.mass) & cells["pivot"].isin(pivots)
    for sign in ("inverted", "hanging"):
        rows = cells[here & (cells["sign"] == sign)]
        if len(rows) > 2 and np.ptp(rows["percent"]) > 0 and np.ptp(rows["null_percent"]) > 0:
            correlation = np.corrcoef(rows["percent"], rows["null_percent"])[0, 1]
            notes.append(
                f"{sign.capitalize()}, {pendulum.time} time, {pendulum.mass.replace('_', ' ')}: correlation with the null "
                f"control {correlation:.3f}, at most {rows['movement_points'].abs().max():.2f} percentage points come from "
                "the movement"
            )
    return notes


def _regulator(settings: StabilitySettings) -> str:
    regulator, pendulum = settings.regulator, settings.pendulum
    return (
        f"Regulator of all basins: Q = {plain(regulator.state_weight)}, R = {regulator.control_weight:g}, "
        f"Qf = {plain(regulator.terminal_weight)}; b = {pendulum.damping_N_m_s:g} N·m·s/rad; it is assumed, the same for all"
    )


def _controls(study: Study, found: dict, areas: pd.DataFrame, grid: pd.DataFrame) -> Table:
    """Return what stands behind the headline: a row per comparison, centre of mass and plane."""
    import pandas as pd

    settings = study.settings
    sides = list(comparisons(areas, study.people, settings.compare.groups))
    trajectories = study.trajectories()
    rows = []
    for plane in PLANES:
        exponents = compared_exponents(trajectories, plane, sides)
        for index, row in enumerate(found["headline"]):
            cells = compared(grid)
            cells = cells[
                (cells["comparison"] == row["comparison"])
                & (cells["com"] == row["com"])
                & (cells["plane"] == plane)
            ]
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
        notes=(_what_varies(settings), _regulator(settings)),
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
        return _number(found[name][index][plane])

    percent, null = of("headline"), of("null")
    spread = [of(name) for name in found if name in _CHANGES and name != "null"]
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
    percent = _number(row[plane])
    if row["status"].startswith("no basin") and percent is None:
        return row["status"]
    changed = {
        words: _number(found[name][index][plane])
        for name, words in _CHANGES.items()
        if name in found and name != "null"
    }
    if percent:
        turned = int((cells["percent"] * percent <= 0).sum())
        if turned:
            changed[f"{turned} of the grid's {len(cells)} conventions"] = -percent
    return verdict(percent, _number(found["null"][index][plane]), changed, interval)


def _number(value) -> float | None:
    return None if value is None or np.isnan(value) else float(value)


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


def _missing_notes(missing: pd.DataFrame) -> tuple[str, ...]:
    return tuple(
        f"Could not be computed and is left out: {row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}: "
        f"{row.basin}: {row.reason}"
        for row in missing.itertuples()
    )


def _comparison_definition(settings: StabilitySettings) -> str:
    first, second = settings.compare.groups
    return (
        f"{first}_vs_{second}: 100(A_{first} − A_{second})/A_{second} with the heaviest box of both; decrease_in_mass_…: "
        "100(A_light − A_heavy)/A_heavy with that lifter's heaviest and lightest box; A = (1/T)∫πρ/√det S dt in rad²/s"
    )


def _definitions(settings: StabilitySettings) -> dict[str, str]:
    texts = {
        "published_percent": "percent difference in {} as the thesis prints it",
        "percent": f"the same in {{}} from this study's lifts in the thesis's wording ({THESIS}), exact method",
        "thesis_method_percent": "as before in {} by the thesis's alternation (Eqs 4.5–4.7), which is no certificate; its "
        "areas, and so these percentages, have no more digits",
        "headline_percent": f"headline: the same in {{}}, {_shown_as(settings)}, about the study's pivot, exact method",
    }
    definitions = {
        "comparison": _comparison_definition(settings),
        "com": COLUMNS["com"],
        **{
            f"{plane}_{name}": text.format(plane.replace("_", " "))
            for plane in PLANES
            for name, text in texts.items()
        },
    }
    return definitions | {"status": "computed, or why the study cannot tell"}


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
        "comparison": _comparison_definition(settings),
        "com": COLUMNS["com"],
        "plane": COLUMNS["plane"],
        "percent": f"percent difference, headline ({_shown_as(settings)})",
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
