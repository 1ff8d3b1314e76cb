"""Validated record for all analyses: evenly sampled channels with units; and sets of records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.settings.axes import AXES, SIDES

CLOCK_TOLERANCE = 0.25
"""Largest distance of a sample from an even clock, as a share of the sampling interval."""
LARGEST = 1e100
"""Largest allowed absolute value: sums of the squares of such values are finite."""
LARGEST_IN = {"N": 1e6, "kN": 1e3, "mN": 1e9, "rad": 1e5, "deg": 1e7, "Nm": 1e6, "N m": 1e6, "N·m": 1e6}
LARGEST_IN |= {"m": 1e3, "cm": 1e5, "mm": 1e6, "um": 1e9, "µm": 1e9}
"""Largest allowed absolute value by unit; larger values come from lost decimal points."""


@dataclass(frozen=True)
class Channel:
    """One measured quantity."""

    values: np.ndarray
    """Values of the samples, shape (samples,)."""
    quantity: str
    """Measured quantity, e.g. ``"position"``."""
    unit: str
    """Unit of the values, e.g. ``"mm"``."""

    @property
    def label(self) -> str:
        """Axis label: quantity and unit."""
        return f"{self.quantity.capitalize()} ({self.unit})" if self.unit else self.quantity.capitalize()


_MAX_STILL_SHARE = 0.05
"""Largest range along an axis that does not move, as a share of the largest range along any axis."""
MIN_SAMPLES = 8
"""Smallest number of samples of a record that can be analysed."""


@dataclass(frozen=True, repr=False)
class Record:
    """Channels that share one evenly sampled clock."""

    name: str
    """Name of the record within its study, e.g. ``"multisine"``."""
    time: np.ndarray
    """Time of the samples in seconds, shape (samples,)."""
    channels: dict[str, Channel]
    """Channels by role: ``"input"`` and ``"output"`` for a tissue test (position, force) and a joint (angle, moment),
    ``"input_x"`` and so on for a tissue test of several axes, ``"position"`` for surgeon motion."""
    source: str = ""
    """The file, for messages."""
    period: float | None = None
    """Period of a periodic excitation in seconds; None if unknown."""
    filled: tuple[int, ...] = ()
    """Samples that were not recorded, but interpolated."""
    points: bool = False
    """True for points of a static test without a clock; `time` then numbers them."""
    trim: tuple[float, float] | None = None
    """Start and stop of the part of the file that was read, in seconds of its clock; None for the whole file."""

    def __getitem__(self, role: str) -> np.ndarray:
        """Values of the channel with this role."""
        return self.channels[role].values

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"<Record {self.summary}>"

    @property
    def summary(self) -> str:
        """Name, samples, clock and channels."""
        if self.points:
            return f"{self.name}: {len(self)} points without a clock; {self.quantities}"
        rate = round(1 / self.sampling_time, 4) if len(self) > 1 else float("nan")
        return f"{self.name}: {len(self)} samples at {rate:g} Hz, {len(self) / rate:.4g} s; {self.quantities}"

    @property
    def quantities(self) -> str:
        """Quantities with units: ``"position (mm), force (N)"``, ``"position x, y (mm), force x, y (N)"``."""
        axes = "".join(f", {axis}" for axis in self.axes)[1:]
        first, *rest = zip(*map(self.roles, SIDES), strict=True)
        return ", ".join(
            f"{item.quantity}{axes if role in first else ''} ({item.unit})"
            for role, item in self.channels.items()
            if not any(role in roles for roles in rest)
        )

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of a record of several axes, ``("x", "y", "z")`` or two of them; empty for one axis."""
        return tuple(axis for axis in AXES if f"input_{axis}" in self.channels)

    def roles(self, side: str) -> tuple[str, ...]:
        """Return the roles of the input or of the output, one per axis.

        Parameters
        ----------
        side : str
            ``"input"`` or ``"output"``.
        """
        return tuple(f"{side}_{axis}" for axis in self.axes) or (side,)

    def along(self, role: str) -> Channel:
        """Return a channel; if the record has several axes, its quantity contains the axis.

        Parameters
        ----------
        role : str
            Role of the channel.
        """
        channel, axis = self.channels[role], role.rpartition("_")[2]
        if axis not in self.axes:
            return channel
        return Channel(channel.values, f"{channel.quantity} {axis}", channel.unit)

    def stacked(self, side: str) -> np.ndarray:
        """Return the values of the input or of the output, shape (axes, samples); (1, samples) for one axis.

        Parameters
        ----------
        side : str
            ``"input"`` or ``"output"``.
        """
        return np.stack([self[role] for role in self.roles(side)])

    def axis(self, name: str) -> Record:
        """Return the record of one axis, with the channels that belong to no axis.

        Parameters
        ----------
        name : str
            ``"x"``, ``"y"`` or ``"z"``.

        Raises
        ------
        InputError
            If the record does not have the axis.
        """
        if name not in self.axes:
            raise InputError(f"{self.name}: no axis {name!r}; there are {', '.join(self.axes) or 'none'}")
        axis = {side: self.channels[f"{side}_{name}"] for side in SIDES}
        every = {role for side in SIDES for role in self.roles(side)}
        others = {role: channel for role, channel in self.channels.items() if role not in every}
        return replace(self, channels=axis | others)

    @property
    def widest(self) -> Record:
        """Record of the axis with the largest motion; a record of one axis is returned itself."""
        if not self.axes:
            return self
        return self.axis(max(self.axes, key=lambda axis: float(np.ptp(self[f"input_{axis}"]))))

    @property
    def moving(self) -> tuple[str, ...]:
        """Axes that move; an axis with hardly any motion compared with the others shows only noise."""
        ranges = {axis: float(np.ptp(self[f"input_{axis}"])) for axis in self.axes}
        return tuple(axis for axis, size in ranges.items() if size > _MAX_STILL_SHARE * max(ranges.values()))

    @property
    def sampling_time(self) -> float:
        """Sampling interval in seconds."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def time_scale(self) -> float:
        """Geometric mean of the sampling interval and the duration, in seconds."""
        return self.sampling_time * float(np.sqrt(len(self)))

    @property
    def duration(self) -> float:
        """Number of samples times sampling interval, in seconds."""
        return self.sampling_time * len(self.time)

    def between(self, start: float, stop: float) -> Record:
        """Return the part with ``start <= time < stop``.

        Parameters
        ----------
        start, stop : float
            Seconds on the record's clock.
        """
        keep = (self.time >= start - 1e-9) & (self.time < stop - 1e-9)
        number = np.cumsum(keep) - 1
        filled = tuple(int(number[sample]) for sample in self.filled if keep[sample])
        values = {role: channel.values[keep] for role, channel in self.channels.items()}
        return self.with_samples(self.time[keep], values, filled)

    def with_samples(
        self, time: np.ndarray, values: Mapping[str, np.ndarray], filled: tuple[int, ...] = ()
    ) -> Record:
        """Return the record with other samples of all channels.

        Parameters
        ----------
        time : ndarray, shape (samples,)
            Clock, in seconds.
        values : mapping of str to ndarray, shape (samples,)
            Values by the role of the channel, in its unit.
        filled : tuple of int
            Numbers of the samples that were interpolated.
        """
        return replace(self.with_values(**values), time=time, filled=filled)

    def with_values(self, **values: np.ndarray) -> Record:
        """Return the record with other values in some channels.

        Parameters
        ----------
        **values : ndarray, shape (samples,)
            Values by the role of the channel, in its unit.
        """
        changed = {
            role: Channel(item, self.channels[role].quantity, self.channels[role].unit)
            for role, item in values.items()
        }
        return replace(self, channels={**self.channels, **changed})


def place_of(sample: int, lines: Sequence[int] | None) -> str:
    """Return the place of a sample for a message: its line in the file, or its number from 1.

    Parameters
    ----------
    sample : int
        Number of the sample, from 0.
    lines : sequence of int, or None
        Line of each sample in the file; None if it has no lines.
    """
    return f"sample {sample + 1}" if lines is None else f"line {lines[sample]}"


def check_record(
    record: Record, may_rest: Collection[str] = (), lines: Sequence[int] | None = None
) -> Record:
    """Return `record` if it can be analysed, else raise with all reasons.

    Parameters
    ----------
    record : Record
        The record.
    may_rest : collection of str
        Roles of channels that may be constant, in addition to the input of one axis, which rests in a hold; of several axes, only
        one needs to move.
    lines : sequence of int, optional
        Line of each sample in the file.

    Raises
    ------
    InputError
        If there are too few samples, a value is not finite or too large, time does not increase or is not even, or a channel
        is constant.
    """
    problems = Problems(record.source or record.name)
    if len(record) < MIN_SAMPLES:
        raise InputError(f"{problems.subject}: {len(record)} samples; at least {MIN_SAMPLES} are needed")
    series = {role: channel.values for role, channel in record.channels.items()}
    with np.errstate(invalid="ignore"):  # values that are not finite are reported separately
        constant = {role for role, values in series.items() if np.ptp(values) == 0}
    all_axes = {role: roles for roles in map(record.roles, SIDES) for role in roles}
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
        elif name not in ("time", "input", *may_rest) and constant.issuperset(all_axes.get(name, (name,))):
            problems.add(name, f"constant ({values[0]:g})", "a channel that does not move cannot be analysed")
    problems.raise_if_any()
    # The clock must increase and be even. Its steps may differ by the rounding of few digits, so samples are compared with
    # an even clock.
    time, steps = record.time, np.diff(record.time)
    step = np.median(steps)
    even = time[0] + record.sampling_time * np.arange(len(time))
    if (steps <= 0).any():
        first = int((steps <= 0).argmax())
        problem = f"time {time[first + 1]:g} s after {time[first]:g} s"
        problems.add(place_of(first + 1, lines), problem, "time must increase")
    elif (np.abs(time - even)[1:] > CLOCK_TOLERANCE * step).any():
        worst = int(np.abs(steps - step).argmax())
        problem = f"step of {steps[worst]:g} s, while the median step is {step:g} s"
        remedy = "records are sampled evenly: resample the recording or cut it before the gap"
        problems.add(place_of(worst + 1, lines), problem, remedy)
    problems.raise_if_any()
    return record


_MOTIONS, _LOADS = ("position", "displacement", "angle", "velocity"), ("force", "moment", "torque")


def use_load_as_input(record: Record) -> Record:
    """Return the record with the load as the input, if its quantities identify the load.

    Parameters
    ----------
    record : Record
        Record of a tissue test or a joint.
    """
    one, other = (record.channels[record.roles(side)[0]] for side in SIDES)
    return swap_input_and_output(record) if one.quantity in _MOTIONS and other.quantity in _LOADS else record


def swap_input_and_output(record: Record) -> Record:
    """Return the record with input and output swapped.

    Parameters
    ----------
    record : Record
        Record with input and output, of one or several axes.
    """
    one, other = map(record.roles, SIDES)
    swapped = zip((*one, *other), (*other, *one), strict=True)
    channels = {role: record.channels[item] for role, item in swapped}
    return replace(record, channels=record.channels | channels)


def require_clock(records: Iterable[Record]) -> None:
    """Raise if records are points of a static test.

    Parameters
    ----------
    records : iterable of Record
        Records of an analysis that needs time.

    Raises
    ------
    InputError
        If there are such records, with their names.
    """
    if points := [record.name for record in records if record.points]:
        raise InputError(
            f"{', '.join(points)}: points of a static test have no clock; only lumbar diagnose reads them, and fits static laws"
        )


def require_one_axis(records: Iterable[Record], what: str) -> None:
    """Raise if records have several axes.

    Parameters
    ----------
    records : iterable of Record
        Records of the analysis.
    what : str
        Name of the analysis, for the message.

    Raises
    ------
    InputError
        If there are such records, with their names.
    """
    if several := [record.name for record in records if record.axes]:
        raise InputError(
            f"{', '.join(several)}: {what} takes records of one axis; compare, locate, diagnose, explore, refine and "
            "export take several"
        )


def require_same_units(records: list[Record]) -> None:
    """Raise unless all records have the same quantity and unit of every channel.

    Parameters
    ----------
    records : list of Record
        At least one record.

    Raises
    ------
    InputError
        If records differ from the first one, with these records and both units.
    """
    problems = Problems("records")
    quantities = [
        {role: f"{channel.quantity} in {channel.unit}" for role, channel in record.channels.items()}
        for record in records
    ]
    for record, present in zip(records[1:], quantities[1:], strict=True):
        if record.axes != records[0].axes:
            one, other = (", ".join(item.axes) or "one axis" for item in (record, records[0]))
            problem = f"{one}, but {other} in {records[0].name}"
            problems.add(record.name, problem, "all records of a set need the same axes")
            continue
        for role in sorted(quantities[0].keys() | present.keys()):
            one, other = present.get(role, "missing"), quantities[0].get(role, "missing")
            if one != other:
                problem = f"{role} is {one}, but {other} in {records[0].name}"
                problems.add(record.name, problem, "all records of a set need the same channels and units")
    problems.raise_if_any()


class RecordSet(Sequence[Record]):
    """Records of one setup, one per excitation.

    Raises
    ------
    InputError
        If two records share a name.
    """

    def __init__(self, records: Iterable[Record]):
        self._records = list(records)
        names = self.names
        if shared := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"records share the name {', '.join(map(repr, shared))}: rename all but one")

    @property
    def names(self) -> list[str]:
        """Names of the records in their order."""
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
        """Return the records with the periods of their excitations.

        Parameters
        ----------
        periods : dict of str to float
            Seconds by the name of a record; the others keep their period.
        """
        self._check_names(periods)
        return RecordSet(
            replace(record, period=periods.get(record.name, record.period)) for record in self._records
        )

    def _check_names(self, names: Iterable[str]) -> None:
        for name in names:
            if name not in self.names:
                raise InputError(f"no record {name!r}; there are {', '.join(self.names)}")

    def rows(self) -> list[dict]:
        """Return a description of each record, for tables."""
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
        lines = [f"  {record.summary}" for record in self]
        return "\n".join([f"{len(self)} record{'s' * (len(self) != 1)}", *lines])

    def _repr_html_(self) -> str:
        import pandas as pd

        return pd.DataFrame(self.rows()).to_html(index=False)
