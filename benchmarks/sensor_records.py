"""Tissue tests with sound sensors, of many kinds of motion, effect and noise, and the same with faults put into them.

A motion is a cubic spline through points four times as dense as the samples; the force comes from a Kelvin–Boltzmann tissue
and one more effect, integrated on those points, so that samples can be taken at any time.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from lumbar.records.record import Channel, Record

DENSE = 4
MOTIONS = (
    "multisine",
    "shot",
    "sine",
    "chirp",
    "ramp_hold",
    "smooth_hold",
    "triangle",
    "cycles",
    "needle",
    "hand",
)
EFFECTS = (
    "none", "hardening", "coulomb", "quadratic_damping", "softening", "drift", "delay", "backlash", "contact_loss",
    "inertia", "disturbance", "thinning",
)  # fmt: skip
NOISES = ("white", "ar1", "pink", "hum", "spikes", "coarse")


def _multisine(rng, time, period, highest):
    lines = np.arange(1, max(int(highest * period), 2) + 1)
    lines = np.sort(rng.choice(lines, min(len(lines), 30), replace=False))
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    wave = np.zeros(len(time))
    for line, phase in zip(lines, phases, strict=True):
        wave += np.cos(2 * np.pi * line * time / period + phase)
    return wave / np.abs(wave).max()


def _trapezoids(rng, time, smooth):
    """Ramps between levels and rests at them; the ramps' ends are sharp or of limited jerk."""
    value, at, level = np.zeros(len(time)), 0.0, 0.0
    while at < time[-1]:
        rest, ramp = rng.uniform(0.5, 4.0), rng.uniform(0.1, 2.0)
        target = 0.0 if level else rng.choice([0.6, 0.8, 1.0])
        share = np.clip((time - at - rest) / ramp, 0, 1)
        if smooth:
            share = share**3 * (10 - 15 * share + 6 * share**2)
        inside = time >= at
        value[inside] = level + (target - level) * share[inside]
        at, level = at + rest + ramp, target
    return value


def motion(kind: str, rng: np.random.Generator, time: np.ndarray, highest: float) -> np.ndarray:
    """Motion of size 1."""
    span = time[-1]
    if kind == "multisine":
        return _multisine(rng, time, (span - 2 * (time[DENSE] - time[0])) / 10, highest)
    if kind == "shot":
        return _multisine(rng, time, 2.1 * span, highest)
    if kind == "sine":
        return np.sin(2 * np.pi * max(1 / span, highest / 4) * time)
    if kind == "chirp":
        return np.sin(2 * np.pi * (0.1 * time + (highest - 0.1) * time**2 / (2 * span)))
    if kind in ("ramp_hold", "smooth_hold"):
        return _trapezoids(rng, time, kind == "smooth_hold")
    if kind == "triangle":
        return 1 - 2 * np.abs((time * rng.uniform(0.3, 1.0)) % 2 - 1)
    if kind == "cycles":
        return 0.5 - 0.5 * np.cos(2 * np.pi * rng.uniform(0.2, 0.5) * time) ** 3
    if kind == "needle":
        steps = np.floor(time / 2.0)
        share = np.clip((time - 2.0 * steps) / 0.4, 0, 1)
        return (steps + share**2 * (3 - 2 * share)) / (span / 2.0 + 1)
    strokes = _multisine(rng, time, 1.7 * span, min(highest, 1.5))
    return strokes + 0.005 * _multisine(rng, time, 1.3 * span, min(8.0, 0.9 * 0.35 / (time[DENSE] - time[0])))


def _force(kind: str, time: np.ndarray, position: np.ndarray) -> np.ndarray:
    step = time[1] - time[0]
    if kind == "backlash":
        from hidden_effects.rate_independent import play

        position = play(position, 0.05 * np.ptp(position) / 2)
    speed = np.gradient(position, step)
    decay = np.exp(-step / 0.3)
    relaxing = 0.3 * position - lfilter([0.3 * (1 - decay)], [1, -decay], position)
    stiffness = 0.4 * (1 - 0.2 * time / time[-1]) if kind == "softening" else 0.4
    damping = 0.02 * (1 - 0.4 * time / time[-1]) if kind == "thinning" else 0.02
    force = stiffness * position + damping * speed + relaxing
    usual = np.std(speed) + 1e-12
    if kind == "hardening":
        force += 0.01 * position**3
    elif kind == "coulomb":
        force += 0.2 * np.tanh(speed / (0.05 * usual))
    elif kind == "quadratic_damping":
        force += 0.3 * speed * np.abs(speed) / usual**2
    elif kind == "drift":
        force += 0.5 * (1 - np.exp(-time / (0.3 * time[-1])))
    elif kind == "delay":
        force = np.interp(time - 0.02, time, force)
    elif kind == "contact_loss":
        force = np.maximum(force, -0.3 * np.abs(force).max())
    elif kind == "inertia":
        force += 1e-4 * np.gradient(speed, step)
    elif kind == "disturbance":
        force += 0.1 * np.sin(2 * np.pi * 1.37 * time)
    return force


