"""The closed loop in time: a hand pushes the stylus into the model and holds it there.

Between two changes of a force device and hand are propagated exactly; the encoder reads in steps, the force stays within
its limit. What the analysis leaves out, quantisation and saturation, is in here.
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
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, propagation
from lumbar.tissue.haptics.ticks.sequence import PeriodicModel, in_ticks

PUSH_MM, PUSH_S, DURATION_S = 5.0, 0.25, 4.0
"""The hand's push: depth, time of its flank of half a cosine, and how long all is watched."""
_FINEST_S = 1e-3
_ROUNDING_S = 1e-11
_TOLD_N = 0.01
"""Peak to peak force from which on a hand may notice it: what dies away below it is no oscillation."""
_PERSISTS = 0.5
"""An oscillation lasts where it keeps this part of its size from the third quarter of the time to the last one."""
_LONGEST, _CHUNK, _NEGLIGIBLE = 20_000, 200, 1e-6
"""Ticks after which an impulse is not followed any further, and how its end is known before."""

Step = Callable[[float], float]
"""From a sampled position in m to the force against the motion in N."""


@dataclass(frozen=True)
class LoopRun:
    """What was simulated."""

    time: np.ndarray
    position: np.ndarray
    """`time`, `position`: shape (points,): seconds and m, about every millisecond."""
    force: np.ndarray
    """Shape (points,): N against the motion, held until the next point."""
    samples: np.ndarray
    """Shape (ticks,): force of every tick in N."""
    ripple: float
    """Peak to peak force in N that the encoder's steps alone may keep up in a stable loop; in an unstable one, that bounds
    of the FMU may calm, the largest force of one step."""
    limit: float = math.inf
    """Largest force in N."""

    @property
    def runs_away(self) -> bool:
        """Whether nothing but the limit ends the force at last: a stylus pressed against it is not at rest."""
        return bool((np.abs(self.samples[-(len(self.samples) // 4) :]) >= self.limit).all())

    @property
    def calm(self) -> bool:
        """Whether it comes to rest."""
        return not (self.oscillates or self.runs_away)

    @property
    def outcome(self) -> str:
        """A few words with the numbers."""
        if self.oscillates:
            return f"it oscillates at {self.frequency:.3g} Hz with {self.peak_to_peak:.3g} N peak to peak"
        if self.runs_away:
            return f"it runs away, until {self.limit:g} N are the limit"
        if self.peak_to_peak < _TOLD_N:
            return "it comes to rest"
        why = "the encoder's steps keep up" if self.ripple >= self.peak_to_peak else "it still changes by"
        return f"it comes to rest but for {self.peak_to_peak:.2g} N that {why}"

    @property
    def peak_to_peak(self) -> float:
        """Of the force in the last quarter of the time, in N."""
        return float(np.ptp(self.samples[-(len(self.samples) // 4) :]))

    @property
    def oscillates(self) -> bool:
        """Whether the force keeps moving to and fro, more than the encoder's steps account for, though the hand rests."""
        quarter = len(self.samples) // 4
        before, last = self.samples[-2 * quarter : -quarter], self.samples[-quarter:]
        if self.peak_to_peak <= _PERSISTS * float(np.ptp(before)):
            return False
        time = np.linspace(-1.0, 1.0, quarter)
        # A force that drifts, as one with time alone, goes along a line.
        swing = float(np.ptp(last - time * (time @ last) / (time @ time)))
        return min(swing, self.peak_to_peak) > max(self.ripple, _TOLD_N)

    @property
    def frequency(self) -> float | None:
        """Of the oscillation in Hz; None where there is none."""
        if not self.oscillates:
            return None
        last = self.position[3 * len(self.position) // 4 :]
        spacing = float(np.mean(np.diff(self.time)))
        spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(len(last)), 8 * len(last)))
        return float(np.fft.rfftfreq(8 * len(last), spacing)[spectrum.argmax()])


def difference_equation(model: SampledModel) -> Step:
    """Return the model as a function from one position to its force, with the memory of those before."""
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


def simulate(
    tick: Callable[[float, float], float],
    intervals: Iterable[float],
    device: DeviceSettings,
    limit: float,
    *,
    delay: float = 0.0,
    ripple: float = 0.0,
    push_mm: float = PUSH_MM,
    duration: float = DURATION_S,
) -> LoopRun:
    """Simulate a push and what follows it.

    Parameters
    ----------
    tick : callable
        From the time in seconds and the position in m to the force against the motion in N, such as `TissueForce`; its
        memory moves on.
    intervals : iterable of float
        Seconds from tick to tick, again and again.
    limit : float
        Largest force in N.
    delay : float
        Seconds from a tick to its force.
    ripple : float
        See `LoopRun`.
    push_mm : float
        How far the hand's rest position moves.
    duration : float
        Seconds.
    """
    motion = cache(lambda part: [*propagation(device, part)[0].ravel(), *propagation(device, part)[1]])
    resolution = device.encoder_um * 1e-6
    # Nobody pushes a stylus that nobody holds: it comes in at a push's mean speed.
    velocity = 0.0 if device.hand_stiffness_N_m else 1e-3 * push_mm / PUSH_S
    position = acting = time = 0.0
    points, samples, coming = [], [], deque()
    for interval in cycle(intervals):
        if time > duration - interval / 2.0:
            break
        read = round(position / resolution) * resolution if resolution else position
        samples.append(min(max(tick(time, read), -limit), limit))
        coming.append((time + delay, samples[-1]))
        end = time + interval
        while end - time > _ROUNDING_S:
            if coming and coming[0][0] - time <= _ROUNDING_S:
                acting = coming.popleft()[1]
                continue
            for part in _split(min(end, coming[0][0] if coming else end) - time):
                points.append((time, position, acting))
                xx, xv, vx, vv, x_by_force, v_by_force = motion(part)
                # The hand moves slowly against a part of at most a millisecond: it is held over it.
                net = _hand_force(device, time + part / 2, push_mm) - acting
                # Dry friction is what stops the stylus by the end of the part, where it can be (J. J. Moreau, 1988): then it
                # sticks, else it slides all along. It is late by a part where the motion turns.
                stopping = net + (vx * position + vv * velocity) / v_by_force
                net -= min(max(stopping, -device.friction_N), device.friction_N)
                position, velocity = (
                    xx * position + xv * velocity + x_by_force * net,
                    vx * position + vv * velocity + v_by_force * net,
                )
                time += part
        time = end
    return LoopRun(*np.array(points).T, np.array(samples), ripple, limit)


def _split(length: float) -> list[float]:
    count = math.ceil(length / _FINEST_S - 1e-9)
    # Times are sums: lengths that differ by rounding are one.
    return [round(length / count, 12)] * count


def _hand_force(device: DeviceSettings, time: float, push_mm: float) -> float:
    """What the moving rest position of the hand adds to the forces, in N."""
    phase = math.pi * min(time / PUSH_S, 1.0)
    position, velocity = (1.0 - math.cos(phase)) / 2.0, math.pi / PUSH_S * math.sin(phase) / 2.0
    return 1e-3 * push_mm * (device.hand_stiffness_N_m * position + device.hand_damping_N_s_m * velocity)


def one_step(model: SampledModel | PeriodicModel, device: DeviceSettings) -> float:
    """Largest force in N that a sine of one encoder's step gives."""
    return float(np.abs(in_ticks(model).model.response(all_angles())).max() * device.encoder_um * 1e-6)


def encoder_ripple(model: SampledModel | PeriodicModel, device: DeviceSettings) -> float:
    """Peak to peak force that the encoder's steps can keep up in a stable loop, in N.

    An encoder errs by half a step at most, and no bounded error gives more than its size times the 1-norm of the impulse
    responses from it to the force of a tick, the largest of a period's.
    """
    free, driven, by_readings = in_ticks(model).transitions(device)
    ticks = len(free)
    # A column for an error at each tick of a period.
    state, total, before = np.zeros((free.shape[1], ticks)), np.zeros(ticks), np.zeros(ticks)
    for tick in range(_LONGEST):
        place = tick % ticks
        state = (free[place] + driven[place]) @ state
        if 0 < tick <= ticks:
            state[:, tick - 1] += by_readings[place][:, 0]
        if tick < ticks:
            state[:, tick] += by_readings[place][:, 1]
        total[place] += np.abs(state[2]).sum()
        if (tick + 1) % max(_CHUNK, 2 * ticks) == 0:
            if (total - before).max() < _NEGLIGIBLE * total.max():
                break
            before = total.copy()
    return float(total.max() * device.encoder_um * 1e-6)
