"""BVH files (inertial suits, animation): a skeleton and its joint angles, as positions of the joints over time.

A joint lies at its OFFSET in the axes of its parent and is turned by its rotation channels, in degrees and in the order in
which they stand; the root moves by its position channels. The file states no unit of length.
"""

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.marker_file import RATES_HZ, MarkerFile, read_frames, split_points
from lumbar.records.number_table import Dialect, Row, decode_lines, split_rows

_CHANNELS = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ"]
_BLANKS = Dialect(None)
_MOST_JOINTS = 1000
_ALIKE = 0.1
"""How far the positions of a joint may lie from its offset, as a share of it, to be the offset written again."""


@dataclass
class _Joint:
    name: str
    parent: int
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels: tuple[str, ...] = ()


def read_bvh(path: str | os.PathLike) -> MarkerFile:
    """Read a BVH file: joints by name, ends of chains as ``<joint>_end``, on a clock that starts at 0.

    Raises
    ------
    InputError
        A skeleton that is no tree of joints, a channel that is unknown, rows of another length than the channels, a
        count of frames that is not the file's.
    """
    path = Path(path)
    lines, _ = decode_lines(path.read_bytes(), str(path), lenient=True)
    begins = next((place for place, line in enumerate(lines) if line.strip().upper() == "MOTION"), None)
    if begins is None or not lines[0].strip().upper().startswith("HIERARCHY"):
        raise InputError(f"{path}: not a BVH file; HIERARCHY, a skeleton, MOTION and frames are needed")
    joints = _skeleton(path, lines[1:begins])
    interval, values = _motion(path, lines, begins + 1, sum(len(joint.channels) for joint in joints))
    notes = ["positions are joints of a skeleton that a program fitted, not markers on the skin"]
    points = _positions(path, joints, values, notes)
    same = [at for at, joint in enumerate(joints) if at and (points[:, at] == points[:, joint.parent]).all()]
    if same:
        shown = ", ".join(f"{joints[at].name} ({joints[joints[at].parent].name})" for at in same)
        notes.append(f"segments of no length: where the joint before them is, lie {shown}")
    file = split_points(
        source=str(path),
        time=np.arange(len(values)) * interval,
        rate=1 / interval,
        unit="",
        labels=[joint.name for joint in joints],
        points=points,
        notes=tuple(notes),
    )
    return replace(file, joints=True)


def _skeleton(path: Path, lines: list[str]) -> list[_Joint]:
    """Joints in the order of the file, parents before children."""
    joints: list[_Joint] = []
    open_joints: list[int] = []
    for place, line in enumerate(lines, start=2):
        words = line.split()
        if not words or words == ["{"]:
            continue
        keyword = words[0].upper()
        where = f"{path}, line {place}"
        if keyword in ("ROOT", "JOINT", "END"):
            if (
                (keyword == "ROOT") != (not joints)
                or (joints and not open_joints)
                or len(joints) >= _MOST_JOINTS
            ):
                raise InputError(
                    f"{where}: {line.strip()!r}; one ROOT with JOINTs inside is needed, at most {_MOST_JOINTS}"
                )
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name}_end" if keyword == "END" else " ".join(words[1:])
            open_joints.append(len(joints))
            joints.append(_Joint(name, parent))
        elif keyword == "}" and open_joints:
            open_joints.pop()
        elif keyword == "OFFSET" and open_joints:
            joints[open_joints[-1]].offset = _numbers(path, [Row(place, words[1:])], 3)[0]
        elif keyword == "CHANNELS" and open_joints:
            wrong = [word for word in words[2:] if word not in _CHANNELS]
            if wrong or [str(len(words) - 2)] != words[1:2] or len(set(words[2:])) < len(words) - 2:
                raise InputError(
                    f"{where}: {line.strip()!r}; a count and as many of {', '.join(_CHANNELS)} are needed"
                )
            joints[open_joints[-1]].channels = tuple(words[2:])
        else:
            raise InputError(
                f"{where}: {line.strip()[:60]!r}; ROOT, JOINT, End Site, OFFSET or CHANNELS is needed"
            )
    if not joints or open_joints:
        raise InputError(
            f"{path}: {len(open_joints)} joints are not closed by '}}'; the skeleton is cut short"
        )
    return joints


