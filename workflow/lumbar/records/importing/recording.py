"""A foreign table as a validated record of time, position and force, with what was guessed and why.

A table is one record, or several: spans of its clock, or what a column names or numbers alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import sanitize_name
from lumbar.records.importing.clock import (
    check_forward,
    contradictions,
    even_clock,
    longest,
    position_of,
    stated_time,
    unrounded,
)
from lumbar.records.importing.raw_table import RawTable
from lumbar.records.importing.roles import NONE, Choices, Role, named_so, named_velocity, wished
from lumbar.records.importing.vector_roles import find_roles_of_axes
from lumbar.records.record import (
    FEWEST_SAMPLES,
    LARGEST,
    Channel,
    Record,
    check_record,
    place_of,
)
from lumbar.records.sampling import check_clipping, runs, samples_between

_MOST_PARTS = 200
_OTHERS = "_.-"
"""What a record's name holds beside letters and digits."""


@dataclass(frozen=True)
class Part:
    """Samples of a table that become one record."""

    name: str
    """Of the record."""
    keep: np.ndarray
    """Shape (samples,): their numbers in the table."""
    why: str = ""
    """What says so; empty for the whole table."""


def record_name(text: str) -> str:
    """Name of a record for any text."""
    return sanitize_name(text, "record", _OTHERS)


def parts_of(table: RawTable, time: np.ndarray, choices: Choices, name: str) -> list[Part]:
    """Part a table as was asked for; `name` is that of the file's record.

    Raises
    ------
    InputError
        With all parts that are empty, share samples or cannot be named.
    """
    samples = len(time)
    if choices.cut:
        parts = _spans(table, time, choices.cut)
    elif choices.cut_by is not None:
        parts = _stretches(table, choices.cut_by, name)
    elif choices.trim is not None:
        keep = samples_between(time, choices.trim, table.source)
        return [
            Part(
                name, keep, f"{samples - keep.size} of {samples} samples lie outside --trim and are left out"
            )
        ]
    else:
        return [Part(name, np.arange(samples))]
    return [
        Part(part.name, part.keep, f"{part.keep.size} of {samples} samples: {part.why}") for part in parts
    ]


def _spans(table: RawTable, time: np.ndarray, cut: tuple[tuple[str, tuple[float, float]], ...]) -> list[Part]:
    problems, parts = Problems(table.source), []
    names = [name for name, _ in cut]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.add("--cut", f"{names.count(name)} parts are named {name!r}")
    for name, (start, stop) in cut:
        option = f"--cut {name}={_edge(start)}:{_edge(stop)}"
        if name != record_name(name):
            problems.add(option, f"{name!r} names no record", "letters, digits, _, . and - are allowed")
        elif not start < stop:
            problems.add(option, "the start must lie before the stop")
        else:
            try:
                parts.append(Part(name, samples_between(time, (start, stop), option), option))
            except InputError as error:
                problems.add("", str(error))
    ordered = sorted((span, name) for name, span in cut if span[0] < span[1])
    for ((_, stop), one), ((start, end), other) in pairwise(ordered):
        if start < stop:
            problems.add("--cut", f"{one} and {other} share {start:g} to {min(stop, end):g} s")
    problems.raise_if_any()
    return parts


def _edge(seconds: float) -> str:
    return f"{seconds:.9g}" if np.isfinite(seconds) else ""


def _stretches(table: RawTable, wish: str, name: str) -> list[Part]:
    """Runs of rows in which a column says one thing; a thing said again later has a number behind its name."""
    column, _ = wished((*table.columns, *table.words), wish, "cut-by")
    said = column.values
    edges = [0, *(np.flatnonzero(said[1:] != said[:-1]) + 1).tolist(), len(said)]
    stretches = [(first, stop) for first, stop in pairwise(edges) if np.isfinite(said[first])]
    if not 0 < len(stretches) <= _MOST_PARTS:
        raise InputError(
            f"{table.source}: --cut-by: {column.label} has {len(stretches)} stretches of one value; 1 to {_MOST_PARTS} become "
            "records"
        )
    problems, parts = Problems(table.source), []
    times: dict[str, int] = {}
    for first, stop in stretches:
        at = int(said[first])
        word = column.spellings[at] if column.spellings else f"{said[first]:g}"
        own = f"{name}_{sanitize_name(word, str(at + 1), _OTHERS)}"
        times[own] = times.get(own, 0) + 1
        own = own if times[own] == 1 else f"{own}_{times[own]}"
        if stop - first < FEWEST_SAMPLES:
            problems.add(own, f"{stop - first} samples", f"at least {FEWEST_SAMPLES} are needed")
        parts.append(Part(own, np.arange(first, stop), f"{column.label} is {word}"))
    problems.raise_if_any()
    return parts


