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
_HIGHEST = 0.7
"""Highest edge, in Nyquist frequencies, that leaves enough beyond it."""
_TRANSITION = 0.25
"""Width of the filter's transition, as a share of the edge."""


def excitation_band(values: np.ndarray, sampling_time: float) -> float | None:
    """Return the upper edge (Hz) of an excitation's band; None where it goes on up to half the sampling rate, or falls all the way.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
        Position.
    sampling_time : float
        Seconds.
    """
    if len(values) < _FEWEST_SEGMENTS * _SEGMENT[0]:
        return None
    from scipy.signal import welch

    length = int(np.clip(2 ** int(np.log2(len(values) / _FEWEST_SEGMENTS)), *_SEGMENT))
    frequency, power = welch(values, 1 / sampling_time, ("kaiser", _KAISER), length, detrend="linear")
    nyquist = 0.5 / sampling_time
    floor = np.median(power[(frequency >= _FLOOR[0] * nyquist) & (frequency <= _FLOOR[1] * nyquist)])
    level = np.convolve(power, np.ones(3) / 3, "same")
    above = np.flatnonzero(level[frequency <= _FLOOR[1] * nyquist] > _ABOVE_FLOOR * floor)
    if not above.size or floor <= 0:
        return None
    edge = frequency[min(above[-1] + 2, len(frequency) - 1)]
    if edge > _HIGHEST * nyquist:
        return None
    return float(edge)


def within_band(values: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return a signal without what lies beyond an edge, with zero phase: gain 1 up to the edge, 0 from 1.25 edge on.

    The signal goes on beyond its ends as its mirror image about them, so that level and slope are kept there.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
    sampling_time : float
        Seconds.
    edge : float
        Hz.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = len(values)
    reach = min(size - 1, int(8 / (_TRANSITION * edge * sampling_time)) + 1)
    line = np.linspace(values[0], values[-1], size)  # mirrored about their ends, what is left goes on smoothly
    rest = values - line
    extended = np.concatenate([-rest[reach:0:-1], rest, -rest[-2 : -reach - 2 : -1]])
    length = next_fast_len(len(extended), real=True)
    spectrum = rfft(extended, length)
    spectrum *= _gain(np.fft.rfftfreq(length, sampling_time), edge)
    return line + irfft(spectrum, length)[reach : reach + size]


def _gain(frequency: np.ndarray, edge: float) -> np.ndarray:
    """1 up to the edge, then half a period of a cosine down to 0."""
    beyond = np.clip((frequency / edge - 1) / _TRANSITION, 0, 1)
    return 0.5 + 0.5 * np.cos(np.pi * beyond)
