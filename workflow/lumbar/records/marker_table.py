"""Markers in tables (CSV): one row per frame, three columns per marker, under one line of names or two.

Either each column says marker and axis, or the first line names markers and the second axes::

    time_s,C7_x,C7_y,C7_z,SACRUM_x,…          ,C7,,,SACRUM,,
    0.00,12.1,853.0,1450.2,…                   time_s,x,y,z,x,y,z

Cells are separated by commas, semicolons (then with a decimal point or comma) or tabs. Times are in seconds, or in the unit
behind their name (``time_ms``, ``Time (ms)``); without them the layout's ``rate_Hz`` is needed. A unit of
length may stand behind the axis (``C7_x_mm``, ``C7 X [mm]``), else the layout's ``unit`` is needed. An empty cell
is a missing sample. Exports of `lumbar.records.vendor_table` are known by how they begin.
"""

import csv
import os
import re
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import MarkerFile, NoMarkers, mark_missing, split_points
from lumbar.records.record import CLOCK_TOLERANCE
from lumbar.records.text_rows import check_even, read_lines, read_rows
from lumbar.records.vendor_table import VendorTable, joined_names, vendor_table

_TIME = re.compile(r"^(?:time|t|zeit)[\s_]*[\[(]?(s|sec|ms|)[\])]?$", re.IGNORECASE)
_FRAME = re.compile(r"^(frame|frame#|index|sample)$", re.IGNORECASE)
_COORDINATE = re.compile(
    r"^(?P<marker>.*?)[\s_.:-]+(?P<axis>[xyz])(?:[\s_]*[\[(]?(?P<unit>mm|cm|m)[\])]?)?$", re.IGNORECASE
)
_LONGEST_NAME = 1000
"""Characters of a column's name."""


def read_marker_table(path: str | os.PathLike, rate: float | None = None) -> MarkerFile:
    """Read markers from a CSV file.

    Parameters
    ----------
    rate : float, optional
        Frames per second, where the file has no times; with times, they must agree.

    Raises
    ------
    InputError
        A header that names no marker with its three axes, a row of another length, a cell that is no number, a clock
        that is missing or not even.
    """
    path = Path(path)
    separator, rows = _cells(path)
    export = vendor_table(path, rows)
    if export is None:
        header, begins = _header(path, rows)
        export = VendorTable(header, rows[begins:], "", None)
    header = export.header
    time_column, markers, unit = _columns(path, header)
    table = read_rows(path, export.rows, len(header), decimal="," if separator == ";" else ".")
    rate = rate or export.rate
    if time_column is None:
        if rate is None:
            raise InputError(
                f"{path}: no column of times (time_s); set markers.rate_Hz to the frames per second"
            )
        time = np.arange(len(table)) / rate
    else:
        position, seconds = time_column
        time, rate = even_clock(path, table[:, position] * seconds, rate)
    points = np.stack([table[:, columns] for columns in markers.values()], axis=1)
    used = {column for columns in markers.values() for column in columns}
    others = [name for column, name in enumerate(header) if column not in used and name]
    others = [name for name in others if not (_TIME.match(name) or _FRAME.match(name))]
    return split_points(
        source=str(path),
        time=time,
        rate=rate,
        unit=unit or export.unit,
        labels=list(markers),
        points=mark_missing(points),
        notes=(f"columns that are no coordinates were left out: {', '.join(others)}",) if others else (),
    )


def _cells(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """Separator, and the line and the cells of every row that is not empty."""
    lines = read_lines(path)
    first = [line for line in lines if line.strip()][:3]
    separator = next((sign for line in first for sign in "\t;," if sign in line), None)
    if separator is None:
        raise InputError(
            f"{path}: its first line has neither tab, semicolon nor comma; a table of markers has a column for every "
            "coordinate"
        )
    try:
        rows = [
            (place, [cell.strip() for cell in cells])
            for place, cells in enumerate(csv.reader(lines, delimiter=separator), start=1)
        ]
    except csv.Error as error:
        raise InputError(f"{path}: not a table ({error})") from error
    return separator, [(place, cells) for place, cells in rows if any(cells)]


def _header(path: Path, rows: list[tuple[int, list[str]]]) -> tuple[list[str], int]:
    """One name per column, and how many rows the names take."""
    if len(rows) < 3:
        raise InputError(f"{path}: {len(rows)} lines; a line of names and two frames are needed")
    first, second = rows[0][1], rows[1][1]
    axes = [cell for cell in second if re.fullmatch("[xyz]", cell, re.IGNORECASE)]
    if len(axes) < 3:
        return first, 1
    return joined_names(first, second), 2


def _columns(path: Path, header: list[str]) -> tuple[tuple[int, float] | None, dict[str, list[int]], str]:
    """Column of the times with their factor to seconds, columns of each marker, and the unit of length."""
    problems = Problems(str(path))
    markers: dict[str, dict[str, int]] = {}
    units = set()
    time_column = None
    for column, name in enumerate(header):
        if found := _TIME.match(name):
            time_column = time_column or (column, 1e-3 if found.group(1).lower() == "ms" else 1.0)
        elif len(name) <= _LONGEST_NAME and (found := _COORDINATE.match(name)):
            axes = markers.setdefault(found["marker"], {})
            units.add((found["unit"] or "").lower())
            if axes.setdefault(found["axis"].lower(), column) != column:
                problems.add(name, "stands twice", "every coordinate has one column")
    for marker, axes in markers.items():
        if len(axes) < 3:
            problems.add(marker, f"has the columns {', '.join(sorted(axes))}", "x, y and z are needed")
    if not markers:
        raise NoMarkers(
            f"{path}: no column of a marker among {', '.join(header[:12])}; names such as C7_x, C7_y, C7_z are needed"
        )
    if len(units) > 1:
        problems.add("", f"units {', '.join(sorted(units))} in the header", "all columns need the same")
    problems.raise_if_any()
    return time_column, {name: [axes[axis] for axis in "xyz"] for name, axes in markers.items()}, units.pop()


def even_clock(path: Path, printed: np.ndarray, declared: float | None) -> tuple[np.ndarray, float]:
    """Return the instants of an even clock and its rate, checked against the printed times.

    Parameters
    ----------
    printed : ndarray, shape (n_frames,)
        Seconds.
    declared : float or None
        ``markers.rate_Hz``, with which they must agree.

    Raises
    ------
    InputError
        A frame without a time, a clock that does not run forward, or not evenly.
    """
    if not np.isfinite(printed).all():
        raise InputError(f"{path}: frame {int((~np.isfinite(printed)).argmax()) + 1} has no time")
    span = printed[-1] - printed[0]
    if not span > 0:
        raise InputError(f"{path}: time runs from {printed[0]:g} to {printed[-1]:g} s; it must increase")
    rate = (len(printed) - 1) / span
    whole = round(rate)
    # Times that are printed with few digits still tell a whole rate.
    if (
        whole
        and np.abs(printed - printed[0] - np.arange(len(printed)) / whole).max() * whole <= CLOCK_TOLERANCE
    ):
        rate = float(whole)
    if declared is not None and not np.isclose(declared, rate, rtol=1e-2):
        raise InputError(
            f"{path}: its times run at {rate:g} Hz, but markers.rate_Hz is {declared:g}; set it to null"
        )
    even = printed[0] + np.arange(len(printed)) / rate
    check_even(path, printed, even, rate)
    return even, rate
