"""The axes of a marker file: turned to x lateral (right), y forward, z up, and compared with the body."""

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.settings.layout import MarkerLayout

_UPPER = ("C7", "T12", "MANUBRIUM", "XIPHOID", "L_SHOULDER", "R_SHOULDER", "SACRUM", "L5", "L_HIP", "R_HIP")
_FEET = ("L_ANKLE", "R_ANKLE", "L_HEEL", "R_HEEL", "L_TOE", "R_TOE")
_TRUNK_TOP = ("C7", "MANUBRIUM", "XIPHOID", "L_SHOULDER", "R_SHOULDER")
_PELVIS = ("SACRUM", "L5", "L_HIP", "R_HIP", "L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS")
_SIDES = ("SHOULDER", "HIP", "ANKLE", "HEEL", "TOE")
_FEET_PAIRS = (("L_HEEL", "L_TOE"), ("R_HEEL", "R_TOE"))
_PELVIS_PAIRS = (("SACRUM", "L_ASIS"), ("SACRUM", "R_ASIS"), ("L_PSIS", "L_ASIS"), ("R_PSIS", "R_ASIS"))
_FACING = (
    (_FEET_PAIRS, "the toes are ahead of the heels"),
    ((("L_ANKLE", "L_TOE"), ("R_ANKLE", "R_TOE")), "the toes are ahead of the ankles"),
    (_PELVIS_PAIRS, "the front of the pelvis is ahead of its back"),
    ((("C7", "MANUBRIUM"), ("C7", "XIPHOID")), "the chest is ahead of the back"),
)
"""Pairs of which the second lies ahead of the first, the surest first, with words for them."""
_LEVEL = 0.7
"""Share of a vector that must be level for it to say where a body faces."""
_CLEARLY = 2.0
"""How much longer than along the declared axis a segment must be along another one to contradict it. A bent
trunk or a turned foot stays below."""


