"""Table 4.1: percent differences of average cross-sections, with what they rest on.

Beside each percentage stand the same number from the thesis's own method, of the sections at t = 0 and of the
smallest ones, with the other sign of gravity and the other convention for the box's mass, the null control, its
range when Q, R and b are halved and doubled and with the sine's Taylor polynomials, the maximum Lyapunov exponents
of the movements compared, and a sentence that says whether it survives all this. A basin that could not be computed
is named in place of its number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import NumericalError
from lumbar.population.contrast import Interval
from lumbar.population.percent_interval import percent_interval
from lumbar.settings.plain import plain
from lumbar.stability.basins import COLUMNS
from lumbar.stability.comparison.lyapunov_exponent import compared_exponents
from lumbar.stability.comparison.percent_differences import (
    TAYLOR_DEGREES,
    VARIANTS,
    comparisons,
    percent_differences,
    taylor_areas,
    varied_areas,
)
from lumbar.stability.comparison.verdicts import verdict
from lumbar.stability.model.failures import Failure, all_or_each, failures_frame, joined
from lumbar.stability.model.trajectory import PLANES, Trajectory
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

THESIS_DECIMALS = 1
"""Digits after the point that the thesis's engine has in a percentage: with areas of the digits they have
(`bilinear_alternation.RESOLUTION`) it may be off by some tenths."""

_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")
TAYLOR = {f"taylor_{degree}": degree for degree in TAYLOR_DEGREES}
"""Degree of the sine's polynomial by change."""
_CHANGES = {
    "null": "null control",
    "other_sign": "the other sign of gravity",
    "other_mass": "the box's mass counted the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
    **{name: f"Taylor degree {degree}" for name, degree in TAYLOR.items()},
}


def variants(
    trajectories: list[Trajectory], other_mass: list[Trajectory], settings: StabilitySettings
) -> tuple[dict[str, pd.DataFrame], list[Failure]]:
    """Return average cross-sections under every change that Table 4.1 is examined with.

    Parameters
    ----------
    trajectories : list of Trajectory
    other_mass : list of Trajectory
        The same with the other convention for the box's mass.
    settings : StabilitySettings

    Returns
    -------
    areas : dict of str to pandas.DataFrame
        By change: ``subject, experience, box_mass_kg, com, plane, mean_area``.
    failures : list of Failure
        Areas that could not be computed: they have no row.
    """
    # All changes of weights at once are fastest; only where one has no basin is each computed by itself.
    try:
        at_once = varied_areas(trajectories, settings) if trajectories else {}
    except NumericalError:
        at_once = {}
    areas, failures = {}, []
    for name in (*VARIANTS, *TAYLOR, "other_mass"):
        items = other_mass if name == "other_mass" else trajectories
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
    return varied_areas(trajectories, settings, ["base" if name == "other_mass" else name]).popitem()[1]


def _areas_frame(results: list[tuple[list[Trajectory], np.ndarray]]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {name: getattr(item, name) for name in _KEYS} | {"mean_area": area}
        for items, areas in results
        for item, area in zip(items, areas, strict=True)
    ]
    return pd.DataFrame(rows, columns=[*_KEYS, "mean_area"])


