"""Motion: position over time with its derivatives, path and reversals.

`Motion` belongs to one record, `SampledMotion` to a running loop, `JoinedMotions` to several records, and `SpatialMotion` to
several axes. `lumbar.tissue.models.parameter.SIGNALS` defines the symbols of the signals in equations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.records.record import Record
from lumbar.records.rests import find_levels
from lumbar.tissue.models.corner_spline import corner_spline
from lumbar.tissue.models.result_cache import ResultCache

SUBSTEPS = 4
"""Number of steps per sample in which a motion that is not smooth is computed."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Evenly sampled position of the tool about the record's zero."""

    time: np.ndarray
    """Seconds since the record's start, shape (samples,)."""
    position: np.ndarray
    """Position in the channel's unit, shape (samples,)."""
    sampling_time: float
    """Sampling time in seconds."""
    smooth: bool = True
    """True for a smooth signal. A position behind play is not smooth: derivatives are differences, not of a spline."""
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    """Additional measured signals by role, for effects that need them."""
    between: np.ndarray | None = None
    """Position in steps between samples, shape (1 + (samples - 1) * `SUBSTEPS`,), if not smooth but known there."""
    interpolation: Callable[..., np.ndarray] | None = None
    """Function from times and the order of the derivative to the position between samples; None: a spline."""
    cache: ResultCache = field(init=False, repr=False, default_factory=ResultCache)
    """Forces of models on this motion."""

    @classmethod
    def from_record(cls, record: Record, role: str = "input", offset: float = 0.0) -> Motion:
        """Return the motion of one channel of a record, with the additional channels: `SteppedMotion` if it jumps between levels.

        Parameters
        ----------
        record : Record
            Record along one axis.
        role : str, optional
            Role of the channel with the position.
        offset : float, optional
            Position that is subtracted, in the channel's unit.
        """
        others = record.channels.keys() - {role, "input", "output"}
        channels = {name: channel.values for name, channel in record.channels.items() if name in others}
        time = record.time - record.time[0]
        levels = find_levels(record[role])
        kind = SteppedMotion if levels is not None and levels.jumps else cls
        return kind(time, record[role] - offset, record.sampling_time, channels=channels)

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def _spline(self) -> Callable[..., np.ndarray]:
        """Interpolating quintic spline, see `corner_spline`."""
        return self.interpolation or corner_spline(self.time, self.position)

    @cached_property
    def velocity(self) -> np.ndarray:
        """First derivative, shape (samples,)."""
        if self.smooth:
            return self._spline(self.time, 1)
        return np.gradient(self.position, self.sampling_time)

    @cached_property
    def velocities(self) -> np.ndarray:
        """First derivative at the previous sample, halfway and at every sample, shape (3, samples); 0 for the first sample."""
        velocities = np.zeros((3, len(self)))
        before, after = self.velocity[:-1], self.velocity[1:]
        # The parabola through both velocities covers the distance between the samples.
        halfway = 1.5 * self.increments[1:] / self.sampling_time - 0.25 * (before + after)
        velocities[:, 1:] = before, halfway, after
        return velocities

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Second derivative, shape (samples,)."""
        if self.smooth:
            return self._spline(self.time, 2)
        return np.gradient(self.velocity, self.sampling_time)

    @cached_property
    def increments(self) -> np.ndarray:
        """Change of position since the sample before, shape (samples,); 0 for the first."""
        return np.diff(self.position, prepend=self.position[0])

    @cached_property
    def path(self) -> np.ndarray:
        """Distance travelled since the record's start, shape (samples,)."""
        return np.cumsum(np.abs(self.increments))

    @cached_property
    def reversals(self) -> np.ndarray:
        """Indices of the first sample, of every sample at which the direction changes, and of the last; shape (reversals,)."""
        direction = np.sign(np.diff(self.position))
        moving = np.flatnonzero(direction)
        turned = moving[1:][direction[moving][1:] != direction[moving][:-1]]
        return np.concatenate([[0], turned, [len(self.position) - 1]])

    @cached_property
    def _turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Extreme position at each reversal, and the first sample after it.

        A smooth position turns between two samples: the extreme is the interpolating spline's, by a step of Newton's method
        from the vertex of the parabola through three samples. The ends of the record are not extremes.
        """
        samples, position = self.reversals.copy(), self.position
        turns = position[samples]
        inner = samples[1:-1]
        if not self.smooth or not len(inner):
            return turns, samples
        before, at, after = position[inner - 1], position[inner], position[inner + 1]
        vertex = 0.5 * (after - before) / (2 * at - before - after)
        time = self.time[inner] + self.sampling_time * np.clip(vertex, -1.0, 1.0)
        speed, curvature = self._spline(time, 1), self._spline(time, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.nan_to_num(speed / curvature, posinf=0.0, neginf=0.0) / self.sampling_time
        time = time - self.sampling_time * np.clip(step, -0.5, 0.5)
        extreme = self._spline(time)
        # A rest, or a corner at which the spline does not exceed the sample, turns at the sample itself.
        is_rest = (before == at) & (position[np.maximum(inner - 2, 0)] == at)
        is_extreme = ((extreme - at) * np.sign(2 * at - before - after) > 0) & ~is_rest
        turns[1:-1] = np.where(is_extreme, extreme, at)
        samples[1:-1] += is_extreme & (time > self.time[inner])
        return turns, samples

    @property
    def turns(self) -> np.ndarray:
        """Position at the start, extreme position at each reversal, and position at the end; shape (reversals,)."""
        return self._turning[0]

    @cached_property
    def interval(self) -> np.ndarray:
        """Number of the monotone interval (between two `turns`) of every sample; shape (samples,)."""
        samples = self._turning[1]
        return np.append(np.repeat(np.arange(len(samples) - 1), np.diff(samples)), len(samples) - 2)

    def delayed(self, delay: float) -> Motion:
        """Return the motion delayed by some time; before the record it rests at its first position.

        Parameters
        ----------
        delay : float
            Seconds, at least 0.
        """

        def interpolate(time: np.ndarray, order: int = 0) -> np.ndarray:
            values = self._spline(np.maximum(time - delay, 0.0), order)
            return np.where(time >= delay, values, 0.0) if order else values

        past = self.time - delay
        channels = {name: np.interp(past, self.time, values) for name, values in self.channels.items()}
        position, step = interpolate(self.time), self.sampling_time
        return Motion(self.time, position, step, channels=channels, interpolation=interpolate)

    def beginning(self, samples: int) -> Motion:
        """Return the first samples of the motion.

        Parameters
        ----------
        samples : int
            Number of samples.
        """
        channels = {name: values[:samples] for name, values in self.channels.items()}
        between = None if self.between is None else self.between[: 1 + (samples - 1) * SUBSTEPS]
        time, position = self.time[:samples], self.position[:samples]
        return type(self)(time, position, self.sampling_time, self.smooth, channels, between)

    @cached_property
    def finer(self) -> Motion:
        """The motion in `SUBSTEPS` steps between two samples, for the position behind play."""
        step = self.sampling_time / SUBSTEPS
        time = self.time[0] + step * np.arange(1 + (len(self) - 1) * SUBSTEPS)
        return Motion(time, self._spline(time), step, interpolation=self._spline)

    def replace_position(self, position: np.ndarray, between: np.ndarray | None = None) -> Motion:
        """Return the motion with a position that is not smooth.

        Parameters
        ----------
        position : numpy.ndarray, shape (samples,)
            Position in the unit of the motion.
        between : numpy.ndarray, shape (1 + (samples - 1) * SUBSTEPS,), optional
            Position in steps between the samples.
        """
        return type(self)(self.time, position, self.sampling_time, False, self.channels, between)

    def through(self, operator: Callable[[Motion], np.ndarray]) -> Motion:
        """Return the motion with a position that is not smooth, computed by an operator.

        Parameters
        ----------
        operator : callable
            Function from a motion to the position, shape (samples,), in the unit of the motion.
        """
        if not self.smooth:
            return self.replace_position(operator(self))
        between = operator(self.finer)
        return self.replace_position(between[::SUBSTEPS], between)

    def scale(self, kind: str) -> float:
        """Return the size of a quantity for starting values, in the motion's units; 1 for a quantity that is 0 in a rest.

        Parameters
        ----------
        kind : str
            Quantity, see `lumbar.tissue.models.parameter.NonlinearParameter`; ``force`` is not available.
        """
        size = {
            "position": lambda: float(np.ptp(self.position) / 2),
            "speed": lambda: float(np.abs(self.velocity).max()),
            "path": lambda: float(self.path[-1]),
            "duration": lambda: float(self.time[-1]),
            "time": lambda: self.sampling_time * np.sqrt(len(self)),
            "rate": lambda: 1.0 / self.scale("time"),
            "sampling": lambda: self.sampling_time,
            "one": lambda: 1.0,
        }[kind]()
        return size or 1.0


@dataclass(frozen=True, eq=False)
class SampledMotion(Motion):
    """Motion with backward differences as derivatives, both 0 at the first sample.

    The velocity of a smooth motion is late by half a sample, its acceleration by one sample.
    """

    smooth: bool = False

    @classmethod
    def from_positions(cls, position: np.ndarray, sampling_time: float) -> SampledMotion:
        """Return the motion through some positions from time 0.

        Parameters
        ----------
        position : numpy.ndarray, shape (samples,)
            Position in any unit.
        sampling_time : float
            Seconds.
        """
        return cls(np.arange(len(position)) * sampling_time, position, sampling_time)

    @cached_property
    def velocity(self) -> np.ndarray:
        """Backward difference of the position, shape (samples,)."""
        return self.increments / self.sampling_time

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Backward difference of the velocity, shape (samples,)."""
        return np.diff(self.velocity, prepend=0.0) / self.sampling_time

    def delayed(self, delay: float) -> Self:
        """Return the motion delayed by some time, linear between samples and at rest before the first sample.

        Parameters
        ----------
        delay : float
            Seconds, at least 0.
        """
        whole, fraction = divmod(delay / self.sampling_time, 1.0)
        index = np.arange(len(self)) - int(whole)
        newer, older = self.position[np.maximum(index, 0)], self.position[np.maximum(index - 1, 0)]
        return type(self)(self.time, newer + fraction * (older - newer), self.sampling_time)


