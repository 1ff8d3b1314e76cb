"""What a body is before a marker is seen: landmarks of pelvis and thorax, joints, limbs, and how they scatter.

Axes of a part: right, forward, up, of a person standing; lengths are shares of stature. Levels of the spine and
lengths between markers are those of `lumbar.lifting.quality.landmarks`, depths of the trunk and all spreads are declared: the
prior is wide, and neighbours scatter together. Joint centres are the published regressions on the landmarks
(`lumbar.lifting.movement.joint_centres`), whose own error is added.
"""

from collections.abc import Mapping

import numpy as np

from lumbar.lifting.movement.joint_centres import (
    cervical_centre,
    harrington_hips,
    lumbosacral_centre,
    pelvis_of,
    thoracolumbar_centre,
)
from lumbar.lifting.quality.landmarks import LENGTHS, LEVELS, vertebra_level

TRUNK = LENGTHS["C7", "SACRUM"]
_SPINE_DEPTH = ((0.0, 0.37, 0.60, 0.80, 1.02), (-0.020, -0.015, -0.030, -0.020, 0.0))
"""How far the skin over the spine lies ahead of C7, by level: the kyphosis's top at T7."""


def _spine(region: str, number: int) -> tuple[float, float, float]:
    level = vertebra_level(region, number)
    return 0.0, float(np.interp(level, *_SPINE_DEPTH)), TRUNK * level


THORAX: dict[str, tuple[float, float, float]] = {
    "C7": (0.0, 0.0, TRUNK * LEVELS["C7"]),
    **{f"T{number}": _spine("T", number) for number in range(1, 13)},
    "MANUBRIUM": (0.0, 0.067, TRUNK * LEVELS["MANUBRIUM"]),
    "XIPHOID": (0.0, 0.092, TRUNK * LEVELS["XIPHOID"]),
    "L_SHOULDER": (-LENGTHS["L_SHOULDER", "R_SHOULDER"] / 2, 0.02, TRUNK * LEVELS["SHOULDER"]),
    "R_SHOULDER": (LENGTHS["L_SHOULDER", "R_SHOULDER"] / 2, 0.02, TRUNK * LEVELS["SHOULDER"]),
}
_ASIS_X, _PSIS_X, _DEPTH = LENGTHS["L_ASIS", "R_ASIS"] / 2, 0.028, 0.088
PELVIS: dict[str, tuple[float, float, float]] = {
    "L_ASIS": (-_ASIS_X, 0.0, 0.0),
    "R_ASIS": (_ASIS_X, 0.0, 0.0),
    "L_PSIS": (-_PSIS_X, -_DEPTH, 0.0),
    "R_PSIS": (_PSIS_X, -_DEPTH, 0.0),
    "SACRUM": (0.0, -_DEPTH - 0.003, -0.005),
    "L5": (0.0, -_DEPTH - 0.002, TRUNK * vertebra_level("L", 4)),
    "L_HIP": (-LENGTHS["L_HIP", "R_HIP"] / 2, -0.030, -0.060),
    "R_HIP": (LENGTHS["L_HIP", "R_HIP"] / 2, -0.030, -0.060),
}
NEEDED = {"thorax": ("C7", "T8", "T12", "MANUBRIUM"), "pelvis": ("L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS")}
"""Landmarks that the joints' regressions ask for; they belong to the model whether a marker shows them or not."""
TEMPLATES = {"pelvis": PELVIS, "thorax": THORAX}
LANDMARK_SD_M, LANDMARK_ALONE_SD_M, NEIGHBOURHOOD_M = 0.022, 0.007, 0.12
"""A landmark lies off the template by this standard deviation per axis, shared by neighbours at this distance, and by
the second alone (a finger's breadth beside the bone)."""
MIDLINE_SD_M = 0.006
"""Off the midline, of landmarks and joints that lie on it."""
JOINT_SD_M = {"C7T1": 0.0115, "T12L1": 0.0115, "L5S1": 0.0115, "L_HIP_CENTRE": 0.0122, "R_HIP_CENTRE": 0.0122}
"""Error of the regressions per axis: 20 mm in space for the spine, 15 mm for the middle of the hips (declared and
published errors of `lumbar.lifting.movement.joint_centres`)."""
PLACEMENT_SD_M = 0.006
"""A marker lies beside its bone by this, per axis (palpation; declared)."""
LEVEL_SD_M = 0.008
"""L4/L5 off its place on the line from L5/S1 to T12/L1, per axis: lumbar lordosis (declared)."""
LUMBAR_LENGTH, LUMBAR_LENGTH_SD, LUMBAR_STRETCH_SD_M = 0.095, 0.012, 0.025
"""L5/S1 to T12/L1 as a share of stature, its spread, and how far the chord changes as the spine bends."""
SOFT_TISSUE_SD_M = {"L_SHOULDER": 0.015, "R_SHOULDER": 0.015, "L_HIP": 0.012, "R_HIP": 0.012, "L5": 0.008}
"""Movement of skin and shoulder girdle against the part; other landmarks `SKIN_SD_M`."""
SKIN_SD_M, RIDER_SD_M, BOX_SD_M = 0.005, 0.012, 0.001
"""Riders are markers without a known landmark, as on shoulder blades and arms that happen to keep still."""
SKIN_CORRELATION_S, JOINT_CORRELATION_S = 0.5, 2.0
"""How long skin stays displaced, before the residuals themselves say so, and how long soft joints do: a posture."""
LIMBS = (
    ("SHOULDER", "ELBOW", 0.010),
    ("ELBOW", "WRIST", 0.008),
    ("HIP_CENTRE", "KNEE", 0.015),
    ("KNEE", "ANKLE", 0.010),
    ("ANKLE", "HEEL", 0.003),
    ("HEEL", "TOE", 0.006),
    ("ANKLE", "TOE", 0.006),
)
"""Points of each side whose distance stays what it is, but for this standard deviation."""
POINTS = ("SHOULDER", "ELBOW", "WRIST", "KNEE", "ANKLE", "HEEL", "TOE")
POINT_NOISE_SD_M = 0.001
"""Noise of the marker of a limb: the marker itself is the point."""
GIRDLE_SD_M, GRIP_SD_M = 0.030, 0.012
"""Shoulder against the thorax, hand against the box while it is held."""


