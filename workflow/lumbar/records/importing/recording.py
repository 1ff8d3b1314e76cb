"""A foreign table as validated records of time, position and force, with the guesses and their reasons.

A table is one record or several: intervals of time, or of rows with one value in a column.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import sanitize_name
from lumbar.records.importing.clock import (
    check_repeated,
    contradictions,
    even_clock,
    integrate_velocity,
    recover_even_clock,
    split_at_gaps,
    stated_time,
)
from lumbar.records.importing.raw_table import SPEEDS, RawTable
from lumbar.records.importing.roles import (
    NONE,
    Choices,
    Role,
    is_velocity_name,
    name_match_score,
    refuse_spectrum,
    select_column,
)
from lumbar.records.importing.vector_roles import find_roles_of_axes
from lumbar.records.record import LARGEST, MIN_SAMPLES, Channel, Record, check_record, place_of
from lumbar.records.sampling import check_clipping, samples_between

_MAX_PARTS = 200
_MAX_LISTED = 5
_NAME_SIGNS = "_.-"
"""Signs allowed in a record's name, in addition to letters and digits."""
_QUANTITIES = {"length": "position", "angle": "angle", "force": "force", "torque": "torque"}
_QUANTITIES |= {"velocity": "position", "angular velocity": "angle"}


def record_name(text: str) -> str:
    """Return a valid name of a record, made from any text.

    Parameters
    ----------
    text : str
        Name of a file or a part.
    """
    return sanitize_name(text, "record", _NAME_SIGNS)


@dataclass(frozen=True)
class TablePart:
    """Samples of a table that become one record."""

    name: str
    """Name of the record."""
    samples: np.ndarray
    """Indices of the samples in the table, shape (samples,)."""
    reason: str = ""
    """Origin of the part; empty for the whole table."""


def _split_parts(table: RawTable, time: np.ndarray, choices: Choices, name: str) -> list[TablePart]:
    """Return the parts that the user requested; the names of parts by column begin with `name`.

    Raise with all parts that are empty, share samples or have no valid name.
    """
    count = len(time)
    if choices.cut:
        parts = _cut_spans(table, time, choices.cut)
    elif choices.cut_by is not None:
        parts = _cut_by_column(table, choices.cut_by, name)
    elif choices.trim is not None:
        samples = samples_between(time, choices.trim, table.source)
        reason = f"{count - samples.size} of {count} samples lie outside --trim and are left out"
        return [TablePart(name, samples, reason)]
    else:
        return [TablePart(name, np.arange(count))]
    return [replace(part, reason=f"{part.samples.size} of {count} samples: {part.reason}") for part in parts]


def _cut_spans(
    table: RawTable, time: np.ndarray, cut: tuple[tuple[str, tuple[float, float]], ...]
) -> list[TablePart]:
    problems, parts = Problems(table.source), []
    names = [name for name, _ in cut]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.add("--cut", f"{names.count(name)} parts are named {name!r}")
    for name, span in cut:
        edges = ":".join(f"{edge:.9g}" if np.isfinite(edge) else "" for edge in span)
        option = f"--cut {name}={edges}"
        if name != record_name(name):
            problems.add(option, f"{name!r} names no record", "letters, digits, _, . and - are allowed")
        elif not span[0] < span[1]:
            problems.add(option, "the start must lie before the stop")
        else:
            try:
                parts.append(TablePart(name, samples_between(time, span, option), option))
            except InputError as error:
                problems.add("", str(error))
    ordered = sorted((span, name) for name, span in cut if span[0] < span[1])
    for ((_, stop), one), ((start, end), other) in pairwise(ordered):
        if start < stop:
            problems.add("--cut", f"{one} and {other} share {start:g} to {min(stop, end):g} s")
    problems.raise_if_any()
    return parts


