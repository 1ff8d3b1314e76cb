"""Chapter runtime: export of the identified models as FMUs."""

from typing import Annotated, Literal

from pydantic import Field

from lumbar.settings.section import Section, Unique


class DeviceSettings(Section):
    """Haptic device and hand on which every model is judged before it is exported.

    The defaults are a stylus as in the thesis's experiment: light, with little friction, held loosely.
    """

    mass_kg: float = Field(0.25, gt=0)
    """Mass that moves with the stylus."""
    damping_N_s_m: float = Field(5.5, gt=0)
    """Viscous damping of the device itself, without the hand: what makes a sampled force passive."""
    friction_N: float = Field(0.0, ge=0)
    """Dry friction of the device itself, the same at every speed. It calms the simulated loop; damping
    needed and largest stable gain are those without it."""
    hand_stiffness_N_m: float = Field(300.0, ge=0, json_schema_extra={"unit": "N/m"})
    """Stiffness with which the hand holds the stylus; 0 is a stylus that nobody holds."""
    hand_damping_N_s_m: float = Field(0.0, ge=0)
    """Damping of the hand."""
    hand_mass_kg: float = Field(0.0, ge=0)
    """Mass of the hand that moves with the stylus."""
    rate_Hz: float = Field(1000.0, ge=4)
    """Rate of the servo loop. Where it is faster than the model it repeats the model's force; where it is
    slower the model's samples between two of its ticks have positions on a straight line. The loaders
    refuse less than 4 Hz."""
    delay_ms: float = Field(0.0, ge=0, le=1000)
    """Time from reading the encoder to the force at the motor: computing, bus, amplifier."""
    encoder_um: float = Field(30.0, ge=0)
    """Resolution of the position that the device reads; 0 is exact."""
    hands_stiffness_N_m: tuple[float, float] = Field((50.0, 1500.0), json_schema_extra={"unit": "N/m"})
    """Range of the hand's stiffness: a model that is unstable in the worst corner of stiffness and damping
    counts as unsafe."""
    hands_damping_N_s_m: tuple[float, float] = (0.0, 50.0)
    """Range of the hand's damping."""
    unsafe: Literal["warn", "refuse"] = "warn"
    """What export does with a model that oscillates on this device in this hand, or in the worst corner of
    the hand's range: warn says so and exports, refuse stops with an error."""


Platform = Literal[
    "host",
    "x86_64-linux",
    "x86_64-windows",
    "aarch64-linux",
    "x86_64-darwin",
    "aarch64-darwin",
]
ModelName = Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9_.+-]*$")]


class RuntimeSettings(Section):
    """Haptic runtime: export of the identified models as FMUs."""

    models: Unique[ModelName] = Field(
        ("IL", "MW", "Maxwell", "KB", "HO", "IL-thesis", "MW-thesis", "KB-thesis", "HO-thesis"), min_length=1
    )
    """Models to export, by their names in tissue/models.json; two FMUs each, FMI 2.0 and 3.0. KB-thesis is
    KB as the thesis's simulator ran it, whatever rate, average, start and guards are set here: at the rate
    of the records, on the mean of the three positions before the present one, within 15 N or output_limit."""
    trained_on: str = "multisine"
    """Training record of the exported models: one of tissue.training."""
    estimator: Literal["arx", "output_error"] = "arx"
    """Which fit is exported: arx (the thesis's ridge regression) or output_error. Models that are
    prescribed, such as IL, have none."""
    unstable: Literal["refuse", "export"] = "refuse"
    """What to do with an unstable model: refuse stops with an error; export makes an FMU that says so
    everywhere and whose output runs into its limit."""
    moving_average_ms: float = Field(3.0, ge=0, le=1000)
    """Length of the moving average on the input, to whole samples of the FMUs' rate; 0 is off. Default
    three samples of a 1 kHz loop, as the thesis has three of its 100 Hz loop: 30 ms with rate_Hz: null."""
    output_limit: float = Field(15.0, gt=0)
    """Largest magnitude of the output in its own unit, N in the thesis: what the device may receive.
    Default 15 N, the largest transient force of the thesis's haptic device."""
    gain_limit: float = Field(10.0, ge=1)
    """Largest factor on the output that a user of the FMU may set."""
    output_rate_limit: float | None = Field(None, gt=0)
    """Largest change of the output in a second, N/s in the thesis's units; the force then begins at 0 and a
    user of the FMU may lower the limit. null is none."""
    contact: bool = False
    """Whether the tissue cannot pull: a tool that is lifted off feels no force until it is back at the rest
    position, where a linear model would hold it back."""
    start: Literal["first_position", "offset"] = "first_position"
    """Where the models rest when they start: at the first position, or (thesis) at their offset, from where
    a first position elsewhere is a jump."""
    device_damping: float | None = Field(None, gt=0, le=1000)
    """Damping that the haptic device surely has at the tool, in N s/m (rotations: N m s/rad). With it the
    FMUs bound their force such that device and FMU together never give out more energy than they took in,
    whatever the hand does. Half of the device's damping leaves the other half to calm what goes on. null is
    no bound."""
    energy_reserve: float = Field(0.2, gt=0, le=1000)
    """Most energy, in J, that counts as taken in where device_damping is given: what was dissipated long
    ago buys no oscillation now. It must cover what the tissue stores at the largest force."""
    targets: Unique[Platform] = Field(("host",), min_length=1)
    """Platforms the FMUs hold binaries for; host is this machine's. The compiler builds what it needs of a
    platform once, which takes a minute for Windows and seconds for the others."""
    rate_Hz: float | None = Field(1000.0, gt=0)
    """Rate at which the FMUs sample the position, at least that of the identified models; null keeps theirs
    (thesis: 100 Hz). Models are discretised anew (ramp-invariant), delays of whole samples kept to the
    millisecond; one that no continuous model could be runs several times over, each on its own samples."""
    compiler_cache: str | None = Field(None, min_length=1)
    """Folder of the C compiler's cache, relative to the working directory or absolute; null takes the
    user's folder for caches."""
    check_samples: int = Field(1000, ge=100, le=100000)
    """Samples each FMU is simulated for when it is checked."""
    device: DeviceSettings = Field(default_factory=DeviceSettings)