@dataclass(frozen=True, eq=False)
class SteppedMotion(SampledMotion):
    """Motion that jumps between levels, linear between samples; a spline would move before a jump.

    The velocity is the smaller of the slopes to both neighbours: 0 at rest and at an extreme, also next to a jump.
    """

    @cached_property
    def velocity(self) -> np.ndarray:
        """Smaller of the slopes to both neighbours, 0 if their signs differ; shape (samples,)."""
        before = self.increments / self.sampling_time
        after = np.append(before[1:], 0.0)
        slope = np.minimum(np.abs(before), np.abs(after))
        return np.where(before * after > 0, np.copysign(slope, before), 0.0)

    def scale(self, kind: str) -> float:
        """Return the size of a quantity for starting values; the speed is that of the largest jump in one sample."""
        return (
            float(np.abs(self.increments).max()) / self.sampling_time
            if kind == "speed"
            else super().scale(kind)
        )


def _joined(name: str) -> cached_property[np.ndarray]:
    return cached_property(lambda self: np.concatenate([getattr(part, name) for part in self.parts]))


@dataclass(frozen=True, eq=False)
class JoinedMotions:
    """Motions one after the other, each with its own clock, path and cache."""

    parts: tuple[Motion, ...]
    """Motions with equal sampling times."""

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    @property
    def sampling_time(self) -> float:
        """Sampling time in seconds."""
        return self.parts[0].sampling_time

    # Signals of the records, one after the other: seconds since the start of each record, position and its derivatives.
    time = _joined("time")
    position = _joined("position")
    velocity = _joined("velocity")
    acceleration = _joined("acceleration")

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """Additional channels that all records have, each of shape (samples,)."""
        first, *others = (part.channels for part in self.parts)
        common = [name for name in first if all(name in other for other in others)]
        return {name: np.concatenate([part.channels[name] for part in self.parts]) for name in common}

    def scale(self, kind: str) -> float:
        """Return the largest size of a quantity in any of the records, in the motions' units.

        Parameters
        ----------
        kind : str
            Quantity, as in `Motion.scale`.
        """
        return max(part.scale(kind) for part in self.parts)

    def split(self, signal: np.ndarray) -> list[np.ndarray]:
        """Split a signal over all samples into one signal per record.

        Parameters
        ----------
        signal : numpy.ndarray, shape (samples, ...)
            Signal in any unit, one record after the other.
        """
        return np.split(signal, np.cumsum([len(part) for part in self.parts])[:-1])


