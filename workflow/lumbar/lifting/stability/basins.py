"""All basins of one lift by each method, with checks: for the headline's pendulums and for the pendulums of the thesis's wording.

Methods: `exact` is the largest funnel of the given V, with the true sine (`exact_funnel`), proved between its knots with a small
margin (`interval_proof`); `thesis` is Eqs 4.5–4.7 exactly as published, with ρ̇ frozen, and certifies nothing
(`eqs_4_5_to_4_7_alternation`). Both read the same keys of the section ``stability``, accept the same loops (either sign of
gravity, any Q, R, Qf, b, mass), and raise `NumericalError` with subject, COM and plane if there is no result.
"""

import math
import zlib
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.movement.pendulum_states import CHOICES
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_alternation import (
    EVIDENCE,
    RESOLUTION,
    alternate,
)
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, funnel_variants, reachable_area
from lumbar.lifting.stability.funnel.interval_proof import proved_share
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    ClosedLoops,
    close_loops,
    feedforward_torque,
)
from lumbar.lifting.stability.model.pendulum_trajectories import THESIS, Failure, Trajectory, compute_together
from lumbar.settings.lifting import StabilitySettings
from lumbar.settings.section import Section
from lumbar.tables.table import Table, columns_of, table_from_schema


@dataclass(frozen=True)
class MethodResult:
    """Basins of several pendulums by one method."""

    funnels: Funnels
    checks: dict[str, np.ndarray] = field(default_factory=dict)
    """Results of checks, shape (pendulums,), by column of ``boa.csv``."""
    control: Funnels | None = None
    """Intentionally too large funnels, for the negative control of the Monte Carlo check."""
    resolution: dict[str, float] = field(default_factory=dict)
    """Relative uncertainty of areas by column; areas without an entry are accurate to all digits."""


def exact(loops: ClosedLoops, settings: StabilitySettings) -> MethodResult:
    """Compute the largest funnels, and prove the funnels with a margin between the knots.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    settings : StabilitySettings
        Settings of the study.
    """
    simulated, proved = "simulation" in settings.checks, "proof" in settings.checks
    overstated = settings.attack.control_overstated if simulated else 0.0
    margin = settings.proof.margin_1_s if proved else 0.0
    variants, checks = funnel_variants(loops, settings.goal_level, margin, overstated), {}
    if proved:
        checks["proved_share"] = proved_share(loops, variants.with_margin)
        checks["proved_area_ratio"] = variants.with_margin.mean_area / variants.exact.mean_area
    return MethodResult(variants.exact, checks, variants.negative_control if simulated else None)


def thesis(loops: ClosedLoops, settings: StabilitySettings) -> MethodResult:
    """Compute basins by the thesis's procedure, with checks of their areas.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    settings : StabilitySettings
        Settings of the study.
    """
    result = alternate(loops, **vars(settings.thesis_method))
    areas = {f"mean_area_after_{number}": result.after[number - 1].mean_area for number in EVIDENCE}
    checks = {name: getattr(result, name) for name in ("violation_share", "unsolved_share", "euler_error")}
    checks |= {"jumped_knots": (result.jumps != 1).sum(axis=0), "largest_jump": result.jumps.max(axis=0)}
    checks |= dict(zip(("first_jump", "last_jump"), result.jump_range, strict=True)) | areas
    resolution = RESOLUTION | dict.fromkeys(areas, RESOLUTION["mean_area"])
    return MethodResult(result.funnels, checks, resolution=resolution)


METHODS: dict[str, Callable[..., MethodResult]] = {"exact": exact, "thesis": thesis}
"""Methods by the name in the column ``method``."""


def thesis_methods(settings: StabilitySettings) -> list[str]:
    """Return the methods for the pendulums of the thesis's wording under a configuration; ``exact`` is always among them.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    """
    return ["exact", *(["thesis"] if "thesis_method" in settings.checks else [])]


