"""Chapter tissue: the tissue tests and the identification of tissue models."""

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from lumbar.settings.layout import ColumnLayout, RecordSettings, columns
from lumbar.settings.section import IN_ORDER, Section, Unique

Instant = Annotated[float, Field(ge=0)]
Turn = Annotated[float, Field(ge=-180, le=180)]


class SearchSettings(Section):
    """Search for the higher-order model."""

    order_max: int = Field(8, ge=2, le=12)
    """Highest order (number of poles) in the search."""
    condition_max: float = Field(5000.0, ge=1)
    """Largest acceptable condition number of the standardised regressors."""
    selection: Literal["training", "test"] = "training"
    """Criterion of the selection: the %VAF of the free run on the training record (as in the thesis), or its
    mean over the test records."""


class RidgeSettings(Section):
    """Ridge coefficients of Eq. 3.7 for standardised columns: 0, then a geometric progression."""

    alpha_min: float = Field(0.001, gt=0)
    """Smallest coefficient above 0."""
    alpha_max: float = Field(100.0, gt=0)
    """Largest coefficient."""
    alpha_points: int = Field(26, ge=2, le=1000)
    """Number of values in the progression."""

    @field_validator("alpha_max")
    @classmethod
    def _check_order(cls, largest: float, info: ValidationInfo) -> float:
        if (smallest := info.data.get("alpha_min", 0.0)) >= largest:
            raise ValueError(f"{largest:g} is not above alpha_min {smallest:g}")
        return largest


class BootstrapSettings(Section):
    """Block bootstrap of the coefficients."""

    block_s: float = Field(0.5, gt=0)
    """Length of a block, longer than the correlation of the residuals."""
    resamples: int = Field(1000, ge=100, le=100000)
    """Number of resampled data sets."""
    confidence: float = Field(0.95, gt=0, lt=1)
    """Confidence level of the intervals of physical parameters."""


class InvertedLinearSettings(Section):
    """The inverted linear model IL."""

    force_max: float = Field(5.0, gt=0)
    """Largest force of the device, in the output's unit (default: N)."""
    travel: float = Field(40.0, gt=0)
    """Travel at which the largest force is reached, in the input's unit (default: mm)."""


class TissueSettings(Section):
    """Tissue tests and the identification of tissue models."""

    layout: ColumnLayout = Field(
        default_factory=lambda: ColumnLayout(
            columns=columns(
                time=("time_s", "s", "time"),
                input=("position_mm", "mm", "position"),
                output=("force_N", "N", "force"),
            )
        )
    )
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which every record is resampled, with an anti-aliasing filter; null keeps their rate."""
    force_frame: tuple[Turn, Turn, Turn] | None = Field(None, json_schema_extra={"unit": "°"})
    """Orientation of a rotated force sensor, for records of several axes: rotation vector [rx, ry, rz] that
    turns its axes to those of the position (along the axis of rotation, right-handed, as long as the angle);
    null: the same axes."""
    records: tuple[RecordSettings, ...] = ()
    """Recordings, one per excitation; their order is that of the test records in Table 3.1."""
    training: Unique[str] = ()
    """Names of the training records, used in turn; all other records test the models. The first is shown in
    Figure 3.5."""
    settling_s: float | None = Field(None, ge=0)
    """Start of every record that errors of a free run leave out. null: 50 samples, a two-hundredth of a record
    longer than 10,000 samples, at most a twentieth of any record."""
    search: SearchSettings = Field(default_factory=SearchSettings)
    ridge: RidgeSettings = Field(default_factory=RidgeSettings)
    bootstrap: BootstrapSettings = Field(default_factory=BootstrapSettings)
    inverted_linear: InvertedLinearSettings = Field(default_factory=InvertedLinearSettings)
    segment_s: Annotated[tuple[Instant, Instant], IN_ORDER] = (1.0, 7.0)
    """Start and end of the part of each record in Figures 3.4 and 3.5, since the record's start."""
