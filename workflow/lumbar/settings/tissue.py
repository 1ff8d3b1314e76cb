"""Chapters surgeon, signals, tissue and improvement: tool motion, excitation, identification, diagnosis."""

from typing import Annotated, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from lumbar.base.errors import InputError, did_you_mean
from lumbar.settings.layout import ColumnLayout, RecordSettings, columns
from lumbar.settings.section import IN_ORDER, FolderName, RecordName, Section, Unique

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


TissueBase = Literal[
    "auto",
    "LE",
    "Maxwell",
    "KV",
    "KB",
    "KV-mass",
    "KB-mass",
    "Burgers",
    "QLV",
    "QLV-2",
    "QLV-power",
    "LE-contact",
    "KV-contact",
    "KB-contact",
]
"""Bases of a tissue that a study may name."""
BASE_NAMES = (*get_args(TissueBase), "pendulum")
BaseFile = Annotated[str, Field(pattern=r".\.ya?ml$")]
"""File of a user-defined base."""


def is_data(file: str) -> bool:
    """Return whether a file is YAML, which is data and runs no code.

    Parameters
    ----------
    file : str
        Name of the file.
    """
    return file.endswith((".yaml", ".yml"))


def system_of(base: str) -> Literal["tissue", "pendulum"]:
    """Return the system that a base models; a user-defined base models a tissue.

    Parameters
    ----------
    base : str
        Name of a base, or a YAML file.

    Raises
    ------
    InputError
        If the base is unknown.
    """
    if base not in BASE_NAMES and not is_data(base):
        suggestion = did_you_mean(base, BASE_NAMES)
        raise InputError(
            f"unknown base model {base!r}{suggestion}; known are {', '.join(BASE_NAMES)} and files, BASE.yaml"
        )
    return "pendulum" if base == "pendulum" else "tissue"


class RecordSetSettings(Section):
    """One set of records that is diagnosed."""

    name: FolderName
    """Name of the set and its folder."""
    base: TissueBase | Literal["pendulum"] | BaseFile | None = None
    """Base model of this set, instead of improvement.base. lifting.moment_layout reads the records of a
    pendulum, tissue.layout all others."""
    session: bool | None = None
    """true: the records of this set are parts of one session; replaces improvement.session."""
    train: str | Unique[str] | None = None
    """Record of this set to fit on, or a list of records, instead of improvement.train."""
    effects: Unique[str] | None = None
    """Effects of this set's model in refined.json, in this order. null: improvement.effects for the records and
    base of the tissue chapter, if it names any; else the effects that the diagnosis selects."""
    records: tuple[RecordSettings, ...] | None = Field(None, min_length=1)
    """Records of the set; default those of the tissue chapter."""
    layout: ColumnLayout | None = None
    """Columns of this set's records, instead of tissue.layout or lifting.moment_layout."""
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which records with this layout are resampled; null keeps their rate."""


class ImprovementSettings(Section):
    """Comparing, diagnosing and refining models of tissue tests."""

    base: TissueBase | BaseFile = "auto"
    """Base model to which effects are added; auto chooses it by the data. Names with -mass move a mass; QLV
    (quasi-linear viscoelasticity) is Fung's exponential times a relaxation: one branch, two, or a power law; names
    with -contact are for a tool that is not fastened to the tissue. A user-defined base is a file, BASE.yaml,
    relative to the project."""
    train: str | Unique[str] | None = None
    """Record to fit on, or a list of records to fit on together; null takes the longest."""
    forward: bool = False
    """true: tissue tests have the force as input and the motion as output (load-controlled tests). Models are
    then simulated from force to motion; errors have the unit of the motion."""
    session: bool = False
    """true: the records are consecutive parts of one session; each begins in the state (path, time, relaxation,
    hysteresis, damage) in which the previous one left the tissue. false: each begins at rest."""
    effects: Unique[str] = ()
    """Effects added to the base, in this order. The model with them is in Table 3.1, Figure 3.5 and
    models.json, and in refined.json of the record sets of the tissue chapter."""
    record_sets: tuple[RecordSetSettings, ...] = Field(
        default_factory=lambda: (RecordSetSettings(name="tissue"),), min_length=1
    )
    """Sets of records that are diagnosed; results are in improvement/<name>."""
    effect_files: tuple[str, ...] = ()
    """Files of user-defined effects, relative to the project: equations in YAML, or Python, which is run as code."""
    most_effects: int = Field(3, ge=1, le=5)
    """Largest number of effects that a diagnosis adds."""
    propose_law: bool = True
    """true: search a short formula for the error that effects of the catalogue leave in a tissue test;
    takes seconds to two minutes."""

    @property
    def base_files(self) -> dict[str, str]:
        """Files of user-defined bases by the key that names each."""
        sets = {f"record_sets.{number}.base": entry.base for number, entry in enumerate(self.record_sets)}
        named = {"base": self.base, **sets}
        return {place: file for place, file in named.items() if file and is_data(file)}


class SurgeonRecord(Section):
    """One trial."""

    name: RecordName
    """Name of the trial, unique; pooled is the name of the mean."""
    file: str = Field(min_length=1)
    """Recording, below the data root."""
    surgeon: str = Field(min_length=1)
    """Surgeon who moved the tool; trials of one surgeon are resampled together."""

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if name == "pooled":
            raise ValueError("pooled is the name of the mean of all trials")
        return name


class WelchSettings(Section):
    """Welch's method."""

    segment_s: float = Field(10.24, gt=0)
    """Length of a segment; the distance of frequency lines is 1/segment_s Hz."""
    overlap: float = Field(0.5, ge=0, le=0.95)
    """Overlap of consecutive segments as a share of a segment."""
    window: Literal["hann", "hamming", "blackman", "boxcar", "bartlett", "flattop"] = "hann"
    """Window of every segment."""
    detrend: Literal["constant", "linear"] = "constant"
    """Part that is subtracted from every segment: its mean, or its straight line."""


