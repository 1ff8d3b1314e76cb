"""Markers in MATLAB files (4 to 7.2): as Qualisys Track Manager exports them, or as arrays with a clock.

- QTM: one struct with ``FrameRate``, ``StartFrame`` and ``Trajectories.Labeled`` (``Labels``; ``Data``, markers × (x, y, z,
  residual) × frames, in millimetres); its ``Events`` are read.
- ``labels`` (cell array of names) with ``points``, frames × markers × 3.
- One array per marker, frames × 3, or × 4 where the last column is 1 (as Kinetics Toolkit has them).

The last two, by themselves or in one struct, need ``time`` (seconds) or ``rate`` (or the layout's ``rate_Hz``); ``unit`` may
stand beside them. A missing sample is NaN or 0, 0, 0. Whatever else has other shapes is left out.
"""

import os
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.marker_file import MarkerFile, NoMarkers, RecordedEvent, mark_missing, split_points
from lumbar.records.marker_table import even_clock
from lumbar.records.matlab_file import load_matlab
from lumbar.records.record import LARGEST

_TIME = ("time", "t", "time_s")
_RATE = ("rate", "framerate", "rate_hz", "fs", "frequency")
_UNIT = ("unit", "units")
_LAYOUTS = (
    "QTM's export (Trajectories.Labeled), labels with points (frames × markers × 3), or an array (frames × 3) per marker "
    "are read, with time or rate"
)


def read_mat_markers(path: str | os.PathLike, rate: float | None = None) -> MarkerFile:
    """Read markers from a MATLAB file.

    Parameters
    ----------
    rate : float, optional
        Frames per second, where the file has neither times nor a rate; with times, they must agree.

    Raises
    ------
    InputError
        No MATLAB file of version 4 to 7.2, none of the layouts above, several recordings in one file, a clock that is missing
        or not even, labels that do not fit the points.
    """
    path = Path(path)
    fields = _fields(path)
    if "Trajectories" in fields:
        return _qualisys(path, fields)
    found = {name.lower(): value for name, value in fields.items()}
    labels, points = _labelled(path, found) if "points" in found else _one_by_one(path, fields)
    time, rate = _clock(path, found, len(points), rate)
    return split_points(
        source=str(path),
        time=time,
        rate=rate,
        unit=next((str(found[name]) for name in _UNIT if isinstance(found.get(name), str)), ""),
        labels=labels,
        points=mark_missing(_limited(path, points)),
    )


def _fields(path: Path) -> dict[str, Any]:
    """Variables of a file, or the fields of the one struct that it holds."""
    content = load_matlab(path.read_bytes(), str(path), "the MATLAB file is broken", simplify_cells=True)
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    structs = {name: value for name, value in variables.items() if isinstance(value, dict)}
    recordings = [name for name, value in structs.items() if "Trajectories" in value]
    if len(recordings) > 1 or (len(structs) > 1 and len(structs) == len(variables)):
        raise InputError(
            f"{path}: {', '.join(recordings or structs)} are several recordings; save each in a file of its own"
        )
    if len(structs) == 1 and (recordings or len(variables) == 1):
        return next(iter(structs.values()))
    return variables


def _qualisys(path: Path, fields: dict[str, Any]) -> MarkerFile:
    trajectories = fields["Trajectories"]
    labelled = trajectories.get("Labeled") if isinstance(trajectories, dict) else None
    if not isinstance(labelled, dict) or "Data" not in labelled or "Labels" not in labelled:
        raise InputError(
            f"{path}: no Trajectories.Labeled with Labels and Data; label the trajectories in QTM, then export"
        )
    labels = _names(labelled["Labels"])
    data = np.asarray(labelled["Data"])
    if data.ndim == 2:  # MATLAB and SciPy drop dimensions of length one: one marker, or one frame
        data = data[None] if len(labels) == 1 else data[..., None]
    rate = fields.get("FrameRate")
    if data.ndim != 3 or data.shape[1] not in (3, 4) or data.shape[0] != len(labels):
        raise InputError(
            f"{path}: Trajectories.Labeled.Data has the shape {' × '.join(map(str, data.shape))} for {len(labels)} labels; "
            "markers × 4 × frames are needed"
        )
    if not _is_rate(rate):
        raise InputError(f"{path}: FrameRate is {rate!r}; a positive number is needed")
    start = fields.get("StartFrame", 1)
    first = int(start) if _is_rate(start) else 1
    points = np.transpose(data[:, :3], (2, 0, 1))
    return split_points(
        source=str(path),
        time=(first - 1 + np.arange(len(points))) / rate,
        rate=float(rate),
        unit="mm",
        labels=labels,
        points=mark_missing(_limited(path, points)),
        events=_events(fields.get("Events")),
    )


