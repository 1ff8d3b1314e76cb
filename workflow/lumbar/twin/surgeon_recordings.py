"""Synthetic tool motion of surgeons gaining access: approach, puncture, probing strokes of decreasing depth.

The motion is a chain of point-to-point movements of minimum jerk (Flash and Hogan, J. Neurosci. 5 (1985) 1688-1703) with rests;
physiological tremor and the noise of the device are added. The duration of a stroke in config/twin.yaml is chosen for a
velocity bandwidth near the thesis's 2.5 Hz: the twin reproduces this number but does not confirm it.
"""

import zlib

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.settings.twin import SyntheticSurgeon, SyntheticSurgeonSettings


def surgeon_trial(name: str, surgeon: str, settings: SyntheticSurgeonSettings, seed: int) -> pd.DataFrame:
    """Return one recording of the tool tip, ``time_s, x_mm, y_mm, z_mm``; z points into the body, 0 is the skin.

    The random numbers depend only on the name of the recording and the twin's seed.
    """
    known = settings.surgeons
    if surgeon not in known:
        raise InputError(
            f"surgeon.records: {name} is by {surgeon!r}; twin.surgeon.surgeons has {', '.join(known)}"
        )
    person = known[surgeon]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    samples = round(settings.duration_s * settings.rate_Hz)
    time = np.arange(samples) / settings.rate_Hz
    depth, twist = (
        minimum_jerk_chain(time, start, duration, np.append(first, target))
        for first, (start, duration, target) in _draw_movements(person, settings, rng)
    )
    radius, angle = settings.lateral_mm, np.radians(twist)
    motion = {"x_mm": radius * np.sin(angle), "y_mm": radius * (1 - np.cos(angle)), "z_mm": depth}
    frame = {"time_s": np.round(time, 6)}
    for axis, values in motion.items():
        tremor = person.tremor_rms_mm * tremor_noise(
            samples, settings.rate_Hz, person.tremor_Hz, settings.tremor_bandwidth_Hz, rng
        )
        noise = settings.noise_rms_mm * rng.standard_normal(samples)
        frame[axis] = np.round(values + tremor + noise, 4)
    return pd.DataFrame(frame)


def minimum_jerk_chain(
    time: np.ndarray, start: np.ndarray, duration: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Return the position along a chain of minimum-jerk movements, each from rest to rest.

    Parameters
    ----------
    time : numpy.ndarray, shape (samples,)
        Seconds.
    start, duration : numpy.ndarray, shape (movements,)
        Start (rising) and duration of each movement, s.
    target : numpy.ndarray, shape (movements + 1,)
        First position, then the end position of every movement.
    """
    if len(start) == 0:
        return np.full(len(time), target[0])
    current = np.searchsorted(start, time, side="right") - 1
    moving = np.maximum(current, 0)
    share = np.clip((time - start[moving]) / duration[moving], 0.0, 1.0)
    share = np.where(current < 0, 0.0, share)
    return target[moving] + (target[moving + 1] - target[moving]) * share**3 * (10 + share * (6 * share - 15))


def tremor_noise(
    samples: int, rate: float, centre: float, bandwidth: float, rng: np.random.Generator
) -> np.ndarray:
    """Return Gaussian noise of expected RMS 1, shape (samples,), with a bell-shaped spectrum about `centre` Hz.

    `rate` is the sampling rate, `bandwidth` the standard deviation of the bell, both in Hz.
    """
    frequency = np.fft.rfftfreq(samples, 1 / rate)
    density = np.exp(-0.5 * ((frequency - centre) / bandwidth) ** 2)
    density[0] = 0.0
    phasors = rng.standard_normal(len(frequency)) + 1j * rng.standard_normal(len(frequency))
    # E|phasor|² is 2; a line of complex amplitude c adds 2|c|² to the mean square of irfft(c·samples).
    amplitudes = np.sqrt(density / (4 * density.sum()))
    return np.fft.irfft(samples * amplitudes * phasors, samples)


def _draw_movements(
    person: SyntheticSurgeon, settings: SyntheticSurgeonSettings, rng: np.random.Generator
) -> list[tuple[float, np.ndarray]]:
    """Draw the movements of a trial in depth and in twist: first position, and start, duration and target of each movement."""
    depth: list[tuple[float, float, float]] = []
    twist: list[tuple[float, float, float]] = []

    def varied(mean: float) -> float:
        return float(mean * np.exp(settings.variation * rng.standard_normal()))

    def move(start: float, duration: float, target: float) -> float:
        depth.append((start, duration, target))
        return start + duration

    clock = varied(settings.pause_s)
    clock = move(clock, varied(settings.approach_s), 0.0) + varied(settings.pause_s)
    reached = settings.puncture_mm
    clock = move(clock, varied(settings.puncture_s), reached) + varied(settings.pause_s)
    end = settings.duration_s - settings.pause_s
    while clock < end:
        # Between bouts the tool is repositioned about the depth reached: the slow, large part of the motion.
        floor = reached + settings.reposition_mm * rng.standard_normal()
        clock = move(clock, varied(settings.reposition_s), floor) + varied(settings.pause_s)
        for _ in range(1 + rng.poisson(settings.strokes_per_bout - 1)):
            # Strokes become shallower as the access deepens.
            done = min(clock / settings.duration_s, 1.0)
            stroke = varied(person.stroke_mm) * (1 - (1 - settings.last_stroke_share) * done)
            floor += settings.gain_mm_per_stroke
            reached += settings.gain_mm_per_stroke
            half = varied(person.stroke_s)
            side = 1 if rng.random() < 0.5 else -1
            twist.append((clock, half, side * varied(settings.twist_deg)))
            clock = move(clock, half, floor + stroke)
            half = varied(person.stroke_s)
            twist.append((clock, half, 0.0))
            clock = move(clock, half, floor)
            if clock >= end:
                break
        clock += varied(settings.pause_s)
    starts = (-settings.approach_mm, depth), (0.0, twist)
    return [(first, np.reshape(moves, (-1, 3)).T) for first, moves in starts]
