"""The closed loop in time: a hand pushes the stylus into the model and holds it there.

Between two changes of a force device and hand are propagated exactly; the encoder reads in steps, the force stays within
its limit. What the analysis leaves out, quantisation and saturation, is in here.

A servo of any rate around an FMU with samples of its own does what ``tissue_force.h`` does at each tick: it takes the samples
whose instants have come since the tick before, at positions on the straight line from that tick to this one, and displays the
force of the newest until the next tick.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from itertools import cycle
from typing import Any

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.fmu.build.guards import shortened
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, propagation
from lumbar.tissue.haptics.ticks import REACHED, PeriodicModel, in_ticks, shares
from lumbar.tissue.models.transfer_function import filtered

LONGEST_GAP_S = 0.25
"""``longest_gap`` of ``tissue_force.h``."""
MOST_TICKS, PLACES = 256, 8
"""Rates whose ticks do not come back to the same place among the samples within so many ticks are judged at the nearest that
do, at so many places of the first tick, as a clock that drifts comes to all of them."""
_ROUNDING = 1e-9


class TissueForce:
    """The loader: time and position of a tick in, force out; numbers of ``tissue_force.h``, operation by operation."""

    def __init__(self, step: Step, sampling_time: float):
        self._step, self._sampling_time = step, sampling_time
        self._start = self._time = self._position = self._force = 0.0
        self._samples = 0

    def __call__(self, time: float, position: float) -> float:
        """Force at a tick; times in seconds, not falling."""
        if not self._samples:
            self._start = self._time = time
        newest = self._start + (self._samples - 1) * self._sampling_time
        moved = position - self._position
        for share in shares(self._time - newest, time - self._time, self._sampling_time):
            self._force = self._step(position if share == 1.0 else self._position + share * moved)
            self._samples += 1
        self._time, self._position = time, position
        return self._force


def on_servo(
    model: SampledModel, device: DeviceSettings, *, held: bool = False
) -> tuple[SampledModel | PeriodicModel, ...]:
    """Return a model that samples by its own clock as the servo of a device meets it, forces late as they are there.

    Parameters
    ----------
    held : bool
        Whether the position waits at that of the tick before, as that of a client of FMI 2.0 does.

    Returns
    -------
    tuple of SampledModel or PeriodicModel
        One from tick to tick, or from sample to sample where the servo is faster by a whole factor; with ticks that repeat
        after several where neither rate is a multiple of the other; several where they do not within `MOST_TICKS`.

    Raises
    ------
    InputError
        If the loader takes no gap as long as that between two ticks.
    """
    if 1.0 / device.rate_Hz > LONGEST_GAP_S:
        raise InputError(
            f"runtime.device: at {device.rate_Hz:g} Hz ticks are {1.0 / device.rate_Hz:.3g} s apart; the loaders take more than "
            f"{LONGEST_GAP_S:g} s for a fault: use a faster servo"
        )
    seconds, wanted = 1e-3 * device.delay_ms, 1.0 / (device.rate_Hz * model.sampling_time)
    ratio = Fraction(wanted).limit_denominator(MOST_TICKS)
    found = PeriodicModel(model, (float(ratio) * model.sampling_time,) * ratio.denominator, held=held)
    if abs(ratio - wanted) > _ROUNDING * wanted:
        # Up to just before the next instant.
        places = np.linspace(0.0, 1.0 - 2.0 * REACHED, PLACES) * model.sampling_time / ratio.denominator
        return tuple(replace(found, age=float(place)).late(seconds) for place in places)
    if ratio.numerator == 1:
        return (model.late(seconds),)
    return (
        (from_tick_to_tick(model, ratio.numerator, held) if ratio.denominator == 1 else found).late(seconds),
    )


def from_tick_to_tick(model: SampledModel, samples: int, held: bool) -> SampledModel:
    """Return the model as the loop meets it where each tick comes a whole number of samples after the one before.

    The positions are those of the ticks, interpolated by a filter, and of the forces those of the ticks are left
    (P. P. Vaidyanathan, Multirate Systems and Filter Banks (1993), section 4.2).
    """
    late, first = (np.ones(samples), 0) if held else (np.bartlett(2 * samples + 1)[1:-1], samples - 1)
    poles = np.roots(model.denominator) ** samples
    denominator = np.real(np.atleast_1d(np.poly(poles)))
    # Behind the filter each pole adds samples - 1 powers of 1/z to the numerator, before all but every so many are left.
    order = (len(model.numerator) - 1 + (samples - 1) * (len(poles) + 1)) // samples
    impulse = np.zeros(order * samples + 1 + first)
    impulse[: len(late)] = late[: len(impulse)]
    forces = filtered(model.numerator, model.denominator, impulse)[first::samples]
    return replace(
        model,
        numerator=np.convolve(denominator, forces)[: order + 1],
        denominator=denominator,
        sampling_time=samples * model.sampling_time,
    )


PUSH_MM, PUSH_S, DURATION_S = 5.0, 0.25, 4.0
"""The hand's push: depth, time of its flank of half a cosine, and how long all is watched."""
PUSHES_MM = (PUSH_MM, PUSH_MM / 10.0)
"""Depths that a model which is not linear is pushed to."""
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
    points, samples = course(tick, intervals, device, limit, delay, push_mm, duration)
    return LoopRun(*np.array(points).T, np.array(samples), ripple, limit)


