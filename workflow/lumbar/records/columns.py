"""Reading column files (CSV, TXT, MAT; gzip too) through a layout: which column is what, in which unit.

A layout is `lumbar.settings.layout.ColumnLayout`; in a study's YAML::

    format: text            # text or mat
    delimiter: ","          # one character, or "whitespace"
    header: true            # a line of column names before the data
    comment: "%"            # lines that start with it are skipped
    decimal: "."
    clipped: refuse         # or accept: flat tops of force and position
    columns:
      time:   {column: time_s, quantity: time, unit: s}
      input:  {column: 2, quantity: angle, unit: rad, scale: 7.6699e-4, offset: 0}
      output: {column: force_N, quantity: force, unit: N}

``column`` is a name from the header or a number counted from 1. Values become ``raw * scale + offset`` in
``unit``. A column with ``optional: true`` may be absent from a file with a header, and may be constant.
"""

import csv
import os
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import require_file
from lumbar.records.record import (
    FEWEST_SAMPLES,
    LARGEST,
    Channel,
    Record,
    check_record,
    resample,
    samples_between,
)
from lumbar.records.stretches import check_clipping
from lumbar.records.text_rows import number, stop_at_many
from lumbar.records.unpacking import read_readable, stem_of
from lumbar.settings.layout import ColumnLayout, ColumnSettings

LONGEST_GAP = 10
"""Rows in a row that are filled at most: over more of them a motion cannot be guessed."""
LARGEST_SHARE = 0.05
"""Share of a record's rows that is filled at most."""
_OFF_CLOCK = 0.1
"""How far a step over a gap may be from a whole number of sampling intervals."""


def with_missing_rows(
    record: Record, lines: Sequence[int] | None = None
) -> tuple[Record, Sequence[int] | None]:
    """Fill gaps of a few rows by a cubic spline; `record` itself where there is none, or one that cannot be filled.

    Returns
    -------
    Record
        With the samples that were filled in as its `filled`.
    sequence of int or None
        Line of each sample; of a filled one, the line before it.
    """
    if len(record.time) < FEWEST_SAMPLES or not _finite(record):
        return record, lines
    steps = np.diff(record.time)
    step = float(np.median(steps))
    if step <= 0:
        return record, lines
    share = steps / step
    rows = np.round(share).astype(int)
    missing = rows - 1
    even = (np.abs(share - rows) <= _OFF_CLOCK) & (rows >= 1) & (missing <= LONGEST_GAP)
    if not missing.any() or not even.all() or missing.sum() > LARGEST_SHARE * len(record.time):
        return record, lines
    places = np.concatenate([[0], np.cumsum(rows)])
    every = np.arange(places[-1] + 1)
    filled = np.setdiff1d(every, places)
    time = np.interp(every, places, record.time)
    if lines is not None:
        before = np.searchsorted(places, every, side="right") - 1
        lines = [lines[index] for index in before]
    whole = replace(record, time=time, filled=tuple(filled.tolist()))
    return whole.with_values(**_interpolated(record, places, every)), lines


def _finite(record: Record) -> bool:
    series = [record.time, *(channel.values for channel in record.channels.values())]
    return all(np.all(np.abs(values) <= LARGEST) for values in series)


def _interpolated(record: Record, places: np.ndarray, every: np.ndarray) -> dict[str, np.ndarray]:
    from scipy.interpolate import make_interp_spline

    values = {}
    for role, channel in record.channels.items():
        values[role] = make_interp_spline(places, channel.values, k=3)(every)
        values[role][places] = channel.values
    return values


TIME = "time"


