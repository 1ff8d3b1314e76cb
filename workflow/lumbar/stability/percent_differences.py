"""Table 4.1: percent differences of average cross-sections, with what they rest on.

Beside each percentage stand the same number from the thesis's own engine, of the sections at t = 0 and of the
smallest ones, with the other sign of gravity and the other convention for the box's mass, the null control (every
trajectory replaced by θ0 = 0, so that only duration, mass and length are left), its range when Q, R and b are
halved and doubled and with the sine's Taylor polynomials, and a sentence that says whether it survives all this.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.stability.basins import COLUMNS, close_loops, weights_of
from lumbar.stability.funnel import Funnels, exact_funnels, integrate_backward, regulate
from lumbar.stability.pendulum import gather
from lumbar.stability.polynomials import circle_maximum, growth_polynomial
from lumbar.stability.riccati import Weights
from lumbar.stability.trajectory import COMS, PLANES, Trajectory
from lumbar.stability.verdicts import bootstrap_percent, verdict
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd

EXPERIENCES = ("expert", "novice")


def percent_differences(areas: pd.DataFrame, column: str = "mean_area") -> list[dict]:
    """Compare average cross-sections as Table 4.1 does.

    Parameters
    ----------
    areas : pandas.DataFrame
        Columns ``experience, box_mass_kg, com, plane`` and `column`, of one method and sign. Several people
        and trials of the same experience are averaged.
    column : str
        The areas compared.

    Returns
    -------
    list of dict
        ``comparison, com, status`` and, per plane, the percentage or None where the study cannot tell.
    """
    import pandas as pd

    table = areas.groupby(["experience", "box_mass_kg", "com", "plane"])[column].mean()
    masses = {name: sorted(group["box_mass_kg"].unique()) for name, group in areas.groupby("experience")}
    others = sorted(set(masses) - set(EXPERIENCES))
    rows = []
    for comparison, before, after, status in _comparisons(masses, others):
        for com in COMS:
            row = {"comparison": comparison, "com": com, "status": status}
            for plane in PLANES:
                row[plane] = None
                if status == "computed":
                    base, other = table[(*before, com, plane)], table[(*after, com, plane)]
                    row[plane] = float(100 * (other - base) / base)
            rows.append(row)
    return pd.DataFrame(rows).astype(dict.fromkeys(PLANES, float)).to_dict("records")


def _comparisons(masses: dict[str, list[float]], others: list[str]):
    """Yield name, (experience, mass) before and after, and whether the study can tell."""
    shared = set(masses.get("expert", [])) & set(masses.get("novice", []))
    missing = [name for name in EXPERIENCES if name not in masses]
    if missing:
        yield "expert_vs_novice", None, None, f"not testable: no {' and no '.join(missing)}"
    elif not shared:
        yield "expert_vs_novice", None, None, "not testable: no box mass in common"
    else:
        yield "expert_vs_novice", ("novice", max(shared)), ("expert", max(shared)), "computed"
    for name in (*EXPERIENCES, *others):
        found = masses.get(name, [])
        comparison = f"decrease_in_mass_{name}"
        if len(found) > 1:
            yield comparison, (name, found[-1]), (name, found[0]), "computed"
        else:
            reason = f"one box mass ({found[0]:g} kg)" if found else f"no {name}"
            yield comparison, None, None, f"not testable: {reason}"


def varied_areas(trajectories: list[Trajectory], settings: dict) -> dict[str, np.ndarray]:
    """Average cross-sections (exact engine) under the null control and with Q, R and b changed.

    Parameters
    ----------
    trajectories : list of Trajectory
        All of the study.
    settings : dict
        Section ``stability`` of the configuration.

    Returns
    -------
    dict of str to numpy.ndarray, shape (trajectories,)
        By variant: ``base``, ``null``, and ``Q``, ``R``, ``b`` ``/`` and ``*`` the factor.
    """
    factor, pendulum = settings["sensitivity_factor"], settings["pendulum"]
    variants = {"base": {}, "null": {}}
    for name in ("Q", "R", "b"):
        variants[f"{name}/"] = {name: 1 / factor}
        variants[f"{name}*"] = {name: factor}
    still = [replace(item, angle=np.zeros_like(item.angle)) for item in trajectories]
    items, scale = [], {name: [] for name in ("Q", "R", "b")}
    for variant, changed in variants.items():
        items += still if variant == "null" else trajectories
        for name, values in scale.items():
            values += [changed.get(name, 1.0)] * len(trajectories)
    base = weights_of(settings)
    weights = Weights(
        state=base.state * np.array(scale["Q"])[:, None],
        control=base.control * np.array(scale["R"]),
        terminal=base.terminal,
    )
    damping = [pendulum["damping_N_m_s"] * value for value in scale["b"]]
    signs = [pendulum["sign"]] * len(items)
    pendulums = gather(items, signs, damping, pendulum["gravity_m_s2"], settings["knots"])
    areas = exact_funnels(regulate(pendulums, weights), settings["goal_level"]).mean_area
    return dict(zip(variants, areas.reshape(len(variants), len(trajectories)), strict=True))


def taylor_areas(trajectories: list[Trajectory], settings: dict) -> dict[str, np.ndarray]:
    """Average cross-sections (exact engine) with the sine replaced by its Taylor polynomials, by their name."""
    # Percentages need no more knots than the other variants.
    fewer = {**settings, "knots": settings["limits"]["knots"]}
    loops = close_loops(trajectories, settings["pendulum"]["sign"], fewer)
    goal = np.full(len(trajectories), np.log(settings["goal_level"]))
    areas = {}
    for degree in TAYLOR_DEGREES:

        def slope(point, log_level, degree=degree):
            polynomial = growth_polynomial(loops.form(point), np.exp(log_level), degree)
            return circle_maximum(polynomial, degree + 1)

        level = np.exp(integrate_backward(loops, goal, slope))
        funnels = Funnels(f"Taylor {degree}", loops.pendulums.duration, loops.cost[::2], level)
        areas[f"Taylor degree {degree}"] = funnels.mean_area
    return areas


def table_4_1(
    boa: pd.DataFrame,
    trajectories: list[Trajectory],
    settings: dict,
    data: str,
    other_mass: list[Trajectory],
    seed: int,
) -> Table:
    """Return Table 4.1 with its controls.

    Parameters
    ----------
    boa : pandas.DataFrame
        Summaries of all lifts, columns `lumbar.stability.basins.COLUMNS`.
    trajectories : list of Trajectory
        Those the summaries were computed from.
    settings : dict
        Section ``stability`` of the configuration.
    data : str
        Where the data come from.
    other_mass : list of Trajectory
        The same with the other convention for the box's mass.
    seed : int
        Of the bootstrap.
    """
    import pandas as pd

    sign = settings["pendulum"]["sign"]
    exact, published = boa["method"] == "exact", boa["sign"] == sign
    columns = {"percent": boa[exact & published], "other_sign": boa[exact & ~published]}
    if settings["thesis_method"]:
        columns["thesis_method"] = boa[(boa["method"] == "thesis") & published]
    keys = pd.DataFrame([{name: getattr(item, name) for name in _KEYS} for item in trajectories])
    changed = varied_areas(trajectories, settings) | taylor_areas(trajectories, settings)
    loops = close_loops(other_mass, sign, settings)
    changed["other_mass"] = exact_funnels(loops, settings["goal_level"]).mean_area
    varied = {name: keys.assign(mean_area=area) for name, area in changed.items()}
    compared = {name: percent_differences(areas) for name, areas in {**columns, **varied}.items()}
    for name in ("initial", "minimum"):
        compared[name] = percent_differences(columns["percent"], f"{name}_area")

    rows = []
    for index, row in enumerate(compared["percent"]):
        entry = {"comparison": row["comparison"], "com": row["com"]}
        entry |= {f"{plane}_percent": row[plane] for plane in PLANES} | {"status": row["status"]}
        for plane in PLANES:
            spread = [compared[name][index][plane] for name in varied if name not in ("null", "other_mass")]
            for name in ("initial", "minimum", "thesis_method", "other_sign", "other_mass", "null"):
                if name in compared:
                    entry[f"{plane}_{name}_percent"] = compared[name][index][plane]
            entry[f"{plane}_lowest_percent"], entry[f"{plane}_highest_percent"] = min(spread), max(spread)
        for plane in PLANES:
            others = {
                _CHANGES.get(name, name): compared[name][index][plane] for name in (*varied, "other_sign")
            }
            null = others.pop(_CHANGES["null"])
            interval = _interval(columns["percent"], row["comparison"], row["com"], plane, seed)
            entry[f"{plane}_verdict"] = verdict(
                _number(row[plane]), _number(null), _numbers(others), interval
            )
        rows.append(entry)
    frame = pd.DataFrame(rows)
    numbers = frozenset(name for name in frame.columns if name.endswith("percent"))
    return Table(
        title="Table 4.1: percent difference in average cross-sectional area of the basin of attraction.",
        frame=frame,
        definitions=_definitions(settings),
        data=data,
        notes=_notes(frame, settings),
        decimals=dict.fromkeys(numbers, 2),
        may_be_empty=numbers,
    )


def _number(value) -> float | None:
    return None if value is None or np.isnan(value) else float(value)


def _numbers(values: dict) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}


def _interval(areas: pd.DataFrame, comparison: str, com: str, plane: str, seed: int):
    """Bootstrap interval over trials of one percentage, or None where the trials are too few."""
    masses = {name: sorted(group["box_mass_kg"].unique()) for name, group in areas.groupby("experience")}
    others = sorted(set(masses) - set(EXPERIENCES))
    found = {name: (before, after) for name, before, after, _ in _comparisons(masses, others)}
    before, after = found[comparison]
    if before is None:
        return None
    here = areas[(areas["com"] == com) & (areas["plane"] == plane)]
    sides = [
        here[(here["experience"] == experience) & (here["box_mass_kg"] == mass)]["mean_area"].to_numpy()
        for experience, mass in (before, after)
    ]
    return bootstrap_percent(*sides, seed)


TAYLOR_DEGREES = (3, 5, 7)
_CHANGES = {
    "null": "null control",
    "other_sign": "the other sign of gravity",
    "other_mass": "the box's mass counted the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
}
_KEYS = ("experience", "box_mass_kg", "com", "plane")


def _definitions(settings: dict) -> dict[str, str]:
    factor = settings["sensitivity_factor"]
    definitions = {
        "comparison": "expert_vs_novice: 100(A_expert − A_novice)/A_novice with the heaviest box of both; "
        "decrease_in_mass_…: 100(A_light − A_heavy)/A_heavy with that lifter's heaviest and lightest box; "
        "A = (1/T)∫πρ/√det S dt in rad²/s",
        "com": COLUMNS["com"],
        "status": "computed, or why the study cannot tell",
    }
    texts = {
        "percent": f"percent difference in {{}}, exact engine, {settings['pendulum']['sign']} pendulum",
        "thesis_method_percent": "the same in {} by the thesis's alternation (equations 4.5 to 4.7), "
        "which is no certificate",
        "other_sign_percent": "the same in {} with the other sign of gravity in equation 4.1",
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
        "verdict": "whether the difference in {} survives: same sign under every change listed, and at least half of "
        "it not in the null control",
    }
    for plane in PLANES:
        for name, text in texts.items():
            definitions[f"{plane}_{name}"] = text.format(plane.replace("_", " "))
    return definitions


def _notes(frame: pd.DataFrame, settings: dict) -> tuple[str, ...]:
    regulator, pendulum = settings["regulator"], settings["pendulum"]
    notes = [
        f"Regulator of all basins: Q = {regulator['state_weight']}, R = {regulator['control_weight']:g}, "
        f"Qf = {regulator['terminal_weight']}; b = {pendulum['damping_N_m_s']:g} N·m·s/rad; pendulum's mass "
        f"{pendulum['mass'].replace('_', ' ')}"
    ]
    values, null = (
        np.concatenate([frame[f"{plane}_{name}"].dropna() for plane in PLANES])
        for name in ("percent", "null_percent")
    )
    if len(values) > 2 and np.ptp(values) > 0 and np.ptp(null) > 0:
        correlation = np.corrcoef(values, null)[0, 1]
        notes.append(
            f"Correlation of the percentages with the null control: {correlation:.3f}; near 1 they tell "
            "of durations, masses and lengths and not of the movement"
        )
    return tuple(notes)


def areas_table(boa: pd.DataFrame, data: str) -> Table:
    """Return the areas of all basins and their checks as a published table."""
    import pandas as pd

    # Counts with empty cells: as objects they print as whole numbers.
    counts = pd.Series([None if pd.isna(item) else int(item) for item in boa["control_exits"]], dtype=object)
    frame = boa[list(COLUMNS)].assign(control_exits=counts.to_numpy())
    optional = {"control_exits", "proved_share", "proved_area_ratio"}
    optional |= {name for name in COLUMNS if name.startswith("sos_")}
    optional |= {"violation_share", "unsolved_share", "euler_error"}
    return Table(
        title="Areas of all basins of attraction, and what was checked of each.",
        frame=frame,
        definitions=COLUMNS,
        data=data,
        may_be_empty=frozenset(optional),
    )
