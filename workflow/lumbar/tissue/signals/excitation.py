"""The excitation signals of the tissue tests, designed from the surgeons' bandwidth, as files, tables and plain data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.settings.tissue import SignalsSettings
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.signals.multisine import Multisine, design_multisine
from lumbar.tissue.signals.spectrum import Kinematics, check_machine_limits, peak_kinematics
from lumbar.tissue.signals.surgeon_motion import bandwidth_readings, readings_in_words, summation_in_words

if TYPE_CHECKING:
    import pandas as pd


def linear_chirp(duration: float, lowest: float, highest: float, rate: float) -> np.ndarray:
    """Return a chirp sin((a t + b) t) that sweeps from one frequency to another; thesis Eq. 3.2 with amplitude 1.

    The instantaneous frequency is the derivative of the phase a t² + b t, (2 a t + b)/2π. For a sweep from f0 to f1 in T
    seconds b = 2π f0 and a = π (f1 − f0)/T; with a = 2π (f1 − f0)/T the sweep would end at 2 f1 − f0, about twice the band.

    Parameters
    ----------
    duration : float
        Seconds.
    lowest, highest : float
        Frequencies at the start and at the end, Hz.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    numpy.ndarray, shape (round(duration * rate),)

    Raises
    ------
    InputError
        If the frequencies are out of order, or not below half the rate.
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
    """Return Gaussian noise, filtered by a zero-phase low-pass filter, with mean 0 and RMS 1.

    White noise passes forward and backward through a Butterworth filter. Both passes together halve the density (−3 dB) at the
    upper end of the band, which is below the filter's corner. The middle of a longer filtered signal is used to avoid
    transients.

    Parameters
    ----------
    duration : float
        Seconds.
    highest : float
        Upper end of the band, Hz.
    rate : float
        Samples per second, Hz.
    order : int
        Order of the filter.
    seed : int
        Seed of the noise.

    Returns
    -------
    numpy.ndarray, shape (round(duration * rate),)

    Raises
    ------
    InputError
        If the corner is not below half the rate.
    """
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
    noise = scipy.signal.sosfiltfilt(scipy.signal.butter(order, corner, fs=rate, output="sos"), white)[
        margin : margin + samples
    ]
    noise -= noise.mean()
    return noise / np.sqrt(np.mean(noise**2))


