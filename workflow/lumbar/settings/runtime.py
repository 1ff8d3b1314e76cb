"""Chapter runtime: export of the identified models as FMUs."""

from typing import Annotated, Literal

from lumbar.settings.key import UNIQUE, Each, key, section, settings


@settings
class DeviceSettings:
    """Haptic device and hand on which every model is judged before it is exported.

    The defaults are a stylus as in the thesis's experiment: light, with little friction, held loosely.
    """

    mass_kg: float = key("Mass that moves with the stylus.", default=0.25, gt=0)
    damping_N_s_m: float = key(
        "Viscous damping of the device itself, without the hand: what makes a sampled force passive.",
        default=5.5,
        gt=0,
    )
    friction_N: float = key(
        "Dry friction of the device itself, the same at every speed. It calms the simulated loop; damping needed and largest "
        "stable gain are those without it.",
        default=0.0,
        ge=0,
    )
    hand_stiffness_N_m: float = key(
        "Stiffness with which the hand holds the stylus; 0 is a stylus that nobody holds.",
        default=300.0,
        unit="N/m",
        ge=0,
    )
    hand_damping_N_s_m: float = key("Damping of the hand.", default=0.0, ge=0)
    hand_mass_kg: float = key("Mass of the hand that moves with the stylus.", default=0.0, ge=0)
    rate_Hz: float = key(
        "Rate of the servo loop. Where it is faster than the model it repeats the model's force; where it is slower the "
        "model's samples between two of its ticks have positions on a straight line. The loaders refuse less than 4 Hz.",
        default=1000.0,
        ge=4,
    )
    delay_ms: float = key(
        "Time from reading the encoder to the force at the motor: computing, bus, amplifier.",
        default=0.0,
        within="[0, 1000]",
    )
    jitter_percent: float = key(
        "How far the time from a tick of the servo to the next may be from the even one, in percent of it; models are judged "
        "in the worst of these timings.",
        default=0.0,
        unit="%",
        within="[0, 90]",
    )
    missed_ticks: int = key(
        "Most ticks in a row that the servo may leave out; models are judged in the worst case.",
        default=0,
        within="[0, 20]",
    )
    encoder_um: float = key(
        "Resolution of the position that the device reads; 0 is exact.", default=30.0, ge=0
    )
    hands: int = key(
        "How many hands are drawn, and fits within the intervals of their parameters, to say in which share of them a model is "
        "stable; 0 leaves it out.",
        default=256,
        within="[0, 100000]",
    )
    hands_stiffness_N_m: tuple[float, float] = key(
        "Loosest and firmest of these hands.", default=(50.0, 1500.0), unit="N/m"
    )
    hands_damping_N_s_m: tuple[float, float] = key(
        "Smallest and largest damping of these hands.", default=(0.0, 50.0)
    )
    least_stable_share: float = key(
        "Share of fits and hands in which a model must be stable: below it, it counts as unsafe.",
        default=0.9,
        within="[0, 1]",
    )
    unsafe: Literal["warn", "refuse"] = key(
        "What export does with a model that oscillates on this device in this hand, or in too many others: warn says so and "
        "exports, refuse stops with an error.",
        default="warn",
    )


Platform = Literal[
    "host",
    "x86_64-linux",
    "x86_64-windows",
    "aarch64-linux",
    "x86_64-darwin",
    "aarch64-darwin",
    "wasm32-wasi",
]
ModelName = Annotated[str, Each(pattern="^[A-Za-z][A-Za-z0-9_.+-]*$")]


@settings
class RuntimeSettings:
    """Haptic runtime: export of the identified models as FMUs."""

    models: Annotated[tuple[ModelName, ...], UNIQUE] = key(
        "Models to export, by their names in tissue/models.json; two FMUs each, FMI 2.0 and 3.0. KB-thesis is KB as the "
        "thesis's simulator ran it, whatever rate, average, start and guards are set here: at the rate of the records, on the "
        "mean of the three positions before the present one, within 15 N or output_limit.",
        default=("IL", "MW", "Maxwell", "KB", "HO", "IL-thesis", "MW-thesis", "KB-thesis", "HO-thesis"),
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
    moving_average_ms: float = key(
        "Length of the moving average on the input, to whole samples of the FMUs' rate; 0 is off. Default three samples of a "
        "1 kHz loop, as the thesis has three of its 100 Hz loop: 30 ms with rate_Hz: null.",
        default=3.0,
        within="[0, 1000]",
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
    output_rate_limit: float | None = key(
        "Largest change of the output in a second, N/s in the thesis's units; the force then begins at 0 and a user of the FMU "
        "may lower the limit. null is none.",
        default=None,
        gt=0,
    )
    contact: bool = key(
        "Whether the tissue cannot pull: a tool that is lifted off feels no force until it is back at the rest position, "
        "where a linear model would hold it back.",
        default=False,
    )
    start: Literal["first_position", "offset"] = key(
        "Where the models rest when they start: at the first position, or (thesis) at their offset, from where a first "
        "position elsewhere is a jump.",
        default="first_position",
    )
    device_damping: float | None = key(
        "Damping that the haptic device surely has at the tool, in N s/m (rotations: N m s/rad). With it the FMUs bound their "
        "force such that device and FMU together never give out more energy than they took in, whatever the hand does. Half "
        "of the device's damping leaves the other half to calm what goes on. null is no bound.",
        default=None,
        within="(0, 1000]",
    )
    energy_reserve: float = key(
        "Most energy, in J, that counts as taken in where device_damping is given: what was dissipated long ago buys no "
        "oscillation now. It must cover what the tissue stores at the largest force.",
        default=0.2,
        within="(0, 1000]",
    )
    targets: Annotated[tuple[Platform, ...], UNIQUE] = key(
        "Platforms the FMUs hold binaries for; host is this machine's, wasm32-wasi WebAssembly for browsers and Node. The "
        "compiler builds what it needs of a platform once, which takes a minute for Windows and seconds for the others.",
        default=("host",),
        min_length=1,
    )
    rate_Hz: float | None = key(
        "Rate at which the FMUs sample the position, at least that of the identified models; null keeps theirs (thesis: "
        "100 Hz). Models are discretised anew (ramp-invariant), delays of whole samples kept to the millisecond; one "
        "that no continuous model could be runs several times over, each on its own samples.",
        default=1000.0,
        gt=0,
    )
    compiler_cache: str | None = key(
        "Folder of the C compiler's cache, relative to the working directory or absolute; null takes the user's "
        "folder for caches.",
        default=None,
        min_length=1,
    )
    check_samples: int = key(
        "Samples each FMU is simulated for when it is checked.", default=1000, within="[100, 100000]"
    )
    device: DeviceSettings = section(default_factory=DeviceSettings)