def _events(listed: Any) -> tuple[RecordedEvent, ...]:
    """Events of QTM: a struct with Label and Time for each."""
    rows = listed if isinstance(listed, list | np.ndarray) else [listed]
    events = [
        RecordedEvent(str(row["Label"]), "", float(row["Time"]))
        for row in rows
        if isinstance(row, dict) and _is_number(row.get("Time")) and "Label" in row
    ]
    return tuple(sorted(events, key=lambda event: event.time))


def _labelled(path: Path, found: dict[str, Any]) -> tuple[list[str], np.ndarray]:
    """Labels and points of one array, shape (n_frames, n_markers, 3)."""
    points, labels = np.asarray(found["points"]), _names(found.get("labels", []))
    if points.ndim == 2 and points.shape[1] == 3 and len(labels) == 1:
        points = points[:, None]
    if points.ndim != 3 or points.shape[1:] != (len(labels), 3):
        raise InputError(
            f"{path}: points has the shape {' × '.join(map(str, points.shape))} for {len(labels)} labels; frames × markers × 3 "
            "and one label per marker are needed"
        )
    return labels, points


def _one_by_one(path: Path, fields: dict[str, Any]) -> tuple[list[str], np.ndarray]:
    """Labels and points of arrays of three columns, one per marker."""
    arrays = {name: np.asarray(value) for name, value in fields.items()}
    arrays = {name: value for name, value in arrays.items() if _is_marker(value)}
    lengths = sorted({len(value) for value in arrays.values()})
    if len(lengths) != 1:
        found = f"arrays of {' and '.join(map(str, lengths))} frames" if arrays else "no markers"
        kind = InputError if arrays else NoMarkers
        raise kind(f"{path}: {found} ({', '.join(list(fields)[:12])}); {_LAYOUTS}")
    return list(arrays), np.stack([value[:, :3] for value in arrays.values()], axis=1)


def _is_marker(value: np.ndarray) -> bool:
    if value.ndim != 2 or value.dtype.kind not in "fiu" or value.shape[0] < 2:
        return False
    if value.shape[1] != 4:
        return value.shape[1] == 3
    fourth = value[:, 3]
    return bool((fourth[np.isfinite(fourth)] == 1).all())


def _clock(path: Path, found: dict[str, Any], n_frames: int, rate: float | None) -> tuple[np.ndarray, float]:
    printed = next((np.asarray(found[name]) for name in _TIME if name in found), None)
    if printed is not None:
        if printed.shape != (n_frames,) or printed.dtype.kind not in "fiu" or n_frames < 2:
            raise InputError(
                f"{path}: time has the shape {' × '.join(map(str, printed.shape))}; {n_frames} numbers are needed, one per frame"
            )
        return even_clock(path, printed.astype(float), rate)
    stated = next((found[name] for name in _RATE if name in found), rate)
    if not _is_rate(stated):
        raise InputError(f"{path}: neither time nor rate; set markers.rate_Hz to the frames per second")
    return np.arange(n_frames) / stated, float(stated)


def _is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a number; MATLAB stores small whole ones as bytes, which SciPy gives as they are."""
    return isinstance(value, int | float | np.integer | np.floating) and bool(np.isfinite(value))


def _is_rate(value: Any) -> TypeGuard[float]:
    return _is_number(value) and 0 < value < 1e6


def _names(labels: Any) -> list[str]:
    """Labels of a cell array, or of one text."""
    return [str(label).strip() for label in np.atleast_1d(np.asarray(labels, dtype=object)).ravel()]


def _limited(path: Path, points: np.ndarray) -> np.ndarray:
    """Points as numbers that a coordinate can be, shape (n_frames, n_markers, 3)."""
    if points.dtype.kind not in "fiu":
        raise InputError(f"{path}: its points are no numbers")
    points = points.astype(float)
    if np.nanmax(np.abs(np.where(np.isfinite(points), points, 0)), initial=0) > LARGEST:
        raise InputError(f"{path}: a number too large; at most {LARGEST:g} in size is allowed")
    return points
