"""Chapter surgeon: motion of the surgeons' tool and its bandwidth."""

from __future__ import annotations

from typing import Literal

from lumbar.settings.key import RECORD_NAME, key, required, section, settings
from lumbar.settings.layout import ColumnLayout, columns


@settings
class SurgeonRecord:
    """One trial."""

    name: str = required(
        "Name of the trial, each once (pooled is the name of the mean).", pattern=RECORD_NAME
    )
    file: str = required("Recording, below the data root.", min_length=1)
    surgeon: str = required("Who moved the tool; trials of one surgeon are resampled together.", min_length=1)

    def __post_init__(self):
        if self.name == "pooled":
            raise ValueError("a trial is named pooled, as the mean of all is")


@settings
class WelchSettings:
    """Welch's method."""

    segment_s: float = key(
        "Length of a segment; frequency lines lie 1/segment_s Hz apart.", default=10.24, unit="s", gt=0
    )
    overlap: float = key("Share of a segment in common with the next.", default=0.5, ge=0, le=0.95)
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
        ge=0.5,
        le=0.999,
    )
    level_dB: float = key(
        "Rule level: the bandwidth is the last frequency at which the density is above this level "
        "under its peak.",
        default=-20.0,
        unit="dB",
        ge=-60,
        le=-1,
    )
    maximum_Hz: float = key(
        "Upper end of the analysis band. Tremor (8 to 12 Hz) and measuring noise above it do not "
        "count; they would decide the velocity's bandwidth.",
        default=6.0,
        unit="Hz",
        gt=0,
    )
    confidence: float = key("Confidence of the intervals.", default=0.95, ge=0.5, le=0.999)
    resamples: int = key(
        "Bootstrap resamples of surgeons, then of their trials.", default=2000, ge=200, le=100000
    )


@settings
class SurgeonSettings:
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = section(
        default_factory=ColumnLayout,
        columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position")),
    )
    rate_Hz: float | None = key(
        "Resample all trials to this rate; null leaves them as recorded.", default=None, unit="Hz", gt=0
    )
    records: tuple[SurgeonRecord, ...] = key(
        "Trials; the interval of a bandwidth needs several, best of several surgeons.", default=()
    )
    welch: WelchSettings = section(default_factory=WelchSettings)
    bandwidth: BandwidthSettings = section(default_factory=BandwidthSettings)
    reference_Hz: float | None = key(
        "A published bandwidth, drawn for comparison (thesis: 2.5); null draws none.",
        default=2.5,
        unit="Hz",
        gt=0,
    )
