"""Reader of points and events in C3D files that `lumbar.records.c3d_structure` has checked, and writer of C3D files.

Each frame has four numbers per point (x, y, z and a residual, negative if the point was not seen), then the analog samples.
Numbers are 4-byte reals or 2-byte integers in the format of the file's processor (C3D user guide, www.c3d.org).
"""

import itertools
import math
import os
import struct
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.base.files import replacing
from lumbar.records.c3d_structure import C3dStructure, check_structure, integers, reals
from lumbar.records.marker_file import MarkerFile, RecordedEvent, mark_missing, split_points
from lumbar.records.unpacking import read_readable

_OMISSION_REASONS = {
    "ANGLES": "joint angle, not a position",
    "FORCES": "force, not a position",
    "MOMENTS": "moment, not a position",
    "POWERS": "power, not a position",
    "SCALARS": "computed number, not a position",
    "REACTIONS": "reaction, not a position",
}
"""Reason to leave out the points of a list, by the list's standard name."""
_INTEGER, _REAL, _TEXT = 2, 4, -1
_MAX_FRAMES, _MAX_LABELS = 65534, 255
"""Largest number of frames in the header (16 bits, and 65535 means "more") and of labels in a list (8 bits)."""


def c3d_markers(content: dict[str, Any], source: str) -> MarkerFile:
    """Return the markers of `c3d_content`. Times count from the start of the recording, even if the file is trimmed.

    Parameters
    ----------
    content : dict
        Result of `c3d_content`.
    source : str
        The file, for messages.

    Raises
    ------
    ValueError
        If the shapes of the content are wrong.
    """
    points, labels, time = (content[name] for name in ("points", "labels", "time"))
    if points.shape != (len(time), len(labels), 3):
        raise ValueError(f"{source}: {points.shape} coordinates, {len(time)} times, {len(labels)} labels")
    events = tuple(RecordedEvent(*event) for event in content["events"])
    rate, unit, notes = content["rate"], content["unit"], tuple(content["notes"])
    file = MarkerFile(source, time, rate, unit, events=events, notes=notes)
    return split_points(file, labels, points, content["listed"])


def c3d_content(path: str | os.PathLike) -> dict[str, Any]:
    """Return numbers and texts of a C3D file, also a gzipped one, for `c3d_markers`.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    InputError
        If the file is broken, truncated or contradictory.
    """
    return read_readable(Path(path), _read_content)


def _read_content(path: Path) -> dict[str, Any]:
    structure = check_structure(path)
    parameters = structure.parameters
    labels = list(map(str, _parameter_list(parameters, "POINT:LABELS")))[: structure.n_points]
    # Labels that the file lists as angles, forces, …: by POINT:TYPE_GROUPS, and by lists of standard names.
    kinds, listed = dict(_OMISSION_REASONS), {}
    for group in parameters.get("POINT:TYPE_GROUPS", [])[::2]:
        kinds.setdefault(group.upper(), f"listed under POINT:{group}, not a position")
    for group, reason in kinds.items():
        names = filter(None, map(str, _parameter_list(parameters, f"POINT:{group}")))
        listed.update(dict.fromkeys(names, reason))
    return {
        "time": (structure.first_frame - 1 + np.arange(structure.n_frames)) / structure.rate,
        "rate": structure.rate,
        "unit": (parameters.get("POINT:UNITS") or [""])[0],
        "labels": labels + [""] * (structure.n_points - len(labels)),
        "points": mark_missing(read_coordinates(path, structure)),
        "listed": listed,
        "events": [astuple(event) for event in _read_events(parameters)],
        "notes": structure.notes,
    }


def read_coordinates(path: Path, structure: C3dStructure) -> np.ndarray:
    """Return coordinates in the file's unit, shape (n_frames, n_points, 3); NaN if the residual is negative.

    Parameters
    ----------
    path : Path
        The file.
    structure : C3dStructure
        Checked structure of the file.
    """
    data = np.memmap(path, np.uint8, "r", structure.data_start, (structure.n_frames, structure.frame_bytes))
    raw = np.array(data[:, : 4 * structure.n_points * structure.word_bytes])
    raw = raw.reshape(structure.n_frames, structure.n_points, 4, structure.word_bytes)
    decode, factor = (reals, 1.0) if structure.scale < 0 else (integers, structure.scale)
    residual = decode(raw[:, :, 3].reshape(structure.n_frames, -1), structure.processor)
    coordinates = raw[:, :, :3].reshape(structure.n_frames, -1)
    del raw  # memory
    points = decode(coordinates, structure.processor).astype(float, copy=False).reshape(*residual.shape, 3)
    points *= factor
    points[~(residual >= 0)] = np.nan
    return points


def _parameter_list(parameters: dict[str, list], name: str) -> list:
    """Return the values of a parameter; lists of more than 255 continue in NAME2, NAME3 and so on."""
    names = [name, *(f"{name}{number}" for number in range(2, 256))]
    lists = [parameters[name] for name in itertools.takewhile(parameters.__contains__, names)]
    return list(itertools.chain.from_iterable(lists))


