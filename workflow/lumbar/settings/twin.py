"""The synthetic twin of the thesis's recordings: one seed, one section per kind of recording."""

from typing import Annotated, Literal

from pydantic import Field

from lumbar.settings.section import NAME, Positive, Section, Unique


class SyntheticSurgeon(Section):
    """One surgeon."""

    stroke_mm: float = Field(gt=0)
    """Mean depth of a stroke at the start."""
    stroke_s: float = Field(gt=0)
    """Mean duration of half a stroke; it sets the velocity's bandwidth, here about 2.5 Hz."""
    tremor_rms_mm: float = Field(ge=0)
    """Physiological tremor of every axis."""
    tremor_Hz: float = Field(ge=4, le=20)
    """Centre of the tremor (physiological 8 to 12)."""


class SyntheticSurgeonSettings(Section):
    """Synthetic trials of gaining access."""

    rate_Hz: float = Field(100.0, ge=30, le=10000)
    """Samples per second."""
    duration_s: float = Field(60.0, ge=5, le=10000)
    """Duration of a trial."""
    approach_mm: float = Field(30.0, ge=0)
    """Distance above the skin at the start of a trial."""
    approach_s: float = Field(2.5, gt=0)
    """Mean time to reach the skin."""
    puncture_mm: float = Field(6.0, ge=0)
    """Depth of the puncture."""
    puncture_s: float = Field(0.35, gt=0)
    """Mean duration of the puncture."""
    pause_s: float = Field(0.7, gt=0)
    """Mean rest between phases and bouts of strokes."""
    reposition_mm: float = Field(12.0, ge=0)
    """Standard deviation of the depth at the start of a bout."""
    reposition_s: float = Field(1.0, gt=0)
    """Mean time to reposition the tool before a bout."""
    strokes_per_bout: float = Field(6.0, ge=1)
    """Mean number of strokes between rests."""
    gain_mm_per_stroke: float = Field(0.2, ge=0, json_schema_extra={"unit": "mm"})
    """Depth gained with every stroke."""
    last_stroke_share: float = Field(0.4, gt=0, le=1)
    """Stroke depth at the end of a trial as a share of that at its start."""
    twist_deg: float = Field(25.0, ge=0)
    """Mean rotation of the tool during a stroke."""
    lateral_mm: float = Field(4.0, ge=0)
    """Distance of the recorded point from the axis of twisting."""
    variation: float = Field(0.2, ge=0, le=1)
    """Log-normal spread of times and lengths within a trial."""
    tremor_bandwidth_Hz: float = Field(1.0, gt=0)
    """Standard deviation of the tremor's spectral peak."""
    noise_rms_mm: float = Field(0.01, ge=0)
    """White measurement noise of every axis."""
    surgeons: dict[str, SyntheticSurgeon] = Field({})
    """One entry per surgeon named in surgeon.records."""


class SyntheticTissueSettings(Section):
    """The synthetic tissue, a Kelvin–Boltzmann solid in parallel with a cubic spring, and the load cell."""

    k1_N_per_mm: float = Field(0.405, gt=0)
    """Stiffness of the spring parallel to the dashpot."""
    k2_N_per_mm: float = Field(3.24, gt=0)
    """Stiffness of the spring in series with both."""
    relaxation_s: float = Field(0.035, gt=0, le=100)
    """Time constant b/(k1 + k2) of the relaxation at held position."""
    cubic_N_per_mm3: float = 0.0202
    """Hardening outside every linear model: force per cube of the position."""
    noise_variance_share: float = Field(0.14, ge=0, lt=1)
    """White noise of the load cell as a share of the variance of the recorded force."""
    noise_N: float | None = Field(None, ge=0)
    """Standard deviation of that noise, equal on every record, instead of its share; null uses the share."""
    noise_correlation_s: float = Field(0.0, ge=0, le=100)
    """Correlation time of that noise, which is then a slow disturbance; 0 makes it white."""
    delay_s: float = Field(0.0, ge=0, le=1)
    """Time by which the recorded force lags the position."""


