"""Writing of trajectories as a C3D file (C3D user guide, www.c3d.org): Intel's byte order, 4-byte reals."""

import math
import os
import struct
from collections.abc import Sequence

import numpy as np

from lumbar.base.files import replacing

_INTEGER, _REAL, _TEXT = 2, 4, -1
_MAX_FRAMES, _MAX_LABELS = 65534, 255
"""The header counts frames in 16 bits, and its largest value means "more"; a list of labels counts in 8."""


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
        One per point.
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
    section = _section(n_points, frames, labels, rate, data_block=0)
    blocks = math.ceil(len(section) / 512)
    section = _section(n_points, frames, labels, rate, data_block=2 + blocks)
    counts = (2, 0x50, n_points, 0, *(min(frame, _MAX_FRAMES + 1) for frame in frames), 10)
    header = struct.pack("<BB5HfHHf", *counts, -1.0, 2 + blocks, 1, rate)
    with replacing(path) as temporary:
        temporary.write_bytes(header.ljust(512, b"\0") + section.ljust(512 * blocks, b"\0") + quads.tobytes())


def _section(
    n_points: int, frames: tuple[int, int], labels: Sequence[str], rate: float, data_block: int
) -> bytes:
    """Return the groups POINT and ANALOG, and TRIAL if the header cannot represent the frames' numbers."""
    n_frames = frames[1] - frames[0] + 1
    content = struct.pack("4B", 1, 0x50, max(data_block - 2, 0), 84)
    content += _entry(b"POINT", -1, b"") + _entry(b"ANALOG", -2, b"")
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
        content += _entry(b"TRIAL", -3, b"")
        for name, frame in zip((b"ACTUAL_START_FIELD", b"ACTUAL_END_FIELD"), frames, strict=True):
            content += _parameter(name, 3, _INTEGER, (2,), struct.pack("<2H", frame % 65536, frame // 65536))
    return content + b"\0\0"


def _parameter(name: bytes, group: int, kind: int, dimensions: tuple[int, ...], values: bytes) -> bytes:
    return _entry(name, group, struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + values)


def _entry(name: bytes, group: int, body: bytes) -> bytes:
    """Return a group (negative number) or a parameter, with an empty description."""
    head = struct.pack("bb", len(name), group) + name
    return head + struct.pack("<h", len(body) + 3) + body + b"\0"
