"""Data of the page of a lift: the body at every frame, and pendulums that can be pushed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from lumbar.lifting.measures.balance import corners_around
from lumbar.lifting.measures.course import CORNERS, base_from_course
from lumbar.lifting.movement.centre_of_mass import COMS
from lumbar.lifting.movement.lift_tables import LOAD, WHOLE_BODY, com_of, points_of
from lumbar.lifting.movement.pendulum_states import PLANES
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import (
    Failure,
    LiftStates,
    Trajectory,
    compute_together,
    headline,
)
from lumbar.lifting.stability.model.torque_limits import exceeds, reference_of, torque_range
from lumbar.settings.lifting import StabilitySettings


@dataclass(frozen=True, eq=False)
class LiftTables:
    """Tables of one analysed lift."""

    body: pd.DataFrame
    """Trajectories of the body: result of `lumbar.lifting.movement.lift_tables.body_frame`."""
    pivot: np.ndarray | None
    """Pivot of the pendulums at the instants of `body`, shape (n, 3), metres; None without markers of the pivot."""
    states: pd.DataFrame
    """Rows of ``pendulum.csv``."""
    facts: Mapping[str, Any]
    """Content of ``pendulum.json``."""
    events: Mapping[str, Mapping[str, Any]]
    """Results of `lumbar.lifting.movement.events.Event.to_dict` by name."""
    source_label: str
    """Origin of the data."""


MAX_FRAMES, MAX_FRAMES_PER_S = 1500, 60
"""Largest number of frames of a page, in total and per second; of longer lifts every second, third, … frame is drawn."""
BALANCE = ("com_x_m", "com_y_m", "xcom_x_m", "xcom_y_m", "margin_of_stability_m", "smallest_impulse_N_s")
"""Columns of the course that the page shows."""


def body_columns(lift: LiftTables, frames: slice) -> dict[str, np.ndarray]:
    """Return the coordinates of all points and the ends of the pendulums at the drawn frames.

    The columns are ``time``; ``<POINT>_x``, ``_y``, ``_z`` in metres; and ``<com>/<plane>/across`` and ``/up``, the pivot plus
    ℓ(sin θ, cos θ) in the plane of the pendulum, NaN outside the deposit.
    """
    points = dict(points_of(lift.body))
    if lift.pivot is not None:
        points["PIVOT"] = lift.pivot
    time = lift.body["time_s"].to_numpy()[frames]
    columns = {"time": time}
    for name, values in points.items():
        for axis, part in zip("xyz", values[frames].T, strict=True):
            columns[f"{name}_{axis}"] = part.astype(np.float32)
    for (com, plane), rows in lift.states.groupby(["com", "plane"], sort=False):
        angle, length = (
            np.interp(time, rows["time_s"], rows[name], np.nan, np.nan) for name in ("angle_rad", "length_m")
        )
        ends = ("across", PLANES[plane], np.sin(angle)), ("up", 2, np.cos(angle))
        for name, axis, share in ends:
            end = lift.pivot[frames, axis] + length * share
            columns[f"{com}/{plane}/{name}"] = end.astype(np.float32)
    return columns


def centres(points) -> list[dict]:
    """Return the points of the known centres of mass with their names."""
    named = {com_of(com): com for com in COMS} | {WHOLE_BODY: "whole body", LOAD: "box"}
    return [{"point": point, "name": name} for point, name in named.items() if f"{point}_x_m" in points]


def balance_columns(course: pd.DataFrame, share: float, frames: slice) -> dict[str, np.ndarray]:
    """Return columns of the balance from above at the drawn frames; empty if the course has no balance.

    The columns are `BALANCE`, ``direction`` of the nearest edge, and the closed outlines ``base_x``, ``base_y``, ``used_x``,
    ``used_y`` of shape (frames, `CORNERS` + 1), NaN without a foot on the ground. `course` is the result of
    `lumbar.lifting.measures.course.course_of_lift`; people use a `share` of the base.
    """
    if BALANCE[-2] not in course:
        return {}
    drawn = course.iloc[frames]
    base = base_from_course(drawn)
    columns = {name: drawn[name].to_numpy(float) for name in BALANCE}
    columns["direction"] = drawn["margin_direction"].to_numpy(str)
    for name, part in {"base": base, "used": base.functional(share)}.items():
        # Convex hulls in order and closed; the last corner fills the rest.
        closed = np.full((len(part.corners), CORNERS + 1, 2), np.nan)
        for outline, points in zip(closed, map(corners_around, part.corners), strict=True):
            if len(points):
                outline[:] = np.vstack([points, *[points[:1]] * (CORNERS + 1 - len(points))])
        columns[f"{name}_x"], columns[f"{name}_y"] = np.moveaxis(closed, -1, 0)
    return columns


@dataclass(frozen=True, eq=False)
class PushedPendulum:
    """Data of one pendulum in closed loop about its trajectory, for a push in the page."""

    com: str
    plane: str
    constants: dict[str, float]
    """Constants in SI units: ``mass, length, inertia, damping, gravity_torque`` (with its sign), ``control_weight``,
    ``duration``, and the limits of the torque ``lowest`` and ``highest``."""
    columns: dict[str, np.ndarray]
    """Reference ``angle`` and ``velocity``, feedforward ``torque``, and ``s11``, ``s12``, ``s22`` of V = x̄ᵀSx̄ at the knots
    and halfway between them, shape (2·knots − 1,). The feedback is K = (s12, s22)/(inertia·control_weight)."""
    level: np.ndarray
    """Shape (knots,): ρ of the exact funnel of the loop without limits."""
    binds: bool
    """True if the torque exceeds its limits in the funnel."""

    @property
    def key(self) -> str:
        """Name of the pendulum in the page."""
        return f"{self.com}/{self.plane}"


def pushed_pendulums(
    states: LiftStates, settings: StabilitySettings
) -> tuple[list[PushedPendulum], list[Failure]]:
    """Return the closed loops of a lift in the headline's convention, with exact funnels, and the failures."""
    trajectories, failures = states.trajectories(headline(settings, states.facts))
    failures = list(failures)

    def push(items: list[Trajectory]) -> list[PushedPendulum]:
        loops = close_loops(items, settings.pendulum.sign, settings)
        level = exact_funnels(loops, settings.goal_level).level
        pendulums, reference = loops.pendulums, reference_of(loops.pendulums)
        cost = dict(zip(("s11", "s12", "s22"), np.moveaxis(loops.cost, -1, 0), strict=True))
        columns = {
            "angle": pendulums.angle,
            "velocity": reference.velocity,
            "torque": reference.torque,
            **cost,
        }
        pushed = []
        for index, item in enumerate(items):
            lowest, highest = torque_range(item, settings)
            constants = {
                "mass": item.mass_kg,
                "length": item.length_m,
                **{
                    name: getattr(pendulums, name)[index] for name in ("inertia", "damping", "gravity_torque")
                },
                "control_weight": loops.weights.control,
                "duration": item.duration,
                "lowest": lowest,
                "highest": highest,
            }
            pushed.append(
                PushedPendulum(
                    item.com,
                    item.plane,
                    {name: float(value) for name, value in constants.items()},
                    {name: np.ascontiguousarray(values[:, index]) for name, values in columns.items()},
                    np.ascontiguousarray(level[:, index]),
                    bool(exceeds(loops, level, reference, lowest, highest)[index]),
                )
            )
        return pushed

    computed = compute_together(push, trajectories, "exact funnel", failures)
    return [pendulum for _, some in computed for pendulum in some], failures