class SyntheticGapSettings(Section):
    """Gaps in which a marker is hidden."""

    count: int = Field(12, ge=0, le=1000)
    """Number of gaps in a recording, each in another marker."""
    longest_s: float = Field(0.15, ge=0, le=1)
    """Longest gap."""


class WorkplaceSettings(Section):
    """Box, pallet and table."""

    box_width_m: float = Field(0.4, gt=0, le=2)
    """Width of the box between the hands."""
    box_depth_m: float = Field(0.32, gt=0, le=2)
    """Depth of the box."""
    box_height_m: float = Field(0.28, gt=0, le=2)
    """Height of the box."""
    pallet_height_m: float = Field(0.2, ge=0, le=2)
    """Height of the pallet."""
    pallet_distance_m: float = Field(0.28, ge=0, le=2)
    """Centre of the box ahead of the ankles before the lift."""
    table_height_m: float = Field(0.66, ge=0, le=2)
    """Height of the table."""
    table_distance_m: float = Field(0.43, ge=0, le=2)
    """Centre of the box ahead of the ankles after the deposit."""
    walk_m: float = Field(0.9, ge=0.2, le=5)
    """Distance between pallet and table, walked in three steps."""


class HiddenMomentSettings(Section):
    """Effects that Eq. 4.1 does not contain."""

    hand_distance_m: float = Field(0.45, ge=0, le=2)
    """Distance of the box from the hip while it is held; 0 removes the hand load."""
    stiffening_N_m: float = Field(0.0, ge=0, le=1000)
    """Passive stiffness: this moment times exp(angle/stiffening_angle_rad) - 1; 0 removes it."""
    stiffening_angle_rad: float = Field(0.35, ge=0.05, le=10)
    """Angle over which the passive moment grows e-fold."""


class MomentTrial(Section):
    """One trial in which a lift is repeated."""

    lift: str
    """Lift that is repeated, one of lifts."""
    pace: float = Field(ge=0.2, le=3)
    """Speed as a factor on that of the lift."""
    repetitions: int = Field(ge=1, le=50)
    """Number of repetitions of the lift."""
    variation: float = Field(ge=0, le=0.3)
    """Spread of the trunk's inclination between repetitions, as a share of it."""
    with_box: bool
    """false: the movement is without the box."""


class SyntheticMomentSettings(Section):
    """Moment at the hip: the pendulum of Eq. 4.1 and the effects hidden in it."""

    damping_N_m_s: float = Field(8.0, ge=0, le=1000, json_schema_extra={"unit": "N·m·s/rad"})
    """Damping b."""
    noise_N_m: float = Field(2.0, ge=0, le=1000)
    """Standard deviation of the noise."""
    hidden: HiddenMomentSettings = Field(default_factory=HiddenMomentSettings)
    trials: dict[str, MomentTrial] = Field({})
    """Trials in which one lift is repeated, by name; records of improvement.record_sets in the folder
    hip_moment."""


class SyntheticPerson(Section):
    """One synthetic person."""

    mass_kg: float = Field(gt=0, le=400)
    """Body mass."""
    height_m: float = Field(ge=0.5, le=2.6)
    """Stature."""


class TrueEvents(Section):
    """True times of the events."""

    lift_off: float = Field(ge=1.4, json_schema_extra={"unit": "s"})
    """The box leaves the pallet."""
    toe_off: float = Field(json_schema_extra={"unit": "s"})
    """The right toe leaves the ground."""
    deposit_start: float = Field(json_schema_extra={"unit": "s"})
    """The wrists are slowest before they go down."""
    release: float = Field(json_schema_extra={"unit": "s"})
    """The box is on the table and the hands leave it."""


