"""Bandwidth of a power spectral density by a stated rule."""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import InputError


def _check(frequency: np.ndarray, psd: np.ndarray, maximum: float) -> None:
    if frequency.shape != psd.shape or len(frequency) < 3:
        raise ValueError(
            f"{frequency.shape} frequencies and {psd.shape} densities; equal shapes of >= 3 lines needed"
        )
    highest = frequency[-1]
    if not frequency[1] < maximum <= highest:
        raise InputError(
            f"analysis band up to {maximum:g} Hz: the spectrum has lines from {frequency[1]:g} to "
            f"{highest:g} Hz; set surgeon.bandwidth.maximum_Hz between them"
        )
    if not np.all(np.isfinite(psd)) or psd.min() < 0 or psd[1:].max() == 0:
        raise InputError("the spectrum has no power, or densities that are negative or not finite")


def power_share_frequency(frequency: np.ndarray, psd: np.ndarray, share: float, maximum: float) -> float:
    """Frequency below which a share of the power of the analysis band lies.

    Every line stands for a cell of one line spacing around it. The line at zero is left out: it holds what
    detrending left over.

    Parameters
    ----------
    frequency : numpy.ndarray of float, shape (lines,)
        Hz, evenly spaced from 0.
    psd : numpy.ndarray of float, shape (lines,)
        One-sided density.
    share : float
        Between 0 and 1, e.g. 0.95.
    maximum : float
        Upper end of the analysis band in Hz; power above it (tremor, measuring noise) does not count.

    Returns
    -------
    float
        Hz.

    Raises
    ------
    InputError
        The analysis band does not lie within the spectrum, or there is no power.
    """
    _check(frequency, psd, maximum)
    spacing = frequency[1] - frequency[0]
    edges = np.concatenate([[frequency[1] - spacing / 2], frequency[1:] + spacing / 2])
    power = np.concatenate([[0.0], np.cumsum(psd[1:]) * spacing])
    total = np.interp(maximum, edges, power)
    return float(np.interp(share * total, power, edges))


def level_frequency(frequency: np.ndarray, psd: np.ndarray, level: float, maximum: float) -> float | None:
    """Last frequency of the analysis band at which the density is above a level under its peak.

    Parameters
    ----------
    frequency, psd : numpy.ndarray of float, shape (lines,)
        As in `power_share_frequency`.
    level : float
        Decibels relative to the peak within the analysis band, e.g. -20.
    maximum : float
        Upper end of the analysis band in Hz.

    Returns
    -------
    float or None
        Hz, interpolated between lines (logarithm of the density against frequency); ``None`` where the
        density is still above the level at the end of the analysis band, so that the rule has no answer
        there.

    Raises
    ------
    InputError
        As `power_share_frequency`.
    """
    _check(frequency, psd, maximum)
    last = int(np.searchsorted(frequency, maximum, side="right"))
    inside, density = frequency[1:last], psd[1:last]
    threshold = density.max() * 10 ** (level / 10)
    above = int(np.flatnonzero(density > threshold)[-1])
    if above == len(inside) - 1:
        return None
    # A density of zero is as far below the level as can be: the crossing is then at the line above it.
    upper, lower = np.log(density[above]), np.log(max(density[above + 1], np.finfo(float).tiny))
    step = (upper - np.log(threshold)) / (upper - lower)
    return float(inside[above] + step * (inside[above + 1] - inside[above]))
