"""Chapter signals: excitation of the tissue tests, designed from the surgeons' bandwidth."""

from __future__ import annotations

from typing import Literal

from lumbar.settings.key import key, section, settings


@settings
class ExcitedBandwidthSettings:
    """Which of the surgeons' bandwidths is excited."""

    quantity: Literal["position", "velocity"] = key("velocity", "Quantity whose spectrum counts.")
    rule: Literal["power_share", "level"] = key("power_share", "Rule of surgeon.bandwidth.")


@settings
class AmplitudeSettings:
    """Scale of all signals, before a ramp."""

    measure: Literal["rms", "peak"] = key("rms", "Whether value_mm is the root mean square or the peak.")
    value_mm: float = key(2.0, "Amplitude.", unit="mm", gt=0, le=1000)


@settings
class MultisineSettings:
    """Multisine of Eq. 3.1."""

    period_s: float = key(
        10.0, "Period, a whole number of samples; lines lie 1/period_s Hz apart.", unit="s", gt=0, le=1000
    )
    periods: int = key(10, "Periods played; the first is left out as transient.", ge=2, le=1000)
    grid: Literal["full", "odd"] = key(
        "full",
        "full: every line (thesis); odd: odd lines, some left out, so that power on the others shows "
        "nonlinearity.",
    )
    detection_group: int = key(
        4, "Odd grid: one line, drawn at random, of this many consecutive odd lines is left out.", ge=2, le=20
    )
    phases: Literal["schroeder", "clipped", "zero"] = key(
        "schroeder",
        "schroeder (thesis), clipped (lowest crest factor, by iterated clipping) or zero (an impulse "
        "train, only to compare with).",
    )
    amplitude_exponent: float = key(
        0.0, "Amplitudes are in proportion to f to this power; 0 is flat as in Eq. 3.1.", ge=-4, le=4
    )


@settings
class NoiseSettings:
    """Band-limited Gaussian noise."""

    duration_s: float = key(10.0, "Duration.", unit="s", gt=0, le=10000)
    filter_order: int = key(
        8,
        "Order of the Butterworth low-pass, run forward and backward; -3 dB lies at the upper end of "
        "the band.",
        ge=1,
        le=20,
    )


@settings
class ChirpSettings:
    """Linear chirp of Eq. 3.2."""

    duration_s: float = key(10.0, "Duration.", unit="s", gt=0, le=10000)
    lowest_Hz: float = key(
        0.0, "Frequency at which the sweep begins; it ends at the upper end of the band.", unit="Hz", ge=0
    )


@settings
class MachineSettings:
    """Limits of the testing machine, from its data sheet; the defaults suit an electrodynamic one of 60 mm stroke."""

    displacement_mm: float = key(30.0, "Largest displacement from the middle.", unit="mm", gt=0)
    velocity_mm_s: float = key(1000.0, "Largest velocity.", unit="mm/s", gt=0)
    acceleration_mm_s2: float = key(
        20000.0,
        "Largest acceleration with tool and grips, i.e. dynamic force over moved mass.",
        unit="mm/s²",
        gt=0,
    )


@settings
class SignalsSettings:
    """Excitation signals designed from the surgeons' bandwidth (Eqs 3.1 and 3.2 of the thesis)."""

    bandwidth: ExcitedBandwidthSettings = section(ExcitedBandwidthSettings)
    band_factor: float = key(
        2.0,
        "The signals excite up to this factor times the bandwidth (thesis: 2, its 'Nyquist rate').",
        ge=0.1,
        le=20,
    )
    round_Hz: float = key(
        0.5,
        "The upper end of the excited band is rounded to the nearest multiple of this.",
        unit="Hz",
        gt=0,
        le=10,
    )
    rate_Hz: float = key(100.0, "Samples per second of the signals.", unit="Hz", ge=1, le=10000)
    amplitude: AmplitudeSettings = section(AmplitudeSettings)
    ramp_s: float = key(
        0.0,
        "Every signal is raised from zero by half a cosine of this length; noise and chirp are also "
        "lowered at the end. 0 leaves them as designed. The multisine's first period is then no "
        "period.",
        unit="s",
        ge=0,
        le=60,
    )
    multisine: MultisineSettings = section(MultisineSettings)
    noise: NoiseSettings = section(NoiseSettings)
    chirp: ChirpSettings = section(ChirpSettings)
    machine: MachineSettings = section(MachineSettings)
