"""The closed loop in time: a hand pushes the stylus into the model and holds it there.

Between two changes of a force device and hand are propagated exactly. Unlike the analysis, the simulation includes the steps of
the encoder and the limit of the force.

A servo of any rate runs an FMU with its own sampling time as ``tissue_force.h`` does: at each tick it takes the samples that
are due since the previous tick, with positions interpolated linearly between both ticks, and displays the newest force until
the next tick.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from itertools import cycle

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.fmu.build.reference_response import limit_size
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, propagation
from lumbar.tissue.haptics.ticks import PeriodicModel, shares, to_periodic


class TissueForce:
    """The loader ``tissue_force.h``, operation by operation: from time and position of a tick to the force."""

    def __init__(self, step: Step, sampling_time: float):
        self._step, self._sampling_time = step, sampling_time
        self._start = self._time = self._position = self._force = 0.0
        self._samples = 0

    def __call__(self, time: float, position: float) -> float:
        """Return the force at a tick; times in seconds must not decrease."""
        if not self._samples:
            self._start = self._time = time
        newest = self._start + (self._samples - 1) * self._sampling_time
        moved = position - self._position
        for share in shares(self._time - newest, time - self._time, self._sampling_time):
            self._force = self._step(position if share == 1.0 else self._position + share * moved)
            self._samples += 1
        self._time, self._position = time, position
        return self._force


PUSH_MM, PUSH_S, DURATION_S = 5.0, 0.25, 4.0
"""Default push of the hand: depth, duration of its half-cosine flank, and duration of the simulation."""
PUSHES_MM = (PUSH_MM, PUSH_MM / 10.0)
"""Depths of the pushes into a nonlinear model."""
_MAX_PART_S = 1e-3
_ROUNDING_S = 1e-11
_PERCEPTIBLE_N = 0.01
"""Smallest perceptible peak to peak force of an oscillation."""
_PERSISTENT_SHARE = 0.5
"""Smallest share of its size that a persistent oscillation has left from the third to the last quarter of the time."""
_MAX_TICKS, _CHUNK, _NEGLIGIBLE_SHARE = 20_000, 200, 1e-6
"""Largest number of ticks of an impulse response, ticks in a chunk, and share: the response ends if a chunk adds less."""

Step = Callable[[float], float]
"""Function from a sampled position in m to the force against the motion in N."""


@dataclass(frozen=True)
class LoopRun:
    """A simulated loop along one axis."""

    time: np.ndarray
    """Time in seconds, about every millisecond, shape (points,)."""
    position: np.ndarray
    """Position in m, shape (points,)."""
    force: np.ndarray
    """Force in N against the motion, held until the next point, shape (points,)."""
    samples: np.ndarray
    """Force of every tick in N, shape (ticks,)."""
    ripple: float
    """Peak to peak force in N that the encoder's steps can sustain in a stable loop; in an unstable loop, which guards of the
    FMU may calm, the largest force of one step."""
    limit: float = math.inf
    """Limit of the force in N."""

    @property
    def runs_away(self) -> bool:
        """True if the force is at its limit at the end; a stylus at this limit does not count as at rest."""
        return bool((np.abs(self.samples[-(len(self.samples) // 4) :]) >= self.limit).all())

    @property
    def calm(self) -> bool:
        """True if the stylus ends at rest."""
        return not (self.oscillates or self.runs_away)

    @property
    def outcome(self) -> str:
        """Behaviour of the loop in words, with its numbers."""
        if self.oscillates:
            return f"it oscillates at {self.frequency:.3g} Hz with {self.peak_to_peak:.3g} N peak to peak"
        if self.runs_away:
            return f"it runs away, until {self.limit:g} N are the limit"
        if self.peak_to_peak < _PERCEPTIBLE_N:
            return "it comes to rest"
        why = "the encoder's steps keep up" if self.ripple >= self.peak_to_peak else "it still changes by"
        return f"it comes to rest but for {self.peak_to_peak:.2g} N that {why}"

    @property
    def peak_to_peak(self) -> float:
        """Peak to peak force in the last quarter of the time, in N."""
        return float(np.ptp(self.samples[-(len(self.samples) // 4) :]))

    @property
    def oscillates(self) -> bool:
        """True if the force still changes by more than the encoder's steps explain although the hand rests."""
        quarter = len(self.samples) // 4
        before, last = self.samples[-2 * quarter : -quarter], self.samples[-quarter:]
        if self.peak_to_peak <= _PERSISTENT_SHARE * float(np.ptp(before)):
            return False
        time = np.linspace(-1.0, 1.0, quarter)
        # Subtract a straight line: a force that only drifts does not oscillate.
        swing = float(np.ptp(last - time * (time @ last) / (time @ time)))
        return min(swing, self.peak_to_peak) > max(self.ripple, _PERCEPTIBLE_N)

    @property
    def frequency(self) -> float | None:
        """Frequency of the oscillation in Hz; None without one."""
        if not self.oscillates:
            return None
        last = self.position[3 * len(self.position) // 4 :]
        spacing = float(np.mean(np.diff(self.time)))
        spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(len(last)), 8 * len(last)))
        return float(np.fft.rfftfreq(8 * len(last), spacing)[spectrum.argmax()])


