"""Markers in tables (CSV): one row per frame, three columns per marker, with one or two lines of names.

Either each column names marker and axis, or the first line names markers and the second axes::

    time_s,C7_x,C7_y,C7_z,SACRUM_x,…          ,C7,,,SACRUM,,
    0.00,12.1,853.0,1450.2,…                   time_s,x,y,z,x,y,z

Cells are separated by commas, semicolons (then with a decimal point or comma) or tabs. Times are in seconds or in the unit
after their name (``time_ms``, ``Time (ms)``); without times the layout's ``rate_Hz`` is needed. A unit of length may follow the
axis (``C7_x_mm``, ``C7 X [mm]``), otherwise the layout's ``unit`` is needed. An empty cell is a missing sample. Tables of Vicon
Nexus, Motive and Qualisys Track Manager (TSV) are recognised by their first cell and read by their published layouts.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import (
    MarkerFile,
    NoMarkersError,
    clock_from_times,
    mark_missing,
    read_frames,
    split_points,
)
from lumbar.records.number_table import Dialect, Row, decode_lines, split_rows

_TIME = re.compile(r"^(?:time|t|zeit)[\s_]*[\[(]?(s|sec|ms|)[\])]?$", re.IGNORECASE)
_FRAME = re.compile(r"^(frame|frame#|index|sample)$", re.IGNORECASE)
_COORDINATE = re.compile(
    r"^(?P<marker>.*?)[\s_.:-]+(?P<axis>[xyz])(?:[\s_]*[\[(]?(?P<unit>mm|cm|m)[\])]?)?$", re.IGNORECASE
)
_MAX_NAME_CHARACTERS = 1000
_UNITS = {"Meters": "m", "Centimeters": "cm", "Millimeters": "mm"}


@dataclass(frozen=True)
class _Table:
    """A table with one name per column, as ``C7_x``; a name is empty if the column is not a coordinate of a marker."""

    header: list[str]
    rows: Sequence[Row]
    unit: str = ""
    rate: float | None = None
    """Frames per second; None if there is a column of times."""


def read_marker_table(path: str | os.PathLike, rate: float | None = None) -> MarkerFile:
    """Read markers from a CSV file.

    Parameters
    ----------
    path : path
        The file.
    rate : float, optional
        Frames per second, if the file has no times; with times, they must agree.

    Raises
    ------
    InputError
        If the header has no marker with its three axes, a row has another length, a cell has no number, or the clock is
        missing or not even.
    """
    path = Path(path)
    lines, _ = decode_lines(path.read_bytes(), str(path), lenient=True)
    # The delimiter is the first character in the first lines that can be one.
    beginning = [line for line in lines if line.strip()][:3]
    delimiter = next((sign for line in beginning for sign in "\t;," if sign in line), None)
    if delimiter is None:
        raise InputError(
            f"{path}: its first line has neither tab, semicolon nor comma; a table of markers has a column for every "
            "coordinate"
        )
    dialect = Dialect(delimiter, "," if delimiter == ";" else ".")
    rows = [row for row in split_rows(lines, dialect, str(path)) if any(row.cells)]
    table = _split_header(path, rows)
    columns = _find_columns(path, table.header)
    frames = read_frames(table.rows, len(table.header), str(path), dialect)
    rate = rate or table.rate
    if columns.time is not None:
        times, rate = clock_from_times(str(path), frames[:, columns.time] * columns.seconds, rate)
    elif rate is not None:
        times = np.arange(len(frames)) / rate
    else:
        raise InputError(f"{path}: no column of times (time_s); set markers.rate_Hz to the frames per second")
    points = np.stack([frames[:, axes] for axes in columns.markers.values()], axis=1)
    notes = f"columns that are not coordinates were left out: {', '.join(columns.others)}"
    unit = columns.unit or table.unit
    file = MarkerFile(str(path), times, rate, unit, notes=(notes,) if columns.others else ())
    return split_points(file, list(columns.markers), mark_missing(points))


class _Columns(NamedTuple):
    """Positions of the columns of markers and time, from 0, and names of all other columns."""

    markers: dict[str, list[int]]
    """Columns of x, y and z by marker."""
    unit: str
    """Unit of length; empty if the header has none."""
    time: int | None
    seconds: float
    """Number of seconds in one unit of the time."""
    others: list[str]


def _find_columns(path: Path, header: list[str]) -> _Columns:
    problems = Problems(str(path))
    markers: dict[str, dict[str, int]] = {}
    units, others = set(), []
    times: list[tuple[int | None, float]] = []
    for column, name in enumerate(header):
        if match := _TIME.match(name):
            times.append((column, 1e-3 if match[1].lower() == "ms" else 1.0))
        elif len(name) <= _MAX_NAME_CHARACTERS and (match := _COORDINATE.match(name)):
            axes = markers.setdefault(match["marker"], {})
            units.add((match["unit"] or "").lower())
            if axes.setdefault(match["axis"].lower(), column) != column:
                problems.add(name, "duplicate", "every coordinate has one column")
        elif name and not _FRAME.match(name):
            others.append(name)
    for marker, axes in markers.items():
        if len(axes) < 3:
            problems.add(marker, f"has the columns {', '.join(sorted(axes))}", "x, y and z are needed")
    if not markers:
        listed = ", ".join(header[:12])
        raise NoMarkersError(f"{path}: no column of a marker among {listed}; name them C7_x, C7_y, C7_z")
    if len(units) > 1:
        problems.add("", f"units {', '.join(sorted(units))} in the header", "all columns need the same")
    problems.raise_if_any()
    coordinates = {marker: [axes[axis] for axis in "xyz"] for marker, axes in markers.items()}
    return _Columns(coordinates, units.pop(), *[*times, (None, 1.0)][0], others)


def _split_header(path: Path, rows: Sequence[Row]) -> _Table:
    """Return a vendor's table, recognised by its first cell, or a table with one or two lines of names."""
    vendor, read = _VENDORS.get(rows[0].cells[0], ("", None)) if rows else ("", None)
    if read is not None:
        try:
            return read(rows)
        except (ArithmeticError, LookupError, ValueError, StopIteration) as error:
            raise InputError(
                f"{path}: begins as an export of {vendor}, but its format differs ({type(error).__name__}: {error}); export it "
                "again"
            ) from error
    if len(rows) < 3:
        raise InputError(f"{path}: {len(rows)} lines; a line of names and two frames are needed")
    first, second = rows[0].cells, rows[1].cells
    if sum(cell.lower() in ("x", "y", "z") for cell in second) < 3:
        return _Table(first, rows[1:])
    return _Table(_join_names(first, second), rows[2:])


