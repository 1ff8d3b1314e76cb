"""Reader of column files (CSV, TXT, MAT; also gzipped) with a layout, which gives meaning and unit of each column.

The layout is `lumbar.settings.layout.ColumnLayout`. A column is named by the header or numbered from 1. Values become
``raw * scale + offset`` in its unit. A column with ``optional: true`` may be absent from a file with a header, and may be
constant.
"""

import itertools
import os
import re
import shlex
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import require_file
from lumbar.records.number_table import (
    Dialect,
    read_format_numbers,
    read_numbers,
    split_rows,
    stream_lines,
)
from lumbar.records.record import Channel, Record, check_record
from lumbar.records.sampling import check_clipping, fill_missing_rows, resample, samples_between
from lumbar.records.unpacking import read_readable, stem_of
from lumbar.settings.axes import AXES, SIDES
from lumbar.settings.layout import ColumnLayout, ColumnSettings

TIME = "time"
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
_MIN_ANNOUNCED_BYTES = 5_000_000
"""Size from which the reading of a file is announced."""
_MIN_PLAIN_BYTES = 50_000
"""Size from which a file is first read as a plain table of numbers."""
_HINT_WITH_STUDY = "  the study in this folder describes the columns of its records: --config {}"
_HINT_WITHOUT_STUDY = "  files of other columns, units, separators, decimal marks or encodings: lumbar import {} --output FOLDER"


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
    path : path
        The file.
    layout : ColumnLayout
        Columns with their units.
    name : str, optional
        Name of the record; default the file's name.
    period : float, optional
        Period of the excitation in seconds.
    rate : float, optional
        Resample to this rate in hertz, with an anti-aliasing filter. Default: the recorded rate.
    trim : tuple of float, optional
        Start and stop in seconds of the file's clock; samples outside are not checked.

    Raises
    ------
    InputError
        If the file has problems, with all of them: line or column, wrong value and allowed values.
    """
    path = Path(path)
    raw, lines = _read_file(path, layout)
    # A role of an axis that the layout does not have is read as the layout's role of one axis.
    columns = {role: layout.columns.get(role) or layout.columns[role[: -len("_x")]] for role in raw}
    with np.errstate(over="ignore"):  # `check_record` reports what overflows, with its place
        scaled = {
            role: raw[role] * float(column.scale) + float(column.offset) for role, column in columns.items()
        }
    time_unit = layout.columns[TIME].unit
    if time_unit not in _SECONDS:
        raise InputError(f"{path}: time is in {time_unit!r}; allowed are {', '.join(_SECONDS)}")
    # Points of a static test have no clock: times are missing or equal.
    time = scaled.get(TIME)
    points = time is None or (len(time) > 1 and bool(np.isnan(time).all() or np.all(time == time[0])))
    if points:
        if rate is not None or trim is not None:
            raise InputError(f"{path}: points without a clock cannot be resampled or trimmed")
        if "input_x" in columns or "input_y" in columns:
            raise InputError(f"{path}: points without a clock must have one axis")
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
    record, lines = fill_missing_rows(record, lines)
    may_rest = [role for role, column in columns.items() if column.optional]
    check_record(record, may_rest=may_rest, lines=lines)
    if layout.clipped != "accept":
        check_clipping(record, lines, load_drives=layout.clipped == "accept_load")
    if rate is not None:
        record = resample(record, rate)
    return record


def _read_file(path: Path, layout: ColumnLayout) -> tuple[dict[str, np.ndarray], Sequence[int] | None]:
    """Return columns by role, and the line of each sample (None if the file has no lines)."""
    size = require_file(path)
    try:
        if layout.format == "mat":
            return _read_mat(path, layout), None
        if size >= _MIN_ANNOUNCED_BYTES:
            print(f"{path.name}: reading {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
        return read_readable(path, _read_text, layout)
    except InputError as error:
        study = path.parent / "study.yaml"
        hint, file = (_HINT_WITH_STUDY, study) if study.is_file() else (_HINT_WITHOUT_STUDY, path)
        raise InputError(f"{error}\n{hint.format(shlex.quote(str(file)))}") from error


def _read_text(path: Path, layout: ColumnLayout) -> tuple[dict[str, np.ndarray], Sequence[int]]:
    """Return columns by role, and the line of each sample."""
    delimiter = None if layout.delimiter == "whitespace" else layout.delimiter
    dialect = Dialect(delimiter, layout.decimal, layout.comment)
    if dialect.decimal == dialect.delimiter:
        raise InputError(f"{path}: the layout has {dialect.decimal!r} both as delimiter and as decimal mark")
    rows = split_rows(stream_lines(path), dialect, str(path))
    first = next(rows, None)
    if first is None:
        raise InputError(f"{path}: no data rows")
    header = first.cells if layout.header else None
    positions = _positions(path, layout.columns, header)
    # With a decimal comma or a missing cell, the columns after it would be wrong.
    by_name = any(isinstance(column.column, str) for column in layout.columns.values())
    width = len(first.cells) if header and by_name else None
    if header is None:
        rows = itertools.chain([first], rows)
    if path.stat().st_size >= _MIN_PLAIN_BYTES:
        begins = first.line + (header is not None)
        lines = [line.rstrip("\r\n") for line in itertools.islice(stream_lines(path), begins - 1, None)]
        plain = read_format_numbers(lines, dialect, len(first.cells), begins)
        is_wide = max(positions.values()) < len(first.cells)
        if is_wide and plain is not None and np.isfinite(plain.values).all():
            values = {role: plain.values[:, position].copy() for role, position in positions.items()}
            return values, plain.lines
    table = read_numbers(rows, positions, str(path), dialect, width, may_be_empty=[TIME])
    if not table.lines:
        raise InputError(f"{path}: no data rows")
    return dict(zip(positions, table.values.T, strict=True)), table.lines


def _positions(path: Path, columns: dict[str, ColumnSettings], header: list[str] | None) -> dict[str, int]:
    """Return the position of each role's column, from 0."""
    problems = Problems(str(path))
    positions = {}
    columns = _expand_axes(columns, header or (), problems)
    # A table of only these two columns has no clock; a further column might be the clock with another name.
    pair = {columns[role].column for role in ("input", "output") if role in columns}
    for role, column in columns.items():
        wanted = column.column
        if isinstance(wanted, int):
            positions[role] = wanted - 1
        elif header is None:
            problem = f"column {wanted!r} is a name, but the layout has no header"
            problems.add(role, problem, "give its number")
        elif header.count(wanted) > 1:
            numbers = [str(number) for number, name in enumerate(header, start=1) if name == wanted]
            problem = f"columns {' and '.join(numbers)} have the name {wanted!r}"
            problems.add(role, problem, "give the number of one of them")
        elif wanted in header:
            positions[role] = header.index(wanted)
        elif not column.optional and not (role == TIME and set(header) == pair):
            problems.add(role, f"no column {wanted!r}", f"the header has {', '.join(header)}")
    problems.raise_if_any()
    return positions


