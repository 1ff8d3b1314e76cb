"""Beyond the thesis's loop: each basin with limited torque, with an uncertain mass, and with a better V.

All by the exact engine, with the study's sign of gravity; every funnel is attacked by simulation.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np

from lumbar.stability.basins import close_loops
from lumbar.stability.funnel import exact_funnels
from lumbar.stability.limits import Limits, disturbance_of, limited_funnels
from lumbar.stability.lyapunov_family import best_of_family
from lumbar.stability.simulation import attack
from lumbar.stability.trajectory import Trajectory
from lumbar.tables import Table

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = {
    "subject": "who lifted",
    "box_mass_kg": "mass of the box",
    "com": "centre of mass taken for the pendulum's",
    "plane": "plane onto which the trajectory is projected",
    "mean_area": "average cross-section A in rad²/s of the exact basin: V the Riccati solution, no limits",
    "torque_limited_area": "A when |u| ≤ U: the feedback saturates, the basin holds for the saturated loop; empty "
    "where the feedforward itself lies beyond U or no basin of the goal set is left",
    "torque_exits": "simulated starts that left this basin",
    "uncertain_mass_area": "A when the mass is anything within the stated interval, while feedforward and feedback "
    "were computed for its middle; empty where no basin of the goal set is left",
    "uncertain_mass_exits": "simulated starts, each with a mass of its own, that left this basin",
    "best_share": "λ of the best V: −Ṡ = A_cᵀS + SA_c + λ(Q + KᵀRK), S(T) = Qf; λ = 1 is the Riccati solution",
    "best_area": "A with the best V, for the same controller and goal set",
    "area_gained": "best_area divided by mean_area",
    "best_exits": "simulated starts that left this basin",
    "simulated_starts": "starts in each of these basins",
}


def extended_basins(trajectories: list[Trajectory], settings: dict, seed: int) -> pd.DataFrame:
    """Compute the extended basins of one lift.

    Parameters
    ----------
    trajectories : list of Trajectory
    settings : dict
        Section ``stability`` of the configuration.
    seed : int

    Returns
    -------
    pandas.DataFrame
        One row per trajectory, columns `COLUMNS`.
    """
    import pandas as pd

    goal, starts, limits = settings["goal_level"], settings["attack"]["starts"], settings["limits"]
    loops = close_loops(trajectories, settings["pendulum"]["sign"], {**settings, "knots": limits["knots"]})
    first = trajectories[0]
    stream = [seed, zlib.crc32(f"{first.subject} {first.box_mass_kg:g} limits".encode())]
    columns = {"mean_area": exact_funnels(loops, goal).mean_area}
    for name, limit in (
        ("torque_limited", Limits(torque=limits["torque_N_m"])),
        ("uncertain_mass", Limits(mass_share=limits["mass_share"])),
    ):
        found = limited_funnels(loops, goal, limit)
        disturbance = disturbance_of(loops, limit, starts, [*stream, 1])
        exits = attack(loops, found.funnels, starts, stream, disturbance).exits.astype(float)
        columns[f"{name}_area"] = np.where(found.held, found.funnels.mean_area, np.nan)
        columns[f"{name.removesuffix('_limited')}_exits"] = np.where(found.held, exits, np.nan)
    best = best_of_family(loops, goal, settings["lyapunov_shares"], margin=0.0)
    columns["best_share"], columns["best_area"] = best.share, best.funnels.mean_area
    columns["area_gained"] = best.funnels.mean_area / columns["mean_area"]
    columns["best_exits"] = attack(best.loops, best.funnels, starts, stream).exits
    columns["simulated_starts"] = np.full(len(trajectories), starts)
    names = ("subject", "box_mass_kg", "com", "plane")
    frame = pd.DataFrame([{name: getattr(item, name) for name in names} for item in trajectories])
    frame = frame.assign(**columns)[list(COLUMNS)]
    counts = {"torque_exits": "Int64", "uncertain_mass_exits": "Int64"}
    return frame.astype(counts)


def extended_table(frame: pd.DataFrame, settings: dict, data: str) -> Table:
    """Return the extended basins of all lifts as a published table."""
    import pandas as pd

    limits = settings["limits"]
    counts = {
        name: pd.Series([None if pd.isna(item) else int(item) for item in frame[name]], dtype=object)
        for name in ("torque_exits", "uncertain_mass_exits")
    }
    empty = {f"{name}_{what}" for name in ("uncertain_mass", "torque") for what in ("exits", "area")}
    return Table(
        title="Basins of attraction with limited torque, with an uncertain mass, and with a better V.",
        frame=frame.assign(**counts),
        definitions=COLUMNS,
        data=data,
        notes=(
            f"U = {limits['torque_N_m']:g} N·m, the same for all; the mass lies within "
            f"±{100 * limits['mass_share']:g} % of the nominal one; λ tried: "
            + ", ".join(f"{share:g}" for share in settings["lyapunov_shares"]),
        ),
        may_be_empty=frozenset({*empty, "torque_limited_area"}),
    )
