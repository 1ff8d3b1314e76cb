"""Marker files in plain text: TRC tables (OpenSim, Cortex), and BVH skeletons with joint angles (inertial suits, animation).

TRC has five header lines and cells separated by tabs or commas. Common irregularities are accepted: ``Times`` for ``Time``, one
to three tabs between names, doubled tabs in the header, an extra tab before or after every row, trajectories without a name, a
clock that does not start at 0. All rows must have three cells per marker, the counts of the header must be those of the file,
and the clock must be even with the stated rate.

The position of a joint of BVH is its OFFSET in the axes of its parent. Its rotation channels, in degrees and in the order of
the file, rotate its own axes; the root moves by its position channels. The file states no unit of length.
"""

import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lumbar.base.errors import MAX_PROBLEMS, InputError, Problems
from lumbar.records.marker_file import (
    RATES_HZ,
    MarkerFile,
    check_even,
    clock_from_times,
    mark_missing,
    read_frames,
    split_points,
)
from lumbar.records.number_table import Dialect, Row, decode_lines, parse_number, split_rows

_RATE_TOLERANCE = 1e-4


def read_trc(path: str | os.PathLike) -> MarkerFile:
    """Read a TRC file.

    Parameters
    ----------
    path : path
        The unpacked file.

    Raises
    ------
    InputError
        If the file is not TRC, the header contradicts the data, a row is truncated or lacks a cell, or the clock is not even.
    """
    path = Path(path)
    lines, _ = decode_lines(path.read_bytes(), str(path), lenient=True)
    header = _read_header(path, lines)
    labels = _read_labels(path, header.names, header.n_markers)
    # Frames, without the header's fifth line (X1, Y1, Z1 and so on).
    dialect = Dialect(header.delimiter)
    rows = [row for row in split_rows(lines[4:], dialect, str(path), first=5) if any(row.cells)]
    rows = [row for row in rows if next(filter(None, row.cells)).upper() not in ("X1", "X")]
    if not rows:
        raise InputError(f"{path}: no data rows")
    columns = _find_columns(path, rows, 2 + 3 * len(labels), len(labels))
    rows = [Row(row.line, row.cells[columns]) for row in rows]
    frames = read_frames(rows, 2 + 3 * len(labels), str(path), dialect)
    _check_frames(path, frames, rows, header)
    even, rate, notes = _read_clock(path, frames[:, 1], rows, header)
    if header.n_frames != len(frames):
        notes += (f"NumFrames is {header.n_frames:g}; {len(frames)} frames were read",)
    points = mark_missing(frames[:, 2:].reshape(len(frames), len(labels), 3))
    return split_points(MarkerFile(str(path), even, rate, header.unit, notes=notes), labels, points)


@dataclass(frozen=True)
class _Header:
    rate: float
    """Frames per second; 0 if the file states none."""
    n_frames: float
    n_markers: int
    unit: str
    """Unit of length; empty if the file states none."""
    names: list[str]
    """Cells of line 4 after the time."""
    delimiter: str


def _read_header(path: Path, lines: list[str]) -> _Header:
    """Return the keys of lines 2 and 3 and the names of line 4."""
    if len(lines) < 4 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path}: not a TRC file; PathFileType and four header lines are needed")
    delimiter = next((sign for sign in "\t," if sign in lines[3]), None)
    if delimiter is None:
        raise InputError(
            f"{path}, line 4: cells are separated by neither tabs nor commas; export it with tabs"
        )
    keys, entries, names = (Dialect(delimiter).split(line) for line in lines[1:4])
    if keys.count("") != entries.count("") or len(keys) != len(entries):
        # Doubled delimiters in one of the two lines.
        keys, entries = [key for key in keys if key], [entry for entry in entries if entry]
    stated = dict(zip(keys, entries, strict=False))
    problems = Problems(f"{path}, lines 2 and 3")
    numbers = {}
    for key, (low, high) in {"DataRate": RATES_HZ, "NumFrames": (1, 1e9), "NumMarkers": (1, 1e5)}.items():
        try:
            numbers[key] = parse_number(stated[key])
            has_no_rate = key == "DataRate" and numbers[key] == 0  # OpenSim Moco
            if not (low <= numbers[key] <= high or has_no_rate):
                problems.add(key, stated[key], f"a positive number is needed, {low:g} to {high:g}")
        except KeyError:
            problems.add("", f"no {key}")
        except ValueError:
            problems.add(key, repr(stated[key]), "a number is needed")
    problems.raise_if_any()
    if names[1:2] == [""]:
        names.pop(1)  # doubled
    if not names[0].startswith("Frame") or len(names) < 3 or not names[1].startswith("Time"):
        raise InputError(f"{path}, line 4: starts with {names[:2]}; Frame# and Time are needed")
    unit, n_markers = stated.get("Units", ""), int(numbers["NumMarkers"])
    return _Header(numbers["DataRate"], numbers["NumFrames"], n_markers, unit, names[2:], delimiter)


