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

COLUMNS = (
    *("com", "plane", "sign", "mean_area", "mean_area_low", "mean_area_high", "mean_area_sd"),
    *("draws", "draws_without_basin"),
)
TOGETHER = 200
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
        Columns `COLUMNS`: areas in rad²/s; draws whose pendulum has no basin (too short, say) are counted and belong to
        no interval.

    Raises
    ------
    InputError
        The most probable pendulum has no basin.
    NumericalError
        As `lumbar.stability.funnel.funnel.exact_funnels`.
    """
    import pandas as pd

    keys = list(pendulums.states)
    made = [
        (key, _trajectory(states, pendulums, key, settings.pendulum.mass, pivot))
        for states in (pendulums.states, *pendulums.draws)
        for key in keys
    ]
    for _, best in made[: len(keys)]:
        if problems := find_problems(best).entries:
            raise InputError(f"{best.label}: {'. '.join(problems)}")
    sound = [(key, trajectory) for key, trajectory in made if not find_problems(trajectory).entries]
    areas = _areas([trajectory for _, trajectory in sound], settings, sign)
    rows = []
    for index, key in enumerate(keys):
        drawn = [
            area
            for (other, _), area in zip(sound[len(keys) :], areas[len(keys) :], strict=True)
            if other == key
        ]
        low, high, sd = np.nan, np.nan, np.nan
        if len(drawn) > 1:
            low, high = np.percentile(drawn, [50 * (1 - coverage), 50 * (1 + coverage)])
            sd = np.std(drawn, ddof=1)
        rows.append((*key, sign, areas[index], low, high, sd, len(drawn), len(pendulums.draws) - len(drawn)))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _areas(trajectories: list[Trajectory], settings: StabilitySettings, sign: str) -> np.ndarray:
    parts = [trajectories[at : at + TOGETHER] for at in range(0, len(trajectories), TOGETHER)]
    loops = [close_loops(part, sign, settings) for part in parts]
    return np.concatenate([exact_funnels(loop, settings.goal_level).mean_area for loop in loops])


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
