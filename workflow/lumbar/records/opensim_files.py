"""Files that OpenSim goes on from: trajectories (TRC) and forces (MOT), in its axes: x forward, y up, z to the right."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lumbar.base.files import write_text


def opensim_axes(vectors: np.ndarray) -> np.ndarray:
    """Turn vectors (right, forward, up), shape (..., 3), into OpenSim's axes."""
    return vectors[..., [1, 2, 0]]


def write_trc(
    path: str | os.PathLike, time: np.ndarray, rate: float, positions: Mapping[str, np.ndarray]
) -> None:
    """Write markers (metres; right, forward, up; shape (n, 3), NaN where not seen: an empty cell) in millimetres."""
    points = 1e3 * np.hstack([opensim_axes(values) for values in positions.values()])
    numbers = [f"{axis}{number}" for number in range(1, len(positions) + 1) for axis in "XYZ"]
    keys = [
        "DataRate",
        "CameraRate",
        "NumFrames",
        "NumMarkers",
        "Units",
        "OrigDataRate",
        "OrigDataStartFrame",
        "OrigNumFrames",
    ]
    values = (rate, rate, len(time), len(positions), "mm", rate, 1, len(time))
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", Path(path).name],
        keys,
        [f"{value:.12g}" if isinstance(value, float) else str(value) for value in values],
        ["Frame#", "Time", *(cell for label in positions for cell in (label, "", ""))][:-2],
        ["", "", *numbers],
        [],
    ]
    for frame, (at, row) in enumerate(zip(time, points, strict=True), 1):
        lines.append([str(frame), f"{at:.6f}", *("" if np.isnan(x) else f"{x:.5f}" for x in row)])
    write_text(path, "".join("\t".join(cells) + "\n" for cells in lines))


def write_mot(path: str | os.PathLike, time: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns over time, each of shape (n,), as a motion file."""
    table = np.column_stack([time, *columns.values()])
    head = [
        Path(path).stem,
        "version=1",
        f"nRows={len(table)}",
        f"nColumns={table.shape[1]}",
        "inDegrees=no",
        "endheader",
    ]
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in table]
    write_text(path, "\n".join([*head, "\t".join(["time", *columns]), *rows]) + "\n")