def _read_labels(path: Path, cells: list[str], n_markers: int) -> list[str]:
    """Return one label per marker; empty for a trajectory without a name, which has an empty cell above its columns."""
    named = [cell for cell in cells if cell]
    if not named:
        raise InputError(f"{path}, line 4: no marker names after Frame# and Time")
    if len(named) == n_markers:
        return named
    above = cells[: 3 * n_markers : 3]
    if len(named) < n_markers and [cell for cell in above if cell] == named:
        return above + [""] * (n_markers - len(above))
    raise InputError(
        f"{path}: NumMarkers: {n_markers}; line 4 names {len(named)} markers; trajectories without a name are read if each name "
        "is above the first of its three columns"
    )


def _check_frames(path: Path, frames: np.ndarray, rows: list[Row], header: _Header) -> None:
    """Raise if a frame has no time, a column is missing, or the file has fewer frames than stated."""
    has_time = np.isfinite(frames[:, :2]).all(axis=1)
    if not has_time.all():
        raise InputError(f"{path}: line {rows[int(has_time.argmin())].line}: no time")
    # If no frame of a marker has all three coordinates, the columns are shifted.
    is_seen = np.isfinite(frames[:, 2:]).reshape(len(frames), -1, 3)
    is_torn = is_seen.any(axis=(0, 2)) & ~is_seen.all(axis=2).any(axis=0)
    if is_torn.any():
        raise InputError(
            f"{path}: marker {int(is_torn.argmax()) + 1} has one or two coordinates and never three; a column is missing"
        )
    if header.n_frames > len(frames):
        raise InputError(
            f"{path}: NumFrames: {header.n_frames:g}; the file holds {len(frames)} frames and may be cut short"
        )


def _find_columns(path: Path, rows: list[Row], width: int, n_markers: int) -> slice:
    """Return the cells of a row with the frame's number, its time and the markers.

    An extra delimiter before or after the numbers adds an empty cell to every row. A row with another number of cells
    is an error: its numbers would be under the wrong markers.
    """
    common = Counter(len(row.cells) for row in rows).most_common(1)[0][0]
    first, last = 0, common
    if common > width and not any(row.cells[0] for row in rows):
        first = 1
    while last - first > width and not any(row.cells[last - 1] for row in rows if len(row.cells) == common):
        last -= 1
    if last - first != width:
        raise InputError(
            f"{path}: line {rows[0].line}: {last - first} cells, as in most rows; {width} are needed for {n_markers} "
            "markers (NumMarkers)"
        )
    problems = Problems(str(path), most=MAX_PROBLEMS)
    remedy = f"{common} are needed, as in the other rows: a cell was lost or added, and later numbers are under other markers"
    for line, cells in rows:
        if len(cells) != common:
            problems.add(f"line {line}", f"{len(cells)} cells", remedy)
    problems.raise_if_any()
    return slice(first, last)


def _read_clock(
    path: Path, printed: np.ndarray, rows: list[Row], header: _Header
) -> tuple[np.ndarray, float, tuple[str, ...]]:
    """Return the times of an even clock, its rate, and a note if the header states no rate."""
    if not header.rate:
        even, rate = clock_from_times(str(path), printed)
        return even, rate, (f"DataRate is 0; the times run at {rate:g} Hz, which was taken",)
    # Times of the frames at the stated rate, compared with the printed ones. A printed time is off by half its last digit; a
    # rate printed with few digits drifts over a recording.
    usual = 1 / header.rate if len(printed) < 2 else np.median(np.diff(printed))
    if usual > 0 and not np.isclose(usual * header.rate, 1, rtol=0.2):
        message = f"DataRate: {header.rate:g}; the times run at {1 / usual:.4g} Hz: correct the wrong one"
        raise InputError(f"{path}: {message}")
    steps = np.arange(len(printed)) / header.rate
    even = np.median(printed - steps) + steps
    decimals = min(max(len(row.cells[1].partition(".")[2]) for row in rows), 300)
    check_even(str(path), printed, even, header.rate, 10.0**-decimals / 2 + _RATE_TOLERANCE * steps[-1])
    return even, header.rate, ()


_CHANNELS = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ"]
_BLANKS = Dialect(None)
_MAX_JOINTS = 1000
_OFFSET_TOLERANCE = 0.1
"""Largest distance of a joint's position channels from its offset, as a share of the offset, if they are a copy of it."""


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
        If the skeleton is not a tree of joints, a channel is unknown, a row does not fit the channels, or the number of
        frames is not the stated one.
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
    """Return the position channels of a joint; subtract its offset if the suit repeats the offset in them."""
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
