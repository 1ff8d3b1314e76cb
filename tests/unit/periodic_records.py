"""Periodic tissue tests made for the tests of noise floor, comparison and location: everything in them is known."""

import numpy as np
from scipy.signal import lfilter

from lumbar.records.record import Channel, Record

STEP = 0.01


def multisine(periods: int, samples: int = 500, lines=None, seed: int = 0) -> np.ndarray:
    """Random-phase multisine of amplitude 1 per line, in mm; default a full grid up to 1/20 of the rate."""
    lines = np.arange(1, samples // 20 + 1) if lines is None else np.asarray(lines)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    time = np.arange(samples) / samples
    return np.tile(np.cos(2 * np.pi * np.outer(time, lines) + phase).sum(axis=1), periods)


def relaxing_force(position: np.ndarray) -> np.ndarray:
    """Force of a spring and a relaxing branch: a first-order filter, independent of the library's."""
    return lfilter([1.5, -1.3], [1.0, -0.85], position)


def noise(size: int, seed: int, pole: float = 0.0) -> np.ndarray:
    """White or AR(1) noise whose process has unit variance."""
    white = np.random.default_rng(seed).standard_normal(size + 2000)
    return lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], white)[2000:]


def record(
    position: np.ndarray,
    force: np.ndarray,
    name: str = "multisine",
    period: float | None = None,
    step: float = STEP,
    source: str = "",
) -> Record:
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, np.arange(len(position)) * step, channels, source, period)


def noisy_record(periods: int, sigma: float, seed: int, pole: float = 0.0, samples: int = 500, extra=None):
    """Multisine record with noise of standard deviation `sigma`; `extra` is a function of time and response."""
    position = multisine(periods, samples, seed=seed)
    force = relaxing_force(position)
    time = np.arange(len(position)) * STEP
    disturbance = 0.0 if extra is None else extra(time, force)
    return record(position, force + disturbance + sigma * noise(len(position), seed + 10_000, pole))


def moved(seed: int, seconds: float = 20.0) -> np.ndarray:
    """A motion of a few mm that does not repeat."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, STEP)
    frequency, phase = random.uniform(0.1, 4.0, 30), random.uniform(0, 2 * np.pi, 30)
    return np.cos(2 * np.pi * np.outer(time, frequency) + phase).sum(axis=1)


def softening_record(name: str, seed: int, seconds: float = 20.0) -> Record:
    """Spring that wears with the path travelled from each record's start, and noise."""
    position = moved(seed, seconds)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    force = (0.8 - 0.3 * (1 - np.exp(-path / 300.0))) * position
    return record(position, force + 0.05 * noise(len(position), seed), name)