class BandwidthSettings(Section):
    """Rules for a bandwidth, and its interval."""

    power_share: float = Field(0.95, ge=0.5, le=0.999)
    """Rule power_share: the bandwidth is the frequency below which this share of the power in the band is."""
    level_dB: float = Field(-20.0, ge=-60, le=-1)
    """Rule level: the bandwidth is the last frequency at which the density exceeds this level below its peak."""
    maximum_Hz: float = Field(6.0, gt=0)
    """Upper end of the analysis band. Tremor (8 to 12 Hz) and measurement noise above it do not count; they
    would dominate the velocity's bandwidth."""
    confidence: float = Field(0.95, ge=0.5, le=0.999)
    """Confidence of the intervals."""
    resamples: int = Field(2000, ge=200, le=100000)
    """Number of bootstrap resamples of surgeons, then of their trials."""


class SurgeonSettings(Section):
    """Motion of the surgeons' tool and its bandwidth (section 3.2.3.1 of the thesis)."""

    layout: ColumnLayout = Field(
        default_factory=lambda: ColumnLayout(
            columns=columns(time=("time_s", "s", "time"), position=("z_mm", "mm", "position"))
        )
    )
    rate_Hz: float | None = Field(None, gt=0)
    """Rate to which all trials are resampled; null keeps their rate."""
    records: tuple[SurgeonRecord, ...] = ()
    """Trials; the interval of a bandwidth needs several, preferably of several surgeons."""
    welch: WelchSettings = Field(default_factory=WelchSettings)
    bandwidth: BandwidthSettings = Field(default_factory=BandwidthSettings)
    reference_Hz: float | None = Field(2.5, gt=0)
    """Published bandwidth, drawn for comparison (thesis: 2.5); null draws none."""