CHECK_COLUMNS = {
    "simulation": ("simulated_starts", "exits", "exits_high", "control_exits"),
    "thesis_method": (
        *("violation_share", "unsolved_share", "jumped_knots", "largest_jump", "first_jump", "last_jump"),
        *("mean_area_after_1", "mean_area_after_4", "euler_error"),
    ),
    "cvxpy": ("sos_cvxpy_difference",),
    "proof": ("proved_share", "proved_area_ratio"),
}
"""Columns of ``boa.csv`` by check of ``stability.checks``."""

FUNNEL_COLUMNS = (
    *("wording", "method", "com", "plane", "time_s", "rho"),
    *("s11", "s12", "s22", "theta0_rad", "thetadot0_rad_s", "u0_N_m", "area_rad2_s"),
)
"""Columns of ``funnel.csv``; ``wording`` is ``study`` for the headline's pendulums, ``thesis`` for pendulums by `THESIS`."""

RANGES, REACHES = ("angle_range_rad", "velocity_range_rad_s"), ("angle_reach_rad", "velocity_reach_rad_s")
"""Columns of a movement's range, and of a basin's largest distance from the movement; angle, then velocity."""
DTYPES = dict.fromkeys(("simulated_starts", "exits", "control_exits", "jumped_knots"), "Int64")
"""Types that pandas does not infer from a ``boa.csv``: counts with empty cells."""


@dataclass(frozen=True)
class LiftBasins:
    """Basins of one lift."""

    summary: pd.DataFrame
    """Rows of ``boa.csv``, one per COM, plane, method and convention."""
    funnels: pd.DataFrame
    """Rows of ``funnel.csv``, one per funnel and knot; columns `FUNNEL_COLUMNS`."""
    failures: list[Failure]
    """Basins that could not be computed; they have no rows in the other tables."""


def basins_of_lift(
    trajectories: list[Trajectory],
    settings: StabilitySettings,
    seed: int,
    as_in_thesis: Sequence[Trajectory] = (),
) -> LiftBasins:
    """Compute and check every basin of one lift.

    Parameters
    ----------
    trajectories : list of Trajectory
        Trajectories of one subject and box, in the headline's convention.
    settings : StabilitySettings
        Settings of the study.
    seed : int
        Seed of the simulated starts.
    as_in_thesis : sequence of Trajectory, default ()
        Trajectories in the convention `THESIS`, computed exactly and, with the check ``thesis_method``, by that method too.
    """
    sign, methods = settings.pendulum.sign, thesis_methods(settings)
    # Pendulums that are the thesis's own are computed exactly a single time.
    pairs = zip(trajectories, as_in_thesis, strict=False)
    if len(trajectories) == len(as_in_thesis) and sign == THESIS.sign:
        methods = methods[1:] if all(_identity(one) == _identity(other) for one, other in pairs) else methods
    plans = [("study", "exact", sign, trajectories)]
    plans += [("thesis", method, THESIS.sign, list(as_in_thesis)) for method in methods]
    result = _compute(plans, settings, seed)
    if result.failures and (remedy := _find_remedy(plans, result.failures, settings, seed)):
        failures = [replace(item, reason=f"{item.reason}; {remedy}") for item in result.failures]
        return replace(result, failures=failures)
    return result


Plan = tuple[str, str, str, list[Trajectory]]
"""Wording, method, sign of gravity, and the trajectories to compute."""


def _compute(plans: Sequence[Plan], settings: StabilitySettings, seed: int) -> LiftBasins:
    rows: list[dict] = []
    frames: list[pd.DataFrame] = []
    failures: list[Failure] = []
    for wording, method, gravity, items in plans:
        compute = partial(_rows_and_funnels, wording, method, gravity, settings, seed)
        for _, (new_rows, funnels) in compute_together(compute, items, f"{method}, {gravity}", failures):
            rows += new_rows
            frames.append(funnels)
    summary = pd.DataFrame(rows, columns=boa_columns()).astype(DTYPES)
    empty = pd.DataFrame(columns=list(FUNNEL_COLUMNS))
    return LiftBasins(summary, pd.concat(frames, ignore_index=True) if frames else empty, failures)


