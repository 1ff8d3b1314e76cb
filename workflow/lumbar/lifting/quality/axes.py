"""Which axes of a file point up and forward, by the body in it."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from lumbar.lifting.quality.body import rightward, trunk_axis
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.marker_axes import check_axes, tells_axes
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import Axis, MarkerLayout

_BY_LABELS = " by its usual labels, which no alias names"
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
    """Read a marker file as `lumbar.records.markers.read_markers` does, and compare its axes with the body by all usual labels.

    What no marker tells is among the notes of the recording.

    Raises
    ------
    InputError
        As `read_markers`; and where the body stands or faces along another axis than `markers.up` or `markers.forward`, or left
        and right are exchanged.
    """
    measured: dict[str, np.ndarray] = {}

    def kept(points: dict[str, np.ndarray], time: np.ndarray, rate: float):
        measured.update(points)
        return points, {}

    recording = read_markers(path, layout, screen=kept)
    unknown = check_unaliased_axes(measured, recording, layout)
    if not unknown:
        return recording
    note = f"not checked: {' and '.join(unknown)} of the axes, which no known label of the body tells"
    return replace(recording, notes=(*recording.notes, note))


def check_unaliased_axes(
    points: dict[str, np.ndarray], recording: MarkerRecording, layout: MarkerLayout
) -> list[str]:
    """Raise where usual labels show a body that stands or faces another way than declared, and no alias tells.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Measured markers by the file's labels, turned by the declared axes.
    recording : MarkerRecording
        The same under standard names.

    Returns
    -------
    list of str
        Which of up and forward no marker tells.
    """
    if not layout.check_axes:
        return []
    if not tells_axes(recording.positions):
        return []
    body = {name: points[label] for name, label in landmarks(points).items()}
    check_axes({**body, **recording.positions}, layout, recording.source, _BY_LABELS)
    return tells_axes({**body, **recording.positions})


def _signed(vector: np.ndarray) -> Axis:
    largest = int(np.abs(vector).argmax())
    return AXES[largest][int(vector[largest] > 0)]