def read_record(
    path: str | os.PathLike,
    layout: ColumnLayout,
    name: str | None = None,
    period: float | None = None,
    rate: float | None = None,
    trim: tuple[float, float] | None = None,
) -> Record:
    """Read one file into a validated record.

    Parameters
    ----------
    period : float, optional
        Period of the excitation in seconds.
    rate : float, optional
        Resample to this rate in hertz, with an anti-aliasing filter. Default: leave as recorded.
    trim : tuple of float, optional
        Start and stop in seconds of the file's clock; what lies outside is not even checked.

    Raises
    ------
    InputError
        With file, line or column, what was found and what is allowed; all problems of a file at once.
    """
    path = Path(path)
    size = require_file(path)
    try:
        raw, lines = _read_columns(path, layout, size)
    except InputError as error:
        study = path.parent / "study.yaml"
        words, file = (_IN_STUDY, study) if study.is_file() else (_ELSEWHERE, path)
        raise InputError(f"{error}\n{words.format(shlex.quote(str(file)))}") from error
    columns = {role: column_of(layout.columns, role) for role in raw}
    with np.errstate(over="ignore"):  # what overflows is refused below, with its place
        scaled = {
            role: raw[role] * float(column.scale) + float(column.offset) for role, column in columns.items()
        }
    time_unit = layout.columns[TIME].unit
    if time_unit not in _SECONDS:
        raise InputError(f"{path}: time is in {time_unit!r}; allowed are {', '.join(_SECONDS)}")
    if points := _without_clock(scaled):
        if rate is not None or trim is not None:
            raise InputError(f"{path}: points without a clock have neither a rate nor a part in seconds")
        if "input_x" in columns or "input_y" in columns:
            raise InputError(f"{path}: points without a clock have one axis; several need times")
        scaled[TIME] = np.arange(float(len(next(iter(scaled.values())))))
    scaled[TIME] = scaled[TIME] * _SECONDS[time_unit]
    if trim is not None:
        keep = samples_between(scaled[TIME], trim, str(path))
        scaled = {role: values[keep] for role, values in scaled.items()}
        lines = None if lines is None else [lines[sample] for sample in keep]
    channels = {
        role: Channel(scaled[role], column.quantity or role, column.unit)
        for role, column in columns.items()
        if role != TIME
    }
    name, period = name or stem_of(path), None if points else period
    record = Record(name, scaled[TIME], channels, str(path), period, trim=trim, points=points)
    record, lines = with_missing_rows(record, lines)
    may_rest = [role for role, column in columns.items() if column.optional]
    check_record(record, may_rest=may_rest, lines=lines)
    if layout.clipped == "refuse":
        check_clipping(record, lines)
    if rate is not None:
        record = resample(record, rate)
    return record


def _without_clock(values: dict[str, np.ndarray]) -> bool:
    """Whether these are points of a static test: times are missing, or all are one."""
    time = values.get(TIME)
    return time is None or (len(time) > 1 and bool(np.all(np.isnan(time)) or np.all(time == time[0])))


_IN_STUDY = "  the study beside it says which columns the records of this folder have: --config {}"
_ELSEWHERE = "  files of other columns, units, separators, decimal marks or encodings: lumbar import {} --output FOLDER"


