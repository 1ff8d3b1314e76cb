"""Small pictures as inline SVG: the error of every step of a diagnosis, the course of a recording, a lift as a stick figure."""

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np
import pandas as pd
from markupsafe import Markup

from lumbar.lifting.movement.joint_centres import MID_HIP
from lumbar.lifting.movement.lift_tables import HEAD, LOAD, points_of

LEFT, RIGHT, MIDDLE = "left", "right", "middle"
_LIMBS = (("SHOULDER", "ELBOW", "WRIST"), ("KNEE", "ANKLE"), ("ANKLE", "HEEL", "TOE", "ANKLE"))
_TRUNK = (HEAD, "C7T1", "T12L1", "L4L5", "L5S1", MID_HIP)
_WIDTH, _HEIGHT = 160, 90


def stick_figure(points) -> list[dict]:
    """Return the lines of the stick figure through the known points, each with its side."""
    lines = [(MIDDLE, list(_TRUNK))]
    for side, letter in ((LEFT, "L"), (RIGHT, "R")):
        limbs = [[f"{letter}_{name}" for name in limb] for limb in _LIMBS]
        limbs[0].insert(0, "C7T1")
        limbs[1].insert(0, MID_HIP)
        lines += [(side, limb) for limb in limbs]
    known = [(side, [name for name in line if name in points]) for side, line in lines]
    return [{"side": side, "points": line} for side, line in known if len(set(line)) > 1]


def _sketch(parts: Iterable[str]) -> Markup:
    attributes = 'class="sketch" preserveAspectRatio="xMinYMid" aria-hidden="true"'
    return Markup(f'<svg {attributes} viewBox="0 0 {_WIDTH} {_HEIGHT}">{"".join(parts)}</svg>')


def _line(points: np.ndarray, opacity: float = 1) -> str:
    """Return a line through points of shape (n, 2); points that are not finite are left out."""
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points[np.isfinite(points).all(axis=1)])
    return f'<polyline points="{text}" opacity="{opacity:g}"/>'


def ladder_sketch(diagnosis: dict) -> Markup:
    """Return a bar per step of a diagnosis with its error on unseen records, and a line at the noise floor.

    `diagnosis` is the content of ``diagnosis.json``; the result is empty if no step has an error.
    """
    errors = [error for step in diagnosis["ladder"] if (error := step.get("test_rms")) is not None]
    floor = diagnosis["noise_floor_rms"]
    if not errors:
        return Markup("")
    scale, pitch = (_HEIGHT - 10) / max([*errors, floor or 0.0]), min(40, _WIDTH / len(errors))
    parts = [
        f'<rect x="{pitch * (step + 0.2):.1f}" y="{_HEIGHT - scale * error:.1f}" width="{0.6 * pitch:.1f}" '
        f'height="{scale * error:.1f}"/>'
        for step, error in enumerate(errors)
    ]
    if floor is not None:
        parts.append(f'<path d="M0 {_HEIGHT - scale * floor:.1f}H{pitch * len(errors):.1f}"/>')
    return _sketch(parts)


def course_sketch(points: Sequence | np.ndarray) -> Markup:
    """Return a line through points of shape (n, 2) with coordinates from 0 to 1."""
    return _sketch([_line(np.asarray(points) * (_WIDTH, 10 - _HEIGHT) + (0, _HEIGHT - 5))])


def lift_sketch(body: pd.DataFrame) -> Markup:
    """Return the stick figure from the right side at three instants of a lift, with a dot at the load; empty without limbs.

    `body` is ``body.csv`` of a saved lift.
    """
    points = points_of(body)
    lines = [limb["points"] for limb in stick_figure(points)]
    frames = np.linspace(0, len(body) - 1, 5).round().astype(int)[1:-1]
    drawn = {name: points[name][frames, 1:] for name in {LOAD, *chain.from_iterable(lines)} & points.keys()}
    every = np.array(list(drawn.values()))
    if not lines or not np.isfinite(every).all(axis=2).any(axis=0).all():
        return Markup("")
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    pitch = _WIDTH / len(frames)
    scale = min((_HEIGHT - 8) / (high[:, 1].max() - low[:, 1].min()), (pitch - 8) / (high - low)[:, 0].max())
    parts = []
    for place in range(len(frames)):
        origin = (
            pitch * (place + 0.5) - scale * (low + high)[place, 0] / 2,
            _HEIGHT - 4 + scale * low[:, 1].min(),
        )
        at = {name: values[place] * (scale, -scale) + origin for name, values in drawn.items()}
        parts += [_line(np.array([at[name] for name in line])) for line in lines]
        if LOAD in at and np.isfinite(at[LOAD]).all():
            parts.append('<circle cx="{:.1f}" cy="{:.1f}" r="4"/>'.format(*at[LOAD]))
    return _sketch(parts)
