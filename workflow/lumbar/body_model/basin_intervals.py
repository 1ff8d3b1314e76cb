"""Intervals of basin areas: the exact basin of every draw of a body's pendulums."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.body_model.pendulums import ModelPendulums, Planar
from lumbar.errors import InputError
from lumbar.stability.basins import close_loops
from lumbar.stability.funnel.funnel import exact_funnels
from lumbar.stability.model.trajectory import Trajectory, find_problems

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

TOGETHER = 100
"""Basins computed at once: more only take memory."""


def basin_intervals(
    pendulums: ModelPendulums, settings: StabilitySettings, sign: str, pivot: str, coverage: float = 0.95
) -> pd.DataFrame:
    """Mean basin area of each pendulum with the interval that the body model leaves it.

    Parameters
    ----------
    pendulums : ModelPendulums
    settings : StabilitySettings
    sign : {"hanging", "inverted"}
    pivot : str
        For the table.
    coverage : float
        Share of the draws that the interval holds.

    Returns
    -------
    pandas.DataFrame
        Columns ``com, plane, sign, mean_area, mean_area_low, mean_area_high, mean_area_sd`` in rad²/s and ``draws``.

    Raises
    ------
    InputError
        A pendulum that has no basin, by its label.
    NumericalError
        As `lumbar.stability.funnel.funnel.exact_funnels`.
    """
    import pandas as pd

    keys = list(pendulums.states)
    trajectories = [
        _trajectory(states, pendulums, key, settings.pendulum.mass, pivot)
        for states in (pendulums.states, *pendulums.draws)
        for key in keys
    ]
    areas = np.concatenate(
        [
            exact_funnels(close_loops(trajectories[at : at + TOGETHER], sign, settings), settings.goal_level).mean_area
            for at in range(0, len(trajectories), TOGETHER)
        ]
    ).reshape(-1, len(keys))
    tail = 50 * (1 - coverage)
    low, high = np.percentile(areas[1:], [tail, 100 - tail], axis=0)
    rows = [
        (*key, sign, areas[0, i], low[i], high[i], areas[1:, i].std(ddof=1), len(areas) - 1)
        for i, key in enumerate(keys)
    ]
    columns = ["com", "plane", "sign", "mean_area", "mean_area_low", "mean_area_high", "mean_area_sd", "draws"]
    return pd.DataFrame(rows, columns=columns)


def _trajectory(
    states: Planar, pendulums: ModelPendulums, key: tuple[str, str], mass: str, pivot: str
) -> Trajectory:
    com, plane = key
    values = states[key]
    trajectory = Trajectory(
        "body model", "", 0.0, com, plane, pivot,
        values.time, values.angle, values.angular_velocity, values.angular_acceleration,
        pendulums.masses[com][mass == "with_box"], float(values.length.mean()),
    )  # fmt: skip
    problems = find_problems(trajectory).entries
    if problems:
        raise InputError(f"{trajectory.label}: {'. '.join(problems)}")
    return trajectory
