"""C3D marker files: points and events, after `lumbar.records.c3d_structure` has checked the file.

Each frame has four numbers per point (x, y, z and a residual, negative if the point was not seen), then the analog samples.
Numbers are 4-byte reals or 2-byte integers in the format of the file's processor (C3D user guide, www.c3d.org).
"""

import itertools
import os
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.records.c3d_structure import C3dStructure, check_structure, integers, reals
from lumbar.records.marker_file import MarkerFile, RecordedEvent, mark_missing, split_points
from lumbar.records.unpacking import read_readable

_KINDS = {
    "ANGLES": "joint angle, not a position",
    "FORCES": "force, not a position",
    "MOMENTS": "moment, not a position",
    "POWERS": "power, not a position",
    "SCALARS": "computed number, not a position",
    "REACTIONS": "reaction, not a position",
}
"""Reason to leave out the points of a list, by the list's standard name."""


def c3d_markers(content: dict[str, Any], source: str) -> MarkerFile:
    """Return the markers of `c3d_content`, on the system's clock: a trimmed recording keeps its start time.

    Raises
    ------
    ValueError
        Content with other shapes.
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

    Raises
    ------
    InputError
        A broken or truncated file, or contradictions in it.
    """
    return read_readable(Path(path), _read_content)


def _read_content(path: Path) -> dict[str, Any]:
    structure = check_structure(path)
    parameters = structure.parameters
    labels = list(map(str, _parameter_list(parameters, "POINT:LABELS")))[: structure.n_points]
    # Labels that the file lists as angles, forces, …: by POINT:TYPE_GROUPS, and by lists of standard names.
    kinds, listed = dict(_KINDS), {}
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
    """Return coordinates in the file's unit, shape (n_frames, n_points, 3); NaN if the residual is negative."""
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
    """Return the events of the EVENT group, whose times are stored as minutes and seconds."""
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
