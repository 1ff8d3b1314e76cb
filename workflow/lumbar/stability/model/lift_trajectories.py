"""From the pendulum states of one lift to its reference trajectories, the unsound ones named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from lumbar.stability.model.failures import NO_TRAJECTORY, Failure
from lumbar.stability.model.trajectory import COMS, PLANES, Trajectory, find_problems

if TYPE_CHECKING:
    import pandas as pd


def trajectories_of_lift(
    states: pd.DataFrame, facts: Mapping, mass: str
) -> tuple[list[Trajectory], list[Failure]]:
    """Return the sound ones of a lift's six trajectories, and what is wrong with the others.

    Parameters
    ----------
    states : pandas.DataFrame
        Columns ``com, plane, time_s, angle_rad, angular_velocity_rad_s, angular_acceleration_rad_s2``.
    facts : mapping
        ``subject, box_mass_kg, pivot``, ``mass_kg`` (per COM ``with_box`` and ``without_box``) and ``length_m`` (per COM
        and plane); ``experience`` where it is known, and ``missing``, the reasons of COMs without a pendulum.
    mass : {"with_box", "without_box"}
        Whether the box counts to the pendulum's mass.

    Returns
    -------
    trajectories : list of Trajectory
        In the order of `COMS`, then `PLANES`.
    failures : list of Failure
        Of those that have no basin.
    """
    trajectories, failures, missing = [], [], facts.get("missing", {})
    person, box = (facts["subject"], facts.get("experience", "")), float(facts["box_mass_kg"])
    for com in COMS:
        for plane in PLANES:
            if com in missing:
                failures.append(Failure(*person, box, com, plane, NO_TRAJECTORY, missing[com]))
                continue
            rows = states[(states["com"] == com) & (states["plane"] == plane)]
            trajectory = Trajectory(
                *person,
                box,
                com=com,
                plane=plane,
                pivot=facts["pivot"],
                time=rows["time_s"].to_numpy(float),
                angle=rows["angle_rad"].to_numpy(float),
                angular_velocity=rows["angular_velocity_rad_s"].to_numpy(float),
                angular_acceleration=rows["angular_acceleration_rad_s2"].to_numpy(float),
                mass_kg=float(facts["mass_kg"][com][mass]),
                length_m=float(facts["length_m"][com][plane]),
            )
            problems = find_problems(trajectory).entries
            if problems:
                failures.append(Failure.of(trajectory, NO_TRAJECTORY, ". ".join(problems)))
            else:
                trajectories.append(trajectory)
    return trajectories, failures
