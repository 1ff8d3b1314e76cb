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


@dataclass(frozen=True, eq=False)
class Motion:
    """Evenly sampled position of the tool about the record's zero.

    Attributes
    ----------
    time : numpy.ndarray, shape (samples,)
        Seconds since the record's start: history effects begin afresh in each record.
    position : numpy.ndarray, shape (samples,)
    sampling_time : float
        Seconds.
    smooth : bool
        Whether the position is a smooth signal. A position that went through play is not: its derivatives are
        taken by differences instead of by a spline.
    channels : dict of str to numpy.ndarray
        What else was measured beside input and output, by role, for effects that need it.
    """

    time: np.ndarray
    position: np.ndarray
    sampling_time: float
    smooth: bool = True
    channels: dict[str, np.ndarray] = field(default_factory=dict)

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
    def stretch(self) -> np.ndarray:
        """For every sample the number of the monotone stretch between reversals it lies in."""
        return np.append(
            np.repeat(np.arange(len(self.reversals) - 1), np.diff(self.reversals)), len(self.reversals) - 2
        )

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
        began = past >= 0
        channels = {name: np.interp(past, self.time, values) for name, values in self.channels.items()}
        late = Motion(self.time, self._spline(np.maximum(past, 0.0)), self.sampling_time, channels=channels)
        # Derivatives of this motion's own spline, put where the delayed motion would compute its own.
        between = past[:-1] + 0.5 * self.sampling_time
        late.__dict__["velocity"] = np.where(began, self._spline(np.maximum(past, 0.0), 1), 0.0)
        late.__dict__["velocity_between"] = np.where(
            between >= 0, self._spline(np.maximum(between, 0.0), 1), 0.0
        )
        return late

    def beginning(self, samples: int) -> Motion:
        """The first samples of the motion."""
        channels = {name: values[:samples] for name, values in self.channels.items()}
        return replace(self, time=self.time[:samples], position=self.position[:samples], channels=channels)

    def replaced(self, position: np.ndarray) -> Motion:
        """Motion with a position that is not smooth, on the same clock."""
        return Motion(self.time, position, self.sampling_time, False, self.channels)

    def scale(self, kind: str) -> float:
        """Size of a quantity, for starting values: see `lumbar.models.parameter.NonlinearParameter`."""
        return {
            "position": lambda: float(np.ptp(self.position) / 2),
            "speed": lambda: float(np.abs(self.velocity).max()),
            "path": lambda: float(self.path[-1]),
            "duration": lambda: float(self.time[-1]),
            "time": lambda: 1.0,
            "sampling": lambda: self.sampling_time,
            "one": lambda: 1.0,
        }[kind]()