def table_4_1(
    boa: pd.DataFrame,
    trajectories: list[Trajectory],
    settings: StabilitySettings,
    data: str,
    other_mass: list[Trajectory],
    seed: int,
    failures: pd.DataFrame | None = None,
) -> tuple[Table, pd.DataFrame]:
    """Return Table 4.1 with its controls, and all basins that could not be computed.

    Parameters
    ----------
    boa : pandas.DataFrame
        Summaries of all lifts, columns `lumbar.stability.basins.COLUMNS`.
    trajectories : list of Trajectory
        The sound ones of all lifts.
    settings : StabilitySettings
    data : str
        Where the data come from.
    other_mass : list of Trajectory
        The same with the other convention for the box's mass.
    seed : int
        Of nothing any more: intervals over persons are not drawn.
    failures : pandas.DataFrame, optional
        Basins of the lifts that could not be computed, columns `failures.COLUMNS`.

    Returns
    -------
    table : Table
    failures : pandas.DataFrame
        Those given and those of the controls.
    """
    import pandas as pd

    sign, groups = settings.pendulum.sign, settings.compare.groups
    exact, published = boa["method"] == "exact", boa["sign"] == sign
    columns = {"percent": boa[exact & published], "other_sign": boa[exact & ~published]}
    if settings.thesis_method:
        columns["thesis_method"] = boa[(boa["method"] == "thesis") & published]
    varied, failed = variants(trajectories, other_mass, settings)
    missing = joined([*([] if failures is None else [failures]), failures_frame(failed)])
    compared = {
        name: percent_differences(areas, missing=missing, groups=groups)
        for name, areas in {**columns, **varied}.items()
    }
    for row in compared.get("thesis_method", ()):
        row |= {plane: None if row[plane] is None else round(row[plane], THESIS_DECIMALS) for plane in PLANES}
    for name in ("initial", "minimum"):
        compared[name] = percent_differences(columns["percent"], f"{name}_area", missing, groups)
    sides = list(comparisons(columns["percent"], missing, groups))
    exponents = {plane: compared_exponents(trajectories, plane, sides) for plane in PLANES}
    rows = [
        _row(index, compared, varied, columns["percent"], sides, exponents)
        for index in range(len(compared["percent"]))
    ]
    frame = pd.DataFrame(rows)
    numbers = frozenset(name for name in frame.columns if name.endswith("percent"))
    table = Table(
        title="Table 4.1: percent difference in average cross-sectional area of the basin of attraction.",
        frame=frame,
        definitions=_definitions(settings),
        data=data,
        notes=(*_notes(frame, settings), *_missing_notes(missing)),
        decimals=dict.fromkeys(numbers, 2)
        | {f"{plane}_thesis_method_percent": THESIS_DECIMALS for plane in PLANES},
        may_be_empty=numbers,
    )
    return table, missing


def _row(
    index: int,
    compared: dict[str, list[dict]],
    varied: dict,
    areas: pd.DataFrame,
    sides: list[tuple],
    exponents: dict[str, dict],
) -> dict:
    """Return one row of the table: a comparison for one COM, both planes."""
    row = compared["percent"][index]
    entry = {"comparison": row["comparison"], "com": row["com"]}
    entry |= {f"{plane}_percent": row[plane] for plane in PLANES} | {"status": row["status"]}
    ranged = [name for name in varied if name not in ("null", "other_mass")]
    for plane in PLANES:
        for name in ("initial", "minimum", "thesis_method", "other_sign", "other_mass", "null"):
            if name in compared:
                entry[f"{plane}_{name}_percent"] = compared[name][index][plane]
        spread = [_number(compared[name][index][plane]) for name in ranged]
        spread = [value for value in spread if value is not None]
        entry[f"{plane}_lowest_percent"] = min(spread, default=None)
        entry[f"{plane}_highest_percent"] = max(spread, default=None)
    for plane in PLANES:
        entry[f"{plane}_exponents"] = exponents[plane][row["comparison"], row["com"]]
    for plane in PLANES:
        others = {
            _CHANGES.get(name, name): _number(compared[name][index][plane])
            for name in (*varied, "other_sign")
        }
        null = others.pop(_CHANGES["null"])
        del others["base"]
        if row["status"].startswith("no basin") and _number(row[plane]) is None:
            entry[f"{plane}_verdict"] = row["status"]
            continue
        interval = _interval(areas, sides, row["comparison"], row["com"], plane)
        entry[f"{plane}_verdict"] = verdict(_number(row[plane]), null, others, interval)
    return entry


def _number(value) -> float | None:
    return None if value is None or np.isnan(value) else float(value)


