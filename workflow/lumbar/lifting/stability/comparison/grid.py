"""The exact areas of one lift under every convention, each beside its own null control.

In error coordinates u0, θ̇0 and θ̈0 cancel: of the movement only cos θ0 and |sin θ0|·e² are left. The null control
(θ0 = 0 throughout) is the same pendulum with the same duration and no movement; what differs between the two comes from
the movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.basins import weights_of
from lumbar.lifting.stability.funnel.funnel import exact_funnels, regulate
from lumbar.lifting.stability.model.convention import GRID, Convention
from lumbar.lifting.stability.model.failures import Failure, all_or_each
from lumbar.lifting.stability.model.lift_trajectories import LiftStates
from lumbar.lifting.stability.model.pendulum_loop import Pendulums, gather
from lumbar.lifting.stability.model.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

COLUMNS = {
    "subject": "who lifted",
    "box_mass_kg": "mass of the box in kg",
    "com": "centre of mass taken for the pendulum's",
    "plane": "plane onto which the trajectory is projected",
    "sign": "sign of gravity in Eq. 4.1: hanging (as published) or inverted (as people stand)",
    "time": "real: the movement lasts as long as it was recorded; unit: it is played in one second",
    "mass": "whether the box counts to the pendulum's mass: with_box or without_box",
    "pivot": "point about which the pendulum turns",
    "mass_kg": "mass m of the pendulum in kg",
    "length_m": "mean length ℓ of the pendulum in m",
    "duration_s": "duration T of the movement as it is played, in s",
    "mean_area": "average cross-section (1/T)∫πρ/√det S dt in rad²/s, exact method",
    "null_area": "the same with θ0 = 0 throughout",
    "reason": "why there is no area",
}
"""Columns of ``grid.csv``; areas are empty where there is a reason."""


def headline(settings: StabilitySettings, pivot: str) -> Convention:
    """Return the convention of the headline: the study's own choices."""
    pendulum = settings.pendulum
    return Convention(pendulum.sign, pendulum.time, pendulum.mass, pivot)


def grid_areas(lift: LiftStates, settings: StabilitySettings) -> pd.DataFrame:
    """Compute the average cross-sections of one lift under every convention.

    Parameters
    ----------
    settings : StabilitySettings
        With the knots and weights of the section ``grid``.

    Returns
    -------
    pandas.DataFrame
        One row per convention, COM and plane; columns `COLUMNS`.
    """
    import pandas as pd

    rows = []
    own = lift.facts["pivot"]
    chosen = dict.fromkeys((*GRID, headline(settings, own)))
    for pivot in dict.fromkeys(convention.pivot for convention in chosen):
        here = [convention for convention in chosen if convention.pivot == pivot]
        about = settings if pivot == own else about_pivot(settings, pivot)
        rows += _rows_about({convention: lift.trajectories(convention) for convention in here}, about)
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _rows_about(
    found: dict[Convention, tuple[list[Trajectory], list[Failure]]], settings: StabilitySettings
) -> list[dict]:
    """Rows of `COLUMNS` of the conventions about one pivot."""
    # All conventions at once are five times as fast as one after the other; only where one has no basin are they taken apart.
    items = [(item, convention.sign) for convention, (sound, _) in found.items() for item in sound]
    try:
        areas = iter(areas_with_null(*zip(*items, strict=True), settings)) if items else iter(())
        results = {
            convention: ([(sound, [next(areas) for _ in sound])], [])
            for convention, (sound, _) in found.items()
        }
    except NumericalError:
        results = {
            convention: all_or_each(_of_one_sign, sound, convention.sign, settings, basin=str(convention))
            for convention, (sound, _) in found.items()
        }
    rows = []
    for convention, (computed, failed) in results.items():
        chosen = vars(convention)
        rows += [
            {**_identity(item), **chosen, "mean_area": area[0], "null_area": area[1], "reason": ""}
            for some, areas_of in computed
            for item, area in zip(some, areas_of, strict=True)
        ]
        rows += [
            {**_identity(item), **chosen, "mean_area": np.nan, "null_area": np.nan, "reason": item.reason}
            for item in (*found[convention][1], *failed)
        ]
    return rows


def about_pivot(settings: StabilitySettings, pivot: str) -> StabilitySettings:
    """Return the settings with the control weight for a pivot that is not the study's own."""
    weight = getattr(settings.grid, f"{pivot}_control_weight")
    return replace(settings, regulator=replace(settings.regulator, control_weight=weight))


def _identity(item) -> dict:
    names = ("subject", "box_mass_kg", "com", "plane", "mass_kg", "length_m")
    known = {name: getattr(item, name, np.nan) for name in names}
    return {**known, "duration_s": getattr(item, "duration", np.nan)}


def areas_with_null(
    trajectories: Sequence[Trajectory], signs: Sequence[str], settings: StabilitySettings
) -> np.ndarray:
    """Return average cross-sections of trajectories and of their null controls in rad²/s, shape (trajectories, 2).

    Parameters
    ----------
    signs : sequence of {"hanging", "inverted"}
        One per trajectory.

    Raises
    ------
    NumericalError
        One of them has no basin.
    """
    pendulum, count = settings.pendulum, len(trajectories)
    damping = [pendulum.damping_N_m_s] * count
    knots = settings.grid.knots
    moving = gather(list(trajectories), list(signs), damping, pendulum.gravity_m_s2, knots)
    loops = regulate(_beside_their_null(moving), weights_of(settings))
    return exact_funnels(loops, settings.goal_level).mean_area.reshape(2, count).T


def _of_one_sign(trajectories: list[Trajectory], sign: str, settings: StabilitySettings) -> np.ndarray:
    return areas_with_null(trajectories, [sign] * len(trajectories), settings)


def _beside_their_null(moving: Pendulums) -> Pendulums:
    """Return the pendulums and, after them, the same ones standing still at θ0 = 0."""
    twice = {
        name: np.concatenate([getattr(moving, name)] * 2)
        for name in ("inertia", "damping", "gravity_torque", "duration")
    }
    angle = np.concatenate([moving.angle, np.zeros_like(moving.angle)], axis=1)
    return replace(moving, labels=moving.labels * 2, angle=angle, **twice)
