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
        10.24, "Length of a segment; frequency lines lie 1/segment_s Hz apart.", unit="s", gt=0
    )
    overlap: float = key(0.5, "Share of a segment in common with the next.", ge=0, le=0.95)
    window: Literal["hann", "hamming", "blackman", "boxcar", "bartlett", "flattop"] = key(
        "hann", "Window of every segment."
    )
    detrend: Literal["constant", "linear"] = key(
        "constant", "What is taken off every segment: its mean, or its straight line."
    )


@settings
class BandwidthSettings:
    """The rules by which a bandwidth is read off, and its interval."""

    power_share: float = key(
        0.95,
        "Rule power_share: the bandwidth is the frequency below which this share of the band's power lies.",
        ge=0.5,
        le=0.999,
    )
    level_dB: float = key(
        -20.0,
        "Rule level: the bandwidth is the last frequency at which the density is above this level "
        "under its peak.",
        unit="dB",
        ge=-60,
        le=-1,
    )
    maximum_Hz: float = key(
        6.0,
        "Upper end of the analysis band. Tremor (8 to 12 Hz) and measuring noise above it do not "
        "count; they would decide the velocity's bandwidth.",
        unit="Hz",
        gt=0,
    )
    confidence: float = key(0.95, "Confidence of the intervals.", ge=0.5, le=0.999)
    resamples: int = key(2000, "Bootstrap resamples of surgeons, then of their trials.", ge=200, le=100000)


@settings
class SurgeonSettings:
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = section(
        ColumnLayout, columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position"))
    )
    rate_Hz: float | None = key(
        None, "Resample all trials to this rate; null leaves them as recorded.", unit="Hz", gt=0
    )
    records: tuple[SurgeonRecord, ...] = key(
        (), "Trials; the interval of a bandwidth needs several, best of several surgeons."
    )
    welch: WelchSettings = section(WelchSettings)
    bandwidth: BandwidthSettings = section(BandwidthSettings)
    reference_Hz: float | None = key(
        2.5, "A published bandwidth, drawn for comparison (thesis: 2.5); null draws none.", unit="Hz", gt=0
    )