def _read_columns(
    path: Path, layout: ColumnLayout, size: int
) -> tuple[dict[str, np.ndarray], Sequence[int] | None]:
    """Columns by role, and the line of each sample where the format has lines."""
    if layout.format == "mat":
        return _read_mat(path, layout), None
    if size >= _LARGE:
        print(f"{path.name}: reading {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
    return read_readable(path, _read_either, layout)


def _read_either(path: Path, layout: ColumnLayout) -> tuple[dict[str, np.ndarray], Sequence[int]]:
    return _read_plain_table(path, layout) or _read_text(path, layout)


_LARGE = 5_000_000
"""Bytes from which on a file is announced."""
_WORTH_IT = 50_000
"""Bytes from which on a file is first tried as a plain table of numbers."""
_MOST_COLUMNS = 1000
"""Columns up to which it is: all of them are kept, the others' numbers too."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}


_SHOWN = 60
"""Characters of a cell that a message shows."""
_LONGEST_LINE = 1_000_000
"""Characters of one line."""


def _lines(path: Path):
    with path.open(encoding="utf-8-sig") as stream:
        number = 0
        try:
            while line := stream.readline(_LONGEST_LINE + 1):
                number += 1
                if len(line) > _LONGEST_LINE:
                    raise InputError(
                        f"{path}: line {number} has more than {_LONGEST_LINE} characters; rows of numbers are needed"
                    )
                yield number, line
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: not a readable text file ({error})") from error


def _read_plain_table(path: Path, layout: ColumnLayout) -> tuple[dict[str, np.ndarray], range] | None:
    """Columns by role and lines of a large file that is nothing but a header and numbers; None of any other.

    Fifty times as fast as going through it line by line, which is left to say where a file is not as it should be.
    """
    if layout.decimal != "." or path.stat().st_size < _WORTH_IT:
        return None
    separator = None if layout.delimiter == "whitespace" else layout.delimiter
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        begins = [_split(stream.readline(_LONGEST_LINE), separator) for _ in range(2)]
    if max(map(len, begins)) > _MOST_COLUMNS:
        return None
    header, first = (begins[0], 2) if layout.header else (None, 1)
    try:
        table = np.loadtxt(
            path, comments=None, delimiter=separator, skiprows=first - 1, ndmin=2, encoding="utf-8-sig"
        )
    except (ValueError, OverflowError):  # also what the decoder raises
        return None
    lines = range(first, first + len(table))  # unless some are blank, which are passed over
    with path.open("rb") as stream:
        if lines.stop - 1 != sum(1 for _ in stream) or not np.isfinite(table).all():
            return None
    if header is not None and len(header) != table.shape[1]:
        return None
    positions = _positions(path, layout.columns, header)
    if max(positions.values()) >= table.shape[1]:
        return None
    return {role: table[:, position].copy() for role, position in positions.items()}, lines


def _read_text(path: Path, layout: ColumnLayout) -> tuple[dict[str, np.ndarray], list[int]]:
    """Columns by role, and the line of each sample."""
    delimiter = layout.delimiter
    separator = None if delimiter == "whitespace" else delimiter
    comment = layout.comment
    decimal = layout.decimal
    positions: dict[str, int] | None = None
    problems = Problems(str(path))
    if decimal == separator:
        raise InputError(f"{path}: the layout has {decimal!r} both as delimiter and as decimal mark")
    by_name = any(isinstance(column.column, str) for column in layout.columns.values())
    width: int | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    for place, line in _lines(path):
        text = line.strip()
        if not text or (comment and text.startswith(comment)):
            continue
        cells = _split(line, separator)
        if positions is None:
            header = cells if layout.header else None
            positions = _positions(path, layout.columns, header)
            if header is not None:
                width = len(header) if by_name else None
                continue
        width = width or len(cells)
        if len(cells) != width:
            # A decimal comma or a missing cell would shift all columns after it.
            problems.add(
                f"line {place}", f"{len(cells)} cells", f"{width} are expected: check delimiter and decimal"
            )
        else:
            rows.append(_numbers(cells, positions, place, decimal, problems))
            lines.append(place)
        stop_at_many(problems)
    problems.raise_if_any()
    if positions is None or not rows:
        raise InputError(f"{path}: no data rows")
    table = np.array(rows)
    return dict(zip(positions, table.T, strict=True)), lines


def _split(line: str, separator: str | None) -> list[str]:
    """Cells of one line; quotes protect separators, and empty cells at the end keep their place."""
    if separator is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])]
    except csv.Error:  # a cell of more than 131072 characters
        return line.split(separator)


def _positions(path: Path, columns: dict[str, ColumnSettings], header: list[str] | None) -> dict[str, int]:
    """Zero-based position of each role's column."""
    problems = Problems(str(path))
    positions = {}
    columns = _along_axes(columns, header or (), problems)
    # A table of these two alone has no clock; beside any other column that one might be it, under another name.
    pair = {columns[role].column for role in ("input", "output") if role in columns}
    for role, column in columns.items():
        wanted = column.column
        if isinstance(wanted, int):
            positions[role] = wanted - 1
        elif header is None:
            problems.add(
                role, f"column {wanted!r} is a name, but the layout has no header", "give its number"
            )
        elif header.count(wanted) > 1:
            twice = [str(number) for number, name in enumerate(header, start=1) if name == wanted]
            problems.add(
                role,
                f"column {wanted!r} stands in columns {' and '.join(twice)}",
                "give the number of one of them",
            )
        elif wanted in header:
            positions[role] = header.index(wanted)
        elif not column.optional and not (role == TIME and set(header) == pair):
            problems.add(role, f"no column {wanted!r}", f"the header has {', '.join(header)}")
    problems.raise_if_any()
    return positions


def _numbers(
    cells: list[str], positions: dict[str, int], line: int, decimal: str, problems: Problems
) -> list[float]:
    values = []
    for role, position in positions.items():
        if position >= len(cells):
            problems.add(f"line {line}", f"{len(cells)} columns", f"{role} is column {position + 1}")
            values.append(np.nan)
            continue
        if role == TIME and not cells[position]:
            values.append(np.nan)  # of points; a single one missing is refused with its line
            continue
        text = cells[position] if decimal == "." else cells[position].replace(decimal, ".")
        try:
            values.append(number(text))
        except ValueError:
            comma = " (with decimal commas, set layout.decimal to ',')" if "," in cells[position] else ""
            found = cells[position] if len(cells[position]) <= _SHOWN else cells[position][:_SHOWN] + "…"
            problems.add(f"line {line}", f"{role} is {found!r}", f"a number is needed{comma}")
            values.append(np.nan)
    return values


def _read_mat(path: Path, layout: ColumnLayout) -> dict[str, np.ndarray]:
    from lumbar.records.child_process import read_in_child

    content = read_in_child(_vectors_of_mat, path)
    problems = Problems(str(path))
    values: dict[str, np.ndarray] = {}
    names = list(content)
    for role, column in _along_axes(layout.columns, names, problems).items():
        name = str(column.column)
        if name not in content and column.optional:
            continue
        if name not in content:
            problems.add(role, f"no variable {column.column!r}", f"the file has {', '.join(names)}")
        elif content[name] is None:
            problems.add(role, f"{column.column} is not a vector of real numbers")
        else:
            values[role] = content[name].astype(float)
    if len({len(value) for value in values.values()}) > 1:
        problems.add("", "variables of different lengths", "time, input and output need one value per sample")
    problems.raise_if_any()
    return values


def _vectors_of_mat(path: str) -> dict[str, np.ndarray | None]:
    """Variables of a MATLAB file that are vectors of real numbers, and None for each of the others."""
    from lumbar.records.matlab_file import load_matlab

    content = load_matlab(
        Path(path).read_bytes(), path, "not a MATLAB file of version 4 to 7.2", squeeze_me=True
    )
    found = {name: np.asarray(value) for name, value in content.items() if not name.startswith("__")}
    return {
        name: value if value.ndim == 1 and value.dtype.kind in "fiu" else None
        for name, value in found.items()
    }


def column_of(columns: Mapping[str, ColumnSettings], role: str) -> ColumnSettings:
    """How a role is read: of an axis that the layout does not name, as the layout's one axis."""
    return columns[role] if role in columns else columns[role[: -len("_x")]]


def _along_axes(columns: dict[str, ColumnSettings], header, problems: Problems) -> dict[str, ColumnSettings]:
    """Columns by role, with an axis each where the header names some."""
    if not any(re.search("_[xyz]_", str(name)) for name in header):
        return columns
    from lumbar.records.vector_columns import along_axes

    return along_axes(columns, header, problems)