def _cut_by_column(table: RawTable, request: str, name: str) -> list[TablePart]:
    """Return one part per run of rows with one value in a column; names of repeated values get a number."""
    column, _ = select_column((*table.columns, *table.text_columns), request, "cut-by")
    values = column.values
    edges = [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1).tolist(), len(values)]
    intervals = [(first, stop) for first, stop in pairwise(edges) if np.isfinite(values[first])]
    if not 0 < len(intervals) <= _MAX_PARTS:
        raise InputError(
            f"{table.source}: --cut-by: {column.label} has {len(intervals)} intervals of one value; 1 to {_MAX_PARTS} become "
            "records"
        )
    problems, parts = Problems(table.source), []
    counts: dict[str, int] = {}
    for first, stop in intervals:
        number = int(values[first])
        label = column.labels[number] if column.labels else f"{values[first]:g}"
        part = f"{name}_{sanitize_name(label, str(number + 1), _NAME_SIGNS)}"
        counts[part] = counts.get(part, 0) + 1
        part = part if counts[part] == 1 else f"{part}_{counts[part]}"
        if stop - first < MIN_SAMPLES:
            problems.add(part, f"{stop - first} samples", f"at least {MIN_SAMPLES} are needed")
        parts.append(TablePart(part, np.arange(first, stop), f"{column.label} is {label}"))
    problems.raise_if_any()
    return parts


@dataclass(frozen=True)
class ImportedRecording:
    """A record and its origin."""

    record: Record
    """Channels ``input`` (position) and ``output`` (force), or one of each per axis."""
    form: str
    """Description of the file's form."""
    grounds: dict[str, str]
    """The column of each role, with the reason."""
    notes: tuple[str, ...] = ()
    """Changes of the samples, and remarks for the user."""
    samples_read: int = 0
    """Rows of the file's table."""
    sha256: str = field(default="", repr=False)
    """SHA-256 of the file."""
    clipped: bool = False
    """True if clipped channels were accepted."""
    sources: dict[str, tuple[str, str]] = field(default_factory=dict)
    """The name and unit of each role's column in the file."""

    @property
    def columns(self) -> dict[str, dict[str, str]]:
        """Settings of the tidy file's columns by role, as in a layout."""
        columns = {"time": {"column": "time_s", "quantity": "time", "unit": "s"}}
        for role, item in self.record.channels.items():
            parts = (item.quantity, role.partition("_")[2], item.unit.replace("·", ""))
            name = "_".join(filter(None, parts))
            columns[role] = {"column": name, "quantity": item.quantity, "unit": item.unit}
        return columns

    @property
    def names(self) -> dict[str, str]:
        """Column names of the tidy file by role."""
        return {role: column["column"] for role, column in self.columns.items()}

    @property
    def tidy(self) -> dict[str, np.ndarray]:
        """Values of the tidy file's columns by name."""
        return {
            name: self.record.time if role == "time" else self.record[role]
            for role, name in self.names.items()
        }

    @property
    def numbers(self) -> dict[str, str | float]:
        """Numbers by which the user checks the record."""
        record = self.record
        row: dict = {"record": record.name, "samples": len(record)}
        row["rate (Hz)"] = round(1 / record.sampling_time, 4)
        row["start (s)"], row["end (s)"] = record.time[0], record.time[-1]
        for name, values in list(self.tidy.items())[1:]:
            row |= {f"least {name}": values.min(), f"largest {name}": values.max()}
        row[f"largest speed ({self.unit}/s)"] = self.speed
        return row

    @property
    def unit(self) -> str:
        """Unit of the motion."""
        return self.record.channels[self.record.roles("input")[0]].unit

    @property
    def speed(self) -> float:
        """Largest speed of the motion, in `unit` per second."""
        velocity = np.gradient(self.record.stacked("input"), self.record.sampling_time, axis=1)
        return float(np.linalg.norm(velocity, axis=0).max())

    def frame(self):
        """Return the record as a data frame in its tidy form."""
        import pandas as pd

        return pd.DataFrame(self.tidy)


