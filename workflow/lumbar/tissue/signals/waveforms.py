"""Linear chirp (thesis Eq. 3.2) and band-limited Gaussian noise."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError


def linear_chirp(duration: float, lowest: float, highest: float, rate: float) -> np.ndarray:
    """sin((a t + b) t) that sweeps from `lowest` to `highest` Hz; thesis Eq. 3.2 with amplitude 1.

    The instantaneous frequency is the derivative of the phase a t² + b t, (2 a t + b)/2π. To begin at f0 and
    to end at f1 after T seconds it needs b = 2π f0 and a = π (f1 − f0)/T; with a = 2π (f1 − f0)/T the sweep
    would end at 2 f1 − f0, about twice the band.

    Parameters
    ----------
    duration : float
        T in seconds.
    lowest, highest : float
        f0 and f1 in Hz.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    numpy.ndarray of float, shape (round(duration * rate),)

    Raises
    ------
    InputError
        Frequencies out of order, or not below half the rate.
    """
    if not 0 <= lowest < highest < rate / 2:
        raise InputError(
            f"chirp from {lowest:g} to {highest:g} Hz at {rate:g} samples per second; needed: "
            f"0 <= signals.chirp.lowest_Hz < upper end of the band < {rate / 2:g} Hz"
        )
    a = np.pi * (highest - lowest) / duration
    b = 2 * np.pi * lowest
    time = np.arange(round(duration * rate)) / rate
    return np.sin((a * time + b) * time)


def band_limited_noise(duration: float, highest: float, rate: float, order: int, seed: int) -> np.ndarray:
    """Gaussian noise through a zero-phase low-pass filter, with mean 0 and RMS 1, shape (round(duration * rate),).

    White noise runs forward and backward through a Butterworth filter. Two passes halve the power at each
    pass's corner twice; the corner is therefore moved up so that the density of the result is halved (−3 dB)
    at `highest`. More noise than needed is filtered and the middle is kept, so that the ends are like the
    rest.

    Parameters
    ----------
    duration : float
        Seconds.
    highest : float
        Upper end of the band in Hz.
    rate : float
        Samples per second, Hz.
    order : int
        Order of the Butterworth filter (of one pass).

    Raises
    ------
    InputError
        The corner is not below half the rate.
    """
    from scipy.signal import butter, sosfiltfilt

    # |H|⁴ = 1/2 at `highest`, with |H|² = 1/(1 + (f/corner)^(2·order)).
    corner = highest / (np.sqrt(2) - 1) ** (1 / (2 * order))
    if not 0 < corner < rate / 2:
        raise InputError(
            f"noise up to {highest:g} Hz at {rate:g} samples per second needs a filter corner of "
            f"{corner:g} Hz, which must be below {rate / 2:g} Hz: raise signals.rate_Hz"
        )
    samples = round(duration * rate)
    margin = int(np.ceil(10 * order * rate / highest))
    white = np.random.default_rng([seed, 3]).standard_normal(samples + 2 * margin)
    noise = sosfiltfilt(butter(order, corner, fs=rate, output="sos"), white)[margin : margin + samples]
    noise -= noise.mean()
    return noise / np.sqrt(np.mean(noise**2))
