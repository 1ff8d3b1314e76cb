"""Centre of mass of the whole body from the trunk's and the limbs' markers, for comparison with force plates."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.centre_of_mass import segment_centres, trunk_centre
from lumbar.lifting.movement.segments import SegmentTable
from lumbar.lifting.movement.trunk_points import MID_HIP, TrunkPoints
from lumbar.records.markers import MarkerRecording

TRUNK_SHARE, HEAD_SHARE = 0.497, 0.081
"""Masses of trunk, and of head with neck, as shares of the body's (Winter, 2009, Table 4.1)."""
HEAD_BEYOND = 0.35
"""The ear canal, centre of head and neck, lies beyond C7/T1 by this share of the line from the hips to C7/T1."""
ARM = (("SHOULDER", "ELBOW", 0.028, 0.436), ("ELBOW", "WRIST", 0.022, 0.682))
_LEG = ((MID_HIP, "KNEE", 0.100, 0.433), ("KNEE", "ANKLE", 0.061, 0.606))
STRAIGHT_ARM, _STRAIGHT_LEG = ("SHOULDER", "WRIST", 0.050, 0.530), (MID_HIP, "ANKLE", 0.161, 0.447)
"""Segments of each side with mass and place of the centre (Winter, 2009, Table 4.1); straight ones where no marker shows
the joint between."""


def head_centre(points: TrunkPoints) -> np.ndarray:
    """Centre of head and neck, shape (n, 3) in metres, from C7/T1 and the middle of the hips."""
    return points["C7T1"] + HEAD_BEYOND * (points["C7T1"] - points[MID_HIP])


def whole_body_centre(recording: MarkerRecording, points: TrunkPoints, table: SegmentTable) -> np.ndarray:
    """Centre of mass of the whole body without the box, shape (n, 3) in metres.

    The trunk is that of the segment table; head and limbs have Winter's shares between markers of the joints.

    Parameters
    ----------
    recording : MarkerRecording
        With shoulders, wrists and ankles of both sides; elbows and knees are used where they are there.

    Raises
    ------
    InputError
        Naming what is missing.
    """
    names = {f"{side}_{name}" for side in "LR" for name in ("SHOULDER", "WRIST", "ANKLE")}
    lacking = sorted(name for name in names if name not in recording)
    lacking += [f"{name} ({points.missing[name]})" for name in ("C7T1", MID_HIP) if name not in points]
    if lacking:
        raise InputError(f"no {', '.join(lacking)}")
    trunk = trunk_centre(segment_centres(points, table), table)
    moment = TRUNK_SHARE * trunk + HEAD_SHARE * head_centre(points)
    for side in "LR":
        elbow, knee = (f"{side}_{joint}" in recording for joint in ("ELBOW", "KNEE"))
        parts = (*(ARM if elbow else (STRAIGHT_ARM,)), *(_LEG if knee else (_STRAIGHT_LEG,)))
        for start, end, mass, share in parts:
            first = points[MID_HIP] if start == MID_HIP else recording[f"{side}_{start}"]
            moment = moment + mass * (first + share * (recording[f"{side}_{end}"] - first))
    return moment
