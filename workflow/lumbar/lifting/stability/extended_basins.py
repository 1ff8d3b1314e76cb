"""Beyond the thesis's loop: each basin with limited torque, with an uncertain mass, and with a better V.

By all methods with the study's sign of gravity, limits by the exact one with the other sign too. Every funnel is
checked by simulation.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from lumbar.lifting.stability.basins import as_counts, basin_rows, columns_not_chosen, method_words
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.saturation import UNSATURATED, Saturation, reference_of
from lumbar.lifting.stability.methods import METHODS, MethodResult, headline_methods
from lumbar.lifting.stability.model.eq_4_1_pendulum import SIGNS
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, close_loops
from lumbar.lifting.stability.model.failures import TORQUE_LIMITED, attempts
from lumbar.lifting.stability.model.trajectories import Failure, Trajectory
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

COUNTS = {"simulated_starts": "Int64", "exits": "Int64", "control_exits": "Int64"}


def torque_range(item: Trajectory, settings: StabilitySettings) -> tuple[float, float]:
    """Return the smallest and the largest torque u in N·m that foot or hips allow a pendulum.

    About the ankles the centre of pressure under the pendulum's weight stays below the feet; about the hips (or L5) strength
    is the limit, all of it for each pendulum. Positive torques turn forward or to the right.
    """
    limits, weight = settings.limits, item.mass_kg * settings.pendulum.gravity_m_s2
    if item.plane == "lateral_bending":
        side = weight * limits.feet_half_width_m if item.pivot == "mid_ankle" else limits.hip_abduction_N_m
        return -side, side
    if item.pivot == "mid_ankle":
        return -weight * limits.foot_ahead_m, weight * limits.foot_behind_m
    return -limits.hip_extension_N_m, limits.hip_flexion_N_m


def torque_limit(trajectories: Sequence[Trajectory], settings: StabilitySettings) -> Saturation:
    """Return `torque_range` of every pendulum as limits of their loops."""
    low, high = np.transpose([torque_range(item, settings) for item in trajectories])
    return Saturation(torque=(high - low) / 2, bias=(high + low) / 2)


def binds(loops: ClosedLoops, level: np.ndarray, saturation: Saturation) -> np.ndarray:
    """Whether u0 − K·x̄ leaves the limits anywhere in a funnel, shape (pendulums,); on V = ρ |K·x̄| ≤ √(ρ·K·S⁻¹·Kᵀ)."""
    points = slice(None, None, 2)
    s11, s12, s22 = np.moveaxis(loops.cost[points], -1, 0)
    k1, k2 = np.moveaxis(loops.gains[points], -1, 0)
    feedback = (s22 * k1**2 - 2 * s12 * k1 * k2 + s11 * k2**2) / (s11 * s22 - s12**2)
    reference = reference_of(loops.pendulums, saturation.bias).torque[points]
    return (np.abs(reference) + np.sqrt(level * feedback) > saturation.torque).any(axis=0)


def extended_basins(
    trajectories: list[Trajectory], settings: StabilitySettings, seed: int
) -> tuple[pd.DataFrame, list[Failure]]:
    """Compute the extended basins of one lift; of no trajectories the table without rows.

    The table has one row per trajectory, loop, method and sign, columns of ``extended.csv``; basins that could not be computed
    have no row and are the failures.
    """
    settings = settings_of_limits(settings)
    published = settings.pendulum.sign
    rows: list[dict] = []
    failures: list[Failure] = []
    for sign in sorted(SIGNS, key=lambda name: name != published):
        methods = headline_methods(settings) if sign == published else ["exact"]
        nominal = NominalLoops(sign, settings, seed)
        plans = list(product((TORQUE_LIMITED, "uncertain_mass"), methods))
        if sign == published:
            plans.append(("better_v", "exact"))
        for name, method in plans:
            compute = limited_rows if name == TORQUE_LIMITED else partial(extended_rows, name)
            for attempt in attempts(trajectories, f"{name}, {method}, {sign}", failures):
                with attempt as some:
                    rows += compute(method, nominal, some)
    return pd.DataFrame(rows, columns=columns_of(__file__, "extended_basins")).astype(COUNTS), failures


class NominalLoops:
    """Loops without limits and their exact funnels with one sign of gravity, each computed once, and what checks others."""

    def __init__(self, sign: str, settings: StabilitySettings, seed: int):
        self.sign, self.settings, self.seed = sign, settings, seed
        self._known: dict[tuple, tuple[ClosedLoops, Funnels]] = {}

    def of(self, trajectories: list[Trajectory]) -> tuple[ClosedLoops, Funnels]:
        """Return the loops of some trajectories and their exact funnels."""
        labels = [item.label for item in trajectories]
        for known, (loops, funnels) in self._known.items():
            if set(labels) <= set(known):
                index = np.array([known.index(label) for label in labels])
                return loops.select(index), funnels.select(index)
        loops = close_loops(trajectories, self.sign, self.settings)
        self._known[tuple(labels)] = loops, exact_funnels(loops, self.settings.goal_level)
        return self._known[tuple(labels)]


def limited_rows(method: str, nominal: NominalLoops, trajectories: list[Trajectory]) -> list[dict]:
    """Rows of the loops with limited torque; where the limits cannot bind the basin is the nominal one, by the exact method."""
    loops, funnels = nominal.of(trajectories)
    bound = binds(loops, funnels.level, torque_limit(trajectories, nominal.settings))
    some = [item for item, beyond in zip(trajectories, bound, strict=True) if beyond]
    found = iter(extended_rows(TORQUE_LIMITED, method, nominal, some) if some else [])
    rows = []
    for index, item in enumerate(trajectories):
        low, high = torque_range(item, nominal.settings)
        limits = {"lowest_torque_N_m": low, "highest_torque_N_m": high}
        if bound[index]:
            rows.append(next(found) | limits | {"binds": "yes"})
        elif method == "exact":
            rows.append(_nominal_row(item, nominal.sign, funnels, index) | limits | {"binds": "no"})
    return rows


def extended_rows(
    name: str, method: str, nominal: NominalLoops, trajectories: list[Trajectory]
) -> list[dict]:
    """Compute and check the basins of some trajectories in one of the extended loops: a row of ``extended.csv`` each."""
    loops, funnels = nominal.of(trajectories)
    settings, saturation = nominal.settings, UNSATURATED
    if name == TORQUE_LIMITED:
        saturation = torque_limit(trajectories, settings)
    elif name == "uncertain_mass":
        saturation = Saturation(mass_share=settings.limits.mass_share)
    own, result, extra = _result(loops, name, method, saturation, settings)
    found = basin_rows(trajectories, own, result, settings, nominal.seed, nominal.sign, saturation)
    return [
        {
            **row,
            "loop": name,
            "method": method,
            "area_ratio": row["mean_area"] / area,
            **{key: values[index].item() for key, values in extra.items()},
        }
        for index, (row, area) in enumerate(zip(found, funnels.mean_area.tolist(), strict=True))
    ]


def _nominal_row(item: Trajectory, sign: str, funnels: Funnels, index: int) -> dict:
    """Row of a basin that its limits do not touch: the nominal one."""
    row = {name: getattr(item, name) for name in ("subject", "box_mass_kg", "com", "plane")}
    areas = {name: getattr(funnels, name)[index].item() for name in ("mean_area", "initial_area")}
    return row | areas | {"loop": TORQUE_LIMITED, "method": "exact", "sign": sign, "area_ratio": 1.0}


def _result(
    loops: ClosedLoops, name: str, method: str, saturation: Saturation, settings: StabilitySettings
) -> tuple[ClosedLoops, MethodResult, dict[str, np.ndarray]]:
    """Run one method; a better V changes the loops that are checked too."""
    if name != "better_v":
        return loops, METHODS[method](loops, settings, saturation), {}
    overstated = settings.attack.control_overstated
    best = best_of_family(loops, settings.goal_level, settings.lyapunov_shares, overstated)
    control = best.negative_control if "simulation" in settings.checks else None
    return best.loops, MethodResult(best.exact, control=control), {"best_share": best.share}


def settings_of_limits(settings: StabilitySettings) -> StabilitySettings:
    """Return the settings with the knots of the section ``limits`` for every method, without the proof, which knows no limits."""
    limits = settings.limits
    certified = replace(settings.sum_of_squares, knots=limits.certified_knots)
    checks = tuple(check for check in settings.checks if check != "proof")
    return replace(settings, knots=limits.knots, sum_of_squares=certified, checks=checks)


def extended_table(frame: pd.DataFrame, settings: StabilitySettings, data: str) -> Table:
    """Return the extended basins of all lifts as a published table."""
    left_out = columns_not_chosen(settings_of_limits(settings).checks)
    frame = frame[[name for name in columns_of(__file__, "extended_basins") if name not in left_out]]
    shown = (frame["com"] == "abdomen") & (frame["method"] == "exact")
    shown &= frame["sign"] == settings.pendulum.sign
    words = method_words() | {
        "limits": settings.limits,
        "binding": _binding(frame),
        "uncertain": 100 * settings.limits.mass_share,
        "mass": settings.pendulum.mass.replace("_", " "),
        "shares": ", ".join(f"{share:g}" for share in settings.lyapunov_shares),
    }
    counted = frame.assign(**{name: as_counts(frame[name]) for name in COUNTS if name in frame})
    first_rows = tuple(shown.to_numpy().nonzero()[0])
    return described(__file__, "extended_basins", counted, data, words, first_rows=first_rows)


def _binding(frame: pd.DataFrame) -> str:
    limited = frame[(frame["loop"] == TORQUE_LIMITED) & (frame["method"] == "exact")]
    free = int((limited["binds"] == "no").sum())
    bound = f"In {len(limited) - free} of {len(limited)} basins with limited torque some state asks for more than the limit"
    nominal = "; in the others none does, and the basin is the nominal one" if free else ""
    return f"{bound}{nominal}. Where the feedforward alone asks for more there is no basin (tables/missing_basins)"
