"""C3D marker files: points, events and what the file says of itself, after `lumbar.records.c3d_structure` has found it sound."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import numpy as np

from lumbar.records.c3d_data import parameter_list, read_coordinates
from lumbar.records.c3d_structure import C3dStructure, check_structure
from lumbar.records.marker_file import MarkerFile, RecordedEvent, mark_missing
from lumbar.records.point_kinds import split_points

_KINDS = {
    "ANGLES": "joint angle, not a position",
    "FORCES": "force, not a position",
    "MOMENTS": "moment, not a position",
    "POWERS": "power, not a position",
    "SCALARS": "computed number, not a position",
    "REACTIONS": "reaction, not a position",
}


def read_c3d(path: str | os.PathLike) -> MarkerFile:
    """Read the points of a C3D file.

    Parameters
    ----------
    path : path

    Returns
    -------
    MarkerFile
        Time counts from the system's first frame, so that a recording that was trimmed keeps its clock.

    Raises
    ------
    InputError
        The file is broken, cut short or contradicts itself.
    """
    path = Path(path)
    structure = check_structure(path)
    labels = list(map(str, parameter_list(structure.parameters, "POINT:LABELS")))[: structure.n_points]
    return split_points(
        source=str(path),
        time=(structure.first_frame - 1 + np.arange(structure.n_frames)) / structure.rate,
        rate=structure.rate,
        unit=(structure.parameters.get("POINT:UNITS") or [""])[0],
        labels=labels + [""] * (structure.n_points - len(labels)),
        points=mark_missing(read_coordinates(path, structure)),
        listed=_listed_kinds(structure),
        events=_events(structure.parameters),
        notes=structure.notes,
    )


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
