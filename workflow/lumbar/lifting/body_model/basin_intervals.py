"""Intervals of basin areas: the exact basin of every draw of a body's pendulums."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.body_model.pendulums import ModelPendulums, Planar
from lumbar.lifting.stability.basins import close_loops
from lumbar.lifting.stability.funnel.funnel import exact_funnels
from lumbar.lifting.stability.model.failures import all_or_each
from lumbar.lifting.stability.model.trajectory import Trajectory, find_problems

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

COLUMNS = (
    *("com", "plane", "sign", "mean_area", "mean_area_low", "mean_area_high", "mean_area_sd"),
    *("draws", "draws_without_basin"),
)
TOGETHER = 50
"""Basins computed at once; where one fails, these are computed one by one."""


def basin_intervals(
    pendulums: ModelPendulums, settings: StabilitySettings, sign: str, pivot: str, coverage: float = 0.95
) -> pd.DataFrame:
    """Mean basin area of each pendulum with the interval that the body model leaves it.

    Parameters
    ----------
    sign : {"hanging", "inverted"}
    pivot : str
        For the table.
    coverage : float
        Share of the draws that the interval holds.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`: areas in rad²/s; draws whose pendulum has no basin (too short, or one that
        reaches beyond any body) are counted and belong to no interval; NaN where the most probable pendulum has none.
    """
    import pandas as pd

    best = {
        key: _trajectory(pendulums.states, pendulums, key, settings.pendulum.mass, pivot)
        for key in pendulums.states
    }
    drawn = {
        key: [_trajectory(draw, pendulums, key, settings.pendulum.mass, pivot) for draw in pendulums.draws]
        for key in best
    }
    areas = _areas([*best.values(), *(one for many in drawn.values() for one in many)], settings, sign)
    rows = []
    for key, trajectory in best.items():
        found = [areas[id(one)] for one in drawn[key] if id(one) in areas]
        low, high, sd = np.nan, np.nan, np.nan
        if len(found) > 1:
            low, high = np.percentile(found, [50 * (1 - coverage), 50 * (1 + coverage)])
            sd = np.std(found, ddof=1)
        area = areas.get(id(trajectory), np.nan)
        rows.append((*key, sign, area, low, high, sd, len(found), len(drawn[key]) - len(found)))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _areas(trajectories: list[Trajectory], settings: StabilitySettings, sign: str) -> dict[int, float]:
    """Mean area of every trajectory that has a basin, by its identity."""
    sound = [one for one in trajectories if not find_problems(one).entries]
    areas = {}
    for at in range(0, len(sound), TOGETHER):
        results, _ = all_or_each(_mean_area, sound[at : at + TOGETHER], settings, sign, basin="body model")
        for some, values in results:
            areas.update(zip(map(id, some), values, strict=True))
    return areas


def _mean_area(trajectories: list[Trajectory], settings: StabilitySettings, sign: str) -> np.ndarray:
    return exact_funnels(close_loops(trajectories, sign, settings), settings.goal_level).mean_area


def _trajectory(
    states: Planar, pendulums: ModelPendulums, key: tuple[str, str], mass: str, pivot: str
) -> Trajectory:
    com, plane = key
    values = states[key]
    return Trajectory(
        "body model", "", 0.0, com, plane, pivot,
        values.time, values.angle, values.angular_velocity, values.angular_acceleration,
        pendulums.masses[com][mass == "with_box"], float(values.length.mean()),
    )  # fmt: skip