def _read_mat(path: Path, layout: ColumnLayout) -> dict[str, np.ndarray]:
    from lumbar.records.child_process import read_in_child

    content = read_in_child(_read_mat_vectors, path)
    problems = Problems(str(path))
    values: dict[str, np.ndarray] = {}
    for role, column in _expand_axes(layout.columns, list(content), problems).items():
        name = str(column.column)
        if content.get(name) is not None:
            values[role] = content[name].astype(float)
        elif name in content:
            problems.add(role, f"{column.column} is not a vector of real numbers")
        elif not column.optional:
            problems.add(role, f"no variable {column.column!r}", f"the file has {', '.join(content)}")
    if len({len(value) for value in values.values()}) > 1:
        problems.add("", "variables of different lengths", "time, input and output need one value per sample")
    problems.raise_if_any()
    return values


def _read_mat_vectors(path: str) -> dict[str, np.ndarray | None]:
    """Return the vectors of real numbers in a MATLAB file by name; None for every other variable."""
    from lumbar.records.unpacking import load_matlab

    content = load_matlab(Path(path).read_bytes(), path, squeeze_me=True)
    arrays = {name: np.asarray(value) for name, value in content.items() if not name.startswith("__")}
    return {
        name: values if values.ndim == 1 and values.dtype.kind in "fiu" else None
        for name, values in arrays.items()
    }


def _expand_axes(
    columns: dict[str, ColumnSettings], header: Collection[str], problems: Problems
) -> dict[str, ColumnSettings]:
    """Return columns by role, one for each axis of position and force if the header has names with axes.

    The axis is between quantity and unit, ``position_x_mm``, so the layout must use names of quantity and unit.
    """
    if not any(re.search("_[xyz]_", str(name)) for name in header):
        return columns
    single = {side: columns[side] for side in SIDES if side in columns}
    are_named = all(item.column == f"{item.quantity}_{item.unit}" for item in single.values())
    if not are_named or {item.quantity for item in single.values()} != {"position", "force"}:
        return columns
    # Names in the header by axis, with any unit; of two names for an axis, the one with the layout's unit.
    named: dict[str, dict[str, str]] = {}
    for side, column in single.items():
        pattern = re.compile(rf"{column.quantity}_([{''.join(AXES)}])_(\S+)")
        matches = [match for name in header if (match := pattern.fullmatch(name))]
        matches.sort(key=lambda match: match[2] == column.unit)
        named[side] = dict(sorted({match[1]: match[0] for match in matches}.items()))
    if not any(named.values()):
        return columns
    _check_axes(single, named, header, problems)
    expanded: dict[str, ColumnSettings] = {}
    for role, column in columns.items():
        if role not in single:
            expanded[role] = column
        for axis, name in named.get(role, {}).items():
            expanded[f"{role}_{axis}"] = column.model_copy(update={"column": name})
    return expanded


def _check_axes(
    single: dict[str, ColumnSettings],
    named: dict[str, dict[str, str]],
    header: Collection[str],
    problems: Problems,
) -> None:
    """Add inconsistent axis columns to `problems`: a column without axis next to columns with axes, an axis that only position
    or only force has, a single axis, or a different unit.
    """
    axes = sorted({axis for names in named.values() for axis in names})
    if len(axes) == 1:
        names = ", ".join(str(column.column) for column in single.values())
        problems.add("", f"columns of {axes[0]} only", f"a record has two or three axes, or one: {names}")
    example = next(name for names in named.values() for name in names.values())
    for side, column in single.items():
        if column.column in header:
            allowed = "use one axis or several: rename the unused columns"
            problems.add(str(column.column), f"is next to {example}", allowed)
        for axis in axes:
            wanted = f"{column.quantity}_{axis}_{column.unit}"
            name = named[side].get(axis)
            if name is None:
                allowed = f"position and force need the same axes: {', '.join(axes)}"
                problems.add(wanted, "no such column", allowed)
            elif name != wanted:
                allowed = f"{wanted} is needed, or a layout with its unit"
                problems.add(name, f"another unit than {column.unit}", allowed)