class SyntheticLift(Section):
    """Movement of one lift."""

    person: str
    """Person who lifts, one of people."""
    box_mass_kg: float = Field(ge=0, le=100)
    """Mass of the box."""
    lift_flexion_deg: float = Field(ge=0, le=120)
    """Inclination of the thorax at the grasp of the box."""
    lift_squat_m: float = Field(ge=0, le=0.6)
    """Descent of the hips at the grasp of the box."""
    deposit_flexion_deg: float = Field(ge=0, le=90)
    """Inclination of the thorax at the release beyond that of carrying."""
    deposit_squat_m: float = Field(ge=0, le=0.6)
    """Descent of the hips at the release."""
    lateral_bending_deg: float = Field(ge=-45, le=45)
    """Largest bending to the right."""
    lateral_sway_m: float = Field(ge=-0.3, le=0.3)
    """Largest shift of the hips to the right."""
    hesitation_deg: float = Field(ge=0, le=20)
    """Amplitude of corrections of the trunk during the deposit."""
    hesitation_Hz: float = Field(gt=0, le=10)
    """Frequency of the corrections."""
    foot_adjustment: bool
    """true: the left foot moves to the box before the lift."""
    events_s: TrueEvents
    """True times of the events."""


GroupName = Annotated[str, Field(pattern=NAME)]
NonNegative = Annotated[float, Field(ge=0)]
Drawn = tuple[float, NonNegative, NonNegative]
"""Mean, standard deviation between persons, standard deviation between the trials of one person."""


class GroupMovement(Section):
    """Movement of a group; the defaults are an expert's."""

    lift_flexion_deg: Drawn = (60.0, 8.0, 3.0)
    """Inclination of the thorax at the grasp of the box [mean, SD between persons, SD between trials]."""
    lift_squat_m: Drawn = (0.33, 0.05, 0.02)
    """Descent of the hips at the grasp of the box [mean, SD between persons, SD between trials]."""
    deposit_flexion_deg: Drawn = (23.0, 5.0, 2.0)
    """Inclination at the release [mean, SD between persons, SD between trials]."""
    deposit_squat_m: Drawn = (0.06, 0.015, 0.007)
    """Descent of the hips at the release [mean, SD between persons, SD between trials]."""
    lateral_bending_deg: Drawn = (3.8, 1.5, 0.8)
    """Largest bending to the right [mean, SD between persons, SD between trials]."""
    lateral_sway_m: Drawn = (0.010, 0.004, 0.002)
    """Largest shift of the hips to the right [mean, SD between persons, SD between trials]."""
    hesitation_deg: Drawn = (0.4, 0.2, 0.1)
    """Amplitude of corrections during the deposit [mean, SD between persons, SD between trials]."""
    hesitation_Hz: Drawn = (1.3, 0.2, 0.1)
    """Frequency of the corrections [mean, SD between persons, SD between trials]."""
    foot_adjustment: float = Field(0.1, ge=0, le=1)
    """Share of the trials with a step of one foot to the box before the lift."""
    tempo: Drawn = (1.0, 0.08, 0.03)
    """Factor on all durations [mean, SD between persons, SD between trials]."""


class CohortGroup(GroupMovement):
    """One group of a cohort: its movement and its size."""

    persons: int = Field(10, ge=1, le=100000)
    """Number of persons."""


