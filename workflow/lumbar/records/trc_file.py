"""TRC marker files (OpenSim, Cortex): tab-separated text with five header lines.

Files in the field are irregular: ``Times`` for ``Time``, one to three tabs between names, an extra leading
tab on data rows, a clock that does not start at 0. What must hold is checked: every row has three values per
marker, the counts of the header are those of the file, and the clock runs evenly at the rate stated.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from lumbar.errors import InputError, Problems
from lumbar.records.marker_file import MarkerFile, mark_missing
from lumbar.records.point_kinds import split_points
from lumbar.records.record import LARGEST

_CLOCK_TOLERANCE = 0.05
"""How far a frame may lie from an even clock, in frames, beyond the rounding of what is printed."""
_RATE_TOLERANCE = 1e-4
_MOST_PROBLEMS = 20


def read_trc(path: str | os.PathLike) -> MarkerFile:
    """Read a TRC file.

    Parameters
    ----------
    path : path

    Returns
    -------
    MarkerFile

    Raises
    ------
    InputError
        Not a TRC file, a header that contradicts the data, a row that is cut short, a clock that is not even.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        # Windows programs write the path in the first line in the system's own code page.
        lines = path.read_text(encoding="cp1252", errors="replace").splitlines()
    header, labels = _header(path, lines)
    printed, values, resolution = _rows(path, lines, len(labels))
    _check_header(path, header, labels, len(printed))
    rate = float(header["DataRate"])
    time = _even_clock(path, printed, rate, resolution)
    return split_points(
        source=str(path),
        time=time,
        rate=rate,
        unit=header.get("Units", ""),
        labels=labels,
        points=mark_missing(values),
    )


def _header(path: Path, lines: list[str]) -> tuple[dict[str, str], list[str]]:
    """Keys of lines 2 and 3, and the marker names of line 4."""
    if len(lines) < 4 or not lines[0].startswith("PathFileType"):
        raise InputError(
            f"{path}: not a TRC file; it must start with PathFileType and have four header lines or more"
        )
    keys, entries = lines[1].split("\t"), lines[2].split("\t")
    header = {key.strip(): entry.strip() for key, entry in zip(keys, entries, strict=False) if key.strip()}
    problems = Problems(f"{path}, lines 2 and 3")
    for key in ("DataRate", "NumFrames", "NumMarkers"):
        try:
            if not float(header[key]) > 0:
                problems.add(key, header[key], "a positive number is needed")
        except KeyError:
            problems.add("", f"no {key}")
        except ValueError:
            problems.add(key, repr(header[key]), "a number is needed")
    problems.raise_if_any()
    names = [name.strip() for name in lines[3].split("\t")]
    if not names[0].startswith("Frame") or len(names) < 3 or not names[1].startswith("Time"):
        raise InputError(f"{path}, line 4: starts with {names[:2]}; Frame# and Time are needed")
    labels = [name for name in names[2:] if name]
    if not labels:
        raise InputError(f"{path}, line 4: no marker names after Frame# and Time")
    return header, labels


def _rows(path: Path, lines: list[str], n_markers: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Time, shape (n_frames,), values, shape (n_frames, n_markers, 3), and resolution of the time.

    Empty cells are missing values.
    """
    width = 2 + 3 * n_markers
    problems = Problems(str(path))
    rows, places = [], []
    decimals = 0
    for number, line in enumerate(lines[4:], start=5):
        cells = [cell.strip() for cell in line.split("\t")]
        if not any(cells) or _is_axis_line(cells):
            continue
        # A leading or trailing tab adds an empty cell; a missing marker in between leaves three.
        if len(cells) > width and not cells[0]:
            cells = cells[1:]
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if len(cells) != width:
            problems.add(
                f"line {number}", f"{len(cells)} cells", f"{width} are needed for {n_markers} markers"
            )
        else:
            try:
                rows.append([float(cell) if cell else np.nan for cell in cells])
                places.append(number)
                decimals = max(decimals, len(cells[1].partition(".")[2]))
            except ValueError as error:
                problems.add(f"line {number}", str(error), "numbers are needed")
        if len(problems.entries) >= _MOST_PROBLEMS:
            problems.add("", f"reading stopped after {_MOST_PROBLEMS} problems")
            break
    problems.raise_if_any()
    if not rows:
        raise InputError(f"{path}: no data rows")
    table = np.array(rows)
    if not np.isfinite(table[:, :2]).all():
        untimed = int((~np.isfinite(table[:, :2])).any(axis=1).argmax())
        raise InputError(f"{path}: line {places[untimed]}: no time")
    large = np.argwhere(np.abs(table) > LARGEST)
    if len(large):
        row, column = large[0]
        raise InputError(
            f"{path}: line {places[row]}: {table[row, column]:g} in column {column + 1}; numbers of at most "
            f"{LARGEST:g} in size are needed"
        )
    return table[:, 1], table[:, 2:].reshape(len(table), n_markers, 3), 10.0**-decimals


def _even_clock(path: Path, printed: np.ndarray, rate: float, resolution: float) -> np.ndarray:
    """Instants of the frames at the stated rate, checked against the printed ones."""
    steps = np.arange(len(printed)) / rate
    even = np.median(printed - steps) + steps
    worst = int(np.abs(printed - even).argmax())
    # A printed instant is off by half its last digit; a rate printed with few digits drifts over a recording.
    tolerance = resolution / 2 + max(_CLOCK_TOLERANCE / rate, _RATE_TOLERANCE * steps[-1])
    if abs(printed[worst] - even[worst]) > tolerance:
        raise InputError(
            f"{path}: frame {worst + 1} is at {printed[worst]:g} s; at DataRate {rate:g} it would be at "
            f"{even[worst]:g} s: the clock and the rate disagree, or frames are missing"
        )
    return even


def _is_axis_line(cells: list[str]) -> bool:
    """Whether this is header line 5: X1, Y1, Z1 and so on."""
    return next(cell for cell in cells if cell).upper() in ("X1", "X")


def _check_header(path: Path, header: dict[str, str], labels: list[str], n_frames: int) -> None:
    problems = Problems(str(path))
    if int(float(header["NumMarkers"])) != len(labels):
        problems.add("NumMarkers", header["NumMarkers"], f"line 4 names {len(labels)} markers")
    if int(float(header["NumFrames"])) != n_frames:
        problems.add(
            "NumFrames", header["NumFrames"], f"the file holds {n_frames} frames; it may be cut short"
        )
    problems.raise_if_any()
