"""C3D marker files: points, events and what the file says of itself, after `lumbar.records.c3d_structure` has found it sound.

Each frame holds four numbers per point (x, y, z, and a residual that is negative where the point was not seen),
then the analog samples, all channels of one instant together. Numbers are 4-byte reals or 2-byte integers,
in the byte order and the format of reals of the processor that the file names (C3D user guide, www.c3d.org).
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


def read_coordinates(path: Path, structure: C3dStructure) -> np.ndarray:
    """Coordinates in the file's unit, shape (n_frames, n_points, 3); NaN where the residual is negative."""
    raw = _frames(path, structure, 0, 4 * structure.n_points)
    decode, factor = (reals, 1.0) if structure.scale < 0 else (integers, structure.scale)
    raw = raw.reshape(structure.n_frames, structure.n_points, 4, structure.word_bytes)
    residual = decode(raw[:, :, 3].reshape(structure.n_frames, -1), structure.processor)
    words = raw[:, :, :3].reshape(structure.n_frames, -1)
    del raw
    points = decode(words, structure.processor).astype(float, copy=False).reshape(*residual.shape, 3)
    points *= factor
    points[~(residual >= 0)] = np.nan
    return points


def parameter_list(parameters: dict[str, list], name: str) -> list:
    """Values of a parameter; lists of more than 255 continue in NAME2, NAME3 and so on."""
    names = [name, *(f"{name}{number}" for number in range(2, 256))]
    lists = [parameters[name] for name in itertools.takewhile(parameters.__contains__, names)]
    return list(itertools.chain.from_iterable(lists))


def _frames(path: Path, structure: C3dStructure, first_word: int, n_words: int) -> np.ndarray:
    """Bytes of the words from `first_word` on of every frame, shape (n_frames, n_words * word_bytes)."""
    data = np.memmap(path, np.uint8, "r", structure.data_start, (structure.n_frames, structure.frame_bytes))
    start = first_word * structure.word_bytes
    return np.array(data[:, start : start + n_words * structure.word_bytes])


_KINDS = {
    "ANGLES": "joint angle, not a position",
    "FORCES": "force, not a position",
    "MOMENTS": "moment, not a position",
    "POWERS": "power, not a position",
    "SCALARS": "computed number, not a position",
    "REACTIONS": "reaction, not a position",
}


def read_c3d(path: str | os.PathLike) -> MarkerFile:
    """Read the points of a C3D file, on the clock of the system's first frame, which a recording that was trimmed keeps.

    Raises
    ------
    InputError
        The file is broken, cut short or contradicts itself.
    """
    return c3d_markers(c3d_content(path), str(path))


def c3d_markers(content: dict[str, Any], source: str) -> MarkerFile:
    """Return the markers of `c3d_content`.

    Raises
    ------
    ValueError
        The content is of another form.
    """
    points, labels, time = (content[name] for name in ("points", "labels", "time"))
    if points.shape != (len(time), len(labels), 3):
        raise ValueError(f"{source}: {points.shape} coordinates, {len(time)} times, {len(labels)} labels")
    events = tuple(RecordedEvent(*event) for event in content["events"])
    return split_points(source, **content | {"events": events, "notes": tuple(content["notes"])})


def c3d_content(path: str | os.PathLike) -> dict[str, Any]:
    """Return numbers and texts of a C3D file, also a packed one, by the names of `lumbar.records.marker_file.split_points`.

    Raises
    ------
    InputError
        As of `read_c3d`.
    """
    return read_readable(Path(path), _content)


def _content(path: Path) -> dict[str, Any]:
    structure = check_structure(path)
    labels = list(map(str, parameter_list(structure.parameters, "POINT:LABELS")))[: structure.n_points]
    return {
        "time": (structure.first_frame - 1 + np.arange(structure.n_frames)) / structure.rate,
        "rate": structure.rate,
        "unit": (structure.parameters.get("POINT:UNITS") or [""])[0],
        "labels": labels + [""] * (structure.n_points - len(labels)),
        "points": mark_missing(read_coordinates(path, structure)),
        "listed": _listed_kinds(structure),
        "events": [astuple(event) for event in _events(structure.parameters)],
        "notes": structure.notes,
    }


def _events(parameters: dict[str, list]) -> tuple[RecordedEvent, ...]:
    """Events of the EVENT group; their times are stored as minutes and seconds."""
    times = parameter_list(parameters, "EVENT:TIMES")
    labels, contexts = (parameter_list(parameters, f"EVENT:{name}") for name in ("LABELS", "CONTEXTS"))
    used = int((parameters.get("EVENT:USED") or [len(labels)])[0]) % 65536
    pairs = zip(times[::2], times[1::2], strict=False)
    rows = itertools.zip_longest(pairs, labels, contexts)
    events = [
        RecordedEvent(str(label), str(context or ""), float(60 * at[0] + at[1]))
        for at, label, context in itertools.islice(rows, used)
        if at is not None and label is not None and not isinstance(at[0], str) and np.isfinite(at).all()
    ]
    return tuple(sorted(events, key=lambda event: event.time))


def _listed_kinds(structure: C3dStructure) -> dict[str, str]:
    """Labels listed as angles, forces, …: by POINT:TYPE_GROUPS, and by the lists of the usual names."""
    parameters = structure.parameters
    kinds = dict(_KINDS)
    for group in parameters.get("POINT:TYPE_GROUPS", [])[::2]:
        kinds.setdefault(group.upper(), f"listed under POINT:{group}, not a position")
    listed = {}
    for group, reason in kinds.items():
        listed.update(
            dict.fromkeys(filter(None, map(str, parameter_list(parameters, f"POINT:{group}"))), reason)
        )
    return listed