def difference_equation(model: SampledModel) -> Step:
    """Return a function from a position to the model's force; it stores earlier positions and forces."""
    numerator, feedback = model.numerator[::-1], model.denominator[:0:-1]
    positions = deque([0.0] * len(numerator), maxlen=len(numerator))
    forces = deque([0.0] * len(feedback), maxlen=len(feedback))

    def step(position: float) -> float:
        positions.append(position)
        force = float(numerator @ np.fromiter(positions, float))
        if len(feedback):
            force -= float(feedback @ np.fromiter(forces, float))
            forces.append(force)
        return force

    return step


@dataclass(frozen=True)
class HandPush:
    """A push of the hand."""

    depth_mm: float = PUSH_MM
    """Distance over which the hand's rest position moves."""
    direction: float | np.ndarray = 1.0
    """Direction of the push; along several axes a vector of length 1, shape (axes,)."""
    duration_s: float = DURATION_S
    """Duration of the simulation."""


def simulate(
    tick: Callable,
    intervals: Iterable[float],
    device: DeviceSettings,
    limit: float,
    push: HandPush,
    ripple: float = 0.0,
) -> LoopRun:
    """Simulate a push and the motion after it.

    Parameters
    ----------
    tick : callable
        Function from time in seconds and position in m to the force against the motion in N, such as `TissueForce`; along
        several axes positions and forces are vectors. Its state changes.
    intervals : iterable of float
        Seconds from tick to tick, repeated without end.
    device : DeviceSettings
        Device and hand.
    limit : float
        Largest force in N; along several axes the largest length of the vector.
    push : HandPush
        Push of the hand.
    ripple : float
        See `LoopRun`.

    Returns
    -------
    LoopRun
        Simulated loop; along several axes the run of the axis that is least calm at the end.
    """
    motion = cache(lambda part: [*propagation(device, part)[0].ravel(), *propagation(device, part)[1]])
    resolution = device.encoder_um * 1e-6
    # A stylus without a hand is not pushed: it comes in at a push's mean speed.
    velocity = (0.0 if device.hand_stiffness_N_m else 1e-3 * push.depth_mm / PUSH_S) * push.direction
    position = acting = 0.0 * push.direction
    time, delay = 0.0, 1e-3 * device.delay_ms
    points, samples, coming = [], [], deque()
    for interval in cycle(intervals):
        if time > push.duration_s - interval / 2.0:
            break
        reading = position
        if resolution:
            rounding = np.round if isinstance(position, np.ndarray) else round
            reading = rounding(position / resolution) * resolution
        samples.append(_limit(tick(time, reading), limit))
        coming.append((time + delay, samples[-1]))
        end = time + interval
        while end - time > _ROUNDING_S:
            if coming and coming[0][0] - time <= _ROUNDING_S:
                acting = coming.popleft()[1]
                continue
            # Until the force changes, propagate in parts of at most a millisecond.
            length = min(end, coming[0][0] if coming else end) - time
            count = math.ceil(length / _MAX_PART_S - 1e-9)
            # Lengths are differences of sums: round them, so that equal ones are cached.
            part = round(length / count, 12)
            xx, xv, vx, vv, x_by_force, v_by_force = motion(part)
            for _ in range(count):
                points.append((time, position, acting))
                # The moving rest position of the hand adds a force, constant over a part: the hand moves slowly.
                phase = math.pi * min((time + part / 2) / PUSH_S, 1.0)
                depth, speed = (1.0 - math.cos(phase)) / 2.0, math.pi / PUSH_S * math.sin(phase) / 2.0
                hand = device.hand_stiffness_N_m * depth + device.hand_damping_N_s_m * speed
                net = 1e-3 * push.depth_mm * hand * push.direction - acting
                # Dry friction stops the stylus by the end of the part if it can (J. J. Moreau, 1988), else the stylus slides
                # throughout. It is late by a part when the motion changes its direction.
                stopping = net + (vx * position + vv * velocity) / v_by_force
                net -= _limit(stopping, device.friction_N)
                position, velocity = (
                    xx * position + xv * velocity + x_by_force * net,
                    vx * position + vv * velocity + v_by_force * net,
                )
                time += part
        time = end
    times, *signals = (np.array(values).T for values in (*zip(*points, strict=True), samples))
    axes = zip(*signals, strict=True) if signals[0].ndim > 1 else [signals]
    return worst_run(LoopRun(times, *values, ripple, limit) for values in axes)


