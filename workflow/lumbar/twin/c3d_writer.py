"""Writes markers as a C3D file (Intel, reals) after the C3D user guide, www.c3d.org."""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Sequence

import numpy as np

from lumbar.base.files import replacing

_INTEGER, _REAL, _TEXT = 2, 4, -1


def write_c3d(
    path: str | os.PathLike, points: np.ndarray, labels: Sequence[str], rate: float, unit: str
) -> None:
    """Write trajectories as a C3D file, whole or not at all.

    Parameters
    ----------
    path : path
    points : ndarray, shape (n_frames, n_points, 3)
        NaN where a point was not seen; at most 65534 frames and 255 points.
    labels : sequence of str
        One per point.
    rate : float
        Hertz.
    unit : str
        Unit of length of the coordinates.
    """
    n_frames, n_points = points.shape[:2]
    missing = np.isnan(points).any(axis=2)
    quads = np.zeros((n_frames, n_points, 4), "<f4")
    quads[..., :3] = np.where(missing[..., None], 0, points)
    quads[..., 3] = np.where(missing, -1, 0)
    # The block at which the data start stands in the section whose length decides it.
    section = _section(n_points, n_frames, labels, rate, unit, data_block=0)
    blocks = math.ceil(len(section) / 512)
    section = _section(n_points, n_frames, labels, rate, unit, data_block=2 + blocks)
    header = struct.pack("<BB5HfHHf", 2, 0x50, n_points, 0, 1, n_frames, 10, -1.0, 2 + blocks, 1, rate)
    with replacing(path) as temporary:
        temporary.write_bytes(header.ljust(512, b"\0") + section.ljust(512 * blocks, b"\0") + quads.tobytes())


def _section(
    n_points: int, n_frames: int, labels: Sequence[str], rate: float, unit: str, data_block: int
) -> bytes:
    """Parameter section: the groups POINT and ANALOG."""
    width = max(map(len, labels))
    text = "".join(label.ljust(width) for label in labels).encode("ascii")
    blocks = max(data_block - 2, 0)
    content = struct.pack("4B", 1, 0x50, blocks, 84)
    content += _entry(b"POINT", -1, b"") + _entry(b"ANALOG", -2, b"")
    content += _parameter(b"USED", 1, _INTEGER, (), struct.pack("<H", n_points))
    content += _parameter(b"FRAMES", 1, _INTEGER, (), struct.pack("<H", n_frames))
    content += _parameter(b"DATA_START", 1, _INTEGER, (), struct.pack("<H", data_block))
    content += _parameter(b"SCALE", 1, _REAL, (), struct.pack("<f", -1.0))
    content += _parameter(b"RATE", 1, _REAL, (), struct.pack("<f", rate))
    content += _parameter(b"UNITS", 1, _TEXT, (len(unit),), unit.encode("ascii"))
    content += _parameter(b"LABELS", 1, _TEXT, (width, len(labels)), text)
    content += _parameter(b"USED", 2, _INTEGER, (), struct.pack("<H", 0))
    content += _parameter(b"RATE", 2, _REAL, (), struct.pack("<f", rate))
    return content + b"\0\0"


def _parameter(name: bytes, group: int, kind: int, dimensions: tuple[int, ...], values: bytes) -> bytes:
    return _entry(name, group, struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + values)


def _entry(name: bytes, group: int, body: bytes) -> bytes:
    """One group (negative number) or parameter, with an empty description."""
    head = struct.pack("bb", len(name), group) + name
    return head + struct.pack("<h", len(body) + 3) + body + b"\0"