@dataclass(frozen=True, eq=False)
class SpatialMotion(JoinedMotions):
    """Motions along several axes at the same instants; signals are concatenated axis by axis."""

    names: tuple[str, ...] = ()
    """Names of the axes, from `AXES`."""
    cache: ResultCache = field(init=False, repr=False, default_factory=ResultCache)
    """Forces of models on this motion."""

    @classmethod
    def from_record(cls, record: Record, rests: Sequence[float] = ()) -> Self:
        """Return the motion of a record of several axes.

        Parameters
        ----------
        record : Record
            Record along several axes.
        rests : sequence of float, optional
            Position that is subtracted along every axis, in the input's unit; by default positions are as recorded.
        """
        along = zip(record.axes, rests or [0.0] * len(record.axes), strict=True)
        parts = tuple(Motion.from_record(record.axis(axis), offset=rest) for axis, rest in along)
        return cls(parts, names=record.axes)

    time = cached_property(lambda self: self.parts[0].time)

    def along(self, axis: str) -> Motion:
        """Return the motion along one axis.

        Parameters
        ----------
        axis : str
            Name of the axis, one of `names`.
        """
        return self.parts[self.names.index(axis)]

    def each(self, change: Callable[[Motion], Motion]) -> Self:
        """Return the motion with a function applied to every axis.

        Parameters
        ----------
        change : callable
            Function from the motion along one axis to another motion with the same number of samples.
        """
        return type(self)(tuple(map(change, self.parts)), self.names)

    @cached_property
    def increments(self) -> np.ndarray:
        """Length of the path since the sample before, shape (samples,); 0 for the first."""
        return np.sqrt(sum(part.increments**2 for part in self.parts))

    @cached_property
    def path(self) -> np.ndarray:
        """Distance travelled since the record's start, shape (samples,)."""
        return np.cumsum(self.increments)

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """Positions along the axes, as channels for signals along one axis; each of shape (samples,)."""
        return {f"axis {name}": part.position for name, part in zip(self.names, self.parts, strict=True)}

    def delayed(self, delay: float) -> Self:
        """Return the motion delayed by some time; before the record it rests at its first position.

        Parameters
        ----------
        delay : float
            Seconds, at least 0.
        """
        return self.each(lambda part: part.delayed(delay))

    def scale(self, kind: str) -> float:
        """Return the size of a quantity: of speed and path in space, of a position along the axis with the largest range.

        Parameters
        ----------
        kind : str
            Quantity, as in `Motion.scale`.
        """
        if kind == "path":
            return float(self.path[-1])
        if kind == "speed":
            return float(np.sqrt(sum(part.velocity**2 for part in self.parts)).max())
        return super().scale(kind)


def along_axes(motion: Motion | JoinedMotions) -> list[Motion | JoinedMotions]:
    """Return one motion per axis, of a motion in space or of joined ones; a motion along one axis is returned in a list.

    Parameters
    ----------
    motion : Motion or JoinedMotions
        Motion of one record or several, along one axis or several.
    """
    if isinstance(motion, SpatialMotion):
        return list(motion.parts)
    parts: tuple = getattr(motion, "parts", ())
    if parts and isinstance(parts[0], SpatialMotion):
        return [part for one in parts for part in along_axes(one)]
    return [motion]


OneMotion = Motion | SpatialMotion
"""Motion of one record, along one axis or several."""
AnyMotion = Motion | JoinedMotions
"""Motion of one record or several."""
