"""The validated record that every analysis works on, evenly sampled channels with units, and sets of such records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.settings.layout import AXES, SIDES

CLOCK_TOLERANCE = 0.25
"""How far a sample may lie from an even clock, as a share of the sampling interval."""
LARGEST = 1e100
"""Largest size of a value: sums of the squares of such values are finite, and no quantity here comes near it."""
LARGEST_IN = {"N": 1e6, "kN": 1e3, "mN": 1e9, "rad": 1e5, "deg": 1e7, "Nm": 1e6, "N m": 1e6, "N·m": 1e6}
LARGEST_IN |= {"m": 1e3, "cm": 1e5, "mm": 1e6, "um": 1e9, "µm": 1e9}
"""Largest size of a value by its unit: a thousand kilonewtons, a kilometre, ten thousand turns. No person, tissue or machine
here comes near them; a lost decimal point does."""


@dataclass(frozen=True)
class Channel:
    """One measured quantity."""

    values: np.ndarray
    """Shape (samples,)."""
    quantity: str
    """What was measured, e.g. ``"position"``."""
    unit: str
    """Unit of the values, e.g. ``"mm"``."""

    @property
    def label(self) -> str:
        """Axis label: quantity and unit."""
        return f"{self.quantity.capitalize()} ({self.unit})" if self.unit else self.quantity.capitalize()


_STILL = 0.05
"""Share of the largest range along an axis, up to which another axis hardly moves."""


@dataclass(frozen=True, repr=False)
class Record:
    """Channels that share one evenly sampled clock."""

    name: str
    """Name of the record within its study, e.g. ``"multisine"``."""
    time: np.ndarray
    """Shape (samples,): seconds."""
    channels: dict[str, Channel]
    """By role: ``"input"`` and ``"output"`` for a tissue test (position, force) and a joint (angle, moment), ``"input_x"`` and
    so on for a tissue test of several axes, ``"position"`` for surgeon motion."""
    source: str = ""
    """File it was read from, for messages."""
    period: float | None = None
    """Period of a periodic excitation in seconds, where it is known."""
    filled: tuple[int, ...] = ()
    """Samples that were not recorded and are interpolated from their neighbours."""
    points: bool = False
    """Whether these are points of a static test, without a clock: `time` numbers them."""
    trim: tuple[float, float] | None = None
    """Start and stop of the part of the file that was read, in seconds of its clock; None for all of it."""

    def __getitem__(self, role: str) -> np.ndarray:
        """Values of the channel with this role."""
        return self.channels[role].values

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        """What it is, in one line."""
        return f"<Record {self.in_words}>"

    @property
    def in_words(self) -> str:
        """Name, samples, clock and channels."""
        if self.points:
            return f"{self.name}: {len(self)} points without a clock; {self.quantities}"
        rate = round(1 / self.sampling_time, 4) if len(self) > 1 else float("nan")
        return f"{self.name}: {len(self)} samples at {rate:g} Hz, {len(self) / rate:.4g} s; {self.quantities}"

    @property
    def quantities(self) -> str:
        """What was measured, with units: ``"position (mm), force (N)"``, ``"position x, y (mm), force x, y (N)"``."""
        along = {self.roles(side)[0]: "".join(f", {axis}" for axis in self.axes)[1:] for side in SIDES}
        told_before = {role for side in SIDES for role in self.roles(side)[1:]}
        return ", ".join(
            f"{item.quantity}{along.get(role, '')} ({item.unit})"
            for role, item in self.channels.items()
            if role not in told_before
        )

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of a record of several, ``("x", "y", "z")`` or two of them; empty for one axis."""
        return tuple(axis for axis in AXES if f"input_{axis}" in self.channels)

    def roles(self, side: str) -> tuple[str, ...]:
        """Roles of the ``"input"`` or the ``"output"``: one per axis."""
        return tuple(f"{side}_{axis}" for axis in self.axes) or (side,)

    def along(self, role: str) -> Channel:
        """Return a channel; one of several axes with its axis behind the quantity."""
        found, axis = self.channels[role], role.rpartition("_")[2]
        return replace(found, quantity=f"{found.quantity} {axis}") if axis in self.axes else found

    def stacked(self, side: str) -> np.ndarray:
        """Values of the ``"input"`` or the ``"output"``, shape (axes, samples); of one axis, shape (1, samples)."""
        return np.stack([self[role] for role in self.roles(side)])

    def axis(self, name: str) -> Record:
        """Return the record of one of several axes, with the channels that belong to none.

        Raises
        ------
        InputError
            If it has no such axis.
        """
        if name not in self.axes:
            raise InputError(f"{self.name}: no axis {name!r}; there are {', '.join(self.axes) or 'none'}")
        along = {side: self.channels[f"{side}_{name}"] for side in SIDES}
        every = {role for side in SIDES for role in self.roles(side)}
        beside = {role: channel for role, channel in self.channels.items() if role not in every}
        return replace(self, channels={**along, **beside})

    @property
    def widest(self) -> Record:
        """The record of the axis that moves farthest; itself of one axis."""
        if not self.axes:
            return self
        return self.axis(max(self.axes, key=lambda axis: float(np.ptp(self[f"input_{axis}"]))))

    @property
    def moving(self) -> tuple[str, ...]:
        """Axes that move; of one that hardly does beside the others noise is all there is to see."""
        ranges = {axis: float(np.ptp(self[f"input_{axis}"])) for axis in self.axes}
        return tuple(axis for axis, found in ranges.items() if found > _STILL * max(ranges.values()))

    @property
    def sampling_time(self) -> float:
        """Sampling interval in seconds."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def time_scale(self) -> float:
        """Time that is short beside the record and long beside a step, s: the geometric mean of the step and all of them."""
        return self.sampling_time * float(np.sqrt(len(self)))

    @property
    def duration(self) -> float:
        """Samples times sampling interval, in seconds."""
        return self.sampling_time * len(self.time)

    def between(self, start: float, stop: float) -> Record:
        """Return the part with ``start <= time < stop`` (seconds)."""
        keep = (self.time >= start - 1e-9) & (self.time < stop - 1e-9)
        channels = {
            role: replace(channel, values=channel.values[keep]) for role, channel in self.channels.items()
        }
        before = np.cumsum(keep) - 1
        filled = tuple(int(before[sample]) for sample in self.filled if keep[sample])
        return replace(self, time=self.time[keep], channels=channels, filled=filled)

    def with_values(self, **values: np.ndarray) -> Record:
        """Return the record with other values in the channels of these roles."""
        changed = {role: replace(self.channels[role], values=found) for role, found in values.items()}
        return replace(self, channels={**self.channels, **changed})


MIN_SAMPLES = 8
"""Fewest samples of a record that can be analysed."""


def place_of(sample: int, lines: Sequence[int] | None) -> str:
    """Name the place of a sample (counted from 0): its line in the file, or the sample where a file has no lines."""
    return f"sample {sample + 1}" if lines is None else f"line {lines[sample]}"


def check_record(
    record: Record, may_rest: Collection[str] = (), lines: Sequence[int] | None = None
) -> Record:
    """Return `record` when it can be analysed, else raise with all reasons; channels of the roles `may_rest` may be constant.

    One of several axes may rest, too.

    Raises
    ------
    InputError
        Too few samples, a value that is not finite or too large to compute with, time that does not increase or is not
        even, a constant channel.
    """
    problems = Problems(record.source or record.name)
    if len(record.time) < MIN_SAMPLES:
        problems.add("", f"{len(record.time)} samples", f"at least {MIN_SAMPLES} are needed")
        problems.raise_if_any()
    series = {role: channel.values for role, channel in record.channels.items()}
    with np.errstate(invalid="ignore"):  # values that are not finite are refused by themselves
        resting = {role for role, values in series.items() if np.ptp(values) == 0}
    alike = {role: roles for roles in map(record.roles, SIDES) for role in roles}
    for name, values in {"time": record.time, **series}.items():
        unit = record.channels[name].unit if name in record.channels else ""
        largest = LARGEST_IN.get(unit, LARGEST)
        bad = np.flatnonzero(~(np.abs(values) <= largest))
        if bad.size:
            more = f" (and {bad.size - 1} more)" if bad.size > 1 else ""
            problems.add(
                place_of(bad[0], lines) + more,
                f"{name} is {values[bad[0]]}",
                f"every value must be a finite number, of at most {largest:g} {unit}".rstrip() + " in size",
            )
        elif name != "time" and name not in may_rest and resting.issuperset(alike.get(name, (name,))):
            problems.add(name, f"constant ({values[0]:g})", "a channel that does not move cannot be analysed")
    problems.raise_if_any()
    _check_clock(record, problems, lines)
    problems.raise_if_any()
    return record


def _check_clock(record: Record, problems: Problems, lines: Sequence[int] | None) -> None:
    steps = np.diff(record.time)
    backward = np.flatnonzero(steps <= 0)
    if backward.size:
        first = int(backward[0])
        problems.add(
            place_of(first + 1, lines),
            f"time {record.time[first + 1]:g} s after {record.time[first]:g} s",
            "time must increase",
        )
        return
    step = np.median(steps)
    # A clock written with few digits steps unevenly by its rounding; what counts is how far a sample lies
    # from where an even clock would have put it.
    even = record.time[0] + record.sampling_time * np.arange(len(record.time))
    uneven = np.flatnonzero(np.abs(record.time - even)[1:] > CLOCK_TOLERANCE * step)
    if uneven.size:
        worst = int(np.abs(steps - step).argmax())
        problems.add(
            place_of(worst + 1, lines),
            f"step of {steps[worst]:g} s where the median step is {step:g} s",
            "records are sampled evenly: resample the recording or cut it before the gap",
        )


def _quantities(record: Record) -> dict[str, str]:
    return {role: f"{channel.quantity} in {channel.unit}" for role, channel in record.channels.items()}


_MOTIONS, _LOADS = ("position", "displacement", "angle", "velocity"), ("force", "moment", "torque")


def use_load_as_input(record: Record) -> Record:
    """The record of a test that its load drove: the load is the input, wherever it stood in the file."""
    one, other = (record.channels[record.roles(side)[0]] for side in SIDES)
    return swap_input_and_output(record) if one.quantity in _MOTIONS and other.quantity in _LOADS else record


def swap_input_and_output(record: Record) -> Record:
    """The record with its output as the input."""
    one, other = map(record.roles, SIDES)
    swapped = zip((*one, *other), (*other, *one), strict=True)
    return replace(
        record, channels={**record.channels, **{role: record.channels[item] for role, item in swapped}}
    )


def require_clock(records: Iterable[Record]) -> None:
    """Refuse points of a static test, with their names."""
    if points := [record.name for record in records if record.points]:
        raise InputError(
            f"{', '.join(points)}: points of a static test have no clock; lumbar diagnose fits static laws to them, and nothing "
            "else can be told of them"
        )


def require_one_axis(records: Iterable[Record], what: str) -> None:
    """Refuse records of several axes, with their names and what takes one axis."""
    if several := [record.name for record in records if record.axes]:
        raise InputError(
            f"{', '.join(several)}: {what} takes records of one axis; compare, locate, diagnose, explore, refine and "
            "export take several"
        )


def require_same_units(records: list[Record]) -> None:
    """Raise unless all records agree in quantity and unit of every channel.

    Raises
    ------
    InputError
        Naming the first record that differs, with both units.
    """
    problems = Problems("records")
    expected = _quantities(records[0]) if records else {}
    for record in records[1:]:
        if record.axes != records[0].axes:
            one, other = (", ".join(item.axes) or "one axis" for item in (record, records[0]))
            words = f"{one}, but {other} in {records[0].name}"
            problems.add(record.name, words, "all records of a set need the same axes")
            continue
        found = _quantities(record)
        for role in sorted(expected.keys() | found.keys()):
            if found.get(role) != expected.get(role):
                problems.add(
                    record.name,
                    f"{role} is {found.get(role, 'missing')}, but {expected.get(role, 'missing')} in "
                    f"{records[0].name}",
                    "all records of a set need the same channels and units",
                )
    problems.raise_if_any()


class RecordSet(Sequence[Record]):
    """Records that were made alike, one per excitation.

    Raises
    ------
    InputError
        If two records share a name.
    """

    def __init__(self, records: Iterable[Record]):
        self._records = list(records)
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"records share the name {', '.join(map(repr, twice))}: each needs one of its own"
            )

    @property
    def names(self) -> list[str]:
        """Names of the records, in their order."""
        return [record.name for record in self._records]

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, which: int | str) -> Record: ...
    @overload
    def __getitem__(self, which: slice) -> RecordSet: ...
    def __getitem__(self, which):
        if isinstance(which, slice):
            return RecordSet(self._records[which])
        if isinstance(which, str):
            self._check_names([which])
            return self._records[self.names.index(which)]
        return self._records[which]

    def with_periods(self, periods: Mapping[str, float]) -> RecordSet:
        """Return the records with the periods of their excitations in seconds, by the record's name."""
        self._check_names(periods)
        return RecordSet(
            replace(record, period=periods.get(record.name, record.period)) for record in self._records
        )

    def _check_names(self, names: Iterable[str]) -> None:
        for name in names:
            if name not in self.names:
                raise InputError(f"no record {name!r}; there are {', '.join(self.names)}")

    def rows(self) -> list[dict]:
        """What every record is: one dict per record, for tables."""
        return [
            {
                "record": record.name,
                "samples": len(record),
                "rate (Hz)": None if record.points else round(1 / record.sampling_time, 4),
                "duration (s)": None if record.points else round(record.duration, 4),
                "channels": record.quantities,
            }
            for record in self._records
        ]

    def __repr__(self) -> str:
        lines = [f"  {record.in_words}" for record in self]
        return "\n".join([f"{len(self)} record{'s' * (len(self) != 1)}", *lines])

    def _repr_html_(self) -> str:
        import pandas as pd

        return pd.DataFrame(self.rows()).to_html(index=False)