def _limit(force, size: float):
    """Return a number within its limit, or a vector of at most this length."""
    if isinstance(force, np.ndarray):
        return limit_size(force[None], size)[0]
    return min(max(force, -size), size)


def worst_run(runs: Iterable[LoopRun]) -> LoopRun:
    """Return the worst run: one that does not settle, or else the one with the largest peak-to-peak motion."""
    return max(runs, key=lambda run: (not run.calm, run.peak_to_peak))


def one_step(model: SampledModel | PeriodicModel, device: DeviceSettings) -> float:
    """Return the largest force in N in response to a sine of one encoder step."""
    return float(np.abs(to_periodic(model).model.response(all_angles())).max() * device.encoder_um * 1e-6)


def encoder_ripple(model: SampledModel | PeriodicModel, device: DeviceSettings) -> float:
    """Return the peak to peak force in N that the encoder's steps can sustain in a stable loop.

    An encoder's error is at most half a step. A bounded error gives at most its size times the 1-norm of the impulse responses
    from error to force; the largest of a period's ticks counts.
    """
    loop = to_periodic(model).transitions(device)
    closed, ticks = loop.free + loop.driven, len(loop.free)
    # A column for an error at each tick of a period.
    state, total, before = np.zeros((closed.shape[1], ticks)), np.zeros(ticks), np.zeros(ticks)
    for tick in range(_MAX_TICKS):
        place = tick % ticks
        state = closed[place] @ state
        if 0 < tick <= ticks:
            state[:, tick - 1] += loop.by_readings[place][:, 0]
        if tick < ticks:
            state[:, tick] += loop.by_readings[place][:, 1]
        total[place] += np.abs(state[2]).sum()
        if (tick + 1) % max(_CHUNK, 2 * ticks) == 0:
            if (total - before).max() < _NEGLIGIBLE_SHARE * total.max():
                break
            before = total.copy()
    return float(total.max() * device.encoder_um * 1e-6)