_NAMES = {"length": "position", "angle": "angle", "force": "force", "torque": "torque"}
_NAMES |= {"velocity": "position", "angular velocity": "angle"}


@dataclass(frozen=True)
class ImportedRecording:
    """A record, and how it came out of its file."""

    record: Record
    """Channels ``input`` (position) and ``output`` (force), or one of each per axis."""
    form: str
    """How the file was read."""
    grounds: dict[str, str]
    """By role, which column it is and why, in words."""
    notes: tuple[str, ...] = ()
    """What was done to the samples, and what a person should look at."""
    samples_read: int = 0
    """Rows of the file's table."""
    sha256: str = field(default="", repr=False)
    """Of the file."""
    clipped: bool = False
    """Whether clipped channels were accepted."""
    found: dict[str, tuple[str, str]] = field(default_factory=dict)
    """By role, the column's name and the unit of its numbers as the file has them."""

    @property
    def names(self) -> dict[str, str]:
        """Column names of the tidy file by role."""
        parts = {
            role: (item.quantity, role.partition("_")[2], item.unit.replace("·", ""))
            for role, item in self.record.channels.items()
        }
        return {"time": "time_s", **{role: "_".join(filter(None, part)) for role, part in parts.items()}}

    @property
    def columns(self) -> dict[str, dict[str, str]]:
        """Columns of the tidy file by role, as a layout has them."""
        described = {"time": ("time", "s")}
        described |= {role: (item.quantity, item.unit) for role, item in self.record.channels.items()}
        return {
            role: {"column": self.names[role], "quantity": quantity, "unit": unit}
            for role, (quantity, unit) in described.items()
        }

    @property
    def tidy(self) -> dict[str, np.ndarray]:
        """Columns of the tidy file, by their names."""
        return {
            name: self.record.time if role == "time" else self.record[role]
            for role, name in self.names.items()
        }

    @property
    def numbers(self) -> dict[str, str | float]:
        """What a person checks the record by: the numbers in which a slip shows."""
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
        """Of the motion."""
        return self.record.channels[self.record.roles("input")[0]].unit

    @property
    def speed(self) -> float:
        """Largest speed of the motion, per second."""
        velocity = np.gradient(self.record.stacked("input"), self.record.sampling_time, axis=1)
        return float(np.linalg.norm(velocity, axis=0).max())

    def frame(self):
        """Return the record as a data frame in its tidy form."""
        import pandas as pd

        return pd.DataFrame(self.tidy)


def to_records(
    table: RawTable, choices: Choices, name: str, sha256: str = ""
) -> tuple[ImportedRecording, ...]:
    """Turn a table into its record, or its parts into records.

    Raises
    ------
    InputError
        If a column, a unit, the rate or a part cannot be told; with all parts in which time stands or goes back, samples are
        missing, or that cannot be analysed.
    """
    roles = find_roles_of_axes(table, choices.wishes(), choices.rate)
    clock = roles.get("time")
    if clock is not None and choices.rate is not None:
        raise InputError(
            f"{table.source}: --rate is given, but {clock.column.label} is time ({clock.why}); leave --rate out, or say "
            f"--time {NONE}"
        )
    if clock is None:
        samples = len(table.columns[0].values)
        time, origin = stated_time(samples, choices.rate, table.rates, table.source)
    else:
        time, origin = clock.column.values * clock.unit.factor, f"{clock.column.label}, {clock.why}"
    grounds = {"time": origin}
    grounds |= {role: f"{item.column.label}, {item.why}" for role, item in roles.items() if role != "time"}
    found = {role: (item.column.label, item.unit.name) for role, item in roles.items()}
    parts = parts_of(table, time, choices, name)
    problems, records = Problems(table.source), []
    for part in parts:
        try:
            record, notes = _to_record(table, choices, roles, time, part)
        except InputError as error:
            if len(parts) == 1 and not choices.cut:
                raise
            words = str(error).removeprefix(f"{table.source}: ").replace("--trim ", f"--cut {part.name}=")
            problems.add(part.name, words.replace("\n", "\n    "))
        else:
            records.append(
                ImportedRecording(
                    record=record,
                    form=table.form,
                    grounds=grounds,
                    notes=notes,
                    samples_read=len(time),
                    sha256=sha256,
                    clipped=choices.clipped,
                    found=found,
                )
            )
    problems.raise_if_any()
    return tuple(records)


