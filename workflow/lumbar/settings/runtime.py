"""Chapter runtime: export of the identified models as FMUs."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.device import DeviceSettings
from lumbar.settings.key import UNIQUE, Each, key, section, settings

Platform = Literal[
    "host", "x86_64-linux", "x86_64-windows", "aarch64-linux", "x86_64-darwin", "aarch64-darwin"
]
ModelName = Annotated[str, Each(pattern="^[A-Za-z][A-Za-z0-9_.+-]*$")]


@settings
class RuntimeSettings:
    """Haptic runtime: export of the identified models as FMUs."""

    models: Annotated[tuple[ModelName, ...], UNIQUE] = key(
        "Models to export, by their names in tissue/models.json; two FMUs each, FMI 2.0 and 3.0.",
        default=("IL", "MW", "Maxwell", "KB", "HO"),
        min_length=1,
    )
    trained_on: str = key(
        "Training record of the exported models: one of tissue.training.", default="multisine"
    )
    estimator: Literal["arx", "output_error"] = key(
        "Which fit is exported: arx (the thesis's ridge regression) or output_error. Models that are "
        "prescribed, such as IL, have none.",
        default="arx",
    )
    unstable: Literal["refuse", "export"] = key(
        "What to do with an unstable model: refuse stops with an error; export makes an FMU that says "
        "so everywhere and whose output runs into its limit.",
        default="refuse",
    )
    moving_average: int = key(
        "Samples of the moving average on the input, the newest included (thesis: 3); 1 is off.",
        default=3,
        ge=1,
        le=16,
    )
    output_limit: float = key(
        "Largest magnitude of the output in its own unit, N in the thesis: what the device may "
        "receive. Default 15 N, the largest transient force of the thesis's haptic device.",
        default=15.0,
        gt=0,
    )
    gain_limit: float = key(
        "Largest factor on the output that a user of the FMU may set.", default=10.0, ge=1
    )
    targets: Annotated[tuple[Platform, ...], UNIQUE] = key(
        "Platforms the FMUs hold binaries for; host is this machine's. The compiler builds what it "
        "needs of a platform once, which takes a minute for Windows and seconds for the others.",
        default=("host",),
        min_length=1,
    )
    rate_Hz: float | None = key(
        "Rate at which the FMUs sample the position, at least that of the identified models; null "
        "keeps theirs. Models are discretised anew (ramp-invariant); one without a continuous "
        "counterpart, such as MW, is refused. The moving average counts samples of this rate.",
        default=None,
        unit="Hz",
        gt=0,
    )
    compiler_cache: str | None = key(
        "Folder of the C compiler's cache, relative to the working directory or absolute; null takes the user's "
        "folder for caches.",
        default=None,
        min_length=1,
    )
    check_samples: int = key(
        "Samples each FMU is simulated for when it is checked.", default=1000, ge=100, le=100000
    )
    device: DeviceSettings = section(default_factory=DeviceSettings)
