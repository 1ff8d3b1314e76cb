"""A stylus that nobody holds: m ẍ + b ẋ + F sign(ẋ) + k x = f(t − τ) + f₀, for many stretches and parameters at once.

The commanded force f is held between two ticks and acts late by τ, so that it changes once within every tick. Between two
changes the motion has a closed form, and it comes to rest at most once. The weak spring k of cables and the like is held over
such a piece, at the place that the stylus would pass in its middle.
"""

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


PARAMETERS = ("mass", "damping", "friction", "delay", "offset", "spring")
"""m in kg, b in N·s/m, F in N, τ in s, f₀ in N and k in N/m: rows of every array of parameters."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a search that goes astray turns back
def free_motion(stretches: Stretches, parameters: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Simulate every stretch with every set of parameters: way in m from its first sample, shape (length, stretches, sets).

    Parameters
    ----------
    parameters : numpy.ndarray, shape (6, sets)
        `PARAMETERS`; mass and damping above 0. A friction below 0 drives; the delay may be negative or longer than a tick.
    velocities : numpy.ndarray, shape (stretches, sets)
        At the first sample of each stretch, m/s.
    """
    mass, damping, friction, delay, offset, spring = parameters
    late = np.floor(delay / stretches.step).astype(int)
    split = delay - late * stretches.step
    pieces = [_Piece(mass, damping, friction, seconds) for seconds in (split, stretches.step - split)]
    # What the spring pulls with at the start of a stretch counts as constant.
    constant = offset - spring * stretches.readings[0][:, None]
    way, velocity = np.zeros_like(velocities), np.array(velocities)
    ways = np.empty((stretches.length, *velocities.shape))
    for tick in range(stretches.length):
        ways[tick] = way
        newest = stretches.starts[:, None] + tick - late
        for piece, sample in zip(pieces, (newest - 1, newest), strict=True):
            force = stretches.forces[np.clip(sample, 0, len(stretches.forces) - 1)] + constant
            moved, velocity = piece.moved(velocity, force - spring * (way + 0.5 * piece.seconds * velocity))
            way = way + moved
    return ways


class _Piece:
    """The motion over a time in which the force is held."""

    def __init__(self, mass: np.ndarray, damping: np.ndarray, friction: np.ndarray, seconds: np.ndarray):
        self.damping, self.friction, self.seconds = damping, friction, seconds
        self.relaxation = mass / damping
        self.lost = -np.expm1(-seconds / self.relaxation)

    def moved(self, velocity: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Way and velocity at the end."""
        starting = np.where(np.abs(force) > self.friction, np.sign(force), 0.0)
        direction = np.where(velocity == 0.0, starting, np.sign(velocity))
        final = (force - direction * self.friction) / self.damping
        way = self.relaxation * self.lost * (velocity - final) + final * self.seconds
        after = velocity + (final - velocity) * self.lost
        way[direction == 0.0] = after[direction == 0.0] = 0.0
        turns = (velocity * after < 0.0).nonzero()
        if len(turns[0]):
            way[turns], after[turns] = self._turned(velocity[turns], force[turns], final[turns], turns[1])
        return way, after

    def _turned(self, velocity, force, final, which) -> tuple[np.ndarray, np.ndarray]:
        """The same where the stylus comes to rest within the time: then it sticks, or goes back."""
        relaxation = self.relaxation[which]
        stop = relaxation * np.log1p(-velocity / final)
        rest = self.seconds[which] - stop
        back = np.sign(force) * np.maximum(np.abs(force) - self.friction[which], 0.0) / self.damping[which]
        lost = -np.expm1(-rest / relaxation)
        return final * stop + relaxation * velocity + back * (rest - relaxation * lost), back * lost
