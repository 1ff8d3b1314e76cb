"""Rigid motions of many instants at once."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def exponential(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices, shape (..., 3, 3), of rotation vectors, shape (..., 3)."""
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)


def logarithm(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors, shape (..., 3), of rotation matrices, shape (..., 3, 3)."""
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec().reshape(matrices.shape[:-1])


def cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Matrices of the cross product with vectors from the left, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def weighted_poses(
    shape: np.ndarray, frames: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift that lay a shape on frames (Kabsch, Acta Crystallogr. A 32 (1976) 922-923).

    Parameters
    ----------
    shape : ndarray, shape (m, 3)
    frames : ndarray, shape (n, m, 3)
        Finite wherever the weight is positive.
    weights : ndarray, shape (n, m)

    Returns
    -------
    rotations, shifts : ndarray, shapes (n, 3, 3) and (n, 3)
        NaN where the weighted points tell no turning: too few, or on a line.
    """
    total = weights.sum(axis=1)
    share = weights / np.where(total > 0, total, 1.0)[:, None]
    seen = np.where(weights[..., None] > 0, frames, 0.0)
    middle, centre = share @ shape, np.einsum("nm,nmi->ni", share, seen)
    apart = shape[None] - middle[:, None]
    covariance = np.einsum("nm,nmi,nmj->nij", share, seen - centre[:, None], apart)
    left, _, right = np.linalg.svd(covariance)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    rotations = left @ right
    spread = np.linalg.svd(np.sqrt(share)[..., None] * apart, compute_uv=False)
    blind = (np.count_nonzero(weights > 1e-3, axis=1) < 3) | (spread[:, 1] < FLATTEST_M)
    rotations[blind] = np.nan
    return rotations, centre - np.einsum("nij,nj->ni", rotations, middle)


FLATTEST_M = 0.015
"""Least spread across the line that points lie nearest to: less tells no turning about it."""


def bridged(
    time: np.ndarray, rotations: np.ndarray, shifts: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fill unknown poses from the nearest known ones, evenly in time; None where none is known."""
    known = np.isfinite(rotations).all(axis=(1, 2))
    if not known.any():
        return None
    if known.sum() == 1:
        return np.repeat(rotations[known], len(time), axis=0), np.repeat(shifts[known], len(time), axis=0)
    inside = np.clip(time, time[known][0], time[known][-1])
    turned = Slerp(time[known], Rotation.from_matrix(rotations[known]))(inside).as_matrix()
    moved = np.stack([np.interp(time, time[known], axis) for axis in shifts[known].T], axis=1)
    return turned, moved
