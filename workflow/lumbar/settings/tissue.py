"""Chapter tissue: the tissue tests and the identification of tissue models."""

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, section, settings
from lumbar.settings.layout import ColumnLayout, RecordSettings, columns

Instant = Annotated[float, Each(ge=0)]


@settings
class SearchSettings:
    """Search for the higher-order model."""

    order_max: int = key("Highest order (poles) that is searched.", default=8, within="[2, 12]")
    condition_max: float = key(
        "Largest condition number of the standardised regressors that is taken for reasonable.",
        default=5000.0,
        ge=1,
    )
    selection: Literal["training", "test"] = key(
        "Models are picked by the %VAF of their free run on the training record (the thesis's way) or "
        "by its mean over the test records.",
        default="training",
    )


@settings
class RidgeSettings:
    """Ridge coefficients of Eq. 3.7 that are tried, for standardised columns: 0, then a geometric progression."""

    alpha_min: float = key("Smallest coefficient above 0.", default=0.001, gt=0)
    alpha_max: float = key("Largest coefficient.", default=100.0, gt=0)
    alpha_points: int = key("Number of values in the progression.", default=26, within="[2, 1000]")


@settings
class BootstrapSettings:
    """Block bootstrap of the coefficients."""

    block_s: float = key("Length of a block: longer than the residuals are correlated.", default=0.5, gt=0)
    resamples: int = key("Number of resampled data sets.", default=1000, within="[100, 100000]")
    confidence: float = key(
        "Confidence level of the intervals of physical parameters.", default=0.95, within="(0, 1)"
    )


@settings
class InvertedLinearSettings:
    """The inverted linear model IL."""

    force_max: float = key(
        "Largest force of the device, in the output's unit (default: N).", default=5.0, gt=0
    )
    travel: float = key(
        "Travel over which it is reached, in the input's unit (default: mm).", default=40.0, gt=0
    )


@settings
class TissueSettings:
    """Tissue tests and the identification of tissue models."""

    layout: ColumnLayout = section(
        default_factory=ColumnLayout,
        columns=columns(
            time=("time_s", "s", "time"),
            input=("position_mm", "mm", "position"),
            output=("force_N", "N", "force"),
        ),
    )
    rate_Hz: float | None = key(
        "Rate to which every record is resampled, with an anti-aliasing filter; null leaves them as "
        "recorded.",
        default=None,
        gt=0,
    )
    records: tuple[RecordSettings, ...] = key(
        "The recordings, one per excitation; their order is that of the test records in Table 3.1.",
        default=(),
    )
    training: Annotated[tuple[str, ...], UNIQUE] = key(
        "Names of the records that models are trained on, each in turn; all other records test them. "
        "The first is shown in Figure 3.5.",
        default=(),
    )
    settling_s: float | None = key(
        "Start of every record that no error of a free run counts; null: 50 samples, a two-hundredth of a record that is "
        "longer than 10,000 samples, never more than a twentieth of it.",
        default=None,
        ge=0,
    )
    search: SearchSettings = section(default_factory=SearchSettings)
    ridge: RidgeSettings = section(default_factory=RidgeSettings)
    bootstrap: BootstrapSettings = section(default_factory=BootstrapSettings)
    inverted_linear: InvertedLinearSettings = section(default_factory=InvertedLinearSettings)
    segment_s: tuple[Instant, Instant] = key(
        "Start and end of the part of each record that Figures 3.4 and 3.5 show, since the record's start.",
        default=(1.0, 7.0),
    )
