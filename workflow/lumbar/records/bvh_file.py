"""BVH files (inertial suits, animation): a skeleton and its joint angles, as positions of the joints over time.

The position of a joint is its OFFSET in the axes of its parent. Its rotation channels, in degrees and in the order of the file,
rotate its own axes; the root moves by its position channels. The file states no unit of length.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.marker_file import RATES_HZ, MarkerFile, read_frames, split_points
from lumbar.records.number_table import Dialect, Row, decode_lines, split_rows

_CHANNELS = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ"]
_BLANKS = Dialect(None)
_MAX_JOINTS = 1000
_OFFSET_TOLERANCE = 0.1
"""Largest distance of a joint's positions from its offset, as a share of it, that is treated as a copy of the offset."""


@dataclass
class _Joint:
    name: str
    parent: int
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels: tuple[str, ...] = ()


def read_bvh(path: str | os.PathLike) -> MarkerFile:
    """Read a BVH file: joints by name, ends of chains as ``<joint>_end``, on a clock that starts at 0.

    Parameters
    ----------
    path : path
        The unpacked file.

    Raises
    ------
    InputError
        A skeleton that is not a tree of joints, an unknown channel, rows with another length than the channels, or another
        number of frames than stated.
    """
    path = Path(path)
    lines, _ = decode_lines(path.read_bytes(), str(path), lenient=True)
    begins = next((place for place, line in enumerate(lines) if line.strip().upper() == "MOTION"), None)
    if begins is None or not lines[0].strip().upper().startswith("HIERARCHY"):
        raise InputError(f"{path}: not a BVH file; HIERARCHY, a skeleton, MOTION and frames are needed")
    joints = _read_skeleton(path, lines[1:begins])
    interval, values = _read_motion(path, lines, begins + 1, sum(len(joint.channels) for joint in joints))
    notes = ["positions are joints of a skeleton that a program fitted, not markers on the skin"]
    points = _joint_positions(path, joints, values, notes)
    zero_length = [
        f"{joint.name} ({joints[joint.parent].name})"
        for index, joint in enumerate(joints)
        if index and (points[:, index] == points[:, joint.parent]).all()
    ]
    if zero_length:
        notes.append(f"joints at the position of the one before them: {', '.join(zero_length)}")
    time = np.arange(len(values)) * interval
    file = MarkerFile(str(path), time, 1 / interval, "", notes=tuple(notes), joints=True)
    return split_points(file, [joint.name for joint in joints], points)


def _read_skeleton(path: Path, lines: list[str]) -> list[_Joint]:
    """Return the joints in the order of the file, parents before children."""
    joints: list[_Joint] = []
    open_joints: list[int] = []
    for place, line in enumerate(lines, start=2):
        tokens = line.split()
        if not tokens or tokens == ["{"]:
            continue
        keyword = tokens[0].upper()
        where = f"{path}, line {place}"
        if keyword in ("ROOT", "JOINT", "END"):
            is_misplaced = (keyword == "ROOT") != (not joints) or (joints and not open_joints)
            if is_misplaced or len(joints) >= _MAX_JOINTS:
                raise InputError(
                    f"{where}: {line.strip()!r}; one ROOT with JOINTs is needed, at most {_MAX_JOINTS}"
                )
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name}_end" if keyword == "END" else " ".join(tokens[1:])
            open_joints.append(len(joints))
            joints.append(_Joint(name, parent))
        elif keyword == "}" and open_joints:
            open_joints.pop()
        elif keyword == "OFFSET" and open_joints:
            joints[open_joints[-1]].offset = _read_numbers(path, [Row(place, tokens[1:])], 3)[0]
        elif keyword == "CHANNELS" and open_joints:
            channels = tokens[2:]
            are_valid = set(channels) <= set(_CHANNELS) and len(set(channels)) == len(channels)
            if not are_valid or tokens[1:2] != [str(len(channels))]:
                raise InputError(f"{where}: {line.strip()!r}; a count and {', '.join(_CHANNELS)} are needed")
            joints[open_joints[-1]].channels = tuple(channels)
        else:
            raise InputError(
                f"{where}: {line.strip()[:60]!r}; ROOT, JOINT, End, OFFSET or CHANNELS is needed"
            )
    if not joints or open_joints:
        raise InputError(f"{path}: {len(open_joints)} joints are not closed by '}}'; it is cut short")
    return joints


def _read_motion(path: Path, lines: list[str], begins: int, n_channels: int) -> tuple[float, np.ndarray]:
    """Return the time between frames, and the channels of all frames, shape (n_frames, n_channels)."""
    rows = list(split_rows(lines[begins:], _BLANKS, str(path), first=begins + 1))
    stated = {}
    for (place, tokens), key in zip(rows[:2], ("Frames:", "Frame Time:"), strict=False):
        if " ".join(tokens[:-1]).lower() != key.lower():
            raise InputError(f"{path}, line {place}: {' '.join(tokens)[:60]!r}; '{key}' NUMBER is needed")
        stated[key] = float(_read_numbers(path, [Row(place, tokens[-1:])], 1)[0, 0])
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
    return interval, _read_numbers(path, rows[2:], n_channels)


def _read_numbers(path: Path, rows: list[Row], width: int) -> np.ndarray:
    return read_frames(rows, width, str(path), _BLANKS, may_be_missing=False)


def _joint_positions(path: Path, joints: list[_Joint], values: np.ndarray, notes: list[str]) -> np.ndarray:
    """Return the positions of all joints, shape (n_frames, n_joints, 3), from the root outwards."""
    from scipy.spatial.transform import Rotation

    points = np.zeros((len(values), len(joints), 3))
    rotations: list[Rotation] = []
    column = 0
    for index, joint in enumerate(joints):
        channels = dict(zip(joint.channels, values[:, column:].T, strict=False))
        column += len(joint.channels)
        step = joint.offset + _displacement(path, joint, channels, notes)
        rotation = Rotation.identity(len(values))
        for name in joint.channels:
            if name.endswith("rotation"):
                angles = channels[name][:, None] % 360
                rotation = rotation * Rotation.from_euler(name[0].lower(), angles, degrees=True)
        if joint.parent < 0:
            points[:, index] = step
            rotations.append(rotation)
        else:
            parent = rotations[joint.parent]
            points[:, index] = points[:, joint.parent] + parent.apply(step)
            rotations.append(parent * rotation)
    return points


def _displacement(path: Path, joint: _Joint, channels: dict[str, np.ndarray], notes: list[str]) -> np.ndarray:
    """Return the position channels of a joint without its offset, which some suits repeat in them."""
    if not any(name.endswith("position") for name in channels):
        return np.zeros(3)
    zero = np.zeros(len(next(iter(channels.values()))))
    moved = np.transpose([channels.get(f"{axis}position", zero) for axis in "XYZ"])
    length = np.linalg.norm(joint.offset)
    if joint.parent < 0 or not length:
        if length:
            notes.append(f"the OFFSET of {joint.name} was added to its positions")
        return moved
    centre = np.median(moved, axis=0)
    if np.linalg.norm(centre - joint.offset) <= _OFFSET_TOLERANCE * length:
        return moved - joint.offset
    if np.linalg.norm(centre) <= _OFFSET_TOLERANCE * length:
        return moved
    raise InputError(
        f"{path}: the positions of {joint.name} are neither around 0 nor around its OFFSET; export joints with rotations only"
    )