class ExcitedBandwidthSettings(Section):
    """Bandwidth of the surgeons that is excited."""

    quantity: Literal["position", "velocity"] = "velocity"
    """Quantity with the spectrum that counts."""
    rule: Literal["power_share", "level"] = "power_share"
    """Rule of surgeon.bandwidth."""


class AmplitudeSettings(Section):
    """Scale of all signals, before a ramp."""

    measure: Literal["rms", "peak"] = "rms"
    """Meaning of value_mm: the root mean square or the peak."""
    value_mm: float = Field(2.0, gt=0, le=1000)
    """Amplitude."""


class MultisineSettings(Section):
    """Multisine of Eq. 3.1."""

    period_s: float = Field(10.0, gt=0, le=1000)
    """Period, a whole number of samples; the distance of lines is 1/period_s Hz."""
    periods: int = Field(10, ge=2, le=1000)
    """Number of periods played; the first is left out as transient."""
    grid: Literal["full", "odd"] = "full"
    """full: every line (thesis); odd: odd lines without some, so that power on the missing ones shows nonlinearity."""
    detection_group: int = Field(4, ge=2, le=20)
    """Odd grid: number of consecutive odd lines of which one, drawn at random, is left out."""
    phases: Literal["schroeder", "clipped", "zero"] = "schroeder"
    """schroeder (thesis), clipped (lowest crest factor, by iterated clipping) or zero (an impulse train, for
    comparison only)."""
    amplitude_exponent: float = Field(0.0, ge=-4, le=4)
    """Exponent of the frequency to which amplitudes are proportional; 0 is flat, as in Eq. 3.1."""


class NoiseSettings(Section):
    """Band-limited Gaussian noise."""

    duration_s: float = Field(10.0, gt=0, le=10000)
    """Duration."""
    filter_order: int = Field(8, ge=1, le=20)
    """Order of the Butterworth low-pass filter, run forward and backward; its -3 dB frequency is the upper end
    of the band."""


class ChirpSettings(Section):
    """Linear chirp of Eq. 3.2."""

    duration_s: float = Field(10.0, gt=0, le=10000)
    """Duration."""
    lowest_Hz: float = Field(0.0, ge=0)
    """Start frequency of the sweep; it ends at the upper end of the band."""


class MachineSettings(Section):
    """Limits of the testing machine, from its data sheet; the defaults suit an electrodynamic one of 60 mm stroke."""

    displacement_mm: float = Field(30.0, gt=0)
    """Largest displacement from the middle."""
    velocity_mm_s: float = Field(1000.0, gt=0)
    """Largest velocity."""
    acceleration_mm_s2: float = Field(20000.0, gt=0)
    """Largest acceleration with tool and grips, i.e. dynamic force over moved mass."""


class SignalsSettings(Section):
    """Excitation signals designed from the surgeons' bandwidth (Eqs 3.1 and 3.2 of the thesis)."""

    bandwidth: ExcitedBandwidthSettings = Field(default_factory=ExcitedBandwidthSettings)
    band_factor: float = Field(2.0, ge=0.1, le=20)
    """Upper end of the excited band divided by the bandwidth (thesis: 2, its 'Nyquist rate')."""
    round_Hz: float = Field(0.5, gt=0, le=10)
    """Step to which the upper end of the excited band is rounded."""
    rate_Hz: float = Field(100.0, ge=1, le=10000)
    """Samples per second of the signals."""
    amplitude: AmplitudeSettings = Field(default_factory=AmplitudeSettings)
    ramp_s: float = Field(0.0, ge=0, le=60)
    """Length of half a cosine that raises every signal from zero; noise and chirp are also lowered at the end.
    0: no ramp. With a ramp the multisine's first period is not periodic."""
    multisine: MultisineSettings = Field(default_factory=MultisineSettings)
    noise: NoiseSettings = Field(default_factory=NoiseSettings)
    chirp: ChirpSettings = Field(default_factory=ChirpSettings)
    machine: MachineSettings = Field(default_factory=MachineSettings)
