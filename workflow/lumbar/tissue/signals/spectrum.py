"""Spectra by Welch's method, their bandwidth by a stated rule, and the range and peaks of a motion."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.base.errors import InputError, Problems
from lumbar.settings.tissue import WelchSettings
from lumbar.tissue.models.model_data import MotionRange

QUANTITIES = ("position", "velocity")
"""Quantities whose spectra are analysed, each from the same position recording."""


def motion_psd(
    position: np.ndarray, rate: float, settings: WelchSettings, quantity: str = "position"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the one-sided power spectral density of a position recording, or of its velocity.

    For the velocity the recording is differenced before it is windowed. This flattens the spectrum (prewhitening) and turns a
    steady advance into a constant that detrending removes; multiplied by (2πf)², the position's density would also contain
    the window's side lobes of the slow, large motion. The gain 2·rate·sin(πf/rate) of a difference is replaced by 2πf.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        Position, e.g. in mm.
    rate : float
        Samples per second, Hz.
    settings : WelchSettings
        Length, overlap, window and detrending of the segments.
    quantity : str
        ``"position"`` or ``"velocity"``.

    Returns
    -------
    frequency : numpy.ndarray, shape (lines,)
        Hz, evenly spaced from 0 to half the rate.
    psd : numpy.ndarray, shape (lines,)
        Unit of the quantity squared per hertz; its sum times the distance of lines is the variance.

    Raises
    ------
    InputError
        If a segment is longer than the recording, or has fewer than 8 samples.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73.
    """
    is_velocity = quantity == "velocity"
    values = np.diff(position) * rate if is_velocity else position
    samples = round(settings.segment_s * rate)
    if samples < 8:
        raise InputError(
            f"Welch segment of {settings.segment_s:g} s has {samples} samples at {rate:g} Hz; 8 are needed"
        )
    if samples > len(values):
        raise InputError(
            f"the recording has {len(position)} samples ({len(position) / rate:g} s); a Welch segment of "
            f"{settings.segment_s:g} s needs {samples + is_velocity}: shorten surgeon.welch.segment_s or leave the recording out"
        )
    frequency, psd = scipy.signal.welch(
        values,
        fs=rate,
        window=settings.window,
        nperseg=samples,
        noverlap=min(int(settings.overlap * samples), samples - 1),
        detrend=settings.detrend,
    )
    # numpy.sinc(x) is sin(πx)/(πx): the gain of the difference relative to that of a differentiator.
    return frequency, psd / np.sinc(frequency / rate) ** 2 if is_velocity else psd


