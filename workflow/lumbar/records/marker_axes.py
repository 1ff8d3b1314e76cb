"""Axes of a marker file: rotation to x lateral (right), y forward, z up, and comparison with the body."""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.layout import Axis, MarkerLayout

_FEET = ("L_ANKLE", "R_ANKLE", "L_HEEL", "R_HEEL", "L_TOE", "R_TOE")
_AXES: tuple[tuple[Axis, Axis], ...] = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))
_TRUNK_TOP = ("C7", "MANUBRIUM", "XIPHOID", "L_SHOULDER", "R_SHOULDER")
_PELVIS = ("SACRUM", "L5", "L_HIP", "R_HIP", "L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS")
_TRUNK = ("T12", *_TRUNK_TOP, *_PELVIS)
_SIDE_PAIRS = tuple((f"L_{part}", f"R_{part}") for part in ("SHOULDER", "HIP", "ANKLE", "HEEL", "TOE"))
_FEET_PAIRS = (("L_HEEL", "L_TOE"), ("R_HEEL", "R_TOE"))
_PELVIS_PAIRS = (("SACRUM", "L_ASIS"), ("SACRUM", "R_ASIS"), ("L_PSIS", "L_ASIS"), ("R_PSIS", "R_ASIS"))
_FACING_PAIRS = (
    (_FEET_PAIRS, "the toes are ahead of the heels"),
    ((("L_ANKLE", "L_TOE"), ("R_ANKLE", "R_TOE")), "the toes are ahead of the ankles"),
    (_PELVIS_PAIRS, "the front of the pelvis is ahead of its back"),
    ((("C7", "MANUBRIUM"), ("C7", "XIPHOID")), "the chest is ahead of the back"),
)
"""Pairs of a rear and a front marker with a description, the most reliable first."""
_FRONT_PAIRS = (*_PELVIS_PAIRS, ("C7", "MANUBRIUM"), *_FEET_PAIRS)
"""Pairs of a rear and a front marker of trunk and feet."""
_ALL_SIDE_PAIRS = (
    *_SIDE_PAIRS,
    *((f"L_{part}", f"R_{part}") for part in ("ASIS", "PSIS", "KNEE", "ELBOW")),
)
_MIN_PAIR_DISTANCE_M = 0.02
"""Smallest horizontal distance of a pair that shows a direction."""
_MIN_LEVEL_SHARE = 0.7
"""Smallest horizontal share of a vector that shows the direction in which a body faces."""
_MAX_TURN_DEG = 15.0
"""Largest angle between the body and an axis of the file that is not reported."""
_MIN_CONTRADICTION_RATIO = 2.0
"""Smallest ratio of the length along another axis to the length along the declared axis that contradicts the declared axis;
a bent trunk or a rotated foot has a smaller ratio."""


