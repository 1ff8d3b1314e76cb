"""The band that an excitation uses, told from the spectrum of the position, and the position without what lies beyond it."""

from __future__ import annotations

import numpy as np

_FEWEST_SEGMENTS = 6
_SEGMENT = (64, 4096)
"""Shortest and longest segment of the spectrum, in samples."""
_KAISER = 16.0
"""Shape of the segments' window: side lobes of −125 dB, below what noise of a sensor leaves."""
_FLOOR = (0.7, 0.9)
"""Where the floor is read, in Nyquist frequencies: beyond it filters of converters fall off."""
_ABOVE_FLOOR = 4.0
"""Power over the floor's that belongs to the excitation."""
_LONE_LINES = 9
"""Bins of which more than half must stand above the floor."""
_HIGHEST = 0.7
"""Highest edge, in Nyquist frequencies, that leaves enough beyond it."""
_TRANSITION = 0.25
"""Width of the filter's transition, as a share of the edge."""
_REACH = 8.0
"""Length over which a signal is carried on beyond its ends, in periods of the edge."""
_CONTINUES = 1e-3
"""Smallest singular value, of the largest, of what is fitted for that."""


def edge_above_floor(values: np.ndarray, sampling_time: float) -> float | None:
    """Return the upper edge (Hz) of an excitation's band; None where no level floor follows it.

    Where the spectrum falls to the floor that a sensor adds, not where a share of the power lies (`spectral_edge`): of the
    weakest motion nothing may pass for noise.

    `values` are positions, shape (samples,), every `sampling_time` seconds.
    """
    if len(values) < _FEWEST_SEGMENTS * _SEGMENT[0]:
        return None
    from scipy.signal import medfilt, welch

    length = int(np.clip(2 ** int(np.log2(len(values) / _FEWEST_SEGMENTS)), *_SEGMENT))
    frequency, power = welch(values, 1 / sampling_time, ("kaiser", _KAISER), length, detrend="linear")
    nyquist = 0.5 / sampling_time
    floor = np.median(power[(frequency >= _FLOOR[0] * nyquist) & (frequency <= _FLOOR[1] * nyquist)])
    # Errors of a converter repeat with the excitation: single lines that stand out little are theirs.
    level = medfilt(np.convolve(power, np.ones(3) / 3, "same"), _LONE_LINES)
    above = np.flatnonzero(level[frequency <= _FLOOR[1] * nyquist] > _ABOVE_FLOOR * floor)
    if not above.size or floor <= 0:
        return None
    edge = frequency[min(above[-1] + 2, len(frequency) - 1)]
    if edge > _HIGHEST * nyquist:
        return None
    return float(edge)


def within_band(values: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return a signal without what lies beyond an edge, with zero phase: gain 1 up to the edge, 0 from 1.25 edge on.

    Beyond its ends the signal is carried on by what fits it there and has no other frequencies (Fourier continuation:
    Bruno, Han and Pohlman, J. Comput. Phys. 227 (2007) 1094-1125): a mirror image would bend sharply at the end, and ring.

    `values` have shape (samples,), every `sampling_time` seconds; `edge` is in Hz.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    reach = min(len(values) - 1, int(_REACH / (edge * sampling_time)) + 1)
    mean = values.mean()
    rest = values - mean
    before = _continuation(rest[reach::-1], sampling_time, edge)[::-1]
    after = _continuation(rest[-reach - 1 :], sampling_time, edge)
    extended = np.concatenate([before, rest, after])
    length = next_fast_len(len(extended), real=True)
    spectrum = rfft(extended, length)
    spectrum *= _gain(np.fft.rfftfreq(length, sampling_time), edge)
    return mean + irfft(spectrum, length)[len(before) : len(before) + len(values)]


def _continuation(end: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """What follows the end of a signal, for as long again, and fades to zero: shape (samples - 1,)."""
    size = len(end)
    harmonics = max(int(2 * size * sampling_time * edge), 1) + 1
    angle = np.pi * np.arange(2 * size - 1)[:, None] / size * np.arange(harmonics)
    basis = np.hstack([np.cos(angle), np.sin(angle[:, 1:])])
    follows = basis[size:] @ np.linalg.lstsq(basis[:size], end, rcond=_CONTINUES)[0]
    largest = 2 * np.abs(end).max()
    fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, size - 1) ** 2)
    return np.clip(follows, -largest, largest) * fade


def _gain(frequency: np.ndarray, edge: float) -> np.ndarray:
    """1 up to the edge, then half a period of a cosine down to 0."""
    beyond = np.clip((frequency / edge - 1) / _TRANSITION, 0, 1)
    return 0.5 + 0.5 * np.cos(np.pi * beyond)
