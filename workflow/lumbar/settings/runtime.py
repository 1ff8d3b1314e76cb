"""Chapters runtime and survey: exported models on a haptic device, and the ratings of participants."""

from typing import Annotated, Literal

from pydantic import Field

from lumbar.settings.section import NAME, Section, Unique, Word

MAX_SCALE_POINTS = 11
"""Largest number of points of a Likert scale."""


class DeviceSettings(Section):
    """Haptic device and hand on which every model is judged before it is exported.

    The defaults are a stylus as in the thesis's experiment: light, with little friction, held loosely.
    """

    mass_kg: float = Field(0.25, gt=0)
    """Mass that moves with the stylus."""
    damping_N_s_m: float = Field(5.5, gt=0)
    """Viscous damping of the device without the hand; it makes a sampled force passive."""
    friction_N: float = Field(0.0, ge=0)
    """Dry friction of the device, equal at every speed. It calms the simulated loop; the required damping and
    the largest stable gain do not include it."""
    hand_stiffness_N_m: float = Field(300.0, ge=0, json_schema_extra={"unit": "N/m"})
    """Stiffness with which the hand holds the stylus; 0: no hand holds it."""
    hand_damping_N_s_m: float = Field(0.0, ge=0)
    """Damping of the hand."""
    hand_mass_kg: float = Field(0.0, ge=0)
    """Mass of the hand that moves with the stylus."""
    rate_Hz: float = Field(1000.0, ge=4)
    """Rate of the servo loop. A loop faster than the model repeats the model's force. In a slower loop the
    model's samples between two ticks have positions on a straight line. Loaders reject less than 4 Hz."""
    delay_ms: float = Field(0.0, ge=0, le=1000)
    """Time between reading the encoder and the force at the motor: computation, bus, amplifier."""
    encoder_um: float = Field(30.0, ge=0)
    """Resolution of the position that the device reads; 0 is exact."""
    hands_stiffness_N_m: tuple[float, float] = Field((50.0, 1500.0), json_schema_extra={"unit": "N/m"})
    """Range of the hand's stiffness. A model that is unstable in the worst corner of stiffness and damping
    counts as unsafe."""
    hands_damping_N_s_m: tuple[float, float] = (0.0, 50.0)
    """Range of the hand's damping."""
    unsafe: Literal["warn", "refuse"] = "warn"
    """Export of a model that oscillates on this device in this hand, or in the worst corner of the hand's
    range. warn: export with a warning; refuse: stop with an error."""


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
    """Models to export, by their names in tissue/models.json; two FMUs each, FMI 2.0 and 3.0. KB-thesis is KB
    as run by the thesis's simulator, whatever rate, average, start and guards are set here: at the rate of the
    records, on the mean of the three positions before the present one, within 15 N or output_limit."""
    trained_on: str = "multisine"
    """Training record of the exported models: one of tissue.training."""
    estimator: Literal["arx", "output_error"] = "arx"
    """Exported fit: arx (the thesis's ridge regression) or output_error. Prescribed models, such as IL, have none."""
    unstable: Literal["refuse", "export"] = "refuse"
    """Export of an unstable model. refuse: stop with an error; export: make an FMU that states it and whose
    output runs into its limit."""
    moving_average_ms: float = Field(3.0, ge=0, le=1000)
    """Length of the moving average on the input, to whole samples of the FMUs' rate; 0: no average. Default:
    three samples of a 1 kHz loop; the thesis has three of its 100 Hz loop, 30 ms with rate_Hz: null."""
    output_limit: float = Field(15.0, gt=0)
    """Largest magnitude of the output in its unit, N in the thesis: what the device may receive. Default 15 N,
    the largest transient force of the thesis's haptic device."""
    gain_limit: float = Field(10.0, ge=1)
    """Largest factor on the output that a user of the FMU may set."""
    output_rate_limit: float | None = Field(None, gt=0)
    """Largest change of the output in a second, N/s in the thesis's units. The force then begins at 0, and a
    user of the FMU may lower the limit. null: no limit."""
    contact: bool = False
    """true: the tissue cannot pull. A tool that is lifted off feels no force until it is back at the rest
    position; a linear model would hold it back."""
    start: Literal["first_position", "offset"] = "first_position"
    """Rest position of the models when they start: the first position, or (thesis) their offset. From the
    offset a first position elsewhere is a jump."""
    device_damping: float | None = Field(None, gt=0, le=1000)
    """Guaranteed damping of the haptic device at the tool, in N s/m (rotations: N m s/rad). With it the FMUs
    bound their force such that device and FMU together never release more energy than they received, whatever
    the hand does. Half of the device's damping leaves the other half to calm oscillations. null: no bound."""
    energy_reserve: float = Field(0.2, gt=0, le=1000)
    """Largest energy, in J, that counts as received if device_damping is given; energy that was dissipated long
    ago allows no oscillation now. It must cover the energy that the tissue stores at the largest force."""
    targets: Unique[Platform] = Field(("host",), min_length=1)
    """Platforms with binaries in the FMUs; host is this machine's. The compiler builds what it needs of a
    platform once, which takes a minute for Windows and seconds for the others."""
    rate_Hz: float | None = Field(1000.0, gt=0)
    """Rate at which the FMUs sample the position, at least that of the identified models; null keeps theirs
    (thesis: 100 Hz). Models are discretised again (ramp-invariant) and keep delays of whole samples to the
    millisecond. A model without a continuous counterpart runs several times in turn, each on its own
    samples."""
    compiler_cache: str | None = Field(None, min_length=1)
    """Folder of the C compiler's cache, relative to the working directory or absolute; null takes the
    user's folder for caches."""
    check_samples: int = Field(1000, ge=100, le=100000)
    """Number of simulated samples of the check of each FMU."""
    device: DeviceSettings = Field(default_factory=DeviceSettings)