def axis_vector(axis: str) -> np.ndarray:
    """Return the unit vector of a signed axis such as ``"+z"`` or ``"-x"``."""
    vector = np.zeros(3)
    vector["xyz".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return vector


def rotation_to_standard(up: str, forward: str) -> np.ndarray:
    """Rotation matrix, shape (3, 3), from a file's axes to x lateral (right), y forward, z up.

    Parameters
    ----------
    up, forward : str
        Signed axes of the file, e.g. ``"+y"`` and ``"+x"``.

    Raises
    ------
    InputError
        Both are along the same line.
    """
    up_vector, forward_vector = axis_vector(up), axis_vector(forward)
    if up_vector @ forward_vector != 0:
        raise InputError(f"markers.up is {up!r} and markers.forward {forward!r}; they must be perpendicular")
    return np.array([np.cross(forward_vector, up_vector), forward_vector, up_vector])


def upright(positions: dict[str, np.ndarray]) -> np.ndarray | None:
    """Vector, shape (3,) in metres, from feet to trunk or from pelvis to shoulders; None without such markers."""
    upward = _segment(positions, _FEET, _UPPER)
    return _segment(positions, _PELVIS, _TRUNK_TOP) if upward is None else upward


def check_axes(
    positions: dict[str, np.ndarray], layout: MarkerLayout, source: str, seen_by: str = ""
) -> None:
    """Raise when the markers contradict the declared axes.

    Three directions are compared, each by the median over the frames that show it, and only where the markers exist: feet to
    trunk (or pelvis to shoulders) is up; heel or ankle to toe, or else the back to the front of pelvis or trunk, is forward;
    left to right is lateral.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Under standard names, turned by the declared axes.

    Raises
    ------
    InputError
        Naming the axis of the file along which the body really lies.
    """
    problems = Problems(source)
    rotation = rotation_to_standard(layout.up, layout.forward)
    upward = upright(positions)
    if upward is not None and _contradicts(upward, 2):
        found = file_axis(upward, rotation)
        words = f"{layout.up}, but the body stands along {found}{seen_by}"
        problems.add("markers.up", words, f'set up: "{found}"')
        problems.raise_if_any()
    facing, words = facing_by(positions)
    if facing is not None and _contradicts(facing, 1):
        found = file_axis(facing, rotation)
        problems.add(
            "markers.forward",
            f"{layout.forward}, but {words} along {found}{seen_by}",
            f'set forward: "{found}" (or check_axes: false where the person turns)',
        )
        problems.raise_if_any()
    widths = [_segment(positions, (f"L_{part}",), (f"R_{part}",)) for part in _SIDES]
    across = [width for width in widths if width is not None]
    if across and _contradicts(np.mean(across, axis=0) * [1, 1, 0], 0):
        facing = np.cross([0.0, 0.0, 1.0], np.mean(across, axis=0))
        problems.add(
            "markers",
            f"the right side of the body is not to the right of the left side{seen_by}",
            _sides_advice(facing, _pointing_forward(positions), layout),
        )
    problems.raise_if_any()


def facing_by(positions: dict[str, np.ndarray]) -> tuple[np.ndarray | None, str]:
    """Level vector, shape (3,), to where the body faces, and words for what shows it; None where no markers do.

    Feet are asked first, then the pelvis, then the chest. A trunk that is bent so far that its front points down tells nothing.
    """
    for pairs, words in _FACING:
        vectors = [_segment(positions, (back,), (front,)) for back, front in pairs]
        found = [vector for vector in vectors if vector is not None]
        level = np.sum(found, axis=0) * [1, 1, 0] if found else np.zeros(3)
        if found and np.linalg.norm(level) > _LEVEL * np.linalg.norm(np.sum(found, axis=0)):
            return level, words
    return None, ""


def uncheckable_axes(positions: dict[str, np.ndarray]) -> list[str]:
    """Which of the declared axes cannot be compared with the body by these markers."""
    sides = any(_segment(positions, (f"L_{part}",), (f"R_{part}",)) is not None for part in _SIDES)
    told = {"up": upright(positions) is not None, "forward": sides or facing_by(positions)[0] is not None}
    return [axis for axis, known in told.items() if not known]


def _sides_advice(facing: np.ndarray, ahead: list[np.ndarray], layout: MarkerLayout) -> str:
    """Say whether labels are swapped or forward is wrong, as far as the body's front tells."""
    skip = "(check_axes: false skips this check)"
    rotation = rotation_to_standard(layout.up, layout.forward)
    faces = file_axis(facing, rotation)
    front = file_axis(np.sum(ahead, axis=0) * [1, 1, 0], rotation) if ahead else None
    if front == layout.forward:
        return f"left and right labels are swapped {skip}"
    if front == faces:
        return f'set forward: "{faces}" {skip}'
    return f'set forward: "{faces}", unless left and right labels are swapped {skip}'


_FRONT = (*_PELVIS_PAIRS, ("C7", "MANUBRIUM"), *_FEET_PAIRS)
"""Pairs of which the second lies in front of the first."""


def _pointing_forward(positions: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Vectors from the back to the front of trunk and feet, by the markers that exist."""
    found = [_segment(positions, (back,), (front,)) for back, front in _FRONT]
    return [vector for vector in found if vector is not None]


def find_axes(positions: dict[str, np.ndarray]) -> tuple[str, str] | None:
    """Return the signed axes of a file along which the body stands and faces, up and forward; None if the markers do not tell.

    Parameters
    ----------
    positions : dict of str to ndarray, shape (n_frames, 3)
        Under standard names, in the axes of the file.

    The markers tell if there are feet or a trunk, and left and right, heel and toe, or back and front.
    """
    upward = upright(positions)
    if upward is None:
        return None
    up = file_axis(upward, np.eye(3))
    vertical = axis_vector(up)
    across = [_segment(positions, (f"L_{part}",), (f"R_{part}",)) for part in (*_SIDES, "ASIS", "PSIS")]
    facing = [np.cross(vertical, vector) for vector in across if vector is not None]
    facing += _pointing_forward(positions)
    if not facing:
        return None
    return up, file_axis(np.sum(facing, axis=0) * (vertical == 0), np.eye(3))


def _segment(
    positions: dict[str, np.ndarray], start: tuple[str, ...], end: tuple[str, ...]
) -> np.ndarray | None:
    """Median vector from the mean of `start` to the mean of `end` markers; None where they are in no frame together.

    The difference is taken within each frame: a person who walks is elsewhere where one marker is hidden and another
    is seen.
    """
    ends = []
    for names in (start, end):
        present = np.array([positions[name] for name in names if name in positions])
        if not present.size:
            return None
        seen = np.isfinite(present).all(axis=2, keepdims=True)
        count = seen.sum(axis=0)
        ends.append(np.where(seen, present, 0.0).sum(axis=0) / np.where(count, count, np.nan))
    vectors = ends[1] - ends[0]
    together = np.isfinite(vectors).all(axis=1)
    return np.median(vectors[together], axis=0) if together.any() else None


def _contradicts(vector: np.ndarray, axis: int) -> bool:
    """Whether `vector` clearly does not point along the positive `axis`."""
    return bool(np.abs(vector).max() > _CLEARLY * vector[axis])


def file_axis(vector: np.ndarray, rotation: np.ndarray) -> str:
    """Return the signed axis of the file along which a vector in standard axes mostly lies."""
    in_file = rotation.T @ vector
    largest = int(np.abs(in_file).argmax())
    return f"{'+' if in_file[largest] > 0 else '-'}{'xyz'[largest]}"