def _noise(kind: str, rng: np.random.Generator, time: np.ndarray, size: float) -> np.ndarray:
    white = rng.standard_normal(len(time))
    if kind == "ar1":
        return size * lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], white)
    if kind == "pink":
        spectrum = np.fft.rfft(white) / np.sqrt(np.maximum(np.arange(len(white) // 2 + 1), 1))
        pink = np.fft.irfft(spectrum, len(white))
        return size * pink / np.std(pink)
    if kind == "hum":
        return size * (0.5 * white + 1.2 * np.sin(2 * np.pi * 50.0 * time + 1.0))
    if kind == "spikes":
        return size * (white + 30 * (rng.random(len(white)) < 2e-3) * rng.standard_normal(len(white)))
    return size * white


@dataclass(frozen=True)
class Plan:
    """Sampling of a record and the fault of its sensor."""

    seconds: float = 20.0
    rate: float = 100.0
    """Samples per second."""
    highest: float = 5.0
    """Highest frequency of the motion in Hz."""
    fault: str = ""
    """Name of the fault, or empty."""
    size: float = 0.0
    """Size of the fault: mm RMS, mm, s RMS, ratio of the clocks minus one, or share of the samples."""
    quiet: float = 0.02
    """RMS of the noise of the force relative to that of the force."""


def tissue_record(
    kind: str, effect: str = "none", noise: str = "white", *, seed: int = 1, **fields
) -> Record:
    """Return one record with a motion, effect and noise of `MOTIONS`, `EFFECTS` and `NOISES`; `fields` are those of `Plan`."""
    rng, plan = np.random.default_rng(seed), Plan(**fields)
    rate, fault, size = plan.rate, plan.fault, plan.size
    count = round(plan.seconds * rate)
    dense = np.arange(-DENSE, (count + 1) * DENSE + 1) / (DENSE * rate)
    amplitude = rng.uniform(2.0, 10.0)
    moved = amplitude * motion(kind, rng, dense - dense[0], plan.highest)
    answer = _force(effect, dense - dense[0], moved)
    position, force = CubicSpline(dense, moved), CubicSpline(dense, answer)
    at = np.arange(count) / rate
    late = size * rng.standard_normal(count) if "jitter" in fault else 0.0
    x = position(np.clip(at + late, dense[0], dense[-1]))
    elapsed = at * (1 + size) if fault == "skew" else at + (late if fault == "shared_jitter" else 0.0)
    f = force(np.clip(elapsed, dense[0], dense[-1]))
    f = f + _noise(noise, rng, at, plan.quiet * np.std(answer))
    if noise == "coarse":
        f = np.round(f / (0.02 * np.std(answer))) * 0.02 * np.std(answer)
    if fault == "noise":
        x = x + size * rng.standard_normal(count)
    elif fault == "low_passed_noise":
        slow = lfilter([0.5], [1, -0.5], rng.standard_normal(count))
        x = x + size * slow / np.std(slow)
    elif fault == "steps":
        x = np.round(x / size) * size
    elif fault == "held":
        x = _hold_samples(x, rng, size)
    elif fault == "held_force":
        f = _hold_samples(f, rng, size)
    samples = np.ones(count, dtype=bool)
    if fault == "dropped":
        samples[rng.choice(np.arange(30, count - 30), max(round(size * count), 1), replace=False)] = False
    x, f = (np.array([float(f"{value:.7g}") for value in values[samples]]) for values in (x, f))
    channels = {"input": Channel(x, "position", "mm"), "output": Channel(f, "force", "N")}
    return Record(f"{kind} {effect} {noise}", np.arange(len(x)) * (1 / rate), channels)


def _hold_samples(values: np.ndarray, rng: np.random.Generator, share: float) -> np.ndarray:
    """Values of which a share is replaced by the one before, three in a row."""
    held = values.copy()
    for start in rng.choice(
        np.arange(20, len(values) - 20, 8), max(round(share * len(values) / 3), 2), replace=False
    ):
        held[start + 1 : start + 4] = held[start]
    return held


def clean_records(count: int, seed: int = 0):
    """Sound records of every kind, drawn at random."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        rate = float(rng.choice([100.0, 200.0, 500.0]))
        yield tissue_record(
            MOTIONS[number % len(MOTIONS)],
            str(rng.choice(EFFECTS)),
            str(rng.choice(NOISES)),
            seed=seed * 100_000 + number,
            seconds=float(rng.choice([5.0, 10.0, 20.0, 60.0, 300.0], p=[0.3, 0.3, 0.3, 0.09, 0.01])),
            rate=rate,
            highest=float(rng.choice([2.0, 5.0, 10.0, 0.08 * rate])),
            quiet=float(rng.choice([0.001, 0.01, 0.05])),
        )
