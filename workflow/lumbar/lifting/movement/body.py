"""The whole body as it moves during a lift: joints, feet, hands, load and centres of mass, in the axes of the planes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.carried_object import carried_object
from lumbar.lifting.movement.centre_of_mass import held_frames, segment_centres
from lumbar.lifting.movement.events import phases
from lumbar.lifting.movement.segments import COMS
from lumbar.lifting.movement.trunk_points import MID_HIP
from lumbar.lifting.movement.whole_body import head_centre, whole_body_centre

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.lifting.movement.lift import AnalysedLift

LIMBS = tuple(
    f"{side}_{name}"
    for side in "LR"
    for name in ("SHOULDER", "ELBOW", "WRIST", "KNEE", "ANKLE", "HEEL", "TOE")
)
TRUNK = ("C7T1", "T12L1", "L4L5", "L5S1", MID_HIP)
WHOLE_BODY, HEAD, LOAD = "WHOLE_BODY", "HEAD", "LOAD"
DECIMALS = 7
"""Of metres in the file: second differences of what is rounded off stay below 0.01 m/s² at 200 frames per second."""


def body_frame(lift: AnalysedLift) -> tuple[pd.DataFrame, dict[str, str]]:
    """Trajectories of the body's points over the whole recording, and which are missing, each with its reason.

    Returns
    -------
    frame : pandas.DataFrame
        ``time_s``, ``phase``, ``load_held`` (0 or 1), ``RIGHT_x`` … (unit vector to the person's right), and for every point
        ``<POINT>_x_m``, ``_y_m``, ``_z_m``: x to the right, y forward, z up; empty where a marker was not seen. Points are
        the markers of `LIMBS`, the joint centres of `TRUNK`, the centres of mass of trunk segments (``THORAX_COM`` …), of
        ``HEAD`` and ``WHOLE_BODY`` without the load, and the ``LOAD`` in the hands.
    missing : dict of str to str
        Points that the recording does not hold.
    """
    import pandas as pd

    recording, points = lift.recording, lift.points
    found = {name: recording[name] for name in LIMBS if name in recording}
    missing = {name: f"no marker {name}" for name in LIMBS if name not in recording}
    found.update({name: points[name] for name in TRUNK if name in points})
    missing.update({name: points.missing[name] for name in TRUNK if name not in points})
    segments = segment_centres(points, lift.table)
    found.update({com_of(name): values for name, values in segments.items()})
    missing.update({com_of(name): lift.missing[name] for name in COMS if name not in segments})
    ends = [name for name in ("C7T1", MID_HIP) if name not in points]
    if ends:
        missing[HEAD] = f"no {', '.join(ends)}"
    else:
        found[HEAD] = head_centre(points)
    try:
        found[WHOLE_BODY] = whole_body_centre(recording, points, lift.table)
    except InputError as error:
        missing[WHOLE_BODY] = str(error)
    load, _ = carried_object(recording)
    if load is None:
        missing[LOAD] = "no markers on the box and none on the wrists"
    else:
        found[LOAD] = load
    held = held_frames(recording.time, lift.events).astype(int)
    columns = {"time_s": recording.time, "phase": phases(recording.time, lift.events), "load_held": held}
    columns.update({f"RIGHT_{axis}": values for axis, values in zip("xyz", points.right.T, strict=True)})
    for name, values in found.items():
        columns.update({f"{name}_{axis}_m": part for axis, part in zip("xyz", values.T, strict=True)})
    frame = pd.DataFrame(columns)
    exact = ["time_s", "phase", "load_held"]
    return pd.concat([frame[exact], frame.drop(columns=exact).round(DECIMALS)], axis=1), missing


def com_of(segment: str) -> str:
    """Name of the point that is a trunk segment's centre of mass."""
    return f"{segment.upper()}_COM"


def points_of(frame: pd.DataFrame) -> dict[str, np.ndarray]:
    """Points of a `body_frame` by name, each of shape (n, 3) in metres."""
    names = [column.removesuffix("_x_m") for column in frame.columns if column.endswith("_x_m")]
    return {name: frame[[f"{name}_{axis}_m" for axis in "xyz"]].to_numpy(dtype=float) for name in names}
