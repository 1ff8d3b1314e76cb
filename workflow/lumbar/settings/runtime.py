"""Chapter runtime: export of the identified models as FMUs."""

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, section, settings


@settings
class DeviceSettings:
    """Haptic device and hand on which every model is judged before it is exported.

    The defaults are a stylus as in the thesis's experiment: light, with little friction, held loosely.
    """

    mass_kg: float = key(default=0.25, gt=0)
    damping_N_s_m: float = key(default=5.5, gt=0)
    friction_N: float = key(default=0.0, ge=0)
    hand_stiffness_N_m: float = key(default=300.0, unit="N/m", ge=0)
    hand_damping_N_s_m: float = key(default=0.0, ge=0)
    hand_mass_kg: float = key(default=0.0, ge=0)
    rate_Hz: float = key(default=1000.0, ge=4)
    delay_ms: float = key(default=0.0, within="[0, 1000]")
    encoder_um: float = key(default=30.0, ge=0)
    hands_stiffness_N_m: tuple[float, float] = key(default=(50.0, 1500.0), unit="N/m")
    hands_damping_N_s_m: tuple[float, float] = key(default=(0.0, 50.0))
    unsafe: Literal["warn", "refuse"] = key(default="warn")


Platform = Literal[
    "host",
    "x86_64-linux",
    "x86_64-windows",
    "aarch64-linux",
    "x86_64-darwin",
    "aarch64-darwin",
]
ModelName = Annotated[str, Each(pattern="^[A-Za-z][A-Za-z0-9_.+-]*$")]


@settings
class RuntimeSettings:
    """Haptic runtime: export of the identified models as FMUs."""

    models: Annotated[tuple[ModelName, ...], UNIQUE] = key(
        default=("IL", "MW", "Maxwell", "KB", "HO", "IL-thesis", "MW-thesis", "KB-thesis", "HO-thesis"),
        min_length=1,
    )
    trained_on: str = key(default="multisine")
    estimator: Literal["arx", "output_error"] = key(default="arx")
    unstable: Literal["refuse", "export"] = key(default="refuse")
    moving_average_ms: float = key(default=3.0, within="[0, 1000]")
    output_limit: float = key(default=15.0, gt=0)
    gain_limit: float = key(default=10.0, ge=1)
    output_rate_limit: float | None = key(default=None, gt=0)
    contact: bool = key(default=False)
    start: Literal["first_position", "offset"] = key(default="first_position")
    device_damping: float | None = key(default=None, within="(0, 1000]")
    energy_reserve: float = key(default=0.2, within="(0, 1000]")
    targets: Annotated[tuple[Platform, ...], UNIQUE] = key(default=("host",), min_length=1)
    rate_Hz: float | None = key(default=1000.0, gt=0)
    compiler_cache: str | None = key(default=None, min_length=1)
    check_samples: int = key(default=1000, within="[100, 100000]")
    device: DeviceSettings = section(default_factory=DeviceSettings)