def _motion(path: Path, lines: list[str], begins: int, n_channels: int) -> tuple[float, np.ndarray]:
    """Time between frames, and the channels of all frames, shape (n_frames, n_channels)."""
    rows = list(split_rows(lines[begins:], _BLANKS, str(path), first=begins + 1))
    stated = {}
    for (place, words), key in zip(rows[:2], ("Frames:", "Frame Time:"), strict=False):
        if " ".join(words[:-1]).lower() != key.lower():
            raise InputError(
                f"{path}, line {place}: {' '.join(words)[:60]!r}; '{key}' and a number are needed"
            )
        stated[key] = float(_numbers(path, [Row(place, words[-1:])], 1)[0, 0])
    if len(rows) < 3:
        raise InputError(f"{path}: no frames")
    interval = stated["Frame Time:"]
    shortest, longest = (1 / rate for rate in reversed(RATES_HZ))
    if not shortest <= interval <= longest:
        raise InputError(f"{path}: Frame Time is {interval:g} s; {shortest:g} to {longest:g} s are read")
    if stated["Frames:"] != len(rows) - 2:
        raise InputError(
            f"{path}: Frames: {stated['Frames:']:g}; the file holds {len(rows) - 2}; it may be cut short: export it again"
        )
    return interval, _numbers(path, rows[2:], n_channels)


def _numbers(path: Path, rows: list[Row], width: int) -> np.ndarray:
    return read_frames(rows, width, str(path), _BLANKS, may_be_missing=False)


def _positions(path: Path, joints: list[_Joint], values: np.ndarray, notes: list[str]) -> np.ndarray:
    """Positions of all joints, shape (n_frames, n_joints, 3), from the root outwards."""
    from scipy.spatial.transform import Rotation

    points = np.zeros((len(values), len(joints), 3))
    turns: list[Rotation] = []
    column = 0
    for index, joint in enumerate(joints):
        own = dict(zip(joint.channels, values[:, column:].T, strict=False))
        column += len(joint.channels)
        rotations = [name for name in joint.channels if name.endswith("rotation")]
        step = joint.offset + _moved(path, joint, own, notes)
        turn = Rotation.identity(len(values))
        for name in rotations:
            turn = turn * Rotation.from_euler(name[0].lower(), own[name][:, None] % 360, degrees=True)
        if joint.parent < 0:
            points[:, index] = step
            turns.append(turn)
        else:
            parent = turns[joint.parent]
            points[:, index] = points[:, joint.parent] + parent.apply(step)
            turns.append(parent * turn)
    return points


def _moved(path: Path, joint: _Joint, own: dict[str, np.ndarray], notes: list[str]) -> np.ndarray:
    """Position channels of a joint beyond its offset; some suits write the offset into them again."""
    if not any(name.endswith("position") for name in own):
        return np.zeros(3)
    still = np.zeros(len(next(iter(own.values()))))
    moved = np.transpose([own.get(f"{axis}position", still) for axis in "XYZ"])
    length = np.linalg.norm(joint.offset)
    if joint.parent < 0 or not length:
        if length:
            notes.append(f"the OFFSET of {joint.name} was added to its positions")
        return moved
    if np.linalg.norm(np.median(moved, axis=0) - joint.offset) <= _ALIKE * length:
        return moved - joint.offset
    if np.linalg.norm(np.median(moved, axis=0)) <= _ALIKE * length:
        return moved
    raise InputError(
        f"{path}: the positions of {joint.name} are neither around 0 nor around its OFFSET; export joints with rotations "
        "alone"
    )