class CohortSettings(Section):
    """Synthetic people drawn from distributions, instead of persons and lifts that are named one by one.

    Every value is drawn from a normal distribution within 2.5 standard deviations. A person's numbers depend only on the twin's
    seed and the person's name: another person changes no existing one.
    """

    groups: dict[GroupName, CohortGroup] = Field({}, min_length=1)
    """Groups by label (experience of the subjects), e.g. expert and novice."""
    box_masses_kg: Unique[Annotated[float, Field(ge=0, le=100)]] = Field((15.0, 23.0), min_length=1)
    """Masses of the boxes that every person lifts."""
    trials: int = Field(3, ge=1, le=1000)
    """Trials of every person with every box."""
    female_share: float = Field(0.5, ge=0, le=1)
    """Share of women in every group."""
    stature_m: dict[Literal["female", "male"], tuple[float, NonNegative]] = Field(
        {"female": (1.628, 0.064), "male": (1.756, 0.069)}
    )
    """Mean and standard deviation by sex (ANSUR II, Gordon et al., 2014)."""
    mass_kg: dict[Literal["female", "male"], tuple[float, NonNegative]] = Field(
        {"female": (67.8, 11.0), "male": (85.5, 14.2)}
    )
    """Mean and standard deviation by sex (ANSUR II)."""
    stature_mass_correlation: float = Field(0.5, gt=-1, lt=1)
    """Correlation of stature and mass within a sex."""
    mass_error_kg: float = Field(0.5, ge=0, le=20)
    """Standard deviation of the declared body mass about the true one; 0 declares the true one."""
    stature_error_m: float = Field(0.005, ge=0, le=0.2)
    """Standard deviation of the declared stature about the true one."""
    durations_s: tuple[Positive, Positive, Positive, Positive] = (2.25, 1.5, 1.8, 1.25)
    """Typical times of reaching for the box, lifting it, carrying it and depositing it; the first is at least 1.8 s."""
    slower_per_kg: float = Field(0.008, ge=0, le=0.1)
    """Relative increase of the durations per kilogram above the lightest box."""


class SyntheticLiftingSettings(Section):
    """Synthetic lifting recordings."""

    rate_Hz: float = Field(100.0, ge=20, le=1000)
    """Frames per second."""
    duration_s: float = Field(9.5, ge=4, le=120)
    """Length of a recording."""
    marker_noise_mm: float = Field(0.5, ge=0, le=20)
    """Standard deviation of the white noise on every coordinate."""
    gaps: SyntheticGapSettings = Field(default_factory=SyntheticGapSettings)
    workplace: WorkplaceSettings = Field(default_factory=WorkplaceSettings)
    hip_moment: SyntheticMomentSettings = Field(default_factory=SyntheticMomentSettings)
    people: dict[str, SyntheticPerson] = Field({})
    """True mass and stature of every synthetic person; config/subjects has the measured ones."""
    lifts: dict[str, SyntheticLift] = Field({})
    """Movement of lifts by name: <subject>_<box mass>kg, with _2 and so on for repeated lifts of a box. Any
    other lift is drawn from the group of its subject."""
    groups: dict[GroupName, GroupMovement] = Field({})
    """Movement of lifts that have no entry in lifts, by label (experience in config/subjects)."""
    cohort: CohortSettings | None = None
    """People drawn from distributions, instead of lifting.subjects, people and lifts; null uses those."""


class TwoHiddenEffectsSettings(Section):
    """A second set of synthetic tissue tests, with dry friction, hardening and little noise."""

    number: int = Field(1, ge=0)
    """Number of the random draw of tissue, motion and effects."""
    noise_share: float = Field(0.01, gt=0, le=1)
    """RMS of the noise divided by that of the force without the effects."""
    residual_over_noise: float = Field(16.0, gt=0)
    """RMS of the residual of the best Kelvin–Boltzmann model for each effect, divided by that of the noise."""


class TwinSettings(Section):
    """The synthetic twin: one section per kind of recording."""

    seed: int = Field(45, ge=0)
    """Seed of every random number of the twin."""
    surgeon: SyntheticSurgeonSettings = Field(default_factory=SyntheticSurgeonSettings)
    tissue: SyntheticTissueSettings = Field(default_factory=SyntheticTissueSettings)
    lifting: SyntheticLiftingSettings = Field(default_factory=SyntheticLiftingSettings)
    two_hidden_effects: TwoHiddenEffectsSettings = Field(default_factory=TwoHiddenEffectsSettings)
