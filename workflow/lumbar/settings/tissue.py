"""Chapter tissue: the tissue tests and the identification of tissue models."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, section, settings
from lumbar.settings.layout import ColumnLayout, RecordSettings, columns

Instant = Annotated[float, Each(ge=0)]


@settings
class SearchSettings:
    """Search for the higher-order model."""

    order_max: int = key(5, "Highest order (poles) that is searched.", ge=2, le=12)
    condition_max: float = key(
        5000.0, "Largest condition number of the standardised regressors that is taken for reasonable.", ge=1
    )
    selection: Literal["training", "test"] = key(
        "training",
        "Models are picked by the %VAF of their free run on the training record (the thesis's way) or "
        "by its mean over the test records.",
    )


@settings
class RidgeSettings:
    """Ridge coefficients of Eq. 3.7 that are tried, for standardised columns: 0, then a geometric progression."""

    alpha_min: float = key(0.001, "Smallest coefficient above 0.", gt=0)
    alpha_max: float = key(100.0, "Largest coefficient.", gt=0)
    alpha_points: int = key(26, "Number of values in the progression.", ge=2, le=1000)


@settings
class BootstrapSettings:
    """Block bootstrap of the coefficients."""

    block_s: float = key(0.5, "Length of a block: longer than the residuals are correlated.", unit="s", gt=0)
    resamples: int = key(1000, "Number of resampled data sets.", ge=100, le=100000)
    confidence: float = key(0.95, "Confidence level of the intervals of physical parameters.", gt=0, lt=1)


@settings
class InvertedLinearSettings:
    """The inverted linear model IL."""

    force_max: float = key(5.0, "Largest force of the device, in the output's unit (default: N).", gt=0)
    travel: float = key(40.0, "Travel over which it is reached, in the input's unit (default: mm).", gt=0)


@settings
class TissueSettings:
    """Tissue tests and the identification of tissue models."""

    layout: ColumnLayout = section(
        ColumnLayout,
        columns=columns(
            time=("time_s", "s", "time"),
            input=("position_mm", "mm", "position"),
            output=("force_N", "N", "force"),
        ),
    )
    rate_Hz: float | None = key(
        None,
        "Rate to which every record is resampled, with an anti-aliasing filter; null leaves them as "
        "recorded.",
        unit="Hz",
        gt=0,
    )
    records: tuple[RecordSettings, ...] = key(
        (), "The recordings, one per excitation; their order is that of the test records in Table 3.1."
    )
    training: Annotated[tuple[str, ...], UNIQUE] = key(
        (),
        "Names of the records that models are trained on, each in turn; all other records test them. "
        "The first is shown in Figure 3.5.",
    )
    settling_s: float = key(0.5, "Start of every record that no free-run error counts.", unit="s", ge=0)
    search: SearchSettings = section(SearchSettings)
    ridge: RidgeSettings = section(RidgeSettings)
    bootstrap: BootstrapSettings = section(BootstrapSettings)
    inverted_linear: InvertedLinearSettings = section(InvertedLinearSettings)
    segment_s: tuple[Instant, Instant] = key(
        (1.0, 7.0),
        "Start and end of the part of each record that Figures 3.4 and 3.5 show, since the record's start.",
        unit="s",
    )