def _to_record(
    table: RawTable, choices: Choices, roles: dict[str, Role], time: np.ndarray, part: Part
) -> tuple[Record, tuple[str, ...]]:
    """Return the record of a part, and what was done to it."""
    keep, notes = part.keep, [part.why] if part.why else []
    lines = None if table.lines is None else np.asarray(table.lines)[keep].tolist()
    # The part as it is in the file, on its clock and in the units of records.
    clock, rounded = unrounded(time[keep])
    notes += [rounded] if rounded else []
    check_forward(clock, lines, table.source)
    names = {role: role.replace("position", "input").replace("force", "output") for role in roles}
    channels = {
        names[role]: _channel(role, item, keep, choices.flip_force)
        for role, item in roles.items()
        if role != "time"
    }
    record = Record(part.name, clock, channels, table.source)
    if choices.flip_force:
        notes.append("the sign of the force is changed, as told by --flip-force")
    _check_complete(record, {name: role for role, name in names.items()}, lines)
    if not choices.clipped:
        check_clipping(record, lines)  # before resampling, after which no two samples are alike
    # A velocity is integrated.
    motion = roles.get("position")
    if motion is not None and motion.is_velocity:
        quantity, unit = channels["input"].quantity, motion.unit.target.removesuffix("/s")
        velocity = motion.column.values * motion.unit.factor
        position, words = position_of(time, velocity, keep, unit, table.lines)
        record = replace(record, channels={**channels, "input": Channel(position, quantity, unit)})
        notes.append(f"the {quantity} is the integral of {motion.column.label} {words}")
    elif motion is not None and named_velocity(motion.column.own_name):
        notes.append(
            f"{motion.column.label} is named a velocity, and is taken for a position as told; --position-unit mm/s would "
            "integrate it"
        )
    notes += contradictions(record, table.rates)
    record, resampled = even_clock(record, lines)
    check_record(record, lines=None if resampled else lines)
    return record, (*notes, *resampled)


def _channel(name: str, role: Role, keep: np.ndarray, flip_force: bool) -> Channel:
    side, _, axis = name.partition("_")
    quantity = side if axis else _NAMES.get(role.unit.quantity, "")
    if (
        not quantity
    ):  # a sensor's reading, e.g. in volts: named as in the file, unless that says position or force
        own = role.column.own_name
        quantity = (
            name
            if named_so(own, name) >= 2
            else sanitize_name(own, "input" if name == "position" else "output")
        )
    values = role.column.values[keep] * role.unit.factor
    return Channel(-values if flip_force and side == "force" else values, quantity, role.unit.target)


def _check_complete(record: Record, roles: Mapping[str, str], lines: Sequence[int] | None) -> None:
    """Raise if samples are missing: a column file cannot hold a gap. `roles` of columns by channel."""
    problems = Problems(record.source)
    missing = np.zeros(len(record), dtype=bool)
    for name, channel in record.channels.items():
        absent = ~np.isfinite(channel.values)
        if absent.any():
            first = place_of(int(absent.argmax()), lines)
            problems.add(
                first, f"{roles[name]} is missing in {absent.sum()} samples, {absent.mean():.3g} of all"
            )
        missing |= absent
        large = np.abs(channel.values) > LARGEST  # no sum, spline or filter of them is finite
        if large.any():
            found = f"{roles[name]} is {channel.values[large.argmax()]:g}"
            problems.add(
                place_of(int(large.argmax()), lines), found, f"at most {LARGEST:g} in size is computed with"
            )
    complete = max(runs(~missing), key=lambda run: run.stop - run.start, default=None)
    if missing.any() and complete is not None:
        step = float(np.median(np.diff(record.time)))
        part = longest(record.time, [complete.start, complete.stop], step)
        problems.add("", "a record has no gaps", part)
    problems.raise_if_any()