def _interval(areas: pd.DataFrame, compared: list[tuple], comparison: str, com: str, plane: str) -> Interval:
    """Interval over persons of one percentage, or why there is none."""
    found = {name: (before, after) for name, before, after, _ in compared}
    before, after = found[comparison]
    if before is None:
        return Interval(remark="nothing to compare")
    here = areas[(areas["com"] == com) & (areas["plane"] == plane)]
    sides = [
        here[(here["experience"] == experience) & (here["box_mass_kg"] == mass)].groupby("subject")[
            "mean_area"
        ]
        for experience, mass in (after, before)
    ]
    same_people = before[0] == after[0]
    return percent_interval(
        *({person: values.to_numpy() for person, values in side} for side in sides),
        paired=same_people,
        names=(after[0], before[0]),
    )


def _missing_notes(missing: pd.DataFrame) -> tuple[str, ...]:
    return tuple(
        f"Could not be computed and is left out: {row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}: "
        f"{row.basin}: {row.reason}"
        for row in missing.itertuples()
    )


def _definitions(settings: StabilitySettings) -> dict[str, str]:
    factor, (first, second) = settings.sensitivity_factor, settings.compare.groups
    definitions = {
        "comparison": f"{first}_vs_{second}: 100(A_{first} − A_{second})/A_{second} with the heaviest box of both; "
        "decrease_in_mass_…: 100(A_light − A_heavy)/A_heavy with that lifter's heaviest and lightest box; "
        "A = (1/T)∫πρ/√det S dt in rad²/s",
        "com": COLUMNS["com"],
        "status": "computed, or why the study cannot tell",
    }
    texts = {
        "percent": f"percent difference in {{}}, exact method, {settings.pendulum.sign} pendulum",
        "thesis_method_percent": "the same in {} by the thesis's alternation (Eqs 4.5–4.7), "
        "which is no certificate; its areas, and so these percentages, have no more digits",
        "other_sign_percent": "the same in {} with the other sign of gravity in Eq. 4.1",
        "null_percent": "null control: the same in {} with every trajectory replaced by θ0 = 0, so that only "
        "duration, mass and length are left",
        "initial_percent": "the same in {} of the cross-sections at t = 0",
        "minimum_percent": "the same in {} of the smallest cross-sections (the goal set's, equal for all, unless "
        "the basin narrows before the end)",
        "other_mass_percent": "the same in {} with the box's mass counted the other way (without instead of with, or "
        "the reverse)",
        "lowest_percent": f"smallest percentage in {{}} with Q, R or b divided or multiplied by {factor:g} and with "
        "the sine's Taylor polynomials of degree 3, 5 and 7",
        "highest_percent": f"largest percentage in {{}} with Q, R or b divided or multiplied by {factor:g} and with "
        "the sine's Taylor polynomials of degree 3, 5 and 7",
        "exponents": "maximum Lyapunov exponents of the movements compared in {} in 1/s, before and after, where trials "
        "repeat often enough; otherwise how many there are",
        "verdict": "whether the difference in {} survives: same sign under every change listed, and at least half of "
        "it not in the null control",
    }
    for plane in PLANES:
        for name, text in texts.items():
            definitions[f"{plane}_{name}"] = text.format(plane.replace("_", " "))
    return definitions


def _notes(frame: pd.DataFrame, settings: StabilitySettings) -> tuple[str, ...]:
    regulator, pendulum = settings.regulator, settings.pendulum
    notes = [
        f"Regulator of all basins: Q = {plain(regulator.state_weight)}, R = {regulator.control_weight:g}, "
        f"Qf = {plain(regulator.terminal_weight)}; b = {pendulum.damping_N_m_s:g} N·m·s/rad; pendulum's mass "
        f"{pendulum.mass.replace('_', ' ')}"
    ]
    values, null = (
        np.concatenate([frame[f"{plane}_{name}"].to_numpy(float) for plane in PLANES])
        for name in ("percent", "null_percent")
    )
    # A basin may be missing and its null control be there.
    known = np.isfinite(values) & np.isfinite(null)
    values, null = values[known], null[known]
    if len(values) > 2 and np.ptp(values) > 0 and np.ptp(null) > 0:
        correlation = np.corrcoef(values, null)[0, 1]
        notes.append(
            f"Correlation of the percentages with the null control: {correlation:.3f}; near 1 they tell "
            "of durations, masses and lengths and not of the movement"
        )
    return tuple(notes)
