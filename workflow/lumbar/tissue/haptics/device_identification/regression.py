"""Where the fit of a haptic device begins: a linear regression on its equation of motion, integrated twice.

m x + b ∫x + F ∫∫sign(ẋ) − f₀ ∫∫1 = ∫∫f(t − τ) + a + c t in each stretch, so that nothing that was read is differentiated but
for the direction of the motion. Where the stylus rests friction balances all forces, and none is counted.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lumbar.tissue.haptics.device_identification.free_motion import free_motion
from lumbar.tissue.haptics.device_identification.stretches import MARGIN, Stretches

_LATEST = (-2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, MARGIN - 2)
"""Delays that are tried, in samples, each with any part of the time to the next one."""
_LEAST = 1e-5
"""Mass in kg and damping in N·s/m to begin with at least."""


def regress(stretches: Stretches) -> np.ndarray:
    """Return the parameters that were found at each delay, the nearest motion first; shape (delays, 6), without a spring."""
    from scipy.optimize import lsq_linear

    step, velocity = stretches.step, stretches.velocity[stretches.ticks]
    moving, way = velocity != 0.0, stretches.readings - stretches.readings[0]

    def twice(values: np.ndarray) -> np.ndarray:
        """Integral of what is held from sample to sample and acts while the stylus moves."""
        once = np.cumsum(values * moving, axis=0) - values * moving
        return step**2 * (np.cumsum(once, axis=0) - 0.5 * once)

    columns = [
        way,
        step * (np.cumsum(way, axis=0) - 0.5 * way),
        twice(np.sign(velocity)),
        twice(-1.0 * moving),
    ]
    found = []
    for late, later in pairwise(_LATEST):
        first, second = (twice(stretches.forces[stretches.ticks - item]) for item in (late, later))
        whole = _apart_from_lines(np.stack([*columns, first - second, first], axis=-1)).reshape(-1, 6)
        sizes = np.sqrt((whole**2).sum(axis=0)) + np.finfo(float).tiny
        # Of the triangle the last column is what the others should add up to.
        triangle = np.linalg.qr(whole / sizes, mode="r")
        limits = np.array([[_LEAST, _LEAST, 0.0, -np.inf, 0.0], [np.inf, np.inf, np.inf, np.inf, 1.0]])
        solved = lsq_linear(triangle[:, :5], triangle[:, 5], limits * sizes[:5] / sizes[5]).x
        *dynamic, offset, part = solved * sizes[5] / sizes[:5]
        found.append([*dynamic, step * (late + part * (later - late)), offset, 0.0])
    sets = np.array(found).T
    starts = np.repeat(stretches.velocity[stretches.starts][:, None], sets.shape[1], axis=1)
    left = _apart_from_lines(stretches.readings[..., None] - free_motion(stretches, sets, starts))
    return sets.T[np.argsort((left**2).sum(axis=(0, 1)))]


def _apart_from_lines(values: np.ndarray) -> np.ndarray:
    """What a straight line in each stretch leaves of values of shape (length, stretches, n)."""
    lines = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(values)), 2))[0]
    return values - np.tensordot(lines, np.tensordot(lines.T, values, axes=1), axes=1)
