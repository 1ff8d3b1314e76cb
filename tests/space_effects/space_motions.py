"""Motions of a surgeon's tool in two or three axes: sums of sines up to 6 Hz, so that velocity and acceleration are exact."""

from dataclasses import dataclass

import numpy as np

RATE_HZ = 100
OVERSAMPLING = 40
PERIOD_S, PERIODS = 12.0, 5
UNSEEN_S = 30.0
BAND_HZ = (0.1, 5.0)
FADE_HZ = (4.0, 6.0)
"""Lines of the unseen records fade out between these frequencies."""


@dataclass(frozen=True)
class Motion:
    """Position (mm), velocity and acceleration, shape (points, axes), every `step` seconds."""

    step: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @property
    def time(self) -> np.ndarray:
        return self.step * np.arange(len(self.position))

    @property
    def path(self) -> np.ndarray:
        """Length of the way since the record began, mm."""
        return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.position, axis=0), axis=1)))

    def scaled(self, factor) -> "Motion":
        """The motion times a number or a number per axis."""
        return Motion(self.step, self.position * factor, self.velocity * factor, self.acceleration * factor)

    def hold_first_position(self) -> "Motion":
        """The tool held at its first position."""
        still = np.zeros_like(self.position)
        return Motion(self.step, still + self.position[0], still, still)


def from_lines(lines: np.ndarray, spacing_Hz: float, periods: int) -> Motion:
    """Motion of the complex amplitudes `lines` (lines, axes) at 0, spacing, 2 spacing …"""
    points = round(RATE_HZ * OVERSAMPLING / spacing_Hz)
    spectrum = np.zeros((points // 2 + 1, lines.shape[1]), dtype=complex)
    spectrum[: len(lines)] = lines * points / 2
    spectrum[0] *= 2
    turn = 2j * np.pi * spacing_Hz * np.arange(len(spectrum))[:, None]
    derivatives = [np.fft.irfft(spectrum * turn**order, points, axis=0) for order in range(3)]
    return Motion(1 / (RATE_HZ * OVERSAMPLING), *(np.tile(values, (periods, 1)) for values in derivatives))


def multisine(rng: np.random.Generator, axes: int) -> Motion:
    """Random phases of each axis' own, amplitudes that fall as f^-1/2, RMS 1-2 mm per axis."""
    frequency = np.arange(0, round(BAND_HZ[1] * PERIOD_S) + 1) / PERIOD_S
    inside = frequency >= BAND_HZ[0]
    amplitudes = np.where(inside, np.maximum(frequency, BAND_HZ[0]) ** -0.5, 0.0)
    amplitudes *= np.sqrt(2 / np.sum(amplitudes**2))
    phases = rng.uniform(0, 2 * np.pi, (len(frequency), axes))
    lines = amplitudes[:, None] * np.exp(1j * phases) * rng.uniform(1.0, 2.0, axes)
    return from_lines(lines, 1 / PERIOD_S, PERIODS)


def unseen(rng: np.random.Generator, axes: int, largest_mm: float) -> dict[str, Motion]:
    """Strokes, raster and loops that stay within 75-100 % of the largest distance from the origin."""
    motions = {}
    for name, rough in (("strokes", strokes), ("raster", raster), ("loops", loops)):
        motion = _band_limited(rough(rng, axes))
        reached = np.linalg.norm(motion.position, axis=1).max()
        motions[name] = motion.scaled(rng.uniform(0.75, 1.0) * largest_mm / reached)
    return motions


def strokes(rng: np.random.Generator, axes: int) -> np.ndarray:
    """Out and back along oblique directions, with holds, each of another size and duration."""
    points, durations = [np.zeros(axes)], []
    while sum(durations) < UNSEEN_S - 1:
        target = rng.uniform(0.25, 1.0) * _unit(rng, axes)
        points += [target, target, np.zeros(axes), np.zeros(axes)]
        durations += [
            rng.uniform(0.2, 0.8),
            rng.uniform(0.1, 0.5),
            rng.uniform(0.2, 0.8),
            rng.uniform(0.1, 0.4),
        ]
    return _through(np.array(points), durations)


def raster(rng: np.random.Generator, axes: int) -> np.ndarray:
    """Pressing along the last axis at the places of a grid over the others, row by row to and fro."""
    columns = np.linspace(-1, 1, 4)
    rows = np.linspace(-1, 1, 3) if axes == 3 else np.zeros(3)
    places = [(x, y) for n, y in enumerate(rows) for x in columns[:: 1 if n % 2 == 0 else -1]]
    points, durations = [], []
    for x, y in places:
        over = np.array([x, y, 0.0]) * rng.uniform(0.85, 1.0)
        down = over + np.array([0.0, 0.0, rng.uniform(0.6, 1.6)])
        points += [over, down, down, over]
        durations += [
            rng.uniform(low, high) for low, high in ((0.5, 0.8), (0.2, 0.5), (0.5, 0.8), (0.4, 0.7))
        ]
    points.append(points[0])
    return _through(np.array(points)[:, [0, 1, 2] if axes == 3 else [0, 2]], durations)


def loops(rng: np.random.Generator, axes: int) -> np.ndarray:
    """Ellipses in planes that change every 5 s, one fading into the next."""
    time = np.arange(round(UNSEEN_S * RATE_HZ)) / RATE_HZ
    total, length = np.zeros((len(time), axes)), UNSEEN_S / 6
    for start in np.arange(6) * length:
        major, other = _unit(rng, axes), _unit(rng, axes)
        minor = other - major * (major @ other)
        phase = 2 * np.pi * rng.uniform(0.5, 2.5) * (time - start)
        weight = _smooth((time - start) / 0.8) * _smooth((start + length - time) / 0.8)
        ellipse = np.outer(np.cos(phase), major) + rng.uniform(0.4, 1.0) * np.outer(np.sin(phase), minor)
        total += weight[:, None] * rng.uniform(0.5, 1.0) * ellipse
    return total


def _unit(rng: np.random.Generator, axes: int) -> np.ndarray:
    vector = rng.standard_normal(axes)
    return vector / np.linalg.norm(vector)


def _smooth(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _through(points: np.ndarray, durations: list[float]) -> np.ndarray:
    """Positions at the rate of the records, from rest to rest through the points in 30 s."""
    knots = np.append(0.0, np.cumsum(durations))
    knots *= UNSEEN_S / knots[-1]
    time = np.arange(round(UNSEEN_S * RATE_HZ)) / RATE_HZ
    piece = np.searchsorted(knots, time, side="right") - 1
    share = _smooth((time - knots[piece]) / np.diff(knots)[piece])
    return points[piece] + share[:, None] * (points[piece + 1] - points[piece])


def _band_limited(rough: np.ndarray) -> Motion:
    lines = np.fft.rfft(rough, axis=0) * 2 / len(rough)
    lines[0] /= 2
    frequency = np.arange(len(lines)) / UNSEEN_S
    lines *= _smooth((FADE_HZ[1] - frequency) / (FADE_HZ[1] - FADE_HZ[0]))[:, None]
    return from_lines(lines[frequency < FADE_HZ[1]], 1 / UNSEEN_S, 1)
