"""The three excitation signals of the tissue tests, designed from the surgeons' bandwidth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.signals.band_limited_noise import band_limited_noise
from lumbar.tissue.signals.chirp import linear_chirp
from lumbar.tissue.signals.machine_limits import Kinematics, check_machine_limits, peak_kinematics
from lumbar.tissue.signals.multisine import Multisine, design_multisine

if TYPE_CHECKING:
    from lumbar.settings.signals import AmplitudeSettings, SignalsSettings


@dataclass(frozen=True)
class Signal:
    """A position signal as the testing machine plays it."""

    name: str
    """``"multisine"``, ``"noise"`` or ``"chirp"``."""
    position: np.ndarray
    """Shape (samples,): mm from the machine's zero."""
    rate: float
    """Samples per second, Hz."""
    window: tuple[float, float]
    """Start and end in seconds of the part that the signal's RMS, crest factor and spectrum refer to: a period after the
    first for the multisine, all of the others."""

    @property
    def time(self) -> np.ndarray:
        """Seconds, shape (samples,)."""
        return np.arange(len(self.position)) / self.rate

    @property
    def steady(self) -> np.ndarray:
        """Samples within `window`."""
        start, stop = (round(end * self.rate) for end in self.window)
        return self.position[start:stop]

    def line_amplitudes(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (Hz) and amplitudes (mm) of the Fourier series of `steady`, its mean left out."""
        values = self.steady
        amplitudes = 2 * np.abs(np.fft.rfft(values)) / len(values)
        if len(values) % 2 == 0:
            amplitudes[-1] /= 2  # the line at half the rate has no mirror image
        return np.fft.rfftfreq(len(values), 1 / self.rate)[1:], amplitudes[1:]

    def band_power_share(self, band: float) -> float:
        """Share of the power of `steady` at or below `band` Hz, from 0 to 1."""
        frequency, amplitude = self.line_amplitudes()
        return float(np.sum(amplitude[frequency <= band + 1e-9] ** 2) / np.sum(amplitude**2))


@dataclass(frozen=True)
class Excitation:
    """The designed signals and what they were designed from."""

    band: float
    """Upper end of the excited band, Hz."""
    signals: tuple[Signal, ...]
    """Multisine, noise, chirp."""
    multisine: Multisine
    """Lines, amplitudes and phases of the multisine."""


def excited_band(bandwidths: dict, settings: SignalsSettings) -> float:
    """Upper end of the band to excite: a factor times the surgeons' bandwidth, rounded.

    Parameters
    ----------
    bandwidths : dict
        As `lumbar.tissue.signals.surgeon_motion.motion_bandwidths` returns it.

    Returns
    -------
    float
        Hz.

    Raises
    ------
    InputError
        The surgeons' spectrum has no bandwidth by the rule asked for.
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
    """Design multisine, noise and chirp up to `band`, scaled and checked against the testing machine.

    Parameters
    ----------
    band : float
        Upper end of the band, Hz.
    seed : int
        For the noise and the detection lines.

    Raises
    ------
    InputError
        A signal cannot be designed with these settings, or asks more than the machine can do.
    """
    rate, options = settings.rate_Hz, settings.multisine
    multisine = design_multisine(
        options.period_s,
        band,
        options.grid,
        options.detection_group,
        options.phases,
        options.amplitude_exponent,
        seed,
    )
    if multisine.lines[-1] >= options.period_s * rate / 2:
        raise InputError(
            f"multisine up to {multisine.frequencies[-1]:g} Hz: signals.rate_Hz of {rate:g} is too low"
        )
    # The multisine's peak between samples is known exactly; the others' is that of their spline.
    scale = _scale(1.0, multisine.peak, settings.amplitude)
    multisine = replace(multisine, amplitudes=scale * multisine.amplitudes)
    period, periods = options.period_s, options.periods
    plain = {
        "multisine": multisine.sampled(rate, periods),
        "noise": band_limited_noise(settings.noise.duration_s, band, rate, settings.noise.filter_order, seed),
        "chirp": linear_chirp(settings.chirp.duration_s, settings.chirp.lowest_Hz, band, rate),
    }
    signals = []
    for name, values in plain.items():
        if name != "multisine":
            rms = float(np.sqrt(np.mean(values**2)))
            values = values * _scale(rms, peak_kinematics(values, rate).displacement, settings.amplitude)
        window = (period * min(1, periods - 1), period * min(2, periods))
        signals.append(
            Signal(
                name,
                _ramped(name, values, rate, settings.ramp_s, at_end=name != "multisine"),
                rate,
                window if name == "multisine" else (0.0, len(values) / rate),
            )
        )
    machine = settings.machine
    check_machine_limits(
        {signal.name: peak_kinematics(signal.position, rate) for signal in signals},
        Kinematics(machine.displacement_mm, machine.velocity_mm_s, machine.acceleration_mm_s2),
    )
    return Excitation(band, tuple(signals), multisine)


def _scale(rms: float, peak: float, amplitude: AmplitudeSettings) -> float:
    """Factor that gives a signal the RMS or the peak asked for."""
    return amplitude.value_mm / (rms if amplitude.measure == "rms" else peak)


def _ramped(name: str, values: np.ndarray, rate: float, ramp: float, at_end: bool) -> np.ndarray:
    """Raise the signal from zero by half a cosine (and lower it at the end): the machine does not jump.

    The multisine is raised within its first period, which is left out as transient, and not lowered: its last
    period stays a period.
    """
    samples = round(ramp * rate)
    if samples == 0:
        return values
    if samples > len(values) / (2 if at_end else 1):
        raise InputError(
            f"signals.ramp_s of {ramp:g} s is too long for the {name} of {len(values) / rate:g} s"
        )
    rise = (1 - np.cos(np.pi * np.arange(samples) / samples)) / 2
    shaped = values.copy()
    shaped[:samples] *= rise
    if at_end:
        shaped[-samples:] *= rise[::-1]
    return shaped
