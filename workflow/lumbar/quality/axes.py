"""Which axes of a file point up and forward, by the body in it."""

from __future__ import annotations

import os

import numpy as np

from lumbar.quality.body import rightward, trunk_axis
from lumbar.quality.landmarks import landmarks
from lumbar.records.marker_axes import check_up, upright
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import Axis, MarkerLayout

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


def read_upright(path: str | os.PathLike, layout: MarkerLayout) -> MarkerRecording:
    """Read a marker file as `lumbar.records.markers.read_markers` does, and compare `markers.up` by all usual labels.

    Raises
    ------
    InputError
        As `read_markers`; and where the body stands along another axis than `markers.up`.
    """
    measured: dict[str, np.ndarray] = {}

    def kept(points: dict[str, np.ndarray], time: np.ndarray, rate: float):
        measured.update(points)
        return points, {}

    recording = read_markers(path, layout, screen=kept)
    check_unaliased_up(measured, recording, layout)
    return recording


def check_unaliased_up(
    points: dict[str, np.ndarray], recording: MarkerRecording, layout: MarkerLayout
) -> None:
    """Raise where no alias tells which way the body stands, but usual labels do, and it is not up.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Measured markers by the file's labels, turned by the declared axes.
    recording : MarkerRecording
        The same under standard names.

    Raises
    ------
    InputError
    """
    if not layout.check_axes or upright(recording.positions) is not None:
        return
    body = {name: points[label] for name, label in landmarks(points).items()}
    upward = upright(body)
    if upward is not None:
        check_up(upward, layout, recording.source, " by its usual labels, which no alias names")


def _signed(vector: np.ndarray) -> Axis:
    largest = int(np.abs(vector).argmax())
    return AXES[largest][int(vector[largest] > 0)]