def to_records(
    table: RawTable, choices: Choices, name: str, sha256: str = ""
) -> tuple[ImportedRecording, ...]:
    """Convert a table, or its parts, to records.

    Parameters
    ----------
    table : RawTable
        Table of the file.
    choices : Choices
        The user's options.
    name : str
        Name of the record of the whole table.
    sha256 : str
        SHA-256 of the file.

    Returns
    -------
    tuple of ImportedRecording
        Recordings, one per part of the table.

    Raises
    ------
    InputError
        If a column, a unit, the rate or a part is unclear; with all parts that have repeated or backward time stamps or
        missing samples, or that cannot be analysed.
    """
    if choices.position is None or choices.force is None:
        refuse_spectrum(table)
    roles = find_roles_of_axes(table, choices.requests, choices.rate)
    clock = roles.get("time")
    if clock is not None and choices.rate is not None:
        raise InputError(
            f"{table.source}: --rate is given, but {clock.column.label} is time ({clock.reason}); leave --rate out, or give "
            f"--time {NONE}"
        )
    if clock is None:
        samples = len(table.columns[0].values)
        time, origin = stated_time(samples, choices.rate, table.rates, table.source)
    else:
        time, origin = clock.column.values * clock.unit.factor, ""
    grounds = {"time": origin} | {role: f"{item.column.label}, {item.reason}" for role, item in roles.items()}
    sources = {role: (item.column.label, item.unit.name) for role, item in roles.items()}
    rows = len(time)
    table, time, roles, incomplete = _drop_incomplete_rows(table, time, roles)
    parts = _split_parts(table, time, choices, name)
    problems, recordings = Problems(table.source), []
    for part in parts:
        try:
            records = _to_records(table, choices, roles, time, part)
        except InputError as error:
            if len(parts) == 1 and not choices.cut:
                raise
            text = str(error).removeprefix(f"{table.source}: ")
            problems.add(part.name, text.replace("\n", "\n    "))
        else:
            recordings += [
                ImportedRecording(
                    record,
                    table.form,
                    grounds,
                    tuple(filter(None, [*table.notes, incomplete, *notes])),
                    rows,
                    sha256,
                    choices.clipped,
                    sources,
                )
                for record, notes in records
            ]
    problems.raise_if_any()
    return tuple(recordings)


def _drop_incomplete_rows(
    table: RawTable, time: np.ndarray, roles: dict[str, Role]
) -> tuple[RawTable, np.ndarray, dict[str, Role], str]:
    """Return table, time and roles without the rows in which a value is missing, and a note on them."""
    every = {"time": time} | {role: item.column.values for role, item in roles.items()}
    absent = {role: ~np.isfinite(values) for role, values in every.items()}
    missing = np.any([*absent.values()], axis=0)
    if not missing.any():
        return table, time, roles, ""
    names = [f"{role} in {flags.sum()}" for role, flags in absent.items() if flags.any()]
    described = f"{missing.sum()} of {len(time)} rows, with a missing number ({', '.join(names)}),"
    complete = np.flatnonzero(~missing)
    if len(complete) < MIN_SAMPLES:
        raise InputError(
            f"{table.source}: {described} leave {len(complete)}; at least {MIN_SAMPLES} are needed"
        )
    shown = np.flatnonzero(missing)[:_MAX_LISTED]
    places = ", ".join(place_of(int(row), table.lines) for row in shown)
    more = ", …" if missing.sum() > _MAX_LISTED else ""
    table = table.with_rows(complete)
    columns = {column.number: column for column in table.columns}
    roles = {role: replace(item, column=columns[item.column.number]) for role, item in roles.items()}
    return table, time[complete], roles, f"{described} are left out: {places}{more}"


def _to_records(
    table: RawTable, choices: Choices, roles: dict[str, Role], time: np.ndarray, part: TablePart
) -> list[tuple[Record, list[str]]]:
    """Return the records between the gaps of a part, each with notes on its changes."""
    clock, note = recover_even_clock(time[part.samples])
    lines = None if table.lines is None else np.asarray(table.lines)[part.samples]
    check_repeated(clock, lines, table.source)
    intervals = split_at_gaps(clock)
    if len(intervals) == 1:
        return [_to_record(table, choices, roles, time, part, (clock, note))]
    long = [interval for interval in intervals if interval.stop - interval.start >= MIN_SAMPLES]
    first = intervals[1].start
    gap = f"from {clock[first - 1]:.9g} to {clock[first]:.9g} s at {place_of(first, lines)}"
    if not 0 < len(long) <= _MAX_PARTS:
        raise InputError(
            f"{table.source}: {len(intervals) - 1} gaps, the first {gap}, leave {len(long)} parts of at least "
            f"{MIN_SAMPLES} samples; 1 to {_MAX_PARTS} become records: if the rows are sampled evenly, give --time {NONE} "
            "--rate HZ"
        )
    short = len(clock) - sum(interval.stop - interval.start for interval in long)
    reason = f"split at {len(intervals) - 1} gaps or restarts of the clock, the first {gap}"
    reason += f"; {short} samples in parts of fewer than {MIN_SAMPLES} are left out" if short else ""
    records, faults = [], []
    for number, interval in enumerate(long, start=1):
        name = f"{part.name}_{number}" if len(long) > 1 else part.name
        piece = TablePart(name, part.samples[interval], part.reason)
        try:
            even = recover_even_clock(time[piece.samples])
            record, notes = _to_record(table, choices, roles, time, piece, even)
            records.append((record, [reason, *notes]))
        except InputError as error:
            faults.append(f"{name} is left out: {str(error).removeprefix(f'{table.source}: ')}")
    if not records:
        raise InputError(f"{table.source}: {faults[0]}")
    return [(record, [*notes, *faults]) for record, notes in records]