def course(
    tick: Callable,
    intervals: Iterable[float],
    device: DeviceSettings,
    limit: float,
    delay: float = 0.0,
    push_mm: float = PUSH_MM,
    duration: float = DURATION_S,
    direction: Any = 1.0,
) -> tuple[list[tuple], list]:
    """Times, positions and forces, and the force of every tick, of `simulate`; along several axes vectors.

    `direction` is that of the push: a vector of length 1 along several axes, then limits are those of a vector's length.
    """
    motion = cache(lambda part: [*propagation(device, part)[0].ravel(), *propagation(device, part)[1]])
    resolution = device.encoder_um * 1e-6
    # Nobody pushes a stylus that nobody holds: it comes in at a push's mean speed.
    velocity = (0.0 if device.hand_stiffness_N_m else 1e-3 * push_mm / PUSH_S) * direction
    position = acting = 0.0 * direction
    time = 0.0
    points, samples, coming = [], [], deque()
    for interval in cycle(intervals):
        if time > duration - interval / 2.0:
            break
        samples.append(_limited(tick(time, _read(position, resolution)), limit))
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
                net = _hand_force(device, time + part / 2, push_mm) * direction - acting
                # Dry friction is what stops the stylus by the end of the part, where it can be (J. J. Moreau, 1988): then it
                # sticks, else it slides all along. It is late by a part where the motion turns.
                stopping = net + (vx * position + vv * velocity) / v_by_force
                net -= _limited(stopping, device.friction_N)
                position, velocity = (
                    xx * position + xv * velocity + x_by_force * net,
                    vx * position + vv * velocity + v_by_force * net,
                )
                time += part
        time = end
    return points, samples


def _read(position, resolution: float):
    """What an encoder reads."""
    if not resolution:
        return position
    return (np.round if isinstance(position, np.ndarray) else round)(position / resolution) * resolution


def _limited(force, most: float):
    """A number within its limit, or a vector no longer than it."""
    if isinstance(force, np.ndarray):
        return shortened(force[None], most)[0]
    return min(max(force, -most), most)


def _split(length: float) -> list[float]:
    count = math.ceil(length / _FINEST_S - 1e-9)
    # Times are sums: lengths that differ by rounding are one.
    return [round(length / count, 12)] * count


def _hand_force(device: DeviceSettings, time: float, push_mm: float) -> float:
    """What the moving rest position of the hand adds to the forces, in N along the push."""
    phase = math.pi * min(time / PUSH_S, 1.0)
    position, velocity = (1.0 - math.cos(phase)) / 2.0, math.pi / PUSH_S * math.sin(phase) / 2.0
    return 1e-3 * push_mm * (device.hand_stiffness_N_m * position + device.hand_damping_N_s_m * velocity)


def worst_run(runs: Iterable[LoopRun]) -> LoopRun:
    """Return the run that is least at rest."""
    return max(runs, key=lambda run: (not run.calm, run.peak_to_peak))


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
