"""Posture of the trunk: how far it leans, and how far the lumbar spine is bent between thorax and pelvis."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.movement.joint_centres import unit

UPRIGHT_SHARE = 5.0
"""Percentage of the recording in which the trunk is straightest: there the lumbar spine counts as not bent."""
UPRIGHT_DEG = 15.0
"""A trunk that always leans further than this never stands upright."""


def horizontal_axes(right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors to the person's right and forward in the plane of the ground, each of shape (n, 3)."""
    across = unit(right * [1.0, 1.0, 0.0])
    return across, np.cross([0.0, 0.0, 1.0], across)


def inclination(line: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Angle of a line from straight up in the vertical plane of a horizontal direction, degrees, positive towards it.

    Parameters
    ----------
    line : ndarray, shape (n, 3)
        From below to above, any length.
    towards : ndarray, shape (n, 3)
        Horizontal unit vectors.
    """
    return np.degrees(np.arctan2(np.einsum("nj,nj->n", line, towards), line[:, 2]))


def lumbar_flexion(
    thorax: np.ndarray, pelvis: np.ndarray, trunk: np.ndarray, forward: np.ndarray
) -> np.ndarray:
    """Angle between thorax and pelvis in the sagittal plane beyond that of standing upright, degrees, flexion positive.

    As Plamondon et al. (2010) measure the flexion of the lumbar region. Zero is the mean over the straightest `UPRIGHT_SHARE`
    per cent of the recording.

    Parameters
    ----------
    thorax, pelvis, trunk : ndarray, shape (n, 3)
        Lines T12/L1 to C7/T1, middle of the hips to L5/S1, and the latter to C7/T1.
    forward : ndarray, shape (n, 3)
        Horizontal unit vectors.

    Raises
    ------
    InputError
        If the person never stands upright.
    """
    bend = inclination(thorax, forward) - inclination(pelvis, forward)
    lean = np.abs(inclination(trunk, forward))
    seen = np.isfinite(bend) & np.isfinite(lean)
    if not seen.any():
        raise InputError("thorax and pelvis are never seen together")
    straightest = np.percentile(lean[seen], UPRIGHT_SHARE)
    if straightest > UPRIGHT_DEG:
        raise InputError(
            f"the trunk never stands upright (it leans {straightest:.0f}° at least): zero of the lumbar spine is not known"
        )
    return bend - bend[seen & (lean <= straightest)].mean()
