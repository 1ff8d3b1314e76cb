"""Linear chirp (thesis Eq. 3.2)."""

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
