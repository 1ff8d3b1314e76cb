"""Noise of the load cell: white or coloured, of a given RMS."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

COLOURS = ("white", "autoregressive", "flicker")
"""White; first-order autoregressive; 1/f above 0.1 Hz."""


def draw_noise(
    rng: np.random.Generator, samples: int, rms: float, colour: str, correlation: float, rate_Hz: float
) -> np.ndarray:
    """Stationary Gaussian noise.

    Parameters
    ----------
    rms : float
        Standard deviation, newtons.
    colour : str
        One of `COLOURS`.
    correlation : float
        Of neighbouring samples, for ``"autoregressive"``.
    rate_Hz : float
        Sampling rate.

    Returns
    -------
    numpy.ndarray, shape (samples,)
    """
    white = rng.standard_normal(samples)
    if colour == "white":
        return rms * white
    if colour == "autoregressive":
        white[1:] *= np.sqrt(1 - correlation**2)
        return rms * lfilter([1.0], [1.0, -correlation], white)
    frequency = np.fft.rfftfreq(samples, 1 / rate_Hz)
    shape = 1 / np.sqrt(np.maximum(frequency, 0.1))
    shape[0] = 0.0
    # White noise has |spectrum|² = samples per line: normalise by the shape's mean square over all lines, each
    # but the last one counts for two.
    count = np.full(len(shape), 2.0)
    count[0] = 1.0
    if samples % 2 == 0:
        count[-1] = 1.0
    shape /= np.sqrt(np.sum(count * shape**2) / samples)
    return rms * np.fft.irfft(np.fft.rfft(white) * shape, samples)