def welch(
    values: np.ndarray, sampling_time: float, window: np.ndarray, degree: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and one-sided power spectral density by Welch's method, with segments that overlap by half.

    The result equals `scipy.signal.welch`, but its import would take a tenth of the time of a diagnosis.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
        Samples in any unit.
    sampling_time : float
        Seconds.
    window : numpy.ndarray, shape (length,)
        Weights of the samples of a segment.
    degree : int
        Degree of the polynomial subtracted from every segment: 0 its mean, 1 its straight line.

    Returns
    -------
    frequency : numpy.ndarray, shape (length // 2 + 1,)
        Hz.
    psd : numpy.ndarray, shape (length // 2 + 1,)
        Unit of the values squared per hertz.
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


def spectral_edge(signal: np.ndarray, share: float) -> float:
    """Return the frequency (cycles per sample) that has a share of a signal's power below it; at least one cycle per record.

    The signal, with its mean, is tapered, so that a drift from start to end is not mistaken for high frequencies.

    Parameters
    ----------
    signal : numpy.ndarray, shape (samples,)
        Samples in any unit.
    share : float
        Between 0 and 1.
    """
    power = np.cumsum(np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2)
    return max(float(np.searchsorted(power, share * power[-1])), 1.0) / len(signal)


def occupied_band(position: np.ndarray, sampling_time: float, occupied: float = 0.99) -> tuple[float, float]:
    """Return the two frequencies (Hz) that bound a share of the power of a position, with equal power below and above.

    The position is not tapered as in `spectral_edge`, so that the edges are lines of a periodic motion. Steps of a coarse encoder
    would dominate its velocity. A rest occupies the lowest line.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        Position in any unit.
    sampling_time : float
        Seconds.
    occupied : float
        Share of the power between both frequencies.
    """
    power = np.abs(np.fft.rfft(position - position.mean())) ** 2
    frequency = np.fft.rfftfreq(len(position), sampling_time)
    if not power.any():
        return float(frequency[1]), float(frequency[1])
    share = np.cumsum(power) / power.sum()
    tail = (1 - occupied) / 2
    low, high = np.searchsorted(share, [tail, 1 - tail])
    return float(max(frequency[low], frequency[1])), float(frequency[high])


def _check_spectrum(frequency: np.ndarray, psd: np.ndarray, maximum: float) -> None:
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
    """Return the frequency in Hz that has a share of the analysis band's power below it.

    Every line represents a cell of one line spacing around it. The line at zero, a remainder of detrending, is excluded.

    Parameters
    ----------
    frequency, psd : numpy.ndarray, shape (lines,)
        Hz, evenly spaced from 0; one-sided density.
    share : float
        Between 0 and 1, e.g. 0.95.
    maximum : float
        Upper end of the analysis band in Hz; power above it (tremor, measuring noise) does not count.

    Raises
    ------
    InputError
        If the analysis band is not within the spectrum, or the spectrum has no power.
    """
    _check_spectrum(frequency, psd, maximum)
    spacing = frequency[1] - frequency[0]
    edges = np.concatenate([[frequency[1] - spacing / 2], frequency[1:] + spacing / 2])
    power = np.concatenate([[0.0], np.cumsum(psd[1:]) * spacing])
    total = np.interp(maximum, edges, power)
    return float(np.interp(share * total, power, edges))


def level_frequency(frequency: np.ndarray, psd: np.ndarray, level: float, maximum: float) -> float | None:
    """Return the last frequency (Hz) of the analysis band at which the density is above a level below its peak.

    It is interpolated between lines (logarithm of the density against frequency); ``None`` if the density is above the level at
    the end of the analysis band.

    Parameters
    ----------
    frequency, psd : numpy.ndarray, shape (lines,)
        Hz, evenly spaced from 0; one-sided density.
    level : float
        Decibels relative to the peak, e.g. -20.
    maximum : float
        Upper end of the analysis band, Hz.

    Raises
    ------
    InputError
        If the analysis band is not within the spectrum, or the spectrum has no power.
    """
    _check_spectrum(frequency, psd, maximum)
    last = int(np.searchsorted(frequency, maximum, side="right"))
    inside, density = frequency[1:last], psd[1:last]
    threshold = density.max() * 10 ** (level / 10)
    above = int(np.flatnonzero(density > threshold)[-1])
    if above == len(inside) - 1:
        return None
    # If the next density is zero, the crossing is at the line above the level.
    upper, lower = np.log(density[above]), np.log(max(density[above + 1], np.finfo(float).tiny))
    step = (upper - np.log(threshold)) / (upper - lower)
    return float(inside[above] + step * (inside[above + 1] - inside[above]))


def motion_range(position: np.ndarray, sampling_time: float) -> MotionRange:
    """Return the range of positions, the speed and the band of a motion.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        At least three positions in any unit.
    sampling_time : float
        Seconds.

    Examples
    --------
    >>> time = np.arange(1000) * 0.01
    >>> covered = motion_range(2 * np.sin(2 * np.pi * time), 0.01)
    >>> print(f"{covered.lowest:.1f} to {covered.highest:.1f}, {covered.speed:.1f}/s, {covered.highest_Hz:.1f} Hz")
    -2.0 to 2.0, 12.6/s, 1.0 Hz
    """
    speeds = np.abs(np.diff(position)) / sampling_time  # the fastest percent may be noise of the sensor
    low, high = occupied_band(position, sampling_time)
    return MotionRange(
        lowest=float(position.min()),
        highest=float(position.max()),
        speed=float(np.quantile(speeds, 0.99)),
        lowest_Hz=low,
        highest_Hz=high,
    )


@dataclass(frozen=True)
class Kinematics:
    """Peaks of a motion, including values between samples."""

    displacement: float
    """Largest displacement from the machine's zero in mm."""
    velocity: float
    """Largest velocity in mm/s."""
    acceleration: float
    """Largest acceleration in mm/s²."""


_UNITS = {"displacement": "mm", "velocity": "mm/s", "acceleration": "mm/s²"}


def peak_kinematics(position: np.ndarray, rate: float) -> Kinematics:
    """Return peak displacement, velocity and acceleration of the smooth motion through samples.

    The motion is a quintic spline; differences of samples would miss the peaks between them and underestimate the acceleration
    of a sine of 20 samples per cycle by 0.8 %.

    Parameters
    ----------
    position : numpy.ndarray, shape (samples,)
        At least 6 samples, mm.
    rate : float
        Samples per second, Hz.
    """
    time = np.arange(len(position)) / rate
    spline = scipy.interpolate.make_interp_spline(time, position, k=5)
    fine = np.linspace(0, time[-1], 8 * (len(position) - 1) + 1)
    displacement, velocity, acceleration = (np.abs(spline(fine, nu=order)).max() for order in range(3))
    return Kinematics(float(displacement), float(velocity), float(acceleration))


def check_machine_limits(motions: dict[str, Kinematics], limits: Kinematics) -> None:
    """Reject signals that the testing machine cannot play.

    Parameters
    ----------
    motions : dict of str to Kinematics
        Peaks of each signal by its name.
    limits : Kinematics
        Largest values of the machine.

    Raises
    ------
    InputError
        If a limit is exceeded. The message has signal, quantity, value, limit and the required scale factor of every violation.
    """
    problems = Problems("excitation signals")
    for name, motion in motions.items():
        for quantity, unit in _UNITS.items():
            value, limit = getattr(motion, quantity), getattr(limits, quantity)
            if value > limit:
                # Three digits, rounded down so that the advice is sufficient.
                digits = 2 - int(np.floor(np.log10(limit / value)))
                factor = f"{np.floor(limit / value * 10**digits) / 10**digits:.{max(digits, 0)}f}"
                problems.add(
                    name,
                    f"peak {quantity} is {value:.4g} {unit}, the machine's limit is {limit:g} {unit}",
                    f"multiply signals.amplitude.value_mm by at most {factor} or change signals.machine",
                )
    problems.raise_if_any()
