"""Ticks that come early or late, or are left out: the worst timing that is found, and up to which gain there is no worse one.

Instants are taken from a grid. A beam search follows the motions that grow most, whatever interval comes next, and what comes
back to the same place among the samples is a timing that can repeat: a lower bound of how the loop grows at worst (R. Jungers,
The Joint Spectral Radius: Theory and Applications, Springer 2009, section 2.3).
"""

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import repeat
from typing import Self

import numpy as np
import scipy

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.ticks.proof import proved_gain
from lumbar.tissue.haptics.ticks.sequence import (
    REACHED,
    PeriodicModel,
    acting_forces,
    realisation,
    tick_transition,
)

_FEWEST, _MOST = 12, 240
"""Places of a tick between two samples."""
_ROUNDING = 1e-9
_WIDTH, _ALIKE, _STEPS = 48, 3, 160
"""Motions that are followed, as many of them at one place, for so many ticks."""
_LONGEST, _EVERY, _BEST, _ROUNDS, _GAINED = 64, 3, 3, 6, 0.995
"""Ticks after which a timing may repeat; of how many ticks one begins; how many of a search are looked at exactly; how often
it is searched anew, and which part of the gain must be left for that."""
_SLOWER, _SWING_S = 1.001, 0.02
"""Of the measure of motions: as if the loop were calmer by this, and in which time a velocity counts as much as its way."""


def spans(device: DeviceSettings) -> list[tuple[float, float]]:
    """Shortest and longest time from tick to tick in seconds: of those that come, then of those with ticks left out."""
    part = 1e-2 * device.jitter_percent
    periods = [count / device.rate_Hz for count in range(1, device.missed_ticks + 2)]
    return [(period * (1.0 - part), period * (1.0 + part)) for period in periods]


def even(device: DeviceSettings, rate: float) -> DeviceSettings:
    """The device with a servo of a rate in Hz whose ticks are all alike."""
    return replace(device, rate_Hz=rate, jitter_percent=0.0, missed_ticks=0)


def common_places(model: SampledModel, device: DeviceSettings) -> int | None:
    """Places among the samples that ticks without jitter come to; None where they drift over all."""
    ratio = 1.0 / (device.rate_Hz * model.sampling_time)
    near = Fraction(ratio).limit_denominator(_MOST)
    return near.denominator if not device.jitter_percent and abs(near - ratio) < _ROUNDING * ratio else None


def longest_wait(model: SampledModel, device: DeviceSettings) -> float:
    """Longest time in seconds from the instant of a sample to the tick that takes it."""
    places = common_places(model, device)
    return spans(device)[-1][1] - (model.sampling_time / places if places else 0.0)


