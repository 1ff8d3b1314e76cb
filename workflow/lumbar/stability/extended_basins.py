"""Beyond the thesis's loop: each basin with limited torque, with an uncertain mass, and with a better V.

By all engines with the study's sign of gravity, limits by the exact one with the other sign too. Every funnel is
attacked by simulation and, where the configuration asks for it, proved between its knots as those of `basins` are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.stability.basins import COLUMNS as BASIN_COLUMNS
from lumbar.stability.basins import basin_rows, close_loops
from lumbar.stability.funnel.funnel import ClosedLoops, exact_funnels
from lumbar.stability.funnel.lyapunov_family import best_of_family
from lumbar.stability.funnel.saturation import Limits
from lumbar.stability.methods import ENGINES, EngineResult, chosen_engines
from lumbar.stability.model.failures import Failure, computed
from lumbar.stability.model.pendulum_loop import SIGNS
from lumbar.stability.model.trajectory import Trajectory
from lumbar.stability.proof.interval_proof import proved_share
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

_SHARED = (
    "initial_area",
    "simulated_starts",
    "exits",
    "control_exits",
    "proved_share",
    "proved_area_ratio",
    "sos_margin_difference",
    "sos_taylor_optimism",
    "sos_rational_share",
    "violation_share",
)
COLUMNS = {
    **{name: BASIN_COLUMNS[name] for name in ("subject", "box_mass_kg", "com", "plane")},
    "loop": "torque_limited: |u| ≤ U, the feedback saturates; uncertain_mass: the mass is anything within the stated "
    "interval, while feedforward and feedback were computed for its middle; better_v: the nominal loop with the "
    "best V of the family",
    "method": BASIN_COLUMNS["method"],
    "sign": BASIN_COLUMNS["sign"],
    "mean_area": BASIN_COLUMNS["mean_area"],
    "area_ratio": "mean_area divided by that of the nominal loop with V the Riccati solution (exact engine)",
    "best_share": "λ of the best V: −Ṡ = A_cᵀS + SA_c + λ(Q + KᵀRK), S(T) = Qf; λ = 1 is the Riccati solution",
    **{name: BASIN_COLUMNS[name] for name in _SHARED},
}
"""Columns of ``extended.csv`` with their definitions; a cell is empty where a check belongs to another method."""

COUNTS = {"control_exits": "Int64"}


def loops_with_limits(settings: StabilitySettings) -> dict[str, Limits]:
    """Limits of the configuration by the name in the column ``loop``."""
    limits = settings.limits
    return {
        "torque_limited": Limits(torque=limits.torque_N_m),
        "uncertain_mass": Limits(mass_share=limits.mass_share),
    }


def extended_basins(
    trajectories: list[Trajectory], settings: StabilitySettings, seed: int
) -> tuple[pd.DataFrame, list[Failure]]:
    """Compute the extended basins of one lift.

    Parameters
    ----------
    trajectories : list of Trajectory
    settings : StabilitySettings
    seed : int

    Returns
    -------
    frame : pandas.DataFrame
        One row per trajectory, loop, method and sign; columns `COLUMNS`.
    failures : list of Failure
        Basins that could not be computed: they have no row.
    """
    import pandas as pd

    settings = _with_fewer_knots(settings)
    published = settings.pendulum.sign
    rows: list[dict] = []
    failures: list[Failure] = []
    for sign in sorted(SIGNS, key=lambda name: name != published):
        plans = [
            (name, method, limits)
            for name, limits in loops_with_limits(settings).items()
            for method in (chosen_engines(settings) if sign == published else ["exact"])
        ]
        if sign == published:
            plans.append(("better_v", "exact", Limits()))
        nominal_loops = _nominal_loops(sign, settings)
        for name, method, limits in plans:

            def compute(
                items, sign=sign, name=name, method=method, limits=limits, nominal_loops=nominal_loops
            ):
                loops, nominal = nominal_loops(items)
                own, result, extra = _result(loops, name, method, limits, settings)
                found = basin_rows(items, own, result, settings, seed, sign, limits)
                return [
                    {
                        **row,
                        "loop": name,
                        "method": method,
                        "area_ratio": row["mean_area"] / nominal[index].item(),
                        **{key: values[index].item() for key, values in extra.items()},
                    }
                    for index, row in enumerate(found)
                ]

            results, failed = computed(trajectories, compute, f"{name}, {method}, {sign}")
            rows += [row for _, own in results for row in own]
            failures += failed
    return pd.DataFrame(rows, columns=list(COLUMNS)).astype(COUNTS), failures


def _nominal_loops(sign: str, settings: StabilitySettings) -> Callable[[list[Trajectory]], tuple]:
    """Return a function from trajectories to loops and areas without limits, each computed once."""
    known: dict[tuple, tuple] = {}

    def nominal_loops(items: list[Trajectory]) -> tuple[ClosedLoops, np.ndarray]:
        key = tuple(item.label for item in items)
        if key not in known:
            loops = close_loops(items, sign, settings)
            known[key] = loops, exact_funnels(loops, settings.goal_level).mean_area
        return known[key]

    return nominal_loops


def _result(
    loops: ClosedLoops, name: str, method: str, limits: Limits, settings: StabilitySettings
) -> tuple[ClosedLoops, EngineResult, dict[str, np.ndarray]]:
    """Run one engine; a better V changes the loops that are attacked too."""
    if name != "better_v":
        return loops, ENGINES[method](loops, settings, limits), {}
    proof = settings.proof
    best = best_of_family(
        loops,
        settings.goal_level,
        settings.lyapunov_shares,
        proof.margin_1_s if proof else 0.0,
        settings.attack.control_overstated,
    )
    checks = {}
    if proof:
        checks["proved_share"] = proved_share(best.loops, best.with_margin)
        checks["proved_area_ratio"] = best.with_margin.mean_area / best.funnels.mean_area
    return best.loops, EngineResult(best.funnels, checks, best.overstated), {"best_share": best.share}


def _with_fewer_knots(settings: StabilitySettings) -> StabilitySettings:
    """Return the settings with knots and proof of the section ``limits`` for every engine."""
    limits = settings.limits
    certified = settings.sum_of_squares and replace(settings.sum_of_squares, knots=limits.certified_knots)
    proof = settings.proof if limits.proved else None
    return replace(settings, knots=limits.knots, sum_of_squares=certified, proof=proof)


def extended_table(frame: pd.DataFrame, settings: StabilitySettings, data: str) -> Table:
    """Return the extended basins of all lifts as a published table."""
    import pandas as pd

    limits = settings.limits
    counts = pd.Series(
        [None if pd.isna(item) else int(item) for item in frame["control_exits"]], dtype=object
    )
    optional = set(_SHARED) - {"initial_area", "simulated_starts", "exits"}
    return Table(
        title="Basins of attraction with limited torque, with an uncertain mass, and with a better V.",
        frame=frame.assign(control_exits=counts.to_numpy()),
        definitions=COLUMNS,
        data=data,
        notes=(
            f"U = {limits.torque_N_m:g} N·m, the same for all; the mass lies within "
            f"±{100 * limits.mass_share:g} % of the nominal one, the pendulum's mass "
            f"{settings.pendulum.mass.replace('_', ' ')}; λ tried: "
            + ", ".join(f"{share:g}" for share in settings.lyapunov_shares),
        ),
        may_be_empty=frozenset({*optional, "best_share"}),
    )
