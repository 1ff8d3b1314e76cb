"""A loop whose ticks fall unevenly among the FMU's samples and repeat after several: exact from tick to tick.

Device, forces in flight and model go over into each other by a matrix for each tick; of their product over a period, the
monodromy matrix, the spectral radius decides (S. Bittanti and P. Colaneri, Periodic Systems: Filtering and Control, Springer
2009, chapter 3).
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, cycle
from typing import Self

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, propagation

REACHED = 1e-3
"""Share of a sampling time within which the instant of a sample counts as reached, as in ``tissue_force.h``."""
_NOTHING = 1e-9
"""Share of an interval that is rounding."""
_LONG, _ROWS, _RANK, _WITHIN = 64, 2000, 1e-9, 1e-7
"""From how many values on, and from how many of them, an impulse response is realised by fewer states, to which part of the
largest singular value and of the response."""


def shares(age: float, interval: float, sampling_time: float) -> list[float]:
    """Where on the line from the tick before, 0, to this one, 1, the samples lie that this tick takes; none before the first.

    Parameters
    ----------
    age : float
        Seconds from the instant of the newest sample to the tick before.
    interval : float
        Seconds from that tick to this one.
    """
    count = int((age + interval) / sampling_time + REACHED)
    instants = [sample * sampling_time - age for sample in range(1, count + 1)]
    late = interval - REACHED * sampling_time
    return [instant / interval if instant < late else 1.0 for instant in instants]


States = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Matrices A, B, C and D; shapes (n, n), (n,), (n,) and none."""


def realisation(model: SampledModel) -> States:
    """State space of a model at its own samples, without `delay`: of a long impulse response as few states as it has."""
    numerator, denominator = model.numerator / model.denominator[0], model.denominator / model.denominator[0]
    found = _of_impulses(numerator) if len(denominator) == 1 and len(numerator) > _LONG else None
    if found is not None:
        return found
    order = max(len(numerator), len(denominator)) - 1
    numerator, denominator = (np.pad(part, (0, order + 1 - len(part))) for part in (numerator, denominator))
    states = np.eye(order, k=1)
    states[:, :1] = -denominator[1:, None]
    return states, numerator[1:] - denominator[1:] * numerator[0], np.eye(1, order)[0], float(numerator[0])


def _of_impulses(impulse: np.ndarray) -> States | None:
    """By the singular values of the Hankel matrix; None where few states do not give the response back.

    S. Y. Kung, A new identification and model reduction algorithm via singular value decomposition, Proc. 12th Asilomar
    Conference on Circuits, Systems and Computers (1978) 705–714.
    """
    hankel = np.lib.stride_tricks.sliding_window_view(np.pad(impulse[1:], (0, _LONG)), _LONG)[:_ROWS]
    left, sizes, right = np.linalg.svd(hankel, full_matrices=False)
    root = np.sqrt(sizes[sizes > _RANK * sizes[0]])
    observed = left[:, : len(root)] * root
    states = np.linalg.lstsq(observed[:-1], observed[1:])[0]
    start, given = root * right[: len(root), 0], np.empty(len(impulse) - 1)
    state = start
    for sample in range(len(given)):
        given[sample], state = observed[0] @ state, states @ state
    same = np.abs(given - impulse[1:]).sum() <= _WITHIN * np.abs(impulse).sum()
    return (states, start, observed[0], float(impulse[0])) if same else None