def _find_remedy(
    plans: Sequence[Plan], failures: Sequence[Failure], settings: StabilitySettings, seed: int
) -> str:
    """Return the first change of one key with which all basins are computed, or an empty text."""
    lost = {(item.com, item.plane, item.basin) for item in failures}
    lost_plans = [
        (*plan, [item for item in items if (item.com, item.plane, f"{plan[1]}, {plan[2]}") in lost])
        for *plan, items in plans
    ]
    # A proof or more simulated starts cannot fail.
    checks = tuple(check for check in settings.checks if check != "proof")
    attack = settings.attack.model_copy(update={"starts": 2})
    quick = settings.model_copy(update={"checks": checks, "attack": attack})
    for key, factors in _REMEDIES.items():
        path = key.split(".")[1:]
        now = reduce(getattr, path, quick)
        values = [type(now)(float(f"{now * factor:.2g}")) for factor in factors]
        trials = [_replace_key(quick, path, value) for value in values]
        first = bisect_left(trials, True, key=lambda trial: _is_computed(lost_plans, trial, seed))
        if first < len(values) and _is_computed(plans, trials[first], seed):
            return f"{key} is now {now:g}: all are computed with {values[first]:g}"
    return ""


def _replace_key(section: Section, path: Sequence[str], value: float) -> Any:
    """Return settings with another value of one key."""
    name, *rest = path
    return section.model_copy(
        update={name: _replace_key(getattr(section, name), rest, value) if rest else value}
    )


def _is_computed(plans: Sequence[Plan], settings: StabilitySettings, seed: int) -> bool:
    """Return whether all basins are computed."""
    try:
        for wording, method, gravity, items in plans:
            if items:
                _rows_and_funnels(wording, method, gravity, settings, seed, items)
    except NumericalError:
        return False
    return True


_REMEDIES = {
    "stability.regulator.control_weight": (3, 10, 30, 100, 300, 1000, 3000, 10000),
    "stability.knots": (2, 4),
    "stability.goal_level": (0.1, 0.01, 0.001),
}
"""Factors that are tried on a key, in this order, if a basin is missing."""


def _rows_and_funnels(
    wording: str,
    method: str,
    gravity: str,
    settings: StabilitySettings,
    seed: int,
    trajectories: list[Trajectory],
) -> tuple[list[dict], pd.DataFrame]:
    """Return rows of ``boa.csv`` with checks, and rows of ``funnel.csv``, for some trajectories by one method."""
    from scipy.interpolate import CubicSpline

    loops = close_loops(trajectories, gravity, settings)
    result = METHODS[method](loops, settings)
    funnels, first, pendulum = result.funnels, trajectories[0], settings.pendulum
    columns = {
        "mean_area": funnels.mean_area,
        "initial_area": funnels.area[0],
        "minimum_area": funnels.area.min(axis=0),
        "final_area": funnels.area[-1],
        **dict(zip(RANGES, np.transpose([item.ranges for item in trajectories]), strict=True)),
        **(dict(zip(REACHES, funnels.reach.T, strict=True)) if method == "exact" else {}),
        "liouville_area": reachable_area(loops, settings.goal_level),
        **result.checks,
    }
    if "simulation" in settings.checks:
        starts = settings.attack.starts
        stream = [seed, zlib.crc32(f"{first.subject} {first.box_mass_kg:g} {gravity} {method}".encode())]
        check = monte_carlo_check(loops, funnels, starts, stream)
        columns |= {"simulated_starts": np.full(len(trajectories), starts), "exits": check.exits}
        columns["exits_high"] = check.share_high
        if result.control is not None:
            columns["control_exits"] = monte_carlo_check(loops, result.control, starts, stream).exits
    rows, frames, phase = [], [], np.linspace(0.0, 1.0, len(funnels.level))
    for index, item in enumerate(trajectories):
        torque = feedforward_torque(item, gravity, pendulum.damping_N_m_s, pendulum.gravity_m_s2)
        row = _identity(item) | {"method": method, "sign": gravity}
        row["peak_torque_N_m"] = float(np.abs(torque).max())
        for name, values in columns.items():
            value, resolution = values[index].item(), result.resolution.get(name)
            # A value with an uncertainty is rounded to its first digit.
            is_exact = resolution is None or value == 0
            row[name] = value if is_exact else round(value, decimals(value, resolution))
        rows.append(row)
        states = np.stack([item.angle, item.angular_velocity, torque], axis=1)
        reference = CubicSpline((item.time - item.time[0]) / item.duration, states)(phase)
        frame = {
            "wording": wording,
            "method": method,
            "com": item.com,
            "plane": item.plane,
            "time_s": phase * item.duration,
            "rho": funnels.level[:, index],
            **dict(zip(("s11", "s12", "s22"), funnels.cost[:, index].T, strict=True)),
            **dict(zip(("theta0_rad", "thetadot0_rad_s", "u0_N_m"), reference.T, strict=True)),
            "area_rad2_s": funnels.area[:, index],
        }
        frames.append(pd.DataFrame(frame, columns=list(FUNNEL_COLUMNS)))
    return rows, pd.concat(frames, ignore_index=True)