def _join_names(markers: list[str], axes: list[str]) -> list[str]:
    """Return names as ``C7_x`` from two lines; the first line has each marker once."""
    names, marker = [], ""
    for column, axis in enumerate(axes):
        marker = (markers[column] if column < len(markers) else "") or marker
        names.append(f"{marker}_{axis}" if axis.lower() in ("x", "y", "z") else axis or marker)
    return names


def _read_nexus(rows: Sequence[Row]) -> _Table:
    """Read the trajectories of a Nexus table: rate, markers, axes, units, then frames up to the next section."""
    begins = next((place for place, row in enumerate(rows, 1) if row.cells[0] == "Trajectories"), None)
    if begins is None:
        raise LookupError("no section Trajectories")
    (rate, *_), markers, axes, units = (row.cells for row in rows[begins : begins + 4])
    header = ["time_s", *(name if name[-2:-1] == "_" else "" for name in _join_names(markers, axes)[1:])]
    numbered = takewhile(lambda row: row.cells[0].isdigit() and len(row.cells) > 1, rows[begins + 4 :])
    frames = [
        Row(row.line, [f"{(int(row.cells[0]) - 1) / float(rate):.9g}", *row.cells[1:]])
        for row in _trim(list(numbered), len(header))
    ]
    return _Table(header, frames, next(filter(None, units), ""))


def _read_motive(rows: Sequence[Row]) -> _Table:
    """Read a Motive table: settings in pairs, lines that describe columns, then frames; omit bones and rigid bodies."""
    facts = dict(zip(rows[0].cells[::2], rows[0].cells[1::2], strict=False))
    begins = next(place for place, row in enumerate(rows) if row.cells[0] == "Frame")
    described = {row.cells[1]: row.cells for row in rows[1:begins]}
    columns = zip(
        described["Type"], described["Name"], rows[begins - 1].cells, rows[begins].cells, strict=True
    )
    header = [
        f"{name}_{axis}" if (kind, quantity) == ("Marker", "Position") else ""
        for kind, name, quantity, axis in columns
    ]
    header[1] = "time_s"
    frames = _trim(rows[begins + 1 :], len(header), facts["Total Exported Frames"])
    return _Table(header, frames, _UNITS[facts["Length Units"]])


def _read_qualisys(rows: Sequence[Row]) -> _Table:
    """Read a Qualisys table: settings by name, optional column names, then frames in mm, with or without numbers and times."""
    facts = {row.cells[0]: row.cells[1:] for row in rows if row.cells[0][:1].isalpha()}
    labels = [label for label in facts["MARKER_NAMES"] if label]
    frames = [row for row in rows if not row.cells[0][:1].isalpha()]
    has_times = len(frames[0].cells) - 3 * len(labels) >= 2
    header = ["", "time_s"] * has_times + [f"{label}_{axis}" for label in labels for axis in "xyz"]
    rate = None if has_times else float(facts["FREQUENCY"][0])
    return _Table(header, _trim(frames, len(header), facts["NO_OF_FRAMES"][0]), "mm", rate)


def _trim(rows: Sequence[Row], width: int, announced: str = "") -> list[Row]:
    """Return rows without the empty cells after the last column."""
    if not rows or (announced and int(announced) != len(rows)):
        raise ValueError(f"{announced or 'some'} frames are announced, the file has {len(rows)}")
    return [Row(line, [*cells[:width], *filter(None, cells[width:])]) for line, cells in rows]


_NEXUS_SECTIONS = ("Devices", "Joints", "Model Outputs", "Segments", "Trajectories")
"""First cells of the sections of a Nexus table; the user chooses which are written."""
_VENDORS = dict.fromkeys(_NEXUS_SECTIONS, ("Vicon Nexus", _read_nexus)) | {
    "Format Version": ("Motive", _read_motive),
    "NO_OF_FRAMES": ("Qualisys Track Manager", _read_qualisys),
}
