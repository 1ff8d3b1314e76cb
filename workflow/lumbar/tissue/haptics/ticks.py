"""A model on a servo of any rate, exact from tick to tick, and the damping that a passive device needs.

If ticks are not at the samples but repeat after several, a transition matrix for each tick maps position, velocity, pending
forces and the model's states to the next tick. The spectral radius of their product over a period, the monodromy matrix,
decides on stability (S. Bittanti and P. Colaneri, Periodic Systems: Filtering and Control, Springer 2009, chapter 3).

J. E. Colgate and G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, Journal
of Robotic Systems 14 (1997) 37–47: a device with damping b behind a hold of the force of H(z) is passive if and only if

    b > T/2 · 1/(1 − cos ωT) · Re{(1 − exp(−jωT)) H(exp(jωT))}   for 0 ≤ ω ≤ π/T.

If forces are late, or ticks repeat only after several, the condition concerns all pieces of a period in which one force acts.
While the device moves by u within s seconds the force f receives f u, and a damping b at least b u²/s (Cauchy and Schwarz).
With f = F(exp(jθ)) u over the pieces no energy is released in the long run, whatever the hand does, if and only if
F + Fᴴ + 2b diag(1/s) ≥ 0 for every θ; with one piece this is the condition above.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import chain, cycle

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, StableGain, all_angles, propagation
from lumbar.tissue.models.transfer_function import filtered

REACHED = 1e-3
"""A sample's instant counts as reached within this share of the sampling time, as in ``tissue_force.h``."""
LONGEST_GAP_S = 0.25
"""Longest allowed gap between ticks in seconds: ``longest_gap`` of ``tissue_force.h``."""
_MAX_TICKS, _PHASES = 256, 8
"""Largest number of ticks in a period of ticks and samples, and number of tested phases. Other rates are judged at the nearest
rate with such a period, at each phase of the first tick, because a drifting clock reaches all phases."""
_ROUNDING = 1e-9
_MIN_LONG_VALUES, _HANKEL_ROWS, _NEGLIGIBLE_SINGULAR_VALUE, _MAX_ERROR = 64, 2000, 1e-9, 1e-7
"""Realisation of a long impulse response by few states: fewest values, rows of the Hankel matrix, smallest singular value as a
share of the largest, largest error as a share of the response."""
_GAINS, _HALVINGS = np.geomspace(1e-4, 1e4, 241), 40
_REFINED_ANGLES, _MIN_ANGLES = 101, 12
_ANGLES_NEAR_POLE = np.sinh(np.linspace(-4.0, 4.0, 33))
"""Angles near a pole, in multiples of its distance to the unit circle."""


def shares(age: float, interval: float, sampling_time: float) -> list[float]:
    """Return the instants of a tick's samples as shares of the interval from the previous tick (0) to this tick (1).

    `age` is the time in seconds from the newest sample to the previous tick, `interval` the time from tick to tick.
    """
    count = int((age + interval) / sampling_time + REACHED)
    instants = [sample * sampling_time - age for sample in range(1, count + 1)]
    late = interval - REACHED * sampling_time
    return [instant / interval if instant < late else 1.0 for instant in instants]


@dataclass(frozen=True)
class Realisation:
    """State space of a model at its own samples."""

    a: np.ndarray
    """State matrix, shape (states, states)."""
    b: np.ndarray
    """Input vector, shape (states,)."""
    c: np.ndarray
    """Output vector, shape (states,)."""
    d: float


def realisation(model: SampledModel) -> Realisation:
    """Return a state space of a model without its `delay`; a long impulse response gets few states if possible."""
    numerator, denominator = model.numerator / model.denominator[0], model.denominator / model.denominator[0]
    if len(denominator) == 1 and len(numerator) > _MIN_LONG_VALUES and (few := _reduce(numerator)):
        return few
    order = max(len(numerator), len(denominator)) - 1
    numerator, denominator = (np.pad(part, (0, order + 1 - len(part))) for part in (numerator, denominator))
    states = np.eye(order, k=1)
    states[:, :1] = -denominator[1:, None]
    by_input = numerator[1:] - denominator[1:] * numerator[0]
    return Realisation(states, by_input, np.eye(1, order)[0], float(numerator[0]))


