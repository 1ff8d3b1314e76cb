"""Chapter tissue: the tissue tests and the identification of tissue models."""

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, section, settings
from lumbar.settings.layout import ColumnLayout, RecordSettings, columns

Instant = Annotated[float, Each(ge=0)]
Turn = Annotated[float, Each(ge=-180, le=180)]


@settings
class SearchSettings:
    """Search for the higher-order model."""

    order_max: int = key(default=8, within="[2, 12]")
    condition_max: float = key(default=5000.0, ge=1)
    selection: Literal["training", "test"] = key(default="training")


@settings
class RidgeSettings:
    """Ridge coefficients of Eq. 3.7 that are tried, for standardised columns: 0, then a geometric progression."""

    alpha_min: float = key(default=0.001, gt=0)
    alpha_max: float = key(default=100.0, gt=0)
    alpha_points: int = key(default=26, within="[2, 1000]")


@settings
class BootstrapSettings:
    """Block bootstrap of the coefficients."""

    block_s: float = key(default=0.5, gt=0)
    resamples: int = key(default=1000, within="[100, 100000]")
    confidence: float = key(default=0.95, within="(0, 1)")


@settings
class InvertedLinearSettings:
    """The inverted linear model IL."""

    force_max: float = key(default=5.0, gt=0)
    travel: float = key(default=40.0, gt=0)


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
    rate_Hz: float | None = key(default=None, gt=0)
    force_frame: tuple[Turn, Turn, Turn] | None = key(default=None, unit="°")
    records: tuple[RecordSettings, ...] = key(default=())
    training: Annotated[tuple[str, ...], UNIQUE] = key(default=())
    settling_s: float | None = key(default=None, ge=0)
    search: SearchSettings = section(default_factory=SearchSettings)
    ridge: RidgeSettings = section(default_factory=RidgeSettings)
    bootstrap: BootstrapSettings = section(default_factory=BootstrapSettings)
    inverted_linear: InvertedLinearSettings = section(default_factory=InvertedLinearSettings)
    segment_s: tuple[Instant, Instant] = key(default=(1.0, 7.0))
