"""Joint centres of pelvis and spine, estimated from markers on the skin by published regressions.

Axes of the pelvis: right along the line from the left to the right anterior superior iliac spine (ASIS), up normal to
the plane of both ASIS and the middle of the posterior ones (PSIS), forward across both. Its origin is the middle of the
ASIS. Regressions for one sex take the mean of both rows where the sex is not known.

Sources
-------
Harrington et al., J. Biomech. 40 (2007) 595-602 (hips; magnetic resonance images of 32 people).
Hara et al., Sci. Rep. 6 (2016) 37707 (hips; computed tomography of 180 people).
Reed, Manary and Schneider, SAE 1999-01-0959 (hips, L5/S1, T12/L1, C7/T1), in the axes above as tabulated by
Dumas and Wojtusch, Estimation of the body segment inertial parameters, Handbook of Human Motion (Springer, 2018).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError

HIP_RULES = ("harrington", "hara", "reed")
_HIPS = {"male": (-0.095, -0.370, 0.361), "female": (-0.139, -0.336, 0.372)}
_LUMBOSACRAL = {"male": (-0.335, -0.032), "female": (-0.340, 0.049)}
"""Forward and up of the middle of the ASIS, shares of the pelvis's width; hips also to the right."""
_THORACOLUMBAR = {"male": (94.0, 0.52), "female": (92.0, 0.50)}
"""Angle from the line T12-T8 towards the front, degrees, and share of the thorax's width C7-suprasternale."""
_CERVICAL = {"male": (8.0, 0.55), "female": (14.0, 0.53)}
"""Angle from the line C7-suprasternale upwards, degrees, and share of its length."""


@dataclass(frozen=True)
class Pelvis:
    """Axes and size of the pelvis; arrays of shape (n, 3)."""

    origin: np.ndarray
    """Middle of the ASIS, metres."""
    forward: np.ndarray
    up: np.ndarray
    right: np.ndarray
    """`forward`, `up`, `right`: unit vectors."""
    width: float
    depth: float
    """`width`, `depth`: distance of the ASIS from each other and of their middle from that of the PSIS: medians over time,
    metres."""

    def point(self, forward: float, up: float, right: float = 0.0) -> np.ndarray:
        """Trajectory, shape (n, 3), of a point of the pelvis, in metres along its axes."""
        return self.origin + forward * self.forward + up * self.up + right * self.right


def pelvis_of(
    left_asis: np.ndarray, right_asis: np.ndarray, middle_of_psis: np.ndarray, source: str = ""
) -> Pelvis:
    """Axes and size of the pelvis from trajectories of its markers, each of shape (n, 3) in metres.

    Raises
    ------
    InputError
        If the markers are never seen together.
    """
    origin = (left_asis + right_asis) / 2
    right = unit(right_asis - left_asis)
    up = unit(np.cross(right_asis - middle_of_psis, left_asis - middle_of_psis))
    width = typical_distance(left_asis, right_asis)
    depth = typical_distance(origin, middle_of_psis)
    if not np.isfinite(up).any():
        raise InputError(f"{source}: the markers of the pelvis (ASIS, PSIS) are never seen together")
    return Pelvis(origin, np.cross(up, right), up, right, width, depth)


def harrington_hips(pelvis: Pelvis) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre in metres (Harrington et al. 2007).

    The published equations that need no length of the leg, with pelvic depth PD and width PW in millimetres:
    -0.24 PD - 9.9, -0.30 PW - 10.9, 0.33 PW + 7.3.
    """
    return (
        -0.24 * pelvis.depth - 0.0099,
        -0.30 * pelvis.width - 0.0109,
        0.33 * pelvis.width + 0.0073,
    )


def hara_hips(leg_length: float) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre from the leg's length, metres (Hara et al. 2016).

    The leg's length is that from ASIS to medial malleolus, LL in millimetres: 11 - 0.063 LL, -9 - 0.078 LL,
    8 + 0.086 LL.
    """
    return (0.011 - 0.063 * leg_length, -0.009 - 0.078 * leg_length, 0.008 + 0.086 * leg_length)


def reed_hips(pelvis: Pelvis, sex: str) -> tuple[float, float, float]:
    """Forward, up and rightward coordinate of the right hip's centre in metres (Reed et al. 1999)."""
    forward, up, right = (share * pelvis.width for share in _row(_HIPS, sex))
    return forward, up, right


def lumbosacral_centre(pelvis: Pelvis, sex: str) -> np.ndarray:
    """Centre of L5/S1, shape (n, 3) in metres (Reed et al. 1999)."""
    return pelvis.point(*(share * pelvis.width for share in _row(_LUMBOSACRAL, sex)))


def cervical_centre(c7: np.ndarray, suprasternale: np.ndarray, below: np.ndarray, sex: str) -> np.ndarray:
    """Centre of C7/T1, shape (n, 3) in metres (Reed et al. 1999).

    Parameters
    ----------
    c7, suprasternale : ndarray, shape (n, 3)
        Markers, metres.
    below : ndarray, shape (n, 3)
        A marker of the spine further down, which gives the sagittal plane.
    sex : {"male", "female", "unknown"}
    """
    angle, share = _row(_CERVICAL, sex)
    forward = unit(suprasternale - c7)
    up = np.cross(_rightward(c7, suprasternale, below), forward)
    return c7 + share * typical_distance(c7, suprasternale) * _turned(forward, up, angle)


def thoracolumbar_centre(
    t12: np.ndarray, above: np.ndarray, c7: np.ndarray, suprasternale: np.ndarray, sex: str
) -> np.ndarray:
    """Centre of T12/L1, shape (n, 3) in metres (Reed et al. 1999).

    Parameters
    ----------
    t12, c7, suprasternale : ndarray, shape (n, 3)
        Markers, metres.
    above : ndarray, shape (n, 3)
        T8; with C7 in its place the point is moved along the spine by about the sine of the angle between both lines.
    sex : {"male", "female", "unknown"}
    """
    angle, share = _row(_THORACOLUMBAR, sex)
    up = unit(above - t12)
    forward = np.cross(up, _rightward(c7, suprasternale, t12))
    return t12 + share * typical_distance(c7, suprasternale) * _turned(up, forward, angle)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length one, shape (n, 3); NaN where a vector has no length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)


def typical_distance(start: np.ndarray, end: np.ndarray) -> float:
    """Median over time of the distance of two trajectories: a size of the body."""
    distance = np.linalg.norm(end - start, axis=-1)
    seen = distance[np.isfinite(distance)]
    return float(np.median(seen)) if seen.size else np.nan


def _rightward(c7: np.ndarray, suprasternale: np.ndarray, below: np.ndarray) -> np.ndarray:
    return unit(np.cross(suprasternale - c7, c7 - below))


def _turned(start: np.ndarray, towards: np.ndarray, angle_deg: float) -> np.ndarray:
    angle = np.deg2rad(angle_deg)
    return np.cos(angle) * start + np.sin(angle) * towards


def _row(table: Mapping[str, tuple[float, ...]], sex: str) -> tuple[float, ...]:
    if sex in table:
        return table[sex]
    return tuple(float(np.mean(values)) for values in zip(*table.values(), strict=True))