def taken_samples(states: States, forces: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """What a tick that takes so many samples makes of the state before it, and of the positions of the samples.

    The state is that of `PeriodicModel.transitions`; shapes (n, n) and (n, samples).

    Parameters
    ----------
    forces : int
        Of so many of the newest ticks that the state holds.
    """
    a, b, c, d = states
    first = 2 + forces
    kept, by_position = np.eye(first + len(a)), np.zeros((first + len(a), samples))
    kept[3:first, 2:first] = np.eye(forces - 1, forces)
    for sample in range(samples):
        kept[2], by_position[2] = c @ kept[first:], c @ by_position[first:]
        by_position[2, sample] += d
        kept[first:], by_position[first:] = a @ kept[first:], a @ by_position[first:]
        by_position[first:, sample] += b
    return kept, by_position


def acting_forces(interval: float, delay: float, before: Iterable[float]) -> list[tuple[int, float]]:
    """What acts from a tick to the next one: how many ticks old a force is, and for how many seconds; in their order.

    Parameters
    ----------
    delay : float
        Seconds from a tick to its force.
    before : iterable of float
        The intervals before, the newest first, without end.
    """
    found, end, begins = [], interval, delay
    for age, earlier in enumerate(before):
        begin = begins if begins > _NOTHING * interval else 0.0
        if begin < end:
            found.append((age, end - begin))
            end = begin
        if not end:
            break
        begins -= earlier
    return found[::-1]


def tick_transition(
    states: States, device: DeviceSettings, forces: int, acting: list[tuple[int, float]], line: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of one tick what `PeriodicModel.transitions` has of all: from what acts before it and the `shares` of its samples."""
    kept, by_position = taken_samples(states, forces, len(line))
    moved, pushed = np.eye(len(kept)), np.zeros_like(kept)
    for age, seconds in acting:
        transition, by_force = propagation(device, seconds)
        moved[:2], pushed[:2] = transition @ moved[:2], transition @ pushed[:2]
        pushed[:2, 2 + age] -= by_force
    by_readings = by_position @ np.stack([1.0 - line, line], axis=1)
    free = kept @ moved + np.outer(by_readings[:, 1], moved[0])
    free[:, 0] += by_readings[:, 0]
    return free, kept @ pushed + np.outer(by_readings[:, 1], pushed[0]), by_readings


_GAINS, _HALVINGS = np.geomspace(1e-4, 1e4, 241), 40


@dataclass(frozen=True)
class PeriodicModel:
    """A model on a servo whose ticks repeat after several."""

    model: SampledModel
    """At the FMU's own samples, without delay."""
    intervals: tuple[float, ...]
    """Seconds from each tick of a period to the next; their sum is a whole number of samples."""
    age: float = 0.0
    """Seconds from the instant of the newest sample to the first tick."""
    delay: float = 0.0
    """Seconds from a tick to its force."""
    held: bool = False
    """Whether samples between two ticks have the position of the first instead of one on a straight line."""

    def late(self, seconds: float) -> Self:
        """The model with its force later by this time."""
        return replace(self, delay=self.delay + seconds)

    @property
    def name(self) -> str:
        """Of the model."""
        return self.model.name

    @property
    def sampling_time(self) -> float:
        """Mean seconds from tick to tick."""
        return sum(self.intervals) / len(self.intervals)

    def ticks(self) -> Iterator[float]:
        """Intervals one after the other, from a first tick at the instant of a sample on; without end."""
        return chain([self.age] if self.age else [], cycle(self.intervals))

    @cached_property
    def states(self) -> States:
        """State space of the model."""
        return realisation(self.model)

    @property
    def static_stiffness(self) -> float:
        """Of the model."""
        return self.model.static_stiffness

    @cached_property
    def taken(self) -> list[np.ndarray]:
        """`shares` of the samples that are taken at the end of each interval."""
        found, age = [], self.age
        for interval in self.intervals:
            line = np.array(shares(age, interval, self.model.sampling_time))
            found.append(np.floor(line) if self.held else line)
            age += interval - len(found[-1]) * self.model.sampling_time
        return found

    @cached_property
    def acting(self) -> list[list[tuple[int, float]]]:
        """`acting_forces` of each interval."""
        found, before = [], deque(reversed(self.intervals))
        for interval in self.intervals:
            found.append(acting_forces(interval, self.delay, cycle(before)))
            before.rotate(1)
        return found

    def transitions(self, device: DeviceSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transition matrices from each tick to the next.

        Returns
        -------
        free, driven : numpy.ndarray, shape (ticks, n, n)
            At gain 0, and what a gain of 1 adds; of position, velocity, forces of the newest ticks at gain 1 and the model's
            states.
        by_readings : numpy.ndarray, shape (ticks, n, 2)
            What an error of the position that is read at the one and at the other tick adds.
        """
        states, forces = self.states, 1 + max(age for parts in self.acting for age, _ in parts)
        ticks = zip(self.acting, self.taken, strict=True)
        found = [tick_transition(states, device, forces, parts, line) for parts, line in ticks]
        free, driven, by_readings = map(np.array, zip(*found, strict=True))
        return free, driven, by_readings

    def monodromy(self, device: DeviceSettings, gain: float = 1.0) -> np.ndarray:
        """Transition matrix over a period with the model's force times a gain."""
        free, driven, _ = self.transitions(device)
        return product(free + gain * driven)

    def largest_stable_gain(self, device: DeviceSettings) -> tuple[float, float]:
        """Largest factor on the model's force below which the loop is stable for every factor from 0 on.

        Factors are tried 8 % apart, and halved where the first unstable one is found.

        Returns
        -------
        gain : float
            0 for an unstable model, infinite where no gain is too large.
        frequency : float
            At which the loop begins to oscillate there, in Hz.
        """
        free, driven, _ = self.transitions(device)

        drifts = not (device.hand_stiffness_N_m or self.static_stiffness)

        def stable(gain: float) -> bool:
            poles = np.linalg.eigvals(product(free + gain * driven))
            if drifts:  # a stylus that nobody holds stays where it is left
                poles = np.delete(poles, np.abs(poles - 1.0).argmin())
            return bool(np.abs(poles).max() < 1.0)

        unstable = next((index for index, gain in enumerate(_GAINS) if not stable(gain)), None)
        if unstable is None:
            return float("inf"), 0.0
        if unstable == 0:
            return 0.0, 0.0
        low, high = _GAINS[unstable - 1 : unstable + 1]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if stable(middle) else (low, middle)
        return float(low), self._frequency(free + high * driven)

    def _frequency(self, transitions: np.ndarray) -> float:
        """Of the largest pole's motion in Hz."""
        poles, motions = np.linalg.eig(product(transitions))
        largest = np.abs(poles).argmax()
        state, positions = motions[:, largest], []
        for transition in transitions:
            positions.append(state[0])
            state = transition @ state
        ticks, angle = len(positions), float(np.angle(poles[largest]))
        turning = np.abs(np.fft.fft(np.array(positions) * np.exp(-1j * angle * np.arange(ticks) / ticks)))
        # Of the parts of a motion that turns by that angle over a period the strongest.
        angle = (angle + 2.0 * np.pi * turning.argmax()) / ticks
        return float(abs((angle + np.pi) % (2.0 * np.pi) - np.pi) / (2.0 * np.pi * self.sampling_time))

    def response(self, angles: np.ndarray) -> np.ndarray:
        """Forces of the ticks of a period by their positions, both turning by an angle over it; without `delay`.

        Complex, shape (angles, ticks, ticks).
        """
        ticks, newest = len(self.taken), np.cumsum([0, *map(len, self.taken)])
        samples = newest[-1]
        positions = np.zeros((len(angles), samples, ticks), complex)
        for tick, line in enumerate(self.taken):
            taken = slice(newest[tick], newest[tick + 1])
            positions[:, taken, tick] += 1.0 - line
            # The tick after the last is the first, one period later.
            ahead = np.exp(1j * angles * (tick + 1 == ticks))
            positions[:, taken, (tick + 1) % ticks] += line * ahead[:, None]
        # All sines that turn by the angle over a period go through the model one by one.
        turned = np.exp(1j * np.multiply.outer(angles, np.arange(samples + 1) / samples))[:, :, None]
        sines = np.fft.fft(np.roll(positions / turned[:, 1:], 1, axis=1), axis=1)
        given = self.model.response((angles[:, None] + 2.0 * np.pi * np.arange(samples)) / samples)
        forces = np.fft.ifft(given[:, :, None] * sines, axis=1)
        read = newest[:-1]
        return turned[:, read] * forces[:, read % samples]


def product(transitions: np.ndarray) -> np.ndarray:
    """Product of matrices in the order of time; by pairs, which is fast for many."""
    while len(transitions) > 1:
        pairs = transitions[1::2] @ transitions[: len(transitions) - 1 : 2]
        transitions = np.concatenate([pairs, transitions[len(transitions) // 2 * 2 :]])
    return transitions[0]


def in_ticks(model: SampledModel | PeriodicModel) -> PeriodicModel:
    """The model with its ticks; those of one that ticks with its samples are all alike."""
    if isinstance(model, PeriodicModel):
        return model
    return PeriodicModel(replace(model, delay=0.0), (model.sampling_time,), delay=model.delay)
