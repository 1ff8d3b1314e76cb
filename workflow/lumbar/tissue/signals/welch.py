"""Power spectral densities of position and velocity by Welch's method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError

if TYPE_CHECKING:
    from lumbar.settings.surgeon import WelchSettings

QUANTITIES = ("position", "velocity")
"""Quantities whose spectra are analysed, each from the same position recording."""


def position_psd(position: np.ndarray, rate: float, settings: WelchSettings) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density of a position recording.

    Parameters
    ----------
    position : numpy.ndarray of float, shape (samples,)
    rate : float
        Samples per second, Hz.

    Returns
    -------
    frequency : numpy.ndarray of float, shape (lines,)
        Hz, evenly spaced from 0 to half the rate.
    psd : numpy.ndarray of float, shape (lines,)
        Unit of position squared per hertz; summed over the lines and multiplied by their distance it is the
        variance.

    Raises
    ------
    InputError
        The recording is shorter than one segment, or a segment has fewer than 8 samples.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73.
    """
    return _welch(position, rate, settings, needed_besides=0)


def velocity_psd(position: np.ndarray, rate: float, settings: WelchSettings) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density of the velocity of a position recording.

    The recording is differenced before it is windowed. Multiplying the position's density by (2πf)² would be
    the same in theory, but the window's side lobes of the slow, large motion would be multiplied too:
    differencing first flattens the spectrum (prewhitening) and turns a steady advance into a constant that
    detrending removes. A first difference has the gain 2·rate·sin(πf/rate) in place of 2πf; the ratio is
    divided out.

    Parameters
    ----------
    position : numpy.ndarray of float, shape (samples,)
    rate : float
        Samples per second, Hz.

    Returns
    -------
    frequency : numpy.ndarray of float, shape (lines,)
        Hz, the lines of `position_psd`.
    psd : numpy.ndarray of float, shape (lines,)
        (Unit of position per second) squared per hertz.

    Raises
    ------
    InputError
        As `position_psd`; the recording has to be one sample longer than a segment.
    """
    frequency, psd = _welch(np.diff(position) * rate, rate, settings, needed_besides=1)
    # numpy.sinc(x) is sin(πx)/(πx): the gain of the difference relative to that of a differentiator.
    return frequency, psd / np.sinc(frequency / rate) ** 2


def _welch(
    values: np.ndarray, rate: float, settings: WelchSettings, needed_besides: int
) -> tuple[np.ndarray, np.ndarray]:
    """Call `scipy.signal.welch` on values made from a recording `needed_besides` samples longer."""
    from scipy.signal import welch

    samples = round(settings.segment_s * rate)
    if samples < 8:
        raise InputError(
            f"Welch segment of {settings.segment_s:g} s has {samples} samples at {rate:g} Hz; 8 are needed"
        )
    if samples > len(values):
        recorded = len(values) + needed_besides
        raise InputError(
            f"the recording has {recorded} samples ({recorded / rate:g} s); a Welch segment of "
            f"{settings.segment_s:g} s needs {samples + needed_besides}: shorten "
            "surgeon.welch.segment_s or leave the recording out"
        )
    return welch(
        values,
        fs=rate,
        window=settings.window,
        nperseg=samples,
        noverlap=min(int(settings.overlap * samples), samples - 1),
        detrend=settings.detrend,
    )