def _read_events(parameters: dict[str, list]) -> list[RecordedEvent]:
    """Return the events of the EVENT group; the file stores their times as minutes and seconds."""
    times = _parameter_list(parameters, "EVENT:TIMES")
    labels, contexts = (_parameter_list(parameters, f"EVENT:{name}") for name in ("LABELS", "CONTEXTS"))
    used = int((parameters.get("EVENT:USED") or [len(labels)])[0]) % 65536
    pairs = zip(times[::2], times[1::2], strict=False)
    rows = itertools.zip_longest(pairs, labels, contexts)
    events = [
        RecordedEvent(str(label), str(context or ""), float(60 * time[0] + time[1]))
        for time, label, context in itertools.islice(rows, used)
        if time is not None and label is not None and not isinstance(time[0], str) and np.isfinite(time).all()
    ]
    return sorted(events, key=lambda event: event.time)


def write_c3d(
    path: str | os.PathLike, points: np.ndarray, labels: Sequence[str], rate: float, first_frame: int = 1
) -> None:
    """Write trajectories as a C3D file, completely or not at all.

    Parameters
    ----------
    path : path
        The file.
    points : ndarray, shape (n_frames, n_points, 3)
        Millimetres; NaN if a point was not seen.
    labels : sequence of str
        Label of each point.
    rate : float
        Frames per second.
    first_frame : int
        Number of the first frame on the clock of the recording, from 1.
    """
    n_frames, n_points = points.shape[:2]
    missing = np.isnan(points).any(axis=2)
    quads = np.zeros((n_frames, n_points, 4), "<f4")
    quads[..., :3] = np.where(missing[..., None], 0, points)
    quads[..., 3] = np.where(missing, -1, 0)
    frames = first_frame, first_frame + n_frames - 1
    # The section contains the block at which the data start, which depends on the section's length.
    section = _parameter_section(n_points, frames, labels, rate, data_block=0)
    blocks = math.ceil(len(section) / 512)
    section = _parameter_section(n_points, frames, labels, rate, data_block=2 + blocks)
    counts = (2, 0x50, n_points, 0, *(min(frame, _MAX_FRAMES + 1) for frame in frames), 10)
    header = struct.pack("<BB5HfHHf", *counts, -1.0, 2 + blocks, 1, rate)
    with replacing(path) as temporary:
        temporary.write_bytes(header.ljust(512, b"\0") + section.ljust(512 * blocks, b"\0") + quads.tobytes())


def _parameter_section(
    n_points: int, frames: tuple[int, int], labels: Sequence[str], rate: float, data_block: int
) -> bytes:
    """Return the parameter groups POINT and ANALOG, and TRIAL if the header cannot represent the frame numbers."""
    n_frames = frames[1] - frames[0] + 1
    content = struct.pack("4B", 1, 0x50, max(data_block - 2, 0), 84)
    content += _encode_entry(b"POINT", -1, b"") + _encode_entry(b"ANALOG", -2, b"")
    content += _parameter(b"USED", 1, _INTEGER, (), struct.pack("<H", n_points))
    content += _parameter(b"FRAMES", 1, _INTEGER, (), struct.pack("<H", min(n_frames, _MAX_FRAMES + 1)))
    content += _parameter(b"DATA_START", 1, _INTEGER, (), struct.pack("<H", data_block))
    content += _parameter(b"SCALE", 1, _REAL, (), struct.pack("<f", -1.0))
    content += _parameter(b"RATE", 1, _REAL, (), struct.pack("<f", rate))
    content += _parameter(b"UNITS", 1, _TEXT, (2,), b"mm")
    for number, start in enumerate(range(0, n_points, _MAX_LABELS), 1):
        texts = [label.encode() for label in labels[start : start + _MAX_LABELS]]
        width = max(map(len, texts))
        name = b"LABELS" if number == 1 else b"LABELS%d" % number
        content += _parameter(
            name, 1, _TEXT, (width, len(texts)), b"".join(text.ljust(width) for text in texts)
        )
    content += _parameter(b"USED", 2, _INTEGER, (), struct.pack("<H", 0))
    content += _parameter(b"RATE", 2, _REAL, (), struct.pack("<f", rate))
    if frames[1] > _MAX_FRAMES:
        content += _encode_entry(b"TRIAL", -3, b"")
        for name, frame in zip((b"ACTUAL_START_FIELD", b"ACTUAL_END_FIELD"), frames, strict=True):
            content += _parameter(name, 3, _INTEGER, (2,), struct.pack("<2H", frame % 65536, frame // 65536))
    return content + b"\0\0"


def _parameter(name: bytes, group: int, kind: int, dimensions: tuple[int, ...], values: bytes) -> bytes:
    return _encode_entry(name, group, struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + values)


def _encode_entry(name: bytes, group: int, body: bytes) -> bytes:
    """Return a group (negative number) or a parameter, with an empty description."""
    head = struct.pack("bb", len(name), group) + name
    return head + struct.pack("<h", len(body) + 3) + body + b"\0"