def _reduce(impulse: np.ndarray) -> Realisation | None:
    """Realise an impulse response by the singular values of its Hankel matrix; None if it cannot be reproduced with few states.

    S. Y. Kung, A new identification and model reduction algorithm via singular value decomposition, Proc. 12th Asilomar
    Conference on Circuits, Systems and Computers (1978) 705–714.
    """
    hankel = np.lib.stride_tricks.sliding_window_view(
        np.pad(impulse[1:], (0, _MIN_LONG_VALUES)), _MIN_LONG_VALUES
    )[:_HANKEL_ROWS]
    left, sizes, right = np.linalg.svd(hankel, full_matrices=False)
    root = np.sqrt(sizes[sizes > _NEGLIGIBLE_SINGULAR_VALUE * sizes[0]])
    observed = left[:, : len(root)] * root
    states = np.linalg.lstsq(observed[:-1], observed[1:])[0]
    start, response = root * right[: len(root), 0], np.empty(len(impulse) - 1)
    state = start
    for sample in range(len(response)):
        response[sample], state = observed[0] @ state, states @ state
    is_equal = np.abs(response - impulse[1:]).sum() <= _MAX_ERROR * np.abs(impulse).sum()
    return Realisation(states, start, observed[0], float(impulse[0])) if is_equal else None


@dataclass(frozen=True)
class Transitions:
    """Transition matrices of a loop from each tick of a period to the next.

    The state is position, velocity, forces of the newest ticks at gain 1, and the model's states.
    """

    free: np.ndarray
    """Transition matrices at gain 0, shape (ticks, n, n)."""
    driven: np.ndarray
    """Change of the transition matrices by a gain of 1, shape (ticks, n, n)."""
    by_readings: np.ndarray
    """Change of the state by an error of the position read at the first and at the second tick, shape (ticks, n, 2)."""
    has_free_position: bool
    """True if neither hand nor model holds the stylus at a position, so that a pole at 1 is not an instability."""

    def radius(self, gain: float = 1.0) -> float:
        """Return the largest magnitude of a pole over a period, with a gain on the model's force; stable below 1."""
        poles = np.linalg.eigvals(product(self.free + gain * self.driven))
        if self.has_free_position:
            poles = np.delete(poles, np.abs(poles - 1.0).argmin())
        return float(np.abs(poles).max())


