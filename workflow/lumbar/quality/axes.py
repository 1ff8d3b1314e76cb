"""Which axes of a file point up and forward, by the body in it."""

from __future__ import annotations

import numpy as np

from lumbar.quality.body import rightward, trunk_axis
from lumbar.settings.layout import Axis

AXES: tuple[tuple[Axis, Axis], ...] = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))


def axes_found(points: dict[str, np.ndarray], named: dict[str, str]) -> tuple[Axis, Axis] | None:
    """Return the signed axes up and forward, e.g. ``("+y", "+x")``, in the axes the points are given in.

    Up is where the shoulders are above the pelvis, forward where neither up nor to the right is. None where the labels name
    no trunk, no sides, or the person lies so that one axis is both.
    """
    trunk = trunk_axis(points, named)
    if trunk is None:
        return None
    up = np.nanmedian(trunk[1], axis=0)
    sides, depths = rightward(points, named)
    votes = [*sides.values(), *depths.values()]
    if not votes or not np.isfinite(up).all():
        return None
    right = np.nanmedian(np.nansum(votes, axis=0), axis=0)
    vertical = _signed(up)
    forward = _signed(np.cross(up, right))
    return None if vertical[1] == forward[1] else (vertical, forward)


def _signed(vector: np.ndarray) -> Axis:
    largest = int(np.abs(vector).argmax())
    return AXES[largest][int(vector[largest] > 0)]