@dataclass(frozen=True)
class Signal:
    """A position signal for the testing machine."""

    name: str
    """``"multisine"``, ``"noise"`` or ``"chirp"``."""
    position: np.ndarray
    """Position in mm from the machine's zero, shape (samples,)."""
    rate: float
    """Samples per second, Hz."""
    window: tuple[float, float]
    """Start and end (s) of the part for RMS, crest factor and spectrum: the second period of a multisine, else the whole
    signal."""

    @property
    def time(self) -> np.ndarray:
        """Time in seconds, shape (samples,)."""
        return np.arange(len(self.position)) / self.rate

    @property
    def steady(self) -> np.ndarray:
        """Samples within `window`."""
        start, stop = (round(end * self.rate) for end in self.window)
        return self.position[start:stop]

    def line_amplitudes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies (Hz) and amplitudes (mm), shape (lines,), of the Fourier series of `steady`, without its mean."""
        values = self.steady
        amplitudes = 2 * np.abs(np.fft.rfft(values)) / len(values)
        if len(values) % 2 == 0:
            amplitudes[-1] /= 2  # the line at half the rate has no mirror image
        return np.fft.rfftfreq(len(values), 1 / self.rate)[1:], amplitudes[1:]

    def band_power_share(self, band: float) -> float:
        """Return the share of the power of `steady` in a band, from 0 to 1.

        Parameters
        ----------
        band : float
            Upper end of the band, Hz; the lower end is 0.
        """
        frequency, amplitude = self.line_amplitudes()
        return float(np.sum(amplitude[frequency <= band + 1e-9] ** 2) / np.sum(amplitude**2))


@dataclass(frozen=True)
class Excitation:
    """The designed signals."""

    band: float
    """Upper end of the excited band, Hz."""
    signals: tuple[Signal, ...]
    """Signals in the order multisine, noise, chirp."""
    multisine: Multisine


def excited_band(bandwidths: dict, settings: SignalsSettings) -> float:
    """Return the upper end in Hz of the band to excite: a factor times the surgeons' bandwidth, rounded.

    Parameters
    ----------
    bandwidths : dict
        Result of `motion_bandwidths`.
    settings : SignalsSettings
        Quantity, rule, factor and rounding of the band.

    Raises
    ------
    InputError
        If the surgeons' spectrum has no bandwidth by the required rule.
    """
    quantity, rule = settings.bandwidth.quantity, settings.bandwidth.rule
    bandwidth = bandwidths[quantity][rule]["value_Hz"]
    if bandwidth is None:
        raise InputError(
            f"signals.bandwidth: the surgeons' {quantity} spectrum has no bandwidth by the rule {rule!r} "
            "within the analysis band: raise surgeon.bandwidth.maximum_Hz or choose the rule power_share"
        )
    step = settings.round_Hz
    band = round(settings.band_factor * bandwidth / step) * step
    if not 0 < band < settings.rate_Hz / 2:
        raise InputError(
            f"signals: {settings.band_factor:g} times the bandwidth of {bandwidth:.3g} Hz, rounded to "
            f"{step:g} Hz, is {band:g} Hz; it must lie between 0 and half of signals.rate_Hz "
            f"({settings.rate_Hz / 2:g} Hz)"
        )
    return band


def design_excitation(band: float, settings: SignalsSettings, seed: int) -> Excitation:
    """Design multisine, noise and chirp, scaled and checked against the testing machine.

    Parameters
    ----------
    band : float
        Upper end of the excited band, Hz.
    settings : SignalsSettings
        Signals, amplitude and limits of the machine.
    seed : int
        Seed of the noise and of the detection lines.

    Raises
    ------
    InputError
        If a signal cannot be designed with these settings, or exceeds the machine's limits.
    """
    rate, options, amplitude = settings.rate_Hz, settings.multisine, settings.amplitude
    multisine = design_multisine(band, options, seed)
    # The multisine's peak between samples is known exactly; that of the others is the peak of their spline.
    is_rms = amplitude.measure == "rms"
    scale = amplitude.value_mm / (1.0 if is_rms else multisine.peak)
    multisine = replace(multisine, amplitudes=scale * multisine.amplitudes)
    unscaled = {
        "noise": band_limited_noise(settings.noise.duration_s, band, rate, settings.noise.filter_order, seed),
        "chirp": linear_chirp(settings.chirp.duration_s, settings.chirp.lowest_Hz, band, rate),
    }
    period = options.period_s
    values = _ramp(settings, "multisine", multisine.sampled(rate, options.periods), at_end=False)
    signals = [Signal("multisine", values, rate, (period, 2 * period))]
    for name, values in unscaled.items():
        size = float(np.sqrt(np.mean(values**2))) if is_rms else peak_kinematics(values, rate).displacement
        values = _ramp(settings, name, values * (amplitude.value_mm / size), at_end=True)
        signals.append(Signal(name, values, rate, (0.0, len(values) / rate)))
    machine = settings.machine
    check_machine_limits(
        {signal.name: peak_kinematics(signal.position, rate) for signal in signals},
        Kinematics(machine.displacement_mm, machine.velocity_mm_s, machine.acceleration_mm_s2),
    )
    return Excitation(band, tuple(signals), multisine)


def _ramp(settings: SignalsSettings, name: str, values: np.ndarray, at_end: bool) -> np.ndarray:
    """Fade the signal in, and at the end out, by half a cosine, so that the machine does not jump.

    The multisine is faded in within its first period (the transient), and not faded out, to keep its last period intact.
    """
    samples = round(settings.ramp_s * settings.rate_Hz)
    if samples == 0:
        return values
    if samples > len(values) / (2 if at_end else 1):
        raise InputError(
            f"signals.ramp_s of {settings.ramp_s:g} s is too long for the {name} of {len(values) / settings.rate_Hz:g} s"
        )
    rise = (1 - np.cos(np.pi * np.arange(samples) / samples)) / 2
    shaped = values.copy()
    shaped[:samples] *= rise
    if at_end:
        shaped[-samples:] *= rise[::-1]
    return shaped


def machine_file(signal: Signal) -> pd.DataFrame:
    """Return the columns ``time_s, position_mm`` for the testing machine, to a nanometre.

    Parameters
    ----------
    signal : Signal
        Designed signal.
    """
    import pandas as pd

    return pd.DataFrame({"time_s": np.round(signal.time, 9), "position_mm": np.round(signal.position, 6)})


def multisine_description(excitation: Excitation, settings: SignalsSettings) -> dict:
    """Return lines, amplitudes, phases and detection lines of the multisine as plain data.

    Parameters
    ----------
    excitation : Excitation
        Designed signals.
    settings : SignalsSettings
        Settings of the design.
    """
    multisine = excitation.multisine
    return {
        "schema": "lumbar.multisine/1",
        "period_s": multisine.period,
        "periods": settings.multisine.periods,
        "rate_Hz": settings.rate_Hz,
        "ramp_s": settings.ramp_s,
        "grid": settings.multisine.grid,
        "phase_rule": settings.multisine.phases,
        "crest_factor": multisine.crest_factor,
        "lines": multisine.lines,
        "frequency_Hz": multisine.frequencies,
        "amplitude_mm": multisine.amplitudes,
        "phase_rad": multisine.phases,
        "detection_lines": {"even": multisine.detection_even, "odd": multisine.detection_odd},
    }


def signal_properties(
    excitation: Excitation, settings: SignalsSettings, source_label: str, bandwidths: dict | None = None
) -> Table:
    """Return the table of the signals and their demands on the machine.

    Parameters
    ----------
    excitation : Excitation
        Designed signals.
    settings : SignalsSettings
        Settings of the design.
    source_label : str
        Name of the source of the data.
    bandwidths : dict, optional
        Result of `motion_bandwidths`, if the band follows from it.
    """
    rows = []
    for signal in excitation.signals:
        motion = peak_kinematics(signal.position, signal.rate)
        steady = signal.steady
        rms = float(np.sqrt(np.mean(steady**2)))
        peak = motion.displacement if signal.name != "multisine" else excitation.multisine.peak
        rows.append(
            {
                "signal": signal.name,
                "duration_s": len(signal.position) / signal.rate,
                "rate_Hz": float(signal.rate),
                "band_Hz": excitation.band,
                "rms_mm": rms,
                "crest_factor": peak / rms,
                "band_power_percent": 100 * signal.band_power_share(excitation.band),
                "peak_displacement_mm": motion.displacement,
                "peak_velocity_mm_s": motion.velocity,
                "peak_acceleration_mm_s2": motion.acceleration,
                "start_jump_mm": float(abs(machine_file(signal)["position_mm"].iloc[0])),
            }
        )
    notes = [assumptions(settings)]
    if bandwidths:
        chosen = settings.bandwidth
        rules = {"power_share": "share of the power in the analysis band", "level": "level under the peak"}
        readings = [
            f"{quantity} {readings_in_words(values)}"
            for quantity, values in bandwidth_readings(bandwidths).items()
        ]
        notes.append(
            f"{excitation.band:g} Hz is {settings.band_factor:g} times the surgeons' bandwidth in {chosen.quantity} by the "
            f"{rules[chosen.rule]}, rounded to {settings.round_Hz:g} Hz. The thesis assesses the spectrum of the position. "
            f"All readings: {'; '.join(readings)}; {summation_in_words(bandwidths)}."
        )
    return table_from_schema("tissue/signals", "properties", rows, source_label, notes=notes)


def assumptions(settings: SignalsSettings) -> str:
    """Return a sentence on assumptions that are not in the thesis.

    Parameters
    ----------
    settings : SignalsSettings
        Settings of the design.
    """
    amplitude, period, noise = settings.amplitude, settings.multisine.period_s, settings.noise.filter_order
    measure = {"rms": "root mean square", "peak": "peak"}[amplitude.measure]
    return (
        f"Assumed (the thesis does not say): {amplitude.value_mm:g} mm {measure}; multisine of {period:g} s period; noise "
        f"by a Butterworth filter of order {noise}."
    )