def landmark_covariance(places: np.ndarray) -> np.ndarray:
    """Covariance of landmarks about their template along one axis, shape (m, m) in m², from places of shape (m, 3)."""
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    shared = LANDMARK_SD_M**2 * np.exp(-((distance / NEIGHBOURHOOD_M) ** 2) / 2)
    return shared + LANDMARK_ALONE_SD_M**2 * np.eye(len(places))


def joints_of(part: str, landmarks: Mapping[str, np.ndarray], sex: str) -> dict[str, np.ndarray]:
    """Joint centres of a part, pelvis or thorax, by the regressions on its landmarks of `NEEDED`; shape (3,), in any axes."""
    at = {name: np.asarray(landmarks[name])[None] for name in NEEDED[part]}
    if part == "thorax":
        c7, above, t12, front = (at[name] for name in NEEDED[part])
        return {
            "C7T1": cervical_centre(c7, front, t12, sex)[0],
            "T12L1": thoracolumbar_centre(t12, above, c7, front, sex)[0],
        }
    pelvis = pelvis_of(at["L_ASIS"], at["R_ASIS"], (at["L_PSIS"] + at["R_PSIS"]) / 2)
    forward, up, right = harrington_hips(pelvis)
    return {
        "L5S1": lumbosacral_centre(pelvis, sex)[0],
        "L_HIP_CENTRE": pelvis.point(forward, up, -right)[0],
        "R_HIP_CENTRE": pelvis.point(forward, up, right)[0],
    }
