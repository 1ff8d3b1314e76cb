"""The pendulum of Figure 4.1: the centre of mass of the total body, without the box, in flexion/extension."""

from collections.abc import Mapping

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.movement.lift_tables import WHOLE_BODY, points_of
from lumbar.lifting.movement.pendulum_states import pendulum_states
from lumbar.lifting.stability.model.pendulum_trajectories import Trajectory

PLANE = "flexion_extension"


def total_body_pendulum(body: pd.DataFrame, centres: pd.DataFrame, facts: Mapping) -> Trajectory:
    """Return the trajectory of the total body's centre of mass about the study's pivot, as long as it was recorded.

    Parameters
    ----------
    body, centres : pandas.DataFrame
        ``body.csv`` and ``com.csv`` of a lift with a deposit.
    facts : mapping
        ``pendulum.json``.

    Raises
    ------
    InputError
        The recording does not have the body's centre of mass, or not during the whole deposit.
    NumericalError
        It passes the pivot too closely.
    """
    points = points_of(body)
    if WHOLE_BODY not in points:
        reason = facts.get("missing_points", {}).get(WHOLE_BODY, "its markers are not in the recording")
        raise InputError(f"no centre of mass of the total body: {reason}")
    pivot = centres[centres["com"] == centres["com"].iloc[0]][[f"pivot_{axis}_m" for axis in "xyz"]]
    relative = points[WHOLE_BODY] - pivot.to_numpy(float)
    interval = facts["start_s"], facts["stop_s"], facts["points"]
    states = pendulum_states(body["time_s"].to_numpy(), relative, *interval, "total body")[PLANE]
    return Trajectory(
        subject=facts["subject"],
        experience=facts.get("experience", ""),
        box_mass_kg=facts["box_mass_kg"],
        com="total body",
        plane=PLANE,
        pivot=facts["pivot"],
        time=states.time,
        angle=states.angle,
        angular_velocity=states.angular_velocity,
        angular_acceleration=states.angular_acceleration,
        mass_kg=facts["body_mass_kg"],
        length_m=float(states.length.mean()),
        mass_counted="without_box",
    )
