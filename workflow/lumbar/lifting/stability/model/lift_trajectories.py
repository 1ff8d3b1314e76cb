"""From the pendulum states of one lift to its reference trajectories, the unsound ones named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lumbar.lifting.stability.model.failures import NO_TRAJECTORY, Failure
from lumbar.lifting.stability.model.trajectory import COMS, PLANES, Trajectory, find_problems, in_unit_time

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.lifting.stability.model.convention import Convention


@dataclass(frozen=True)
class LiftStates:
    """Pendulum states of one lift about every pivot that was taken."""

    states: pd.DataFrame
    """``pendulum.csv``: about the study's pivot."""
    facts: Mapping
    """``pendulum.json``; ``other_pivots`` holds ``length_m`` and ``missing`` of the further pivots by name."""
    others: pd.DataFrame | None = None
    """``other_pivots.csv``: column ``pivot`` and those of `states`; None where there is no such file."""

    def trajectories(self, convention: Convention) -> tuple[list[Trajectory], list[Failure]]:
        """Return the sound trajectories of one convention, and what is wrong with the others."""
        pivot, mass, time = convention.pivot, convention.mass, convention.time
        if pivot == self.facts["pivot"]:
            return trajectories_of_lift(self.states, self.facts, mass, time)
        further = self.facts.get("other_pivots", {})
        if self.others is None or pivot not in further:
            reason = f"no pendulum states about the pivot {pivot}: 'lumbar lift' writes other_pivots.csv"
            lost = {**self.facts, "missing": dict.fromkeys(COMS, reason)}
            return trajectories_of_lift(self.states, lost, mass, time)
        rows = self.others[self.others["pivot"] == pivot]
        return trajectories_of_lift(rows, {**self.facts, "pivot": pivot, **further[pivot]}, mass, time)


def trajectories_of_lift(
    states: pd.DataFrame, facts: Mapping, mass: str, time: str = "real"
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
    time : {"real", "unit"}
        Whether the movement lasts as long as it was recorded or one second.

    Returns
    -------
    trajectories : list of Trajectory
        In the order of `COMS`, then `PLANES`.
    failures : list of Failure
        Of those that have no basin.
    """
    trajectories, failures, missing = [], [], facts.get("missing", {})
    parts = dict(iter(states.groupby(["com", "plane"])))
    person, box = (facts["subject"], facts.get("experience", "")), float(facts["box_mass_kg"])
    for com in COMS:
        for plane in PLANES:
            if com in missing:
                failures.append(Failure(*person, box, com, plane, NO_TRAJECTORY, missing[com]))
                continue
            rows = parts.get((com, plane), states[:0])
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
                mass_counted=mass,
            )
            problems = find_problems(trajectory).entries
            if problems:
                failures.append(Failure.of(trajectory, NO_TRAJECTORY, ". ".join(problems)))
            else:
                trajectories.append(in_unit_time(trajectory) if time == "unit" else trajectory)
    return trajectories, failures
