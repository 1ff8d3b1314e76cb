"""The closed loop in time: a hand pushes the stylus into the model and holds it there.

Between two changes of a force device and hand are propagated exactly; the encoder reads in steps, the force stays within
its limit. What the analysis leaves out, quantisation and saturation, is in here.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, period, propagation

PUSH_MM, PUSH_S, DURATION_S = 5.0, 0.25, 4.0
"""The hand's push: depth, time of its flank of half a cosine, and how long all is watched."""
_FINEST_S = 1e-3
_PERSISTS = 0.5
"""An oscillation lasts where it keeps this part of its size from the third quarter of the time to the last one."""
_LONGEST, _CHUNK, _NEGLIGIBLE = 20_000, 200, 1e-6
"""Samples after which an impulse is not followed any further, and how its end is known before."""

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
    """Shape (samples,): force of every sample in N."""
    sampling_time: float
    """Seconds."""
    ripple: float
    """Peak to peak force in N that the encoder's steps alone may keep up in a stable loop; in an unstable one, that bounds
    of the FMU may calm, the largest force of one step."""

    @property
    def peak_to_peak(self) -> float:
        """Of the force in the last quarter of the time, in N."""
        return float(np.ptp(self.samples[-(len(self.samples) // 4) :]))

    @property
    def oscillates(self) -> bool:
        """Whether the force keeps moving, more than the encoder's steps account for, though the hand rests."""
        quarter = len(self.samples) // 4
        before = float(np.ptp(self.samples[-2 * quarter : -quarter]))
        return self.peak_to_peak > max(_PERSISTS * before, self.ripple)

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
    step: Step,
    sampling_time: float,
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
    step : callable
        The model; its memory moves on.
    sampling_time : float
        Seconds between two samples.
    limit : float
        Largest force in N.
    delay : float
        Seconds from a sample to its force, less than `sampling_time`.
    ripple : float
        See `LoopRun`.
    push_mm : float
        How far the hand's rest position moves.
    duration : float
        Seconds.
    """
    parts = [
        (old, part)
        for old, length in ((True, delay), (False, sampling_time - delay))
        for part in _split(length)
    ]
    motions = {
        part: [*propagation(device, part)[0].ravel(), *propagation(device, part)[1]] for _, part in parts
    }
    resolution = device.encoder_um * 1e-6
    position = velocity = force = time = 0.0
    points, samples = [], []
    for _ in range(round(duration / sampling_time)):
        read = round(position / resolution) * resolution if resolution else position
        before, force = force, min(max(step(read), -limit), limit)
        samples.append(force)
        for old, part in parts:
            acting = before if old else force
            points.append((time, position, acting))
            xx, xv, vx, vv, x_by_force, v_by_force = motions[part]
            # The hand moves slowly against a part of at most a millisecond: it is held over it.
            net = _hand_force(device, time + part / 2, push_mm) - acting
            position, velocity = (
                xx * position + xv * velocity + x_by_force * net,
                vx * position + vv * velocity + v_by_force * net,
            )
            time += part
    return LoopRun(*np.array(points).T, np.array(samples), sampling_time, ripple)


def _split(length: float) -> list[float]:
    count = int(np.ceil(length / _FINEST_S - 1e-9))
    return [length / count] * count if count else []


def _hand_force(device: DeviceSettings, time: float, push_mm: float) -> float:
    """What the moving rest position of the hand adds to the forces, in N."""
    phase = math.pi * min(time / PUSH_S, 1.0)
    position, velocity = (1.0 - math.cos(phase)) / 2.0, math.pi / PUSH_S * math.sin(phase) / 2.0
    return 1e-3 * push_mm * (device.hand_stiffness_N_m * position + device.hand_damping_N_s_m * velocity)


def one_step(model: SampledModel, device: DeviceSettings) -> float:
    """Largest force in N that a sine of one encoder's step gives."""
    return float(np.abs(model.response(all_angles())).max() * device.encoder_um * 1e-6)


def encoder_ripple(model: SampledModel, device: DeviceSettings) -> float:
    """Peak to peak force that the encoder's steps can keep up in a stable loop, in N.

    An encoder errs by half a step at most, and no bounded error gives more than its size times the 1-norm of the impulse
    response from it to the force.
    """
    step, (transition, by_new, by_old) = difference_equation(model), period(model, device)
    state, before, total, recent = np.zeros(2), 0.0, 0.0, 0.0
    for sample in range(1, _LONGEST + 1):
        force = step(state[0] + (sample == 1))
        state = transition @ state - by_new * force - by_old * before
        before, total, recent = force, total + abs(force), recent + abs(force)
        if sample % _CHUNK == 0:
            if recent < _NEGLIGIBLE * total:
                break
            recent = 0.0
    return float(total * device.encoder_um * 1e-6)
