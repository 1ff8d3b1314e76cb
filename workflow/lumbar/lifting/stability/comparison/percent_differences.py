"""Percent differences of average cross-sections, as Table 4.1 compares them, and what they are compared with.

`varied_areas` are the same areas under the null control (every trajectory replaced by θ0 = 0, so that only
duration, mass and length are left) and with Q, R and b changed, `taylor_areas` those with the sine's polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.basins import close_loops, weights_of
from lumbar.lifting.stability.funnel.funnel import Funnels, exact_funnels, integrate_backward, regulate
from lumbar.lifting.stability.funnel.polynomials import circle_maximum, growth_polynomial
from lumbar.lifting.stability.model.pendulum_loop import gather
from lumbar.lifting.stability.model.riccati import Weights
from lumbar.lifting.stability.model.trajectory import COMS, PLANES, Trajectory
from lumbar.settings.stability import GROUPS

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

TAYLOR_DEGREES = (3, 5, 7)
VARIANTS = ("base", "null", *(f"{name}{change}" for name in ("Q", "R", "b") for change in ("/", "*")))
"""``base``, ``null``, and ``Q``, ``R``, ``b`` divided and multiplied by the factor of the configuration."""


def percent_differences(
    areas: pd.DataFrame,
    column: str = "mean_area",
    missing: pd.DataFrame | None = None,
    groups: tuple[str, str] = GROUPS,
) -> list[dict]:
    """Compare average cross-sections as Table 4.1 does.

    Parameters
    ----------
    areas : pandas.DataFrame
        Columns ``experience, box_mass_kg, com, plane`` and `column`, of one method and sign. Several people
        and trials of the same experience are averaged.
    column : str
        The areas compared.
    missing : pandas.DataFrame, optional
        Columns ``subject, experience, box_mass_kg, com, plane`` of the basins that could not be computed.
    groups : tuple of str
        Labels of the people compared, the first with the second.

    Returns
    -------
    list of dict
        ``comparison, com, status`` and, per plane, the percentage or NaN where the study cannot tell or a basin is
        missing; the status names it.
    """
    table = areas.groupby(["experience", "box_mass_kg", "com", "plane"])[column].mean().to_dict()
    rows = []
    for comparison, before, after, status in comparisons(areas, missing, groups):
        for com in COMS:
            row = {"comparison": comparison, "com": com, "status": status}
            gone = []
            for plane in PLANES:
                row[plane] = np.nan
                if status != "computed":
                    continue
                sides = [(*side, com, plane) for side in (before, after)]
                gone += [side for side in sides if side not in table]
                if all(side in table for side in sides):
                    base, other = (table[side] for side in sides)
                    row[plane] = float(100 * (other - base) / base)
            if gone:
                names = [f"{name} {mass:g} kg {com} {plane}" for name, mass, com, plane in gone]
                row["status"] = f"no basin: {', '.join(names)}"
            rows.append(row)
    return rows


def comparison_names(groups: tuple[str, str]) -> dict[str, str]:
    """Names of the comparisons of two groups by those that the thesis's Table 4.1 has them under.

    Examples
    --------
    >>> comparison_names(("trained", "untrained"))["expert_vs_novice"]
    'trained_vs_untrained'
    """
    between = {"_vs_".join(GROUPS): "_vs_".join(groups)}
    within = {
        f"decrease_in_mass_{thesis}": f"decrease_in_mass_{name}"
        for thesis, name in zip(GROUPS, groups, strict=True)
    }
    return between | within


def comparisons(areas: pd.DataFrame, missing: pd.DataFrame | None = None, groups: tuple[str, str] = GROUPS):
    """Yield name, (experience, mass) before and after, and whether the study can tell.

    Parameters
    ----------
    areas, missing : pandas.DataFrame
        Columns ``experience`` and ``box_mass_kg``: a lift counts also where all its basins are missing.
    groups : tuple of str
        Labels of the people compared, the first with the second.
    """
    lifts = {
        (str(name), float(mass))
        for frame in (areas, missing)
        if frame is not None
        for name, mass in zip(frame["experience"], frame["box_mass_kg"], strict=True)
    }
    masses = {name: sorted(mass for who, mass in lifts if who == name) for name, _ in lifts}
    others = sorted(set(masses) - set(groups))
    first, second = groups
    between = "_vs_".join(groups)
    shared = set(masses.get(first, [])) & set(masses.get(second, []))
    absent = [name for name in groups if name not in masses]
    if absent:
        yield between, None, None, f"not testable: no {' and no '.join(absent)}"
    elif not shared:
        yield between, None, None, "not testable: no box mass in common"
    else:
        yield between, (second, max(shared)), (first, max(shared)), "computed"
    for name in (*groups, *others):
        found = masses.get(name, [])
        comparison = f"decrease_in_mass_{name}"
        if len(found) > 1:
            yield comparison, (name, found[-1]), (name, found[0]), "computed"
        else:
            reason = f"one box mass ({found[0]:g} kg)" if found else f"no {name}"
            yield comparison, None, None, f"not testable: {reason}"


def varied_areas(cases: Mapping[str, list[Trajectory]], settings: StabilitySettings) -> dict[str, np.ndarray]:
    """Average cross-sections (exact method) under the null control and with Q, R and b changed, all at once.

    Parameters
    ----------
    cases : mapping of str to list of Trajectory
        Trajectories by change: where it is one of `VARIANTS`, under that, and as they are under any other name.

    Returns
    -------
    dict of str to numpy.ndarray, shape (trajectories,)
        By change.

    Raises
    ------
    NumericalError
        One of them has no basin.
    """
    counts = [len(own) for own in cases.values()]
    factors = {"/": 1 / settings.sensitivity_factor, "*": settings.sensitivity_factor}
    changes = [{name[0]: factors[name[1]]} if name[1:] in factors else {} for name in cases]
    items = [
        replace(item, angle=np.zeros_like(item.angle)) if name == "null" else item
        for name, own in cases.items()
        for item in own
    ]
    scale = {
        quantity: np.repeat([change.get(quantity, 1.0) for change in changes], counts)
        for quantity in ("Q", "R", "b")
    }
    pendulum, base = settings.pendulum, weights_of(settings)
    weights = Weights(base.state * scale["Q"][:, None], base.control * scale["R"], base.terminal)
    damping = pendulum.damping_N_m_s * scale["b"]
    signs = [pendulum.sign] * len(items)
    pendulums = gather(items, signs, list(damping), pendulum.gravity_m_s2, settings.limits.knots)
    areas = exact_funnels(regulate(pendulums, weights), settings.goal_level).mean_area
    return dict(zip(cases, np.split(areas, np.cumsum(counts)[:-1]), strict=True))


def taylor_areas(trajectories: list[Trajectory], settings: StabilitySettings, degree: int) -> np.ndarray:
    """Average cross-sections (exact method) with the sine replaced by its Taylor polynomial of a degree.

    Raises
    ------
    NumericalError
        The polynomial has no basin that is finite.
    """
    fewer = replace(settings, knots=settings.limits.knots)
    loops = close_loops(trajectories, settings.pendulum.sign, fewer)
    goal = np.full(len(trajectories), np.log(settings.goal_level))

    def slope(point, log_level):
        polynomial = growth_polynomial(loops.form(point), np.exp(log_level), degree)
        return circle_maximum(polynomial, degree + 1)

    with np.errstate(over="ignore", invalid="ignore"):
        level = np.exp(integrate_backward(loops, goal, slope))
        areas = Funnels(f"Taylor {degree}", loops.pendulums.duration, loops.cost[::2], level).mean_area
    if not np.isfinite(areas).all():
        index = int(np.argmin(np.isfinite(areas)))
        raise NumericalError(f"{loops.pendulums.labels[index]}: no finite basin with Taylor degree {degree}")
    return areas
