"""TRC marker files (OpenSim, Cortex): text with five header lines, its cells separated by tabs or commas.

Files in the field are irregular: ``Times`` for ``Time``, one to three tabs between names, doubled tabs in the header, an
extra tab before or after every row, trajectories without a name, a clock that does not start at 0. What must hold
is checked: every row has as many cells as all others and three per marker, the counts of the header are those of the
file, and the clock runs evenly at the rate stated.
"""

import os
from collections import Counter
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.marker_file import RATES_HZ, MarkerFile, mark_missing, split_points
from lumbar.records.text_rows import check_even, number, read_lines, read_rows, stop_at_many

_RATE_TOLERANCE = 1e-4


def read_trc(path: str | os.PathLike) -> MarkerFile:
    """Read a TRC file.

    Raises
    ------
    InputError
        Not a TRC file, a header that contradicts the data, a row that is cut short or has lost a cell, a clock that is
        not even.
    """
    path = Path(path)
    lines = read_lines(path)
    header, names, separator = _header(path, lines)
    labels = _labels(path, names, int(header["NumMarkers"]))
    printed, values, resolution = _rows(path, lines, separator, len(labels))
    if header["NumFrames"] != len(printed):
        raise InputError(
            f"{path}: NumFrames: {header['NumFrames']:g}; the file holds {len(printed)} frames; it may be cut short"
        )
    # Instants of the frames at the stated rate, checked against the printed ones.
    rate = header["DataRate"]
    steps = np.arange(len(printed)) / rate
    even = np.median(printed - steps) + steps
    # A printed instant is off by half its last digit; a rate printed with few digits drifts over a recording.
    check_even(path, printed, even, rate, resolution / 2 + _RATE_TOLERANCE * steps[-1])
    return split_points(
        source=str(path),
        time=even,
        rate=rate,
        unit=str(header.get("Units", "")),
        labels=labels,
        points=mark_missing(values),
    )


def _header(path: Path, lines: list[str]) -> tuple[dict, list[str], str]:
    """Keys of lines 2 and 3 (those that count as numbers), the cells of line 4 after the time, and the separator."""
    if len(lines) < 4 or not lines[0].startswith("PathFileType"):
        raise InputError(
            f"{path}: not a TRC file; it must start with PathFileType and have four header lines or more"
        )
    separator = next((sign for sign in "\t," if sign in lines[3]), None)
    if separator is None:
        raise InputError(
            f"{path}, line 4: its cells are separated by neither tabs nor commas; export it with tabs"
        )
    keys, entries = ([cell.strip() for cell in line.split(separator)] for line in lines[1:3])
    if keys.count("") != entries.count("") or len(keys) != len(entries):
        # Doubled separators in one of the two lines.
        keys, entries = [key for key in keys if key], [entry for entry in entries if entry]
    header: dict = dict(zip(keys, entries, strict=False))
    problems = Problems(f"{path}, lines 2 and 3")
    for key, (low, high) in {"DataRate": RATES_HZ, "NumFrames": (1, 1e9), "NumMarkers": (1, 1e5)}.items():
        if key not in header:
            problems.add("", f"no {key}")
            continue
        try:
            value = number(header[key])
        except ValueError:
            problems.add(key, repr(header[key]), "a number is needed")
            continue
        if not low <= value <= high:
            problems.add(key, header[key], f"a positive number is needed, {low:g} to {high:g}")
        header[key] = value
    problems.raise_if_any()
    names = [name.strip() for name in lines[3].split(separator)]
    if names[1:2] == [""]:
        names.pop(1)  # doubled
    if not names[0].startswith("Frame") or len(names) < 3 or not names[1].startswith("Time"):
        raise InputError(f"{path}, line 4: starts with {names[:2]}; Frame# and Time are needed")
    return header, names[2:], separator


def _labels(path: Path, cells: list[str], n_markers: int) -> list[str]:
    """One label per marker; empty for a trajectory without a name, which is known by a gap above its three columns."""
    named = [cell for cell in cells if cell]
    if not named:
        raise InputError(f"{path}, line 4: no marker names after Frame# and Time")
    if len(named) == n_markers:
        return named
    above = cells[: 3 * n_markers : 3]
    if len(named) < n_markers and [cell for cell in above if cell] == named:
        return above + [""] * (n_markers - len(above))
    raise InputError(
        f"{path}: NumMarkers: {n_markers}; line 4 names {len(named)} markers; trajectories without a name are read "
        "where each name stands above the first of its three columns"
    )


def _rows(
    path: Path, lines: list[str], separator: str, n_markers: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Time, shape (n_frames,), values, shape (n_frames, n_markers, 3), and resolution of the time.

    Empty cells are missing values.
    """
    rows = [
        (place, [cell.strip() for cell in line.split(separator)])
        for place, line in enumerate(lines[4:], start=5)
    ]
    axes = ("X1", "X")  # header line 5: X1, Y1, Z1 and so on
    rows = [row for row in rows if any(row[1]) and next(filter(None, row[1])).upper() not in axes]
    if not rows:
        raise InputError(f"{path}: no data rows")
    columns = _columns(path, rows, 2 + 3 * n_markers, n_markers)
    rows = [(place, cells[columns]) for place, cells in rows]
    decimals = max(len(cells[1].partition(".")[2]) for _, cells in rows)
    table = read_rows(path, rows, 2 + 3 * n_markers)
    if not np.isfinite(table[:, :2]).all():
        untimed = int((~np.isfinite(table[:, :2])).any(axis=1).argmax())
        raise InputError(f"{path}: line {rows[untimed][0]}: no time")
    points = table[:, 2:].reshape(len(table), n_markers, 3)
    # A marker that is never there with all three coordinates: the columns are shifted.
    seen = np.isfinite(points)
    torn = seen.any(axis=(0, 2)) & ~seen.all(axis=2).any(axis=0)
    if torn.any():
        raise InputError(
            f"{path}: marker {int(torn.argmax()) + 1} has one or two coordinates and never three; a column is missing"
        )
    return table[:, 1], points, 10.0 ** -min(decimals, 300)


def _columns(path: Path, rows: list[tuple[int, list[str]]], width: int, n_markers: int) -> slice:
    """Cells of a row that hold the frame's number, its time and the markers.

    An extra separator before or after the numbers adds an empty cell to every row. A row that differs from the
    others lost or won a cell, and from there on its numbers belong to other markers.
    """
    usual = Counter(len(cells) for _, cells in rows).most_common(1)[0][0]
    first, last = 0, usual
    if usual > width and not any(cells[0] for _, cells in rows):
        first = 1
    while last - first > width and not any(cells[last - 1] for _, cells in rows if len(cells) == usual):
        last -= 1
    if last - first != width:
        raise InputError(
            f"{path}: line {rows[0][0]}: {last - first} cells, as in most rows; {width} are needed for {n_markers} "
            "markers (NumMarkers)"
        )
    problems = Problems(str(path))
    for place, cells in rows:
        if len(cells) != usual:
            problems.add(
                f"line {place}",
                f"{len(cells)} cells",
                f"{usual} are needed, as in the other rows: a cell was lost or added, and the numbers after it stand "
                "under other markers",
            )
        stop_at_many(problems)
    problems.raise_if_any()
    return slice(first, last)