def _to_record(
    table: RawTable,
    choices: Choices,
    roles: dict[str, Role],
    time: np.ndarray,
    part: TablePart,
    even: tuple[np.ndarray, str],
) -> tuple[Record, list[str]]:
    """Return the record of a part without gaps, whose clock and note are `even`, and notes on its changes."""
    samples, (clock, note) = part.samples, even
    notes = [part.reason, note]
    lines = None if table.lines is None else np.asarray(table.lines)[samples]
    # The part as in the file, on its clock and in the units of records.
    names = {role.replace("position", "input").replace("force", "output"): role for role in roles}
    channels = {
        name: _make_channel(role, roles[role], samples, choices.flip_force)
        for name, role in names.items()
        if role != "time"
    }
    record = Record(part.name, clock, channels, table.source)
    if choices.flip_force:
        notes.append("the sign of the force is changed, as given by --flip-force")
    _check_size(record, names, lines)
    if not choices.clipped:
        # Before resampling, after which no two samples are equal.
        check_clipping(record, lines, choices.load_drives)
    motion = roles.get("position")
    if motion is not None and motion.unit.quantity in SPEEDS.values():
        quantity, unit = channels["input"].quantity, motion.unit.target.removesuffix("/s")
        velocity = motion.column.values * motion.unit.factor
        position, note = integrate_velocity(time, velocity, samples, unit, table.lines)
        channels |= {"input": Channel(position, quantity, unit)}
        record = Record(part.name, clock, channels, table.source)
        notes.append(f"the {quantity} is the integral of {motion.column.label} {note}")
    elif motion is not None and is_velocity_name(motion.column.name_in_group):
        notes.append(
            f"{motion.column.label} has the name of a velocity, and is used as a position, as given; --position-unit mm/s would "
            "integrate it"
        )
    notes += contradictions(record, table.rates)
    record, note = even_clock(record)
    check_record(record, lines=None if note else lines)
    return record, [*notes, note]


def _make_channel(name: str, role: Role, samples: np.ndarray, flip_force: bool) -> Channel:
    side, _, axis = name.partition("_")
    quantity = side if axis else _QUANTITIES.get(role.unit.quantity, "")
    if not quantity:
        # A sensor's reading, e.g. in volts, is named as its column, or as its role if both names agree.
        column = role.column.name_in_group
        default = "input" if name == "position" else "output"
        quantity = name if name_match_score(column, name) >= 2 else sanitize_name(column, default)
    values = role.column.values[samples] * role.unit.factor
    return Channel(-values if flip_force and side == "force" else values, quantity, role.unit.target)


def _check_size(record: Record, roles: Mapping[str, str], lines: Sequence[int] | None) -> None:
    """Raise if values are too large; `roles` are the columns' roles by channel."""
    problems = Problems(record.source)
    for name, channel in record.channels.items():
        large = np.abs(channel.values) > LARGEST  # no sum, spline or filter of them is finite
        if large.any():
            problem = f"{roles[name]} is {channel.values[large.argmax()]:g}"
            problems.add(place_of(int(large.argmax()), lines), problem, f"at most {LARGEST:g} is allowed")
    problems.raise_if_any()