def axis_vector(axis: str) -> np.ndarray:
    """Return the unit vector, shape (3,), of a signed axis.

    Parameters
    ----------
    axis : str
        The axis, e.g. ``"+z"``.
    """
    vector = np.zeros(3)
    vector["xyz".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return vector


def rotation_to_standard(up: str, forward: str) -> np.ndarray:
    """Return the rotation matrix, shape (3, 3), from a file's axes to x lateral (right), y forward, z up.

    Parameters
    ----------
    up, forward : str
        Signed axes of the file, e.g. ``"+y"`` and ``"+x"``.

    Raises
    ------
    InputError
        If both axes are along the same line.
    """
    up_vector, forward_vector = axis_vector(up), axis_vector(forward)
    if up_vector @ forward_vector != 0:
        raise InputError(f"markers.up is {up!r} and markers.forward {forward!r}; they must be perpendicular")
    return np.array([np.cross(forward_vector, up_vector), forward_vector, up_vector])


def check_axes(positions: dict[str, np.ndarray], layout: MarkerLayout, source: str, remark: str = "") -> None:
    """Raise if the markers contradict the declared axes.

    Three directions are compared, each by the median over the frames with its markers: feet to trunk (or pelvis to shoulders)
    is up; heel or ankle to toe, or else the back to the front of pelvis or trunk, is forward; left to right is lateral.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Markers by standard name, rotated by the declared axes.
    layout : MarkerLayout
        The declared axes.
    source, remark : str
        The file, and a remark on the markers, for messages.

    Raises
    ------
    InputError
        If an axis is wrong, with the correct axis of the file.
    """
    rotation = rotation_to_standard(layout.up, layout.forward)
    upward = _upward_vector(positions)
    if upward is not None and _contradicts(upward, 2):
        axis = _file_axis(upward, rotation)
        raise InputError(
            f'{source}: markers.up: {layout.up}, but the body stands along {axis}{remark}; set up: "{axis}"'
        )
    facing, description = _facing_vector(positions)
    if facing is not None and _contradicts(facing, 1):
        axis = _file_axis(facing, rotation)
        raise InputError(
            f"{source}: markers.forward: {layout.forward}, but {description} along {axis}{remark}; set forward: "
            f'"{axis}" (or check_axes: false if the person turns around)'
        )
    across = _segments(positions, _SIDE_PAIRS)
    if across and _contradicts(np.mean(across, axis=0) * [1, 1, 0], 0):
        # Either the labels are swapped or forward is wrong; the front of the body may decide.
        faces = _file_axis(np.cross([0.0, 0.0, 1.0], np.mean(across, axis=0)), rotation)
        ahead = _segments(positions, _FRONT_PAIRS)
        front = _file_axis(np.sum(ahead, axis=0) * [1, 1, 0], rotation) if ahead else None
        remedy = f'set forward: "{faces}"'
        if front == layout.forward:
            remedy = "left and right labels are swapped"
        elif front != faces:
            remedy += ", unless left and right labels are swapped"
        raise InputError(
            f"{source}: the right side of the body is not to the right of the left side{remark}; {remedy} (check_axes: "
            "false skips this check)"
        )


def uncheckable_axes(positions: dict[str, np.ndarray]) -> list[str]:
    """Return the declared axes (``up``, ``forward``) that cannot be compared with the body, because markers are missing.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Markers by standard name.
    """
    has_forward = bool(_segments(positions, _SIDE_PAIRS)) or _facing_vector(positions)[0] is not None
    checkable = {"up": _upward_vector(positions) is not None, "forward": has_forward}
    return [axis for axis, is_checkable in checkable.items() if not is_checkable]


@dataclass(frozen=True)
class BodyAxes:
    """Axes of a file along which the body stands and faces."""

    up: Axis
    forward: Axis | None
    """None if no pair of markers shows it."""
    turn_deg: float
    """Angle between the forward axis and the direction in which the body faces."""
    evidence: str
    """Markers that show the axes, as text."""

    def __str__(self) -> str:
        forward = f"forward {self.forward}" if self.forward else "forward not known"
        turned = f", {self.turn_deg:.0f}° away from it" if self.turn_deg > _MAX_TURN_DEG else ""
        return f"up {self.up}, {forward}{turned} ({self.evidence})"


def find_up(positions: dict[str, np.ndarray]) -> Axis | None:
    """Return the signed axis of a file along which the body stands; None without markers of feet and trunk, or pelvis and trunk.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Markers by standard name, in the axes of the file.
    """
    upward = _upward_vector(positions)
    return None if upward is None else _file_axis(upward, np.eye(3))


def find_axes(positions: dict[str, np.ndarray]) -> BodyAxes | None:
    """Return the axes of a file from the directions in which the body stands and faces; None if no marker shows which axis is up.

    Every pair of markers, left and right or back and front, has one vote for the forward direction.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Markers by standard name, in metres and in the axes of the file.
    """
    up = find_up(positions)
    if up is None:
        return None
    vertical = axis_vector(up)
    across = [np.cross(vertical, vector) for vector in _segments(positions, _ALL_SIDE_PAIRS)]
    ahead = [vector * (vertical == 0) for vector in _segments(positions, _FRONT_PAIRS)]
    votes = [
        vector / length
        for vector in (*across, *ahead)
        if (length := np.linalg.norm(vector)) > _MIN_PAIR_DISTANCE_M
    ]
    facing = np.sum(votes, axis=0) if votes else np.zeros(3)
    evidence = f"{len(across)} pairs of left and right markers, {len(ahead)} of front and back"
    if not facing.any():
        return BodyAxes(up, None, 0.0, evidence)
    forward = _file_axis(facing, np.eye(3))
    turn = np.degrees(np.arccos(np.clip(facing @ axis_vector(forward) / np.linalg.norm(facing), -1, 1)))
    return BodyAxes(up, forward, float(turn), evidence)


def _upward_vector(positions: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the vector, shape (3,) in metres, from feet to trunk or from pelvis to shoulders; None without such markers."""
    upward = _segment(positions, _FEET, _TRUNK)
    return _segment(positions, _PELVIS, _TRUNK_TOP) if upward is None else upward


def _facing_vector(positions: dict[str, np.ndarray]) -> tuple[np.ndarray | None, str]:
    """Return the horizontal vector, shape (3,), in which the body faces, and its description; None without markers.

    Feet are used first, then the pelvis, then the chest, unless they point too far down, as the front of a bent trunk.
    """
    for pairs, description in _FACING_PAIRS:
        vectors = _segments(positions, pairs)
        total = np.sum(vectors, axis=0) if vectors else np.zeros(3)
        level = total * [1, 1, 0]
        if vectors and np.linalg.norm(level) > _MIN_LEVEL_SHARE * np.linalg.norm(total):
            return level, description
    return None, ""


def _segments(positions: dict[str, np.ndarray], pairs: tuple[tuple[str, str], ...]) -> list[np.ndarray]:
    """Return the median vectors of the pairs of markers that exist."""
    vectors = (_segment(positions, (start,), (end,)) for start, end in pairs)
    return [vector for vector in vectors if vector is not None]


def _segment(
    positions: dict[str, np.ndarray], start: tuple[str, ...], end: tuple[str, ...]
) -> np.ndarray | None:
    """Return the median vector from the mean of `start` to the mean of `end` markers; None if no frame has both.

    The difference is computed within each frame, because different markers may be hidden while a subject walks.
    """
    ends = []
    for names in (start, end):
        present = np.array([positions[name] for name in names if name in positions])
        if not present.size:
            return None
        is_seen = np.isfinite(present).all(axis=2, keepdims=True)
        count = is_seen.sum(axis=0)
        ends.append(np.where(is_seen, present, 0.0).sum(axis=0) / np.where(count, count, np.nan))
    vectors = ends[1] - ends[0]
    together = np.isfinite(vectors).all(axis=1)
    return np.median(vectors[together], axis=0) if together.any() else None


def _contradicts(vector: np.ndarray, axis: int) -> bool:
    """Return whether a vector clearly does not point along the positive `axis`."""
    return bool(np.abs(vector).max() > _MIN_CONTRADICTION_RATIO * vector[axis])


def _file_axis(vector: np.ndarray, rotation: np.ndarray) -> Axis:
    """Return the signed axis of the file closest to a vector in standard axes."""
    in_file = rotation.T @ vector
    largest = int(np.abs(in_file).argmax())
    return _AXES[largest][int(in_file[largest] > 0)]
