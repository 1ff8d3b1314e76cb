"""Spectra by Welch's method with the bandwidth by a stated rule, and what a motion covers and asks of a machine."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.base.errors import InputError, Problems
from lumbar.settings.signals import WelchSettings
from lumbar.tissue.models.model_data import MotionRange

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
    """One-sided power spectral density of the velocity of a position recording, in (its unit per second)² per hertz.

    The recording is differenced before it is windowed. Multiplying the position's density by (2πf)² would be
    the same in theory, but the window's side lobes of the slow, large motion would be multiplied too:
    differencing first flattens the spectrum (prewhitening) and turns a steady advance into a constant that
    detrending removes. A first difference has the gain 2·rate·sin(πf/rate) in place of 2πf; the ratio is
    divided out.

    Arguments, lines and errors are those of `position_psd`; the recording has to be one sample longer than a segment.
    """
    frequency, psd = _welch(np.diff(position) * rate, rate, settings, needed_besides=1)
    # numpy.sinc(x) is sin(πx)/(πx): the gain of the difference relative to that of a differentiator.
    return frequency, psd / np.sinc(frequency / rate) ** 2


def welch(
    values: np.ndarray, sampling_time: float, window: np.ndarray, degree: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and one-sided power spectral density by Welch's method, with segments that overlap by half.

    As `scipy.signal.welch`, whose import takes a tenth of a diagnosis. Of every segment of the window's length the mean is taken
    off, with `degree` 1 the straight line.
    """
    length = len(window)
    segments = sliding_window_view(values, length)[:: length - length // 2]
    segments = segments - segments.mean(axis=1, keepdims=True)
    if degree:
        line = np.linspace(-1, 1, length)
        segments -= np.outer(segments @ line / (line @ line), line)
    power = np.mean(np.abs(np.fft.rfft(window * segments)) ** 2, axis=0) * sampling_time / (window @ window)
    power[1 : (length + 1) // 2] *= 2
    return np.fft.rfftfreq(length, sampling_time), power


def _welch(
    values: np.ndarray, rate: float, settings: WelchSettings, needed_besides: int
) -> tuple[np.ndarray, np.ndarray]:
    """Call `scipy.signal.welch` on values made from a recording `needed_besides` samples longer."""
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
    return scipy.signal.welch(
        values,
        fs=rate,
        window=settings.window,
        nperseg=samples,
        noverlap=min(int(settings.overlap * samples), samples - 1),
        detrend=settings.detrend,
    )


_OCCUPIED = 0.99  # share of the power within an occupied band


def spectral_edge(signal: np.ndarray, share: float) -> float:
    """Return the frequency (cycles per sample) below which a share of a signal's power lies; at least one cycle per record.

    The signal is tapered, so that a drift from its start to its end is not mistaken for high frequencies. For methods that must
    follow the whole motion.

    Parameters
    ----------
    signal : numpy.ndarray, shape (samples,)
        Without its mean, unless that is to count.
    share : float
        Between 0 and 1.
    """
    power = np.cumsum(np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2)
    return max(float(np.searchsorted(power, share * power[-1])), 1.0) / len(signal)


def occupied_band(
    position: np.ndarray, sampling_time: float, occupied: float = _OCCUPIED
) -> tuple[float, float]:
    """Return the lowest and the highest frequency (Hz) that bound 99 % of the power of a position, as much beyond either.

    Not tapered as `spectral_edge`: the lines of a periodic motion stay single lines, so that the edges are lines of it. The
    position is used, not the velocity, in which the steps of a coarse encoder are mistaken for motion.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
    sampling_time : float
        Seconds.
    occupied : float
        Another share of the power.
    """
    power = np.abs(np.fft.rfft(position - position.mean())) ** 2
    share = np.cumsum(power) / power.sum()
    frequency = np.fft.rfftfreq(len(position), sampling_time)
    tail = (1 - occupied) / 2
    low, high = np.searchsorted(share, [tail, 1 - tail])
    return float(max(frequency[low], frequency[1])), float(frequency[high])


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
    """Frequency in Hz below which a share of the power of the analysis band lies.

    Every line represents a cell of one line spacing around it. The line at zero is left out: it is a remainder of
    detrending.

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

    Raises
    ------
    InputError
        If the analysis band is not within the spectrum, or the spectrum has no power.
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


_SPEED_SHARE = 0.99
"""Share of the samples below the reported speed: the fastest ones may be noise of the sensor."""


def motion_range(position: np.ndarray, sampling_time: float) -> MotionRange:
    """Return the range of positions, the speed and the band of a motion.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        At least three samples, not all equal.
    sampling_time : float
        Seconds.

    Examples
    --------
    >>> time = np.arange(1000) * 0.01
    >>> covered = motion_range(2 * np.sin(2 * np.pi * time), 0.01)
    >>> print(f"{covered.lowest:.1f} to {covered.highest:.1f}, {covered.speed:.1f}/s, {covered.highest_Hz:.1f} Hz")
    -2.0 to 2.0, 12.6/s, 1.0 Hz
    """
    speeds = np.abs(np.diff(position)) / sampling_time
    low, high = occupied_band(position, sampling_time)
    return MotionRange(
        lowest=float(position.min()),
        highest=float(position.max()),
        speed=float(np.quantile(speeds, _SPEED_SHARE)),
        lowest_Hz=low,
        highest_Hz=high,
    )


_POINTS_PER_SAMPLE = 8


@dataclass(frozen=True)
class Kinematics:
    """Peaks of the motion a signal commands, between samples too."""

    displacement: float
    """mm from the machine's zero."""
    velocity: float
    """mm/s."""
    acceleration: float
    """mm/s²."""


_PEAKS = {"displacement": "mm", "velocity": "mm/s", "acceleration": "mm/s²"}


def peak_kinematics(position: np.ndarray, rate: float) -> Kinematics:
    """Peak displacement, velocity and acceleration of the smooth motion through the samples.

    The motion is a quintic spline; differences of samples would miss the peaks between them and underestimate the
    acceleration of a sine of 20 samples per cycle by 0.8 %.

    Parameters
    ----------
    position : numpy.ndarray of float, shape (samples,)
        mm, at least 6 samples.
    rate : float
        Samples per second, Hz.
    """
    time = np.arange(len(position)) / rate
    spline = scipy.interpolate.make_interp_spline(time, position, k=5)
    fine = np.linspace(0, time[-1], _POINTS_PER_SAMPLE * (len(position) - 1) + 1)
    displacement, velocity, acceleration = (np.abs(spline(fine, nu=order)).max() for order in range(3))
    return Kinematics(float(displacement), float(velocity), float(acceleration))


def check_machine_limits(motions: dict[str, Kinematics], limits: Kinematics) -> None:
    """Raise if the testing machine cannot play the signals.

    Raises
    ------
    InputError
        Naming signal, quantity, value, limit and the factor by which to scale the signal, for every
        violation.
    """
    problems = Problems("excitation signals")
    for name, motion in motions.items():
        for quantity, unit in _PEAKS.items():
            value, limit = getattr(motion, quantity), getattr(limits, quantity)
            if value > limit:
                # Three digits that are never more than the factor, so that following the advice is enough.
                digits = 2 - int(np.floor(np.log10(limit / value)))
                factor = f"{np.floor(limit / value * 10**digits) / 10**digits:.{max(digits, 0)}f}"
                problems.add(
                    name,
                    f"peak {quantity} is {value:.4g} {unit}, the machine's limit is {limit:g} {unit}",
                    f"multiply signals.amplitude.value_mm by at most {factor} or change signals.machine",
                )
    problems.raise_if_any()
