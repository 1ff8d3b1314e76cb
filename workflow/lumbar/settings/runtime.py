"""Chapter runtime: export of the identified models as FMUs."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, settings

Platform = Literal[
    "host", "x86_64-linux", "x86_64-windows", "aarch64-linux", "x86_64-darwin", "aarch64-darwin"
]
ModelName = Annotated[str, Each(pattern="^[A-Za-z][A-Za-z0-9_.+-]*$")]


@settings
class RuntimeSettings:
    """Haptic runtime: export of the identified models as FMUs."""

    models: Annotated[tuple[ModelName, ...], UNIQUE] = key(
        ("IL", "MW", "Maxwell", "KB", "HO"),
        "Models to export, by their names in tissue/models.json; two FMUs each, FMI 2.0 and 3.0.",
        min_length=1,
    )
    trained_on: str = key("multisine", "Training record of the exported models: one of tissue.training.")
    estimator: Literal["arx", "output_error"] = key(
        "arx",
        "Which fit is exported: arx (the thesis's ridge regression) or output_error. Models that are "
        "prescribed, such as IL, have none.",
    )
    unstable: Literal["refuse", "export"] = key(
        "refuse",
        "What to do with an unstable model: refuse stops with an error; export makes an FMU that says "
        "so everywhere and whose output runs into its limit.",
    )
    moving_average: int = key(
        3,
        "Samples of the moving average on the input, the newest included (thesis: 3); 1 is off.",
        ge=1,
        le=16,
    )
    output_limit: float = key(
        15.0,
        "Largest magnitude of the output in its own unit, N in the thesis: what the device may "
        "receive. Default 15 N, the largest transient force of the thesis's haptic device.",
        gt=0,
    )
    gain_limit: float = key(10.0, "Largest factor on the output that a user of the FMU may set.", ge=1)
    targets: Annotated[tuple[Platform, ...], UNIQUE] = key(
        ("host",),
        "Platforms the FMUs hold binaries for; host is this machine's. The compiler builds what it "
        "needs of a platform once, which takes a minute for Windows and seconds for the others.",
        min_length=1,
    )
    rate_Hz: float | None = key(
        None,
        "Rate at which the FMUs sample the position, at least that of the identified models; null "
        "keeps theirs. Models are discretised anew (ramp-invariant); one without a continuous "
        "counterpart, such as MW, is refused. The moving average counts samples of this rate.",
        unit="Hz",
        gt=0,
    )
    compiler_cache: str | None = key(
        None,
        "Folder of the C compiler's cache, relative to the working directory or absolute; null takes the user's "
        "folder for caches.",
        min_length=1,
    )
    check_samples: int = key(1000, "Samples each FMU is simulated for when it is checked.", ge=100, le=100000)