@dataclass(frozen=True)
class PeriodicModel:
    """A model on a servo with a periodic pattern of ticks among the samples."""

    model: SampledModel
    """The model at the FMU's samples, without delay."""
    intervals: tuple[float, ...]
    """Seconds from each tick of a period to the next; the period is a whole number of samples."""
    age: float = 0.0
    """Seconds from the instant of the newest sample to the first tick."""
    delay: float = 0.0
    """Seconds from a tick to its force."""
    held: bool = False
    """True if samples between two ticks have the first tick's position, false if positions are interpolated."""

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model.name

    @property
    def sampling_time(self) -> float:
        """Mean seconds from tick to tick."""
        return sum(self.intervals) / len(self.intervals)

    def ticks(self) -> Iterator[float]:
        """Return intervals without end; the first tick is at the instant of a sample."""
        return chain([self.age] if self.age else [], cycle(self.intervals))

    @cached_property
    def states(self) -> Realisation:
        """State space of the model."""
        return realisation(self.model)

    @cached_property
    def samples(self) -> list[np.ndarray]:
        """Instants of the samples within each interval, see `shares`."""
        samples, age = [], self.age
        for interval in self.intervals:
            line = np.array(shares(age, interval, self.model.sampling_time))
            samples.append(np.floor(line) if self.held else line)
            age += interval - len(line) * self.model.sampling_time
        return samples

    @cached_property
    def acting(self) -> list[list[tuple[int, float]]]:
        """Forces that act during each interval, in order: age in ticks and duration in seconds."""
        acting, before = [], deque(reversed(self.intervals))
        for interval in self.intervals:
            parts, end, begins = [], interval, self.delay
            for age, earlier in enumerate(cycle(before)):
                begin = begins if begins > _ROUNDING * interval else 0.0
                if begin < end:
                    parts.append((age, end - begin))
                    end = begin
                if not end:
                    break
                begins -= earlier
            acting.append(parts[::-1])
            before.rotate(1)
        return acting

    def transitions(self, device: DeviceSettings) -> Transitions:
        """Return the transition matrices of the loop with device and hand."""
        model, forces = self.states, 1 + max(age for parts in self.acting for age, _ in parts)
        first, size = 2 + forces, 2 + forces + len(self.states.a)
        free, driven, readings = [], [], []
        for acting, line in zip(self.acting, self.samples, strict=True):
            # A tick maps the state before it, and the positions of its samples, to the state after it.
            kept, by_position = np.eye(size), np.zeros((size, len(line)))
            kept[3:first, 2:first] = np.eye(forces - 1, forces)
            for sample in range(len(line)):
                kept[2], by_position[2] = model.c @ kept[first:], model.c @ by_position[first:]
                by_position[2, sample] += model.d
                kept[first:], by_position[first:] = model.a @ kept[first:], model.a @ by_position[first:]
                by_position[first:, sample] += model.b
            # Move device and hand through the pieces of the interval, in each of which one force acts.
            moved, pushed = np.eye(size), np.zeros((size, size))
            for age, seconds in acting:
                transition, by_force = propagation(device, seconds)
                moved[:2], pushed[:2] = transition @ moved[:2], transition @ pushed[:2]
                pushed[:2, 2 + age] -= by_force
            # The samples' positions are on the straight line between the readings at both ticks.
            by_readings = by_position @ np.stack([1.0 - line, line], axis=1)
            free.append(kept @ moved + np.outer(by_readings[:, 1], moved[0]))
            free[-1][:, 0] += by_readings[:, 0]
            driven.append(kept @ pushed + np.outer(by_readings[:, 1], pushed[0]))
            readings.append(by_readings)
        has_free_position = not (device.hand_stiffness_N_m or self.model.static_stiffness)
        return Transitions(np.array(free), np.array(driven), np.array(readings), has_free_position)

    def largest_stable_gain(self, device: DeviceSettings) -> StableGain:
        """Return the largest stable gain: try factors 8 % apart, and halve the interval below the first unstable one."""
        loop = self.transitions(device)
        unstable = next((index for index, gain in enumerate(_GAINS) if not loop.radius(gain) < 1.0), None)
        if unstable is None:
            return StableGain(float("inf"), 0.0)
        if unstable == 0:
            return StableGain(0.0, 0.0)
        low, high = _GAINS[unstable - 1 : unstable + 1]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if loop.radius(middle) < 1.0 else (low, middle)
        return StableGain(float(low), self._frequency(loop.free + high * loop.driven))

    def _frequency(self, transitions: np.ndarray) -> float:
        """Return the frequency in Hz of the largest pole's motion."""
        poles, motions = np.linalg.eig(product(transitions))
        largest = np.abs(poles).argmax()
        state, positions = motions[:, largest], []
        for transition in transitions:
            positions.append(state[0])
            state = transition @ state
        ticks, angle = len(positions), float(np.angle(poles[largest]))
        turning = np.abs(np.fft.fft(np.array(positions) * np.exp(-1j * angle * np.arange(ticks) / ticks)))
        # The motion turns by that angle over a period: take its strongest component.
        angle = (angle + 2.0 * np.pi * turning.argmax()) / ticks
        return float(abs((angle + np.pi) % (2.0 * np.pi) - np.pi) / (2.0 * np.pi * self.sampling_time))

    def response(self, angles: np.ndarray) -> np.ndarray:
        """Return the matrix from a period's positions to its forces, without `delay`, at angles of rotation per period.

        Complex, shape (angles, ticks, ticks).
        """
        ticks, newest = len(self.samples), np.cumsum([0, *map(len, self.samples)])
        samples = newest[-1]
        positions = np.zeros((len(angles), samples, ticks), complex)
        for tick, line in enumerate(self.samples):
            new = slice(newest[tick], newest[tick + 1])
            positions[:, new, tick] += 1.0 - line
            # The tick after the last is the first, one period later.
            ahead = np.exp(1j * angles * (tick + 1 == ticks))
            positions[:, new, (tick + 1) % ticks] += line * ahead[:, None]
        # All sines that turn by the angle over a period go through the model one by one.
        turned = np.exp(1j * np.multiply.outer(angles, np.arange(samples + 1) / samples))[:, :, None]
        sines = np.fft.fft(np.roll(positions / turned[:, 1:], 1, axis=1), axis=1)
        gains = self.model.response((angles[:, None] + 2.0 * np.pi * np.arange(samples)) / samples)
        forces = np.fft.ifft(gains[:, :, None] * sines, axis=1)
        read = newest[:-1]
        return turned[:, read] * forces[:, read % samples]


