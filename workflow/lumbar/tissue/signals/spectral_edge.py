"""Where the power of a motion's spectrum lies: below which frequency, or between which two."""

from __future__ import annotations

import numpy as np

_OCCUPIED = 0.99
"""Share of the power within an occupied band."""


def spectral_edge(signal: np.ndarray, share: float) -> float:
    """Return the frequency (cycles per sample) below which a share of a signal's power lies; at least one cycle per record.

    The signal is tapered, so that a drift from its beginning to its end does not pass for high frequencies: for what has to
    follow the whole of a motion.

    Parameters
    ----------
    signal : numpy.ndarray, shape (samples,)
        Without its mean, unless that is to count.
    share : float
        Between 0 and 1.
    """
    power = np.cumsum(np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2)
    return max(float(np.searchsorted(power, share * power[-1])), 1.0) / len(signal)


def occupied_band(position: np.ndarray, sampling_time: float) -> tuple[float, float]:
    """Return the lowest and the highest frequency (Hz) that bound 99 % of the power of a position, as much beyond either.

    Not tapered as `spectral_edge`: the lines of a periodic motion stay single lines, so that the edges are lines of it. Of
    the position, not the velocity, in which the steps of a coarse encoder would pass for motion.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
    sampling_time : float
        Seconds.
    """
    power = np.abs(np.fft.rfft(position - position.mean())) ** 2
    share = np.cumsum(power) / power.sum()
    frequency = np.fft.rfftfreq(len(position), sampling_time)
    tail = (1 - _OCCUPIED) / 2
    low, high = np.searchsorted(share, [tail, 1 - tail])
    return float(max(frequency[low], frequency[1])), float(frequency[high])
