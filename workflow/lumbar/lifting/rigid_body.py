"""Markers of one rigid body: where one is not seen for a while, the others say where it is."""

from __future__ import annotations

import numpy as np

NEEDED = 3
"""Markers that place a rigid body."""
_FLAT = 0.1
"""Second over first spread of the markers seen below which they lie on a line, and the body may turn about it."""


def carried_by_the_body(markers: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Fill unseen frames of markers of one rigid body from the other markers of the same frame.

    The body's shape is the mean over the frames with all markers; it is laid on the markers seen by least squares
    (Arun, Huang and Blostein, IEEE Trans. Pattern Anal. Mach. Intell. 9 (1987) 698-700).

    Parameters
    ----------
    markers : dict of str to ndarray, shape (n, 3)
        NaN where a marker was not seen.

    Returns
    -------
    filled : dict of str to ndarray, shape (n, 3)
        Frames seen are unchanged.
    frames : dict of str to int
        Frames filled, of the markers that have any.
    """
    stack = np.array(list(markers.values()))
    seen = np.isfinite(stack).all(axis=2)
    complete = np.flatnonzero(seen.all(axis=0))
    partial = np.flatnonzero((seen.sum(axis=0) >= NEEDED) & ~seen.all(axis=0))
    if not complete.size or not partial.size:
        return markers, {}
    shape = _mean_shape(stack[:, complete])
    filled = stack.copy()
    # Few sets of markers are seen together, each in many frames.
    for there in np.unique(seen[:, partial], axis=1).T:
        if _on_a_line(shape[there]):
            continue
        frames = np.flatnonzero((seen == there[:, None]).all(axis=0))
        rotations, shifts = _laid_on(shape[there], stack[np.ix_(there, frames)])
        placed = np.einsum("nij,mj->mni", rotations, shape[~there]) + shifts
        filled[np.ix_(~there, frames)] = placed
    gained = np.isfinite(filled).all(axis=2).sum(axis=1) - seen.sum(axis=1)
    named = zip(markers, gained, strict=True)
    return dict(zip(markers, filled, strict=True)), {name: int(count) for name, count in named if count}


def _mean_shape(stack: np.ndarray) -> np.ndarray:
    """Mean of a body's shape over frames, shape (markers, 3), each laid on the first; `stack` is (markers, n, 3)."""
    # Some hundred frames are enough for a mean.
    stack = stack[:, np.unique(np.linspace(0, stack.shape[1] - 1, 200).astype(int))]
    rotations, shifts = _laid_on(stack[:, 0], stack)
    return np.mean(np.einsum("nji,mnj->mni", rotations, stack - shifts), axis=1)


def _on_a_line(points: np.ndarray) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < _FLAT * spread[0])


def _laid_on(points: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 3, 3) and shifts (n, 3) that bring `points` (markers, 3) onto `targets` (markers, n, 3)."""
    centre, goals = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd(np.einsum("mi,mnj->nij", points - centre, targets - goals))
    v, ut = np.swapaxes(vt, 1, 2), np.swapaxes(u, 1, 2)
    # A mirrored body is none: its third axis turns round.
    v[:, :, 2] *= np.sign(np.linalg.det(v @ ut))[:, None]
    rotations = v @ ut
    return rotations, goals - rotations @ centre
