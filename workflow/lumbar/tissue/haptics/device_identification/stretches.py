"""A recording of a haptic device, cut into stretches that each begin anew, and what an encoder's readings are worth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record

MARGIN = 66
"""Samples before the first stretch of a recording: forces of so long ago may still come to act."""
_AFTER = 3
"""Samples after the last one, for forces that stand in a later row."""
_STRETCHES, _FEWEST, _SHORTEST, _MOST_SAMPLES = 40, 12, 32, 200_000
_FEWEST_STEPS = 50
"""Steps of its encoder that the stylus must move over."""
_STEPS_PER_SPEED = 20
"""Steps of the encoder that the stylus passes, root mean square, in the time over which its speed is told."""
_UNITS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}


@dataclass(frozen=True)
class Stretches:
    """Parts of a recording that are simulated each from a start of its own."""

    step: float
    """Seconds from tick to tick."""
    forces: np.ndarray
    """Shape (samples,): commanded, N."""
    positions: np.ndarray
    """Shape (samples,): read, m."""
    starts: np.ndarray
    """Shape (stretches,): samples at which they begin."""
    length: int
    """Samples of each."""

    @property
    def ticks(self) -> np.ndarray:
        """Samples of every stretch, shape (length, stretches)."""
        return np.arange(self.length)[:, None] + self.starts

    @cached_property
    def readings(self) -> np.ndarray:
        """Positions of every stretch, shape (length, stretches)."""
        return self.positions[self.ticks]

    @cached_property
    def runs(self) -> np.ndarray:
        """Number of the run of like readings that each is in, counted through all stretches; shape (length, stretches)."""
        new = np.diff(self.readings, axis=0, prepend=np.inf) != 0.0
        return np.cumsum(new.T).reshape(new.T.shape).T - 1

    @cached_property
    def weights(self) -> np.ndarray:
        """One for each run of like readings, and for each of the runs that come back: of a stylus at rest, or of a motion that
        repeats itself, an encoder tells one thing many times, with one error. Shape (length, stretches).

        Runs are the same where they are as long, of the same reading, and between the same readings.
        """
        lengths = np.bincount(self.runs.T.ravel())
        values = self.readings.T.ravel()[np.cumsum(lengths) - 1]
        around = np.stack([np.roll(values, 1), values, np.roll(values, -1), lengths], axis=1)
        _, which, times = np.unique(around, axis=0, return_inverse=True, return_counts=True)
        return (1.0 / (lengths * times[which.ravel()]))[self.runs]

    @cached_property
    def resolution(self) -> float:
        """Step between the values that the positions take, in m; 0 where they are on no grid."""
        levels = np.unique(self.positions)
        return float(np.median(np.diff(levels))) if 1 < len(levels) < len(self.positions) / 2 else 0.0

    @cached_property
    def velocity(self) -> np.ndarray:
        """At every sample in m/s, by central differences; 0 where the stylus passes no two steps of the encoder.

        Shape (samples,).
        """
        half, last = 1, len(self.positions) - 1
        samples = np.arange(last + 1)
        while True:
            after, before = np.minimum(samples + half, last), np.maximum(samples - half, 0)
            way = self.positions[after] - self.positions[before]
            if np.sqrt(np.mean(way**2)) >= _STEPS_PER_SPEED * self.resolution or 4 * half >= last:
                return np.where(np.abs(way) > 1.5 * self.resolution, way, 0.0) / (2 * half * self.step)
            half *= 2

    def rms(self, values: np.ndarray) -> float:
        """Root mean square over all stretches, of values of shape (samples,)."""
        return float(np.sqrt(np.mean(values[self.ticks] ** 2)))


def cut(recording: Record) -> Stretches:
    """Cut a recording into stretches of equal length, none of which holds a row that was filled in.

    Raises
    ------
    InputError
        A recording of no position and force, too short, too long, or in which nothing moves.
    """
    name, count = recording.source or recording.name, len(recording)
    position, force = (getattr(recording.channels.get(role), "unit", "none") for role in ("input", "output"))
    if position not in _UNITS_M or force != "N":
        units = ", ".join(_UNITS_M)
        raise InputError(
            f"{name}: input in {position}, output in {force}; position in {units} and commanded force in N are needed"
        )
    if count > _MOST_SAMPLES:
        raise InputError(f"{name}: {count} samples; at most {_MOST_SAMPLES} are taken, and 15 s are enough")
    edges = np.unique([0, *recording.filled, count])
    parts = [(first + MARGIN, stop - _AFTER) for first, stop in pairwise(edges)]
    usable = sum(max(stop - first, 0) for first, stop in parts)
    length = max(_SHORTEST, usable // _STRETCHES)
    starts = np.concatenate([np.arange(first, stop - length + 1, length) for first, stop in parts])
    positions = _UNITS_M[position] * recording["input"]
    found = Stretches(recording.sampling_time, recording["output"], positions, starts, length)
    if len(starts) < _FEWEST:
        seconds = (_FEWEST * _SHORTEST + MARGIN + _AFTER) * found.step
        raise InputError(
            f"{name}: {usable} samples can be used, {count} in all; at least {seconds:.2g} s without a gap are needed, and "
            "some 15 s are good"
        )
    if np.ptp(positions) <= _FEWEST_STEPS * found.resolution:
        steps = round(np.ptp(positions) / found.resolution) if found.resolution else 0
        raise InputError(
            f"{name}: the stylus moves over {steps} steps of its encoder ({1e6 * found.resolution:.3g} µm) in all; more than "
            f"{_FEWEST_STEPS} are needed: command forces well above the dry friction"
        )
    return found