class RatedModelSettings(Section):
    """One rated model."""

    name: str = Field(pattern=NAME)
    """Name of the model, e.g. KB."""
    column: str = Field(min_length=1)
    """Column with its ratings."""


class RatingsLayout(Section):
    """Columns of the participants' table; the file needs a header."""

    participant: str = Field(min_length=1)
    """Column with the name or code of the participant; every value occurs once."""
    models: tuple[RatedModelSettings, ...] = Field(min_length=3, max_length=12)
    """Rated models in the order of the tables; Friedman's test needs three."""
    scale_points: int = Field(ge=2, le=MAX_SCALE_POINTS)
    """Points of the Likert scale; ratings are whole numbers between 1 and this."""
    best: str = Field(min_length=1)
    """Column with the name of the model chosen as the best."""
    delimiter: str = Field(",", min_length=1, max_length=1)
    """Character between the cells."""
    yes_no: Unique[Word] = ()
    """Columns that describe the participants by yes or no (1/0 or true/false are read too)."""
    experience: str | None = Field(None, min_length=1)
    """Column with the level of experience; null if the survey did not include it."""
    experience_levels: Unique[Word] = ()
    """Levels of experience to choose from, in order."""
    source: str | None = Field(None, min_length=1)
    """Column with the source of an answer, or null; reconstructed_not_real marks answers that no participant gave."""


class SurveySettings(Section):
    """The participants' survey (section 3.2.3.2 of the thesis)."""

    file: str = Field("survey.csv", min_length=1)
    """Participants' table (CSV), below the data root."""
    note: str = Field("reconstructed survey (not real answers)", min_length=1)
    """Label on every table and figure of answers that the source column marks as reconstructed_not_real; real
    answers do not get it."""
    statement: str = Field(
        "The forces experienced during the simulation were similar to those of what I felt on the rubber analogue",
        min_length=1,
    )
    """Statement that the participants rated for every model."""
    scale_labels: tuple[Word, ...] = Field(
        ("strongly disagree", "disagree", "neutral", "agree", "strongly agree"),
        min_length=2,
        max_length=MAX_SCALE_POINTS,
    )
    """Names of the points of the scale, in order of agreement: layout.scale_points of them."""
    layout: RatingsLayout = Field(
        default_factory=lambda: RatingsLayout(
            participant="participant",
            models=tuple(RatedModelSettings(name=name, column=name) for name in ("IL", "MW", "KB", "HO")),
            scale_points=5,
            best="best",
            yes_no=("clinician", "dry_needling", "acupuncture", "palpation"),
            experience="experience",
            experience_levels=("<5", "5-20", ">20"),
            source="source",
        )
    )
    baseline: str = "IL"
    """Static model of layout.models; the best choices are also compared without it."""
    confidence: float = Field(0.95, ge=0.5, le=0.999)
    """Confidence of all intervals."""
    resamples: int = Field(10000, ge=1000, le=1000000)
    """Number of bootstrap samples of participants for the intervals of A."""
    negligible_A: float = Field(0.06, gt=0, lt=0.5)
    """Largest |A - 0.5| that counts as no difference in the test of equivalence."""
