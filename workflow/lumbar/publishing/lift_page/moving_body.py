"""A moving body as it is drawn, frame by frame: limbs, centres of mass, pendulums, and the base of support below."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.measures.balance import BaseOfSupport
from lumbar.lifting.measures.course import CORNERS
from lumbar.lifting.movement.body import HEAD, LOAD, WHOLE_BODY, com_of, points_of
from lumbar.lifting.movement.pendulum_states import PLANES
from lumbar.lifting.movement.segments import COMS
from lumbar.lifting.movement.trunk_points import MID_HIP

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.publishing.lift_page.recorded_lift import RecordedLift

MOST_FRAMES, MOST_PER_SECOND = 1500, 60
"""Frames that a page draws, and how many of a second: of others every second, third, … is drawn."""
LEFT, RIGHT, MIDDLE = "left", "right", "middle"
_LIMBS = (("SHOULDER", "ELBOW", "WRIST"), ("KNEE", "ANKLE"), ("ANKLE", "HEEL", "TOE", "ANKLE"))
_TRUNK = (HEAD, "C7T1", "T12L1", "L4L5", "L5S1", MID_HIP)
BALANCE = ("com_x_m", "com_y_m", "xcom_x_m", "xcom_y_m", "margin_of_stability_m", "smallest_impulse_N_s")
"""Columns of the course that the page shows."""


def drawn_frames(time: np.ndarray) -> slice:
    """Which frames are drawn: evenly spaced from the first on."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    return slice(None, None, max(1, math.ceil(rate / MOST_PER_SECOND), math.ceil(len(time) / MOST_FRAMES)))


def chains(points) -> list[dict]:
    """Lines of the stick figure through the points that there are, each with its side."""
    lines = [(MIDDLE, [name for name in _TRUNK if name in points])]
    for side, letter in ((LEFT, "L"), (RIGHT, "R")):
        limbs = [[f"{letter}_{name}" for name in limb] for limb in _LIMBS]
        limbs[0].insert(0, "C7T1")
        limbs[1].insert(0, MID_HIP)
        lines += [(side, [name for name in limb if name in points]) for limb in limbs]
    return [{"side": side, "points": line} for side, line in lines if len(set(line)) > 1]


def body_columns(lift: RecordedLift, frames: slice) -> dict[str, np.ndarray]:
    """Coordinates of all points at the frames that are drawn: ``<POINT>_x``, ``_y``, ``_z`` in metres."""
    points = dict(points_of(lift.body))
    if lift.pivot is not None:
        points["PIVOT"] = lift.pivot
    columns = {
        f"{name}_{axis}": part.astype(np.float32)
        for name, values in points.items()
        for axis, part in zip("xyz", values[frames].T, strict=True)
    }
    return {"time": lift.body["time_s"].to_numpy()[frames], **columns, **_pendulum_ends(lift, frames)}


def _pendulum_ends(lift: RecordedLift, frames: slice) -> dict[str, np.ndarray]:
    """Ends of the pendulums in their planes: pivot plus ℓ(sin θ, cos θ); NaN outside the deposit."""
    time = lift.body["time_s"].to_numpy()[frames]
    columns = {}
    for (com, plane), rows in lift.states.groupby(["com", "plane"], sort=False):
        at, angle, length = (rows[name].to_numpy() for name in ("time_s", "angle_rad", "length_m"))
        theta, reach = (np.interp(time, at, values, np.nan, np.nan) for values in (angle, length))
        across = lift.pivot[frames, PLANES[plane]]
        columns[f"{com}/{plane}/across"] = (across + reach * np.sin(theta)).astype(np.float32)
        columns[f"{com}/{plane}/up"] = (lift.pivot[frames, 2] + reach * np.cos(theta)).astype(np.float32)
    return columns


def centres(points) -> list[dict]:
    """Centres of mass that there are, with what they are called."""
    named = {com_of(com): com for com in COMS} | {WHOLE_BODY: "whole body", LOAD: "box"}
    return [{"point": point, "name": name} for point, name in named.items() if f"{point}_x_m" in points]


def balance_columns(course: pd.DataFrame, share: float, frames: slice) -> dict[str, np.ndarray]:
    """What is seen from above, at the frames that are drawn; nothing where the course has no balance.

    Parameters
    ----------
    course : pandas.DataFrame
        As of `lumbar.lifting.measures.course.course_of_lift`.
    share : float
        Share of the base that people use.

    Returns
    -------
    dict of str to numpy.ndarray
        `BALANCE`, ``direction`` of the nearest edge, and outlines ``base_x``, ``base_y``, ``used_x``, ``used_y`` of
        shape (frames, `CORNERS` + 1), closed, NaN where no foot is on the ground.
    """
    if BALANCE[-2] not in course:
        return {}
    drawn = course.iloc[frames]
    corners = np.stack(
        [drawn[[f"base_{i}_{axis}_m" for axis in "xy"]].to_numpy(float) for i in range(1, CORNERS + 1)],
        axis=1,
    )
    base = BaseOfSupport(corners, np.isfinite(corners).all(axis=2))
    outlines = {"base": base, "used": base.functional(share)}
    columns = {name: drawn[name].to_numpy(float) for name in BALANCE}
    columns["direction"] = drawn["margin_direction"].to_numpy(str)
    for name, part in outlines.items():
        closed = np.stack([_outline(points) for points in part.corners])
        columns[f"{name}_x"], columns[f"{name}_y"] = np.moveaxis(closed, -1, 0)
    return columns


def _outline(points: np.ndarray) -> np.ndarray:
    """Convex hull of known points in order and closed, shape (`CORNERS` + 1, 2); its last corner fills the rest."""
    from scipy.spatial import ConvexHull, QhullError

    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.full((CORNERS + 1, 2), np.nan)
    with suppress(QhullError, ValueError):  # all on a line, or fewer than three: drawn as they are
        points = points[ConvexHull(points).vertices]
    return np.vstack([points, *[points[:1]] * (CORNERS + 1 - len(points))])