@dataclass(frozen=True)
class _Grid:
    """Places of ticks among samples, and the intervals that lead from one to another."""

    model: SampledModel
    step: float
    """Seconds."""
    places: int
    intervals: tuple[int, ...]
    """In steps."""
    first: float
    """Age of the newest sample at the first place, in seconds."""

    @classmethod
    def of(cls, model: SampledModel, device: DeviceSettings) -> Self:
        """For the spans of a device: their ends, and what lies evenly between."""
        sampling_time, period = model.sampling_time, 1.0 / device.rate_Hz
        places = common_places(model, device)
        drifts = places is None
        if places is None:
            jitter = max(1e-2 * device.jitter_percent * period / sampling_time, 1.0 / _MOST)
            near = Fraction(period / sampling_time).limit_denominator(_MOST).denominator
            places = near * int(np.ceil(min(max(_FEWEST, 1.0 / jitter), _MOST) / near))
        step = sampling_time / places
        found = set()
        for low, high in spans(device):
            ends = int(np.ceil(low / step - REACHED)), int(np.floor(high / step + REACHED))
            found |= {ends[0], sum(ends) // 2, ends[1]} if ends[0] <= ends[1] else set()
        # Where ticks may drift, just before the next instant is the place where all comes latest.
        first = step - 2.0 * REACHED * sampling_time if drifts else 0.0
        return cls(model, step, places, tuple(sorted(found)), first)

    def timing(self, place: int, intervals: list[int], delay: float, held: bool) -> PeriodicModel:
        """Ticks that repeat, from a place on."""
        seconds = tuple(self.step * interval for interval in intervals)
        return PeriodicModel(self.model, seconds, self.first + place * self.step, delay, held)

    def transitions(self, device: DeviceSettings, delay: float, held: bool) -> tuple[np.ndarray, np.ndarray]:
        """At gain 0 and what a gain of 1 adds, by place and interval; forces in flight as after even ticks."""
        states, period = realisation(self.model), 1.0 / device.rate_Hz
        acting = [acting_forces(self.step * interval, delay, repeat(period)) for interval in self.intervals]
        forces = 1 + max(age for parts in acting for age, _ in parts)
        found = [
            [
                tick_transition(
                    states, device, forces, parts, self.timing(place, [interval], 0.0, held).taken[0]
                )[:2]
                for interval, parts in zip(self.intervals, acting, strict=True)
            ]
            for place in range(self.places)
        ]
        free, driven = np.moveaxis(np.array(found), 2, 0)
        return free, driven

    def even(self, delay: float, held: bool) -> list[PeriodicModel]:
        """Ticks that are alike, from some places on, the last among them."""
        found = []
        for interval in self.intervals:
            places = int(np.gcd(interval, self.places))
            count = self.places // places
            some = range(places - 1, -1, -int(np.ceil(places / _FEWEST)))
            found += [self.timing(place, [interval] * count, delay, held) for place in some]
        return found


@dataclass(frozen=True)
class WorstTiming:
    """What was found of a model on ticks that are uneven."""

    loop: PeriodicModel
    """The model on the ticks whose largest stable gain is lowest."""
    gain: float
    """This gain."""
    tried: int
    """Timings that were looked at."""
    proved: float
    """Gain up to which all timings are proved to be stable."""


def worst_timing(model: SampledModel, device: DeviceSettings, *, held: bool = False) -> WorstTiming:
    """Look for the ticks, among those that a device may have, whose largest stable gain is lowest.

    The model is that at the FMU's own samples, without delay; `held` as of `PeriodicModel`.
    """
    delay, grid = 1e-3 * device.delay_ms, _Grid.of(model, device)
    evens = grid.even(delay, held)
    gains = [loop.largest_stable_gain(device)[0] for loop in evens]
    worst, gain, tried = evens[int(np.argmin(gains))], min(gains), len(evens)
    free, driven = grid.transitions(device, delay, held)
    for _ in range(_ROUNDS):
        if not 0.0 < gain < np.inf:
            break
        cycles = _cycles(free + gain * driven, grid)
        tried += len(cycles)
        loops = [grid.timing(place, intervals, delay, held) for _, place, intervals in cycles[:_BEST]]
        gains = [loop.largest_stable_gain(device)[0] for loop in loops]
        if not gains or min(gains) > _GAINED * gain:
            break
        worst, gain = loops[int(np.argmin(gains))], min(gains)
    proved = 0.0 if held else proved_gain(model, device, longest_wait(model, device), spans(device)[-1][1])
    return WorstTiming(worst, gain, tried, proved)


def _cycles(transitions: np.ndarray, grid: _Grid) -> list[tuple[float, int, list[int]]]:
    """Ticks that repeat on the path of the motion that grows most: growth, first place and intervals; the most growth first."""
    places, choices = _path(transitions, grid)
    found = []
    for begin in range(max(len(choices) - 2 * _LONGEST, 0), len(choices), _EVERY):
        passed = np.eye(transitions.shape[-1])
        for end in range(begin, min(begin + _LONGEST, len(choices))):
            passed = transitions[places[end], choices[end]] @ passed
            if (places[end] + grid.intervals[choices[end]]) % grid.places == places[begin]:
                growth = np.log(np.abs(np.linalg.eigvals(passed)).max()) / (end + 1 - begin)
                intervals = [grid.intervals[choice] for choice in choices[begin : end + 1]]
                found.append((float(growth), places[begin], intervals))
    return sorted(found, reverse=True)


def _path(transitions: np.ndarray, grid: _Grid) -> tuple[list[int], list[int]]:
    """Place before each tick and choice of its interval on the way to the largest motion."""
    size, moves = transitions.shape[-1], np.array(grid.intervals)
    size_of = measure(transitions.mean(axis=(0, 1)), grid.model)
    rng = np.random.default_rng(0)
    motions, at = rng.standard_normal((_WIDTH, size)), rng.integers(0, grid.places, _WIDTH)
    history = []
    for _ in range(_STEPS):
        moved = np.einsum("wcij,wj->wci", transitions[at], motions)
        sizes = np.linalg.norm(moved @ size_of.T, axis=-1)
        reached = (at[:, None] + moves) % grid.places
        kept, crowd = [], np.zeros(grid.places, int)
        for index in np.argsort(-sizes, axis=None):
            place = reached.flat[index]
            if crowd[place] < _ALIKE and len(kept) < _WIDTH:
                crowd[place] += 1
                kept.append(index)
        before, choice = np.unravel_index(kept, sizes.shape)
        history.append((at, before, choice))
        motions, at = moved[before, choice] / sizes.max(), reached[before, choice]
    places, choices, index = [], [], 0
    for at, before, choice in reversed(history):
        choices.append(int(choice[index]))
        index = before[index]
        places.append(int(at[index]))
    return places[::-1], choices[::-1]


def measure(mean: np.ndarray, model: SampledModel) -> np.ndarray:
    """Square root of a Lyapunov function of a mean transition, as if that were calmer: a size for motions of all kinds."""
    stiffness = np.abs(model.numerator).max()
    units = np.r_[stiffness, stiffness * _SWING_S, np.ones(len(mean) - 2)]
    calm = mean / (_SLOWER * np.abs(np.linalg.eigvals(mean)).max())
    scaled = units[:, None] * calm / units
    return np.linalg.cholesky(scipy.linalg.solve_discrete_lyapunov(scaled.T, np.eye(len(mean)))).T * units
