"""Position over time with what effects need of it: derivatives, path travelled, reversals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from lumbar.records.record import Record

_MOST_KEPT = 8
"""Results that a motion remembers."""
SUBSTEPS = 4
"""Steps between two samples in which a motion that is not smooth is followed."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Evenly sampled position of the tool about the record's zero."""

    time: np.ndarray
    """Shape (samples,): seconds since the record's start: history effects begin afresh in each record."""
    position: np.ndarray
    """Shape (samples,)."""
    sampling_time: float
    """Seconds."""
    smooth: bool = True
    """Whether the position is a smooth signal. A position that went through play is not: its derivatives are taken by
    differences instead of by a spline."""
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    """What else was measured beside input and output, by role, for effects that need it."""
    between: np.ndarray | None = None
    """Shape (1 + (samples - 1) * `SUBSTEPS`,): position in steps between the samples, where it is not smooth but known
    there."""

    @classmethod
    def of(cls, record: Record, role: str = "input", offset: float = 0.0) -> Motion:
        """Motion of one channel of a record, counted from `offset`, with the channels beside input and output."""
        beside = {
            name: channel.values
            for name, channel in record.channels.items()
            if name not in (role, "input", "output")
        }
        time = record.time - record.time[0]
        return cls(time, record[role] - offset, record.sampling_time, channels=beside)

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def _spline(self):
        """Interpolating quintic spline: its second derivative is accurate to the fourth order of the step."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.time, self.position, k=5)

    @cached_property
    def velocity(self) -> np.ndarray:
        """First derivative."""
        if self.smooth:
            return self._spline(self.time, 1)
        return np.gradient(self.position, self.sampling_time)

    @cached_property
    def velocity_between(self) -> np.ndarray:
        """First derivative halfway between samples, shape (samples - 1,); smooth positions only."""
        return self._spline(self.time[:-1] + 0.5 * self.sampling_time, 1)

    @cached_property
    def velocities(self) -> np.ndarray:
        """First derivative at the sample before, halfway and at every sample, shape (3, samples); 0 at the first sample."""
        found = np.zeros((3, len(self)))
        found[:, 1:] = self.velocity[:-1], self.velocity_between, self.velocity[1:]
        return found

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Second derivative."""
        if self.smooth:
            return self._spline(self.time, 2)
        return np.gradient(self.velocity, self.sampling_time)

    def rate_of(self, role: str) -> np.ndarray:
        """First derivative of a further channel, by the same spline as the input's."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.time, self.channels[role], k=5)(self.time, 1)

    @cached_property
    def increments(self) -> np.ndarray:
        """Change of position since the sample before; 0 for the first."""
        return np.diff(self.position, prepend=self.position[0])

    @cached_property
    def path(self) -> np.ndarray:
        """Distance travelled since the record's start."""
        return np.cumsum(np.abs(self.increments))

    @cached_property
    def reversals(self) -> np.ndarray:
        """Indices of the first sample, of every sample at which the direction changes, and of the last one."""
        direction = np.sign(np.diff(self.position))
        moving = np.flatnonzero(direction)
        turned = moving[1:][direction[moving][1:] != direction[moving][:-1]]
        return np.concatenate([[0], turned, [len(self.position) - 1]])

    @cached_property
    def _turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Extreme position at each reversal, and the first sample after it.

        A smooth position turns between two samples: the extreme is the interpolating spline's, by a step of Newton's method
        from the vertex of the parabola through three samples. Ends of the record are no extremes.
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
        # A rest, or a corner, where the spline does not reach beyond the sample, turns at the sample itself.
        rests = (before == at) & (position[np.maximum(inner - 2, 0)] == at)
        beyond = ((extreme - at) * np.sign(2 * at - before - after) > 0) & ~rests
        turns[1:-1] = np.where(beyond, extreme, at)
        samples[1:-1] += beyond & (time > self.time[inner])
        return turns, samples

    @property
    def turns(self) -> np.ndarray:
        """Position at the start, extreme position at each reversal, and position at the end."""
        return self._turning[0]

    @cached_property
    def stretch(self) -> np.ndarray:
        """For every sample the number of the monotone stretch between `turns` it lies in."""
        samples = self._turning[1]
        return np.append(np.repeat(np.arange(len(samples) - 1), np.diff(samples)), len(samples) - 2)

    def remembered(self, name: str, nonlinear: np.ndarray, compute: Callable[[], Any]) -> Any:
        """Result of `compute`, kept for the latest few nonlinear parameters: fits change one at a time."""
        key = name, np.asarray(nonlinear, dtype=float).tobytes()
        kept = self.__dict__.setdefault("_kept", {})
        found = kept.pop(key) if key in kept else compute()
        kept[key] = found
        if len(kept) > _MOST_KEPT:
            del kept[next(iter(kept))]
        return found

    def kept(self, name: str, compute: Callable[[], Any]) -> Any:
        """Result of `compute`, kept as long as the motion: what no parameter changes."""
        lasting = self.__dict__.setdefault("_lasting", {})
        if name not in lasting:
            lasting[name] = compute()
        return lasting[name]

    def delayed(self, delay: float) -> Motion:
        """Motion `delay` seconds ago, at rest at its first position before the record began."""
        past = self.time - delay
        channels = {name: np.interp(past, self.time, values) for name, values in self.channels.items()}
        late = Motion(self.time, self._spline(np.maximum(past, 0.0)), self.sampling_time, channels=channels)
        spline = self._spline

        def delayed_spline(time: np.ndarray, order: int = 0) -> np.ndarray:
            found = spline(np.maximum(time - delay, 0.0), order)
            return np.where(time >= delay, found, 0.0) if order else found

        late.__dict__["_spline"] = delayed_spline
        return late

    def beginning(self, samples: int) -> Motion:
        """The first samples of the motion."""
        channels = {name: values[:samples] for name, values in self.channels.items()}
        between = None if self.between is None else self.between[: 1 + (samples - 1) * SUBSTEPS]
        return replace(
            self,
            time=self.time[:samples],
            position=self.position[:samples],
            channels=channels,
            between=between,
        )

    @cached_property
    def refined(self) -> Motion:
        """The same smooth motion in `SUBSTEPS` steps between two samples, for a position that it becomes behind play."""
        step = self.sampling_time / SUBSTEPS
        time = self.time[0] + step * np.arange(1 + (len(self) - 1) * SUBSTEPS)
        fine = Motion(time, self._spline(time), step)
        fine.__dict__["_spline"] = self._spline
        return fine

    def replaced(self, position: np.ndarray) -> Motion:
        """Motion with a position that is not smooth, on the same clock."""
        return Motion(self.time, position, self.sampling_time, False, self.channels)

    def through(self, moved: Callable[[Motion], np.ndarray]) -> Motion:
        """Motion whose position is what `moved` makes of it and which is not smooth; on the same clock."""
        if not self.smooth:
            return self.replaced(moved(self))
        between = moved(self.refined)
        return replace(self.replaced(between[::SUBSTEPS]), between=between)

    def scale(self, kind: str) -> float:
        """Size of a quantity, for starting values: see `lumbar.tissue.models.parameter.NonlinearParameter`."""
        return {
            "position": lambda: float(np.ptp(self.position) / 2),
            "speed": lambda: float(np.abs(self.velocity).max()),
            "path": lambda: float(self.path[-1]),
            "duration": lambda: float(self.time[-1]),
            "time": lambda: 1.0,
            "sampling": lambda: self.sampling_time,
            "one": lambda: 1.0,
        }[kind]()
