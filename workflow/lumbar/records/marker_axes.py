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
_SIDE_PAIRS = tuple(
    (f"L_{part}", f"R_{part}")
    for part in ("SHOULDER", "HIP", "ANKLE", "HEEL", "TOE", "ASIS", "PSIS", "KNEE", "ELBOW")
)
_FRONT_PAIRS = (
    *(
        ("SACRUM", "L_ASIS"),
        ("SACRUM", "R_ASIS"),
        ("L_PSIS", "L_ASIS"),
        ("R_PSIS", "R_ASIS"),
        ("C7", "MANUBRIUM"),
    ),
    *((f"{side}_{rear}", f"{side}_TOE") for rear in ("HEEL", "ANKLE") for side in "LR"),
)
"""Pairs of a rear and a front marker of trunk and feet."""
_PAIRS = (_SIDE_PAIRS, _FRONT_PAIRS, (*_SIDE_PAIRS, *_FRONT_PAIRS))
_FORWARD, _UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_MIN_PAIR_DISTANCE_M = 0.02
"""Smallest horizontal distance of a pair that shows a direction."""
_MIN_LEVEL_SHARE = 0.7
"""Smallest horizontal share of a vector that shows the direction in which a body faces."""
_MAX_TURN_DEG = 15.0
"""Largest angle between the body and an axis of the file that is not reported."""
_MIN_STEADINESS = 0.7
"""Smallest length of the mean of unit vectors over the frames that shows a direction; it is smaller if the body turns around."""
_CONTRADICTION_DEG = 60.0
"""Smallest angle between the body and a declared axis that contradicts the axis; a bent trunk or a rotated foot makes less."""


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


def check_axes(
    positions: dict[str, np.ndarray], layout: MarkerLayout, source: str, remark: str = ""
) -> list[str]:
    """Compare the declared axes with the directions of `find_axes`, and return the axes, up and forward, that no marker shows.

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
    if upward is not None and _angle_deg(upward, _UP) > _CONTRADICTION_DEG:
        axis = _file_axis(upward, rotation)
        raise InputError(
            f'{source}: markers.up: {layout.up}, but the body stands along {axis}{remark}; set up: "{axis}"'
        )
    across, ahead, facing = (_facing_vector(_votes(positions, _UP, pairs)) for pairs in _PAIRS)
    if across is not None and ahead is not None and _angle_deg(across, ahead) > 180 - _CONTRADICTION_DEG:
        raise InputError(
            f"{source}: the right side of the body is not to the right of the left side{remark}; left and right labels are "
            "swapped (check_axes: false skips this check)"
        )
    if facing is not None and _angle_deg(facing, _FORWARD) > _CONTRADICTION_DEG:
        axis = _file_axis(facing, rotation)
        other = "" if ahead is not None else ", unless left and right labels are swapped"
        raise InputError(
            f"{source}: markers.forward: {layout.forward}, but the body faces along {axis}{remark}; set forward: "
            f'"{axis}"{other}'
        )
    return [axis for axis, vector in (("up", upward), ("forward", facing)) if vector is None]


@dataclass(frozen=True)
class BodyAxes:
    """Axes of a file along which the body stands and faces."""

    up: Axis
    forward: Axis | None
    """None if no pair of markers shows it, or the body turns around."""
    turn_deg: float
    """Angle between the forward axis and the direction in which the body faces."""
    evidence: str
    """Markers that show the axes, as text."""

    def __str__(self) -> str:
        forward = f"forward {self.forward or 'not known: no markers show it, or the body turns'}"
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

    In every frame each pair of markers, left and right or back and front, has one vote for the direction; frames without a
    pair have none. The body faces forward as in the mean of the frames.

    Parameters
    ----------
    positions : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by standard name, in metres and in the axes of the file.
    """
    up = find_up(positions)
    if up is None:
        return None
    sides, fronts = (_votes(positions, axis_vector(up), pairs) for pairs in (_SIDE_PAIRS, _FRONT_PAIRS))
    evidence = f"{len(sides)} pairs of left and right markers, {len(fronts)} of front and back"
    facing = _facing_vector([*sides, *fronts])
    if facing is None:
        return BodyAxes(up, None, 0.0, evidence)
    forward = _file_axis(facing, np.eye(3))
    return BodyAxes(up, forward, _angle_deg(facing, axis_vector(forward)), evidence)


def _upward_vector(positions: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the vector, shape (3,) in metres, from feet to trunk or from pelvis to shoulders; None without such markers."""
    upward = _segment(positions, _FEET, _TRUNK)
    return _segment(positions, _PELVIS, _TRUNK_TOP) if upward is None else upward


def _votes(
    positions: dict[str, np.ndarray], vertical: np.ndarray, pairs: tuple[tuple[str, str], ...]
) -> list[np.ndarray]:
    """Return by pair the horizontal unit vectors in which it lets the body face, shape (n_frames, 3); NaN if it shows none."""
    votes = []
    for start, end in (pair for pair in pairs if set(pair) <= positions.keys()):
        vector = positions[end] - positions[start]
        level = vector * (vertical == 0)
        length, total = (np.linalg.norm(each, axis=1, keepdims=True) for each in (level, vector))
        with np.errstate(invalid="ignore", divide="ignore"):
            is_clear = (length > _MIN_PAIR_DISTANCE_M) & (length > _MIN_LEVEL_SHARE * total)
            vote = np.where(is_clear, level / length, np.nan)
        if is_clear.any():
            votes.append(np.cross(vertical, vote) if (start, end) in _SIDE_PAIRS else vote)
    return votes


def _facing_vector(votes: list[np.ndarray]) -> np.ndarray | None:
    """Return the direction in which the body faces by the mean of the frames with votes, shape (3,); None if it is not steady."""
    frames = np.nansum(votes, axis=0) if votes else np.zeros((1, 3))
    length = np.linalg.norm(frames, axis=1)
    # Frames without a vote, or with votes that contradict each other, show nothing.
    known = length > 0
    mean = (frames[known] / length[known, None]).mean(axis=0) if known.any() else np.zeros(3)
    return mean if np.linalg.norm(mean) >= _MIN_STEADINESS else None


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


def _angle_deg(one: np.ndarray, other: np.ndarray) -> float:
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _file_axis(vector: np.ndarray, rotation: np.ndarray) -> Axis:
    """Return the signed axis of the file closest to a vector in standard axes."""
    in_file = rotation.T @ vector
    largest = int(np.abs(in_file).argmax())
    return _AXES[largest][int(in_file[largest] > 0)]
