"""Chapters surgeon and signals: motion of the surgeons' tool with its bandwidth, and the excitation designed from it."""

from typing import Literal

from pydantic import Field, field_validator

from lumbar.settings.layout import ColumnLayout, columns
from lumbar.settings.section import RecordName, Section


class SurgeonRecord(Section):
    """One trial."""

    name: RecordName
    """Name of the trial, unique; pooled is the name of the mean."""
    file: str = Field(min_length=1)
    """Recording, below the data root."""
    surgeon: str = Field(min_length=1)
    """Surgeon who moved the tool; trials of one surgeon are resampled together."""

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if name == "pooled":
            raise ValueError("pooled is the name of the mean of all trials")
        return name


class WelchSettings(Section):
    """Welch's method."""

    segment_s: float = Field(10.24, gt=0)
    """Length of a segment; the distance of frequency lines is 1/segment_s Hz."""
    overlap: float = Field(0.5, ge=0, le=0.95)
    """Overlap of consecutive segments as a share of a segment."""
    window: Literal["hann", "hamming", "blackman", "boxcar", "bartlett", "flattop"] = "hann"
    """Window of every segment."""
    detrend: Literal["constant", "linear"] = "constant"
    """Part that is subtracted from every segment: its mean, or its straight line."""


class BandwidthSettings(Section):
    """Rules for a bandwidth, and its interval."""

    power_share: float = Field(0.95, ge=0.5, le=0.999)
    """Rule power_share: the bandwidth is the frequency below which this share of the power in the band is."""
    level_dB: float = Field(-20.0, ge=-60, le=-1)
    """Rule level: the bandwidth is the last frequency at which the density exceeds this level below its peak."""
    maximum_Hz: float = Field(6.0, gt=0)
    """Upper end of the analysis band. Tremor (8 to 12 Hz) and measurement noise above it do not count; they
    would dominate the velocity's bandwidth."""
    confidence: float = Field(0.95, ge=0.5, le=0.999)
    """Confidence of the intervals."""
    resamples: int = Field(2000, ge=200, le=100000)
    """Number of bootstrap resamples of surgeons, then of their trials."""


class SurgeonSettings(Section):
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = Field(
        default_factory=lambda: ColumnLayout(
            columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position"))
        )
    )
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which all trials are resampled; null keeps their rate."""
    records: tuple[SurgeonRecord, ...] = ()
    """Trials; the interval of a bandwidth needs several, preferably of several surgeons."""
    welch: WelchSettings = Field(default_factory=WelchSettings)
    bandwidth: BandwidthSettings = Field(default_factory=BandwidthSettings)
    reference_Hz: float | None = Field(2.5, gt=0)
    """Published bandwidth, drawn for comparison (thesis: 2.5); null draws none."""


class ExcitedBandwidthSettings(Section):
    """Bandwidth of the surgeons that is excited."""

    quantity: Literal["position", "velocity"] = "velocity"
    """Quantity with the spectrum that counts."""
    rule: Literal["power_share", "level"] = "power_share"
    """Rule of surgeon.bandwidth."""


class AmplitudeSettings(Section):
    """Scale of all signals, before a ramp."""

    measure: Literal["rms", "peak"] = "rms"
    """Meaning of value_mm: the root mean square or the peak."""
    value_mm: float = Field(2.0, gt=0, le=1000)
    """Amplitude."""


class MultisineSettings(Section):
    """Multisine of Eq. 3.1."""

    period_s: float = Field(10.0, gt=0, le=1000)
    """Period, a whole number of samples; the distance of lines is 1/period_s Hz."""
    periods: int = Field(10, ge=2, le=1000)
    """Number of periods played; the first is left out as transient."""
    grid: Literal["full", "odd"] = "full"
    """full: every line (thesis); odd: odd lines without some, so that power on the missing ones shows nonlinearity."""
    detection_group: int = Field(4, ge=2, le=20)
    """Odd grid: number of consecutive odd lines of which one, drawn at random, is left out."""
    phases: Literal["schroeder", "clipped", "zero"] = "schroeder"
    """schroeder (thesis), clipped (lowest crest factor, by iterated clipping) or zero (an impulse train, for
    comparison only)."""
    amplitude_exponent: float = Field(0.0, ge=-4, le=4)
    """Exponent of the frequency to which amplitudes are proportional; 0 is flat, as in Eq. 3.1."""


class NoiseSettings(Section):
    """Band-limited Gaussian noise."""

    duration_s: float = Field(10.0, gt=0, le=10000)
    """Duration."""
    filter_order: int = Field(8, ge=1, le=20)
    """Order of the Butterworth low-pass filter, run forward and backward; its -3 dB frequency is the upper end
    of the band."""


class ChirpSettings(Section):
    """Linear chirp of Eq. 3.2."""

    duration_s: float = Field(10.0, gt=0, le=10000)
    """Duration."""
    lowest_Hz: float = Field(0.0, ge=0)
    """Start frequency of the sweep; it ends at the upper end of the band."""


class MachineSettings(Section):
    """Limits of the testing machine, from its data sheet; the defaults suit an electrodynamic one of 60 mm stroke."""

    displacement_mm: float = Field(30.0, gt=0)
    """Largest displacement from the middle."""
    velocity_mm_s: float = Field(1000.0, gt=0)
    """Largest velocity."""
    acceleration_mm_s2: float = Field(20000.0, gt=0)
    """Largest acceleration with tool and grips, i.e. dynamic force over moved mass."""


class SignalsSettings(Section):
    """Excitation signals designed from the surgeons' bandwidth (Eqs 3.1 and 3.2 of the thesis)."""

    bandwidth: ExcitedBandwidthSettings = Field(default_factory=ExcitedBandwidthSettings)
    band_factor: float = Field(2.0, ge=0.1, le=20)
    """Upper end of the excited band divided by the bandwidth (thesis: 2, its 'Nyquist rate')."""
    round_Hz: float = Field(0.5, gt=0, le=10)
    """Step to which the upper end of the excited band is rounded."""
    rate_Hz: float = Field(100.0, ge=1, le=10000)
    """Samples per second of the signals."""
    amplitude: AmplitudeSettings = Field(default_factory=AmplitudeSettings)
    ramp_s: float = Field(0.0, ge=0, le=60)
    """Length of half a cosine that raises every signal from zero; noise and chirp are also lowered at the end.
    0: no ramp. With a ramp the multisine's first period is not periodic."""
    multisine: MultisineSettings = Field(default_factory=MultisineSettings)
    noise: NoiseSettings = Field(default_factory=NoiseSettings)
    chirp: ChirpSettings = Field(default_factory=ChirpSettings)
    machine: MachineSettings = Field(default_factory=MachineSettings)
