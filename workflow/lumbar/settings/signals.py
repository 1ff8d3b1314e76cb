"""Chapters surgeon and signals: motion of the surgeons' tool with its bandwidth, and the excitation designed from it."""

from typing import Literal

from lumbar.settings.key import RecordName, key, required, section, settings
from lumbar.settings.layout import ColumnLayout, columns


@settings
class SurgeonRecord:
    """One trial."""

    name: RecordName = required()
    file: str = required(min_length=1)
    surgeon: str = required(min_length=1)

    def __post_init__(self):
        if self.name == "pooled":
            raise ValueError("a trial is named pooled, as the mean of all is")


@settings
class WelchSettings:
    """Welch's method."""

    segment_s: float = key(default=10.24, gt=0)
    overlap: float = key(default=0.5, within="[0, 0.95]")
    window: Literal["hann", "hamming", "blackman", "boxcar", "bartlett", "flattop"] = key(default="hann")
    detrend: Literal["constant", "linear"] = key(default="constant")


@settings
class BandwidthSettings:
    """The rules by which a bandwidth is read off, and its interval."""

    power_share: float = key(default=0.95, within="[0.5, 0.999]")
    level_dB: float = key(default=-20.0, within="[-60, -1]")
    maximum_Hz: float = key(default=6.0, gt=0)
    confidence: float = key(default=0.95, within="[0.5, 0.999]")
    resamples: int = key(default=2000, within="[200, 100000]")


@settings
class SurgeonSettings:
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = section(
        default_factory=ColumnLayout,
        columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position")),
    )
    rate_Hz: float | None = key(default=None, gt=0)
    records: tuple[SurgeonRecord, ...] = key(default=())
    welch: WelchSettings = section(default_factory=WelchSettings)
    bandwidth: BandwidthSettings = section(default_factory=BandwidthSettings)
    reference_Hz: float | None = key(default=2.5, gt=0)


@settings
class ExcitedBandwidthSettings:
    """Which of the surgeons' bandwidths is excited."""

    quantity: Literal["position", "velocity"] = key(default="velocity")
    rule: Literal["power_share", "level"] = key(default="power_share")


@settings
class AmplitudeSettings:
    """Scale of all signals, before a ramp."""

    measure: Literal["rms", "peak"] = key(default="rms")
    value_mm: float = key(default=2.0, within="(0, 1000]")


@settings
class MultisineSettings:
    """Multisine of Eq. 3.1."""

    period_s: float = key(default=10.0, within="(0, 1000]")
    periods: int = key(default=10, within="[2, 1000]")
    grid: Literal["full", "odd"] = key(default="full")
    detection_group: int = key(default=4, within="[2, 20]")
    phases: Literal["schroeder", "clipped", "zero"] = key(default="schroeder")
    amplitude_exponent: float = key(default=0.0, within="[-4, 4]")


@settings
class NoiseSettings:
    """Band-limited Gaussian noise."""

    duration_s: float = key(default=10.0, within="(0, 10000]")
    filter_order: int = key(default=8, within="[1, 20]")


@settings
class ChirpSettings:
    """Linear chirp of Eq. 3.2."""

    duration_s: float = key(default=10.0, within="(0, 10000]")
    lowest_Hz: float = key(default=0.0, ge=0)


@settings
class MachineSettings:
    """Limits of the testing machine, from its data sheet; the defaults suit an electrodynamic one of 60 mm stroke."""

    displacement_mm: float = key(default=30.0, gt=0)
    velocity_mm_s: float = key(default=1000.0, gt=0)
    acceleration_mm_s2: float = key(default=20000.0, gt=0)


@settings
class SignalsSettings:
    """Excitation signals designed from the surgeons' bandwidth (Eqs 3.1 and 3.2 of the thesis)."""

    bandwidth: ExcitedBandwidthSettings = section(default_factory=ExcitedBandwidthSettings)
    band_factor: float = key(default=2.0, within="[0.1, 20]")
    round_Hz: float = key(default=0.5, within="(0, 10]")
    rate_Hz: float = key(default=100.0, within="[1, 10000]")
    amplitude: AmplitudeSettings = section(default_factory=AmplitudeSettings)
    ramp_s: float = key(default=0.0, within="[0, 60]")
    multisine: MultisineSettings = section(default_factory=MultisineSettings)
    noise: NoiseSettings = section(default_factory=NoiseSettings)
    chirp: ChirpSettings = section(default_factory=ChirpSettings)
    machine: MachineSettings = section(default_factory=MachineSettings)