def product(transitions: np.ndarray) -> np.ndarray:
    """Return the product of matrices in the order of time, computed by pairs."""
    while len(transitions) > 1:
        pairs = transitions[1::2] @ transitions[: len(transitions) - 1 : 2]
        transitions = np.concatenate([pairs, transitions[len(transitions) // 2 * 2 :]])
    return transitions[0]


def to_periodic(model: SampledModel | PeriodicModel) -> PeriodicModel:
    """Return a model as a periodic one, with a tick at each sample."""
    if isinstance(model, PeriodicModel):
        return model
    return PeriodicModel(replace(model, delay=0.0), (model.sampling_time,), delay=model.delay)


def servo_loops(
    model: SampledModel, device: DeviceSettings, *, held: bool = False
) -> tuple[SampledModel | PeriodicModel, ...]:
    """Return a model that samples by its own clock at the ticks of a device's servo, with the forces' delay.

    With `held` a sample has the position of the previous tick, as with a client of FMI 2.0. The result is one model from sample
    to sample if the servo is faster by a whole factor, from tick to tick if it is slower by a whole factor, and periodic if
    neither rate is a multiple of the other; several periodic models if ticks do not repeat within `_MAX_TICKS`.

    Raises
    ------
    InputError
        If the loader rejects the gap between two ticks.
    """
    if 1.0 / device.rate_Hz > LONGEST_GAP_S:
        raise InputError(
            f"runtime.device: at {device.rate_Hz:g} Hz ticks are {1.0 / device.rate_Hz:.3g} s apart; the loaders reject more "
            f"than {LONGEST_GAP_S:g} s: use a faster servo"
        )
    seconds, wanted = 1e-3 * device.delay_ms, 1.0 / (device.rate_Hz * model.sampling_time)
    ratio = Fraction(wanted).limit_denominator(_MAX_TICKS)
    intervals = (float(ratio) * model.sampling_time,) * ratio.denominator
    if abs(ratio - wanted) > _ROUNDING * wanted:
        # The last place is just before the next instant.
        places = np.linspace(0.0, 1.0 - 2.0 * REACHED, _PHASES) * model.sampling_time / ratio.denominator
        return tuple(PeriodicModel(model, intervals, float(place), seconds, held) for place in places)
    if ratio.numerator == 1:
        return (model.late(seconds),)
    if ratio.denominator == 1:
        return (decimate_to_ticks(model, ratio.numerator, held).late(seconds),)
    return (PeriodicModel(model, intervals, delay=seconds, held=held),)


def decimate_to_ticks(model: SampledModel, samples: int, held: bool) -> SampledModel:
    """Return a model from tick to tick, with ticks a whole number of samples apart.

    A filter interpolates the positions between the ticks, and only the forces at the ticks remain (P. P. Vaidyanathan,
    Multirate Systems and Filter Banks (1993), section 4.2).
    """
    late, first = (np.ones(samples), 0) if held else (np.bartlett(2 * samples + 1)[1:-1], samples - 1)
    poles = np.roots(model.denominator) ** samples
    denominator = np.real(np.atleast_1d(np.poly(poles)))
    # Behind the filter each pole adds samples - 1 powers of 1/z to the numerator, before decimation.
    order = (len(model.numerator) - 1 + (samples - 1) * (len(poles) + 1)) // samples
    impulse = np.zeros(order * samples + 1 + first)
    impulse[: len(late)] = late[: len(impulse)]
    forces = filtered(model.numerator, model.denominator, impulse)[first::samples]
    return SampledModel(
        model.name,
        np.convolve(denominator, forces)[: order + 1],
        denominator,
        samples * model.sampling_time,
        model.delay,
    )


def damping_at(model: SampledModel | PeriodicModel, angles: np.ndarray) -> np.ndarray:
    """Return the damping in N·s/m that the condition requires at every angle θ in (0, π] over a period; shape (angles,)."""
    moves, seconds = force_by_moves(model, angles)
    weighted = np.sqrt(np.outer(seconds, seconds)) * (moves + moves.conj().swapaxes(1, 2))
    return -np.linalg.eigvalsh(weighted)[:, 0] / 2.0


def force_by_moves(model: SampledModel | PeriodicModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return F at every angle, (angles, pieces, pieces), and the duration in s of the pieces of a period, with one force each."""
    model = to_periodic(model)
    ticks = len(model.intervals)
    pieces = [(tick, age, seconds) for tick, parts in enumerate(model.acting) for age, seconds in parts]
    tick, age, seconds = (np.array(values) for values in zip(*pieces, strict=True))
    ahead = np.exp(1j * angles)[:, None, None]
    periods, shown = np.divmod(tick - age, ticks)
    forces = model.response(angles)[:, shown] * ahead ** periods[:, None]
    # The position of a tick is the sum of all moves before it.
    return forces @ ((tick < np.arange(ticks)[:, None]) + 1.0 / (ahead - 1.0)), seconds


def required_damping(model: SampledModel | PeriodicModel, points: int = 2000) -> float:
    """Return the smallest damping in N·s/m with which the device is passive with a stable model in any passive hand.

    0 if the model needs none; infinite with a negative static stiffness, which releases energy in the slowest motion, in which
    a damping receives none. The condition is evaluated at `points` angles, then near the worst angle.
    """
    ticking = to_periodic(model)
    if ticking.model.static_stiffness < 0:
        return float("inf")
    intervals = ticking.intervals
    # An angle over a period of several ticks covers one frequency per tick.
    angles = all_angles(max(points // len(intervals), _MIN_ANGLES))
    # Add angles near the poles, as dense as each resonance is narrow; `unique` keeps one of a conjugate pair.
    poles = ticking.model.poles ** sum(map(len, ticking.samples))
    near = np.unique(np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * _ANGLES_NEAR_POLE)
    angles = np.sort(np.concatenate([angles, near[(near > 0.0) & (near < np.pi)]]))
    worst = int(damping_at(model, angles).argmax())
    refined = max(_REFINED_ANGLES // len(intervals), _MIN_ANGLES)
    angles = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], refined)
    return max(0.0, float(damping_at(model, angles).max()))
