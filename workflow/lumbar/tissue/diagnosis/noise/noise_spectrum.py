"""The level of a noise spectrum, from few periods and whatever lines stand in it."""

from __future__ import annotations

import numpy as np

FEWEST_LINES = 5
"""Lines of a band whose median is deaf to a sinusoid in it."""
_MOST_LINES = 24


def taper(samples: int) -> np.ndarray:
    """Half a sine of RMS 1: without it the jump from a row's end to its start covers the weak end of a spectrum."""
    return np.sqrt(2) * np.sin(np.pi * (np.arange(samples) + 0.5) / samples)


def line_power(rows: np.ndarray, degrees: float) -> np.ndarray:
    """Mean power of the rows at 0, 1, 2, … cycles per row, as variance per sample.

    Parameters
    ----------
    rows : numpy.ndarray, shape (periods, samples)
    degrees : float
        Rows' worth of degrees of freedom that are left in them.
    """
    return np.sum(np.abs(np.fft.rfft(rows, axis=1)) ** 2, axis=0) / (rows.shape[1] * degrees)


def smooth_power(power: np.ndarray, degrees: float, bins_per_line: int = 1) -> np.ndarray:
    """Level of a noise spectrum: medians over bands that widen with frequency, deaf to single lines.

    Parameters
    ----------
    power : numpy.ndarray, shape (bins,)
        Power at 0, 1, 2, … bins, mean of `degrees` rows.
    bins_per_line : int
        How much finer than lines the power is given.

    Returns
    -------
    numpy.ndarray, shape (bins,)
        Positive.
    """
    fewest, most = FEWEST_LINES * bins_per_line, _MOST_LINES * bins_per_line
    centres, levels, start, last = [], [], 1, len(power) - 1
    while start < last:
        stop = min(start + min(max(fewest, start // 3), most), last)
        if last - stop < fewest:
            stop = last
        centres.append(0.5 * (start + stop - 1))
        levels.append(np.median(power[start:stop]))
        start = stop
    if not levels:
        centres, levels = [1.0], [power.mean()]
    # Towards frequency 0 a spectrum may go on rising as it does between the lowest two bands.
    if len(centres) > 1:
        slope = (
            np.log(levels[1] / levels[0]) / np.log(centres[1] / centres[0]) if min(levels[:2]) > 0 else 0.0
        )
        centres.insert(0, max(0.5, centres[0] / 4))
        levels.insert(0, levels[0] * (centres[0] / centres[1]) ** np.clip(slope, -2, 0))
    # Median of a mean of squares, by Wilson and Hilferty's cube root.
    levels = np.array(levels) / (1 - 1 / (9 * max(degrees, 0.5))) ** 3
    levels = np.maximum(levels, 1e-12 * power.max() + 1e-300)
    return np.exp(np.interp(np.arange(len(power)), centres, np.log(levels)))


def excess(statistic: float, degrees: float) -> float:
    """Standard deviations of a χ² statistic above its mean (Wilson and Hilferty, PNAS 17, 1931)."""
    spread = 2 / (9 * degrees)
    return ((statistic / degrees) ** (1 / 3) - (1 - spread)) / np.sqrt(spread)