def decimals(value: float, resolution: float) -> int:
    """Return the number of decimals up to the first digit of the uncertainty.

    Parameters
    ----------
    value, resolution : float
        Value in any unit, not zero; relative uncertainty of the value.
    """
    return -math.floor(math.log10(resolution * abs(value)))


def _identity(item: Trajectory) -> dict:
    names = ("subject", "experience", "box_mass_kg", "com", "plane", *CHOICES, "mass_kg", "length_m")
    convention = {"time": item.clock, "mass": item.mass_counted}
    return {**{name: getattr(item, name) for name in names}, **convention, "duration_s": item.duration}


def boa_columns() -> list[str]:
    """Return the columns of ``boa.csv``; a cell is empty if a check belongs to another method or is not selected."""
    return columns_of("lifting/stability", "basin_areas")


def areas_table(boa: pd.DataFrame, settings: StabilitySettings, source_label: str) -> Table:
    """Return the areas of all basins and their checks as a published table, without columns of unselected checks.

    Parameters
    ----------
    boa : pandas.DataFrame
        Rows of ``boa.csv`` of all lifts.
    settings : StabilitySettings
        Settings of the study.
    source_label : str
        Source of the recordings, for the table's caption.
    """
    others = [check for check in CHECK_COLUMNS if check not in settings.checks]
    left_out = {name for check in others for name in CHECK_COLUMNS[check]}
    shown = [name for name in boa_columns() if name not in left_out]
    frame = boa[shown].copy()
    for name in (name for name in DTYPES if name in shown):
        # Counts with empty cells as objects print as whole numbers.
        frame[name] = pd.Series(
            [None if pd.isna(item) else int(item) for item in boa[name]], frame.index, object
        )
    drawn = (frame["method"] == "exact") & (frame["sign"] == settings.pendulum.sign)
    drawn &= (frame["time"] == settings.pendulum.time) & (frame["mass"] == settings.pendulum.mass)
    # The share of all states that reach the goal set that is in the exact basins: the effect of V.
    notes = []
    exact = boa[boa["method"] == "exact"]
    for (sign, time, mass), rows in exact.groupby(["sign", "time", "mass"], sort=False):
        share = 100 * rows["initial_area"] / rows["liouville_area"]
        notes.append(
            f"At t = 0 the exact basins ({sign}, {time} time, {mass.replace('_', ' ')}) hold {share.min():.2g} to "
            f"{share.max():.2g} % of the states that reach the goal set under the same regulator"
        )
    made, omitted = ", ".join(settings.checks) or "none", ", ".join(others) or "none"
    notes.append(f"Checks made (stability.checks): {made}; not chosen: {omitted}")
    sizes = ", ".join(f"{100 * size:g} % ({name})" for name, size in RESOLUTION.items())
    fields, first_rows = {"resolution": sizes}, tuple(drawn.to_numpy().nonzero()[0])
    return table_from_schema(
        "lifting/stability", "basin_areas", frame, source_label, fields, notes=notes, first_rows=first_rows
    )
