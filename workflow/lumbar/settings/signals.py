"""Chapters surgeon and signals: motion of the surgeons' tool with its bandwidth, and the excitation designed from it."""

from typing import Literal

from lumbar.settings.key import RecordName, key, required, section, settings
from lumbar.settings.layout import ColumnLayout, columns


@settings
class SurgeonRecord:
    """One trial."""

    name: RecordName = required("Name of the trial, each once (pooled is the name of the mean).")
    file: str = required("Recording, below the data root.", min_length=1)
    surgeon: str = required("Who moved the tool; trials of one surgeon are resampled together.", min_length=1)

    def __post_init__(self):
        if self.name == "pooled":
            raise ValueError("a trial is named pooled, as the mean of all is")


@settings
class WelchSettings:
    """Welch's method."""

    segment_s: float = key(
        "Length of a segment; frequency lines lie 1/segment_s Hz apart.", default=10.24, gt=0
    )
    overlap: float = key("Share of a segment in common with the next.", default=0.5, within="[0, 0.95]")
    window: Literal["hann", "hamming", "blackman", "boxcar", "bartlett", "flattop"] = key(
        "Window of every segment.", default="hann"
    )
    detrend: Literal["constant", "linear"] = key(
        "What is taken off every segment: its mean, or its straight line.", default="constant"
    )


@settings
class BandwidthSettings:
    """The rules by which a bandwidth is read off, and its interval."""

    power_share: float = key(
        "Rule power_share: the bandwidth is the frequency below which this share of the band's power lies.",
        default=0.95,
        within="[0.5, 0.999]",
    )
    level_dB: float = key(
        "Rule level: the bandwidth is the last frequency at which the density is above this level "
        "under its peak.",
        default=-20.0,
        within="[-60, -1]",
    )
    maximum_Hz: float = key(
        "Upper end of the analysis band. Tremor (8 to 12 Hz) and measuring noise above it do not "
        "count; they would decide the velocity's bandwidth.",
        default=6.0,
        gt=0,
    )
    confidence: float = key("Confidence of the intervals.", default=0.95, within="[0.5, 0.999]")
    resamples: int = key(
        "Bootstrap resamples of surgeons, then of their trials.", default=2000, within="[200, 100000]"
    )


@settings
class SurgeonSettings:
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = section(
        default_factory=ColumnLayout,
        columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position")),
    )
    rate_Hz: float | None = key(
        "Resample all trials to this rate; null leaves them as recorded.", default=None, gt=0
    )
    records: tuple[SurgeonRecord, ...] = key(
        "Trials; the interval of a bandwidth needs several, best of several surgeons.", default=()
    )
    welch: WelchSettings = section(default_factory=WelchSettings)
    bandwidth: BandwidthSettings = section(default_factory=BandwidthSettings)
    reference_Hz: float | None = key(
        "A published bandwidth, drawn for comparison (thesis: 2.5); null draws none.", default=2.5, gt=0
    )


@settings
class ExcitedBandwidthSettings:
    """Which of the surgeons' bandwidths is excited."""

    quantity: Literal["position", "velocity"] = key("Quantity whose spectrum counts.", default="velocity")
    rule: Literal["power_share", "level"] = key("Rule of surgeon.bandwidth.", default="power_share")


@settings
class AmplitudeSettings:
    """Scale of all signals, before a ramp."""

    measure: Literal["rms", "peak"] = key(
        "Whether value_mm is the root mean square or the peak.", default="rms"
    )
    value_mm: float = key("Amplitude.", default=2.0, within="(0, 1000]")


@settings
class MultisineSettings:
    """Multisine of Eq. 3.1."""

    period_s: float = key(
        "Period, a whole number of samples; lines lie 1/period_s Hz apart.", default=10.0, within="(0, 1000]"
    )
    periods: int = key("Periods played; the first is left out as transient.", default=10, within="[2, 1000]")
    grid: Literal["full", "odd"] = key(
        "full: every line (thesis); odd: odd lines, some left out, so that power on the others shows "
        "nonlinearity.",
        default="full",
    )
    detection_group: int = key(
        "Odd grid: one line, drawn at random, of this many consecutive odd lines is left out.",
        default=4,
        within="[2, 20]",
    )
    phases: Literal["schroeder", "clipped", "zero"] = key(
        "schroeder (thesis), clipped (lowest crest factor, by iterated clipping) or zero (an impulse "
        "train, only to compare with).",
        default="schroeder",
    )
    amplitude_exponent: float = key(
        "Amplitudes are in proportion to f to this power; 0 is flat as in Eq. 3.1.",
        default=0.0,
        within="[-4, 4]",
    )


@settings
class NoiseSettings:
    """Band-limited Gaussian noise."""

    duration_s: float = key("Duration.", default=10.0, within="(0, 10000]")
    filter_order: int = key(
        "Order of the Butterworth low-pass, run forward and backward; -3 dB lies at the upper end of "
        "the band.",
        default=8,
        within="[1, 20]",
    )


@settings
class ChirpSettings:
    """Linear chirp of Eq. 3.2."""

    duration_s: float = key("Duration.", default=10.0, within="(0, 10000]")
    lowest_Hz: float = key(
        "Frequency at which the sweep begins; it ends at the upper end of the band.", default=0.0, ge=0
    )


@settings
class MachineSettings:
    """Limits of the testing machine, from its data sheet; the defaults suit an electrodynamic one of 60 mm stroke."""

    displacement_mm: float = key("Largest displacement from the middle.", default=30.0, gt=0)
    velocity_mm_s: float = key("Largest velocity.", default=1000.0, gt=0)
    acceleration_mm_s2: float = key(
        "Largest acceleration with tool and grips, i.e. dynamic force over moved mass.", default=20000.0, gt=0
    )


@settings
class SignalsSettings:
    """Excitation signals designed from the surgeons' bandwidth (Eqs 3.1 and 3.2 of the thesis)."""

    bandwidth: ExcitedBandwidthSettings = section(default_factory=ExcitedBandwidthSettings)
    band_factor: float = key(
        "The signals excite up to this factor times the bandwidth (thesis: 2, its 'Nyquist rate').",
        default=2.0,
        within="[0.1, 20]",
    )
    round_Hz: float = key(
        "The upper end of the excited band is rounded to the nearest multiple of this.",
        default=0.5,
        within="(0, 10]",
    )
    rate_Hz: float = key("Samples per second of the signals.", default=100.0, within="[1, 10000]")
    amplitude: AmplitudeSettings = section(default_factory=AmplitudeSettings)
    ramp_s: float = key(
        "Every signal is raised from zero by half a cosine of this length; noise and chirp are also "
        "lowered at the end. 0 leaves them as designed. The multisine's first period is then no "
        "period.",
        default=0.0,
        within="[0, 60]",
    )
    multisine: MultisineSettings = section(default_factory=MultisineSettings)
    noise: NoiseSettings = section(default_factory=NoiseSettings)
    chirp: ChirpSettings = section(default_factory=ChirpSettings)
    machine: MachineSettings = section(default_factory=MachineSettings)
