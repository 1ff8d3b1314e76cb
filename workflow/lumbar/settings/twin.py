"""The synthetic twin of the thesis's recordings: one seed, one section per kind of recording."""

from typing import Annotated, Literal

from lumbar.settings.key import NAME, UNIQUE, Each, Positive, key, required, section, settings


@settings
class SyntheticSurgeon:
    """One surgeon."""

    stroke_mm: float = required("Mean depth of a stroke at the start.", gt=0)
    stroke_s: float = required(
        "Mean duration of half a stroke; it decides the velocity's bandwidth and is built to give "
        "about 2.5 Hz.",
        gt=0,
    )
    tremor_rms_mm: float = required("Physiological tremor of every axis.", ge=0)
    tremor_Hz: float = required("Centre of the tremor (physiological 8 to 12).", within="[4, 20]")


@settings
class SyntheticSurgeonSettings:
    """Synthetic trials of gaining access."""

    rate_Hz: float = key("Samples per second.", default=100.0, within="[30, 10000]")
    duration_s: float = key("Duration of a trial.", default=60.0, within="[5, 10000]")
    approach_mm: float = key("Distance above the skin at which a trial begins.", default=30.0, ge=0)
    approach_s: float = key("Mean time to reach the skin.", default=2.5, gt=0)
    puncture_mm: float = key("Depth of the puncture.", default=6.0, ge=0)
    puncture_s: float = key("Mean duration of the puncture.", default=0.35, gt=0)
    pause_s: float = key("Mean rest between phases and bouts of strokes.", default=0.7, gt=0)
    reposition_mm: float = key("Standard deviation of the depth at which a bout begins.", default=12.0, ge=0)
    reposition_s: float = key("Mean time to set the tool anew before a bout.", default=1.0, gt=0)
    strokes_per_bout: float = key("Mean number of strokes between rests.", default=6.0, ge=1)
    gain_mm_per_stroke: float = key("Depth gained with every stroke.", default=0.2, unit="mm", ge=0)
    last_stroke_share: float = key(
        "Stroke depth at the end of a trial as a share of that at its start.", default=0.4, within="(0, 1]"
    )
    twist_deg: float = key("Mean angle by which the tool is twisted during a stroke.", default=25.0, ge=0)
    lateral_mm: float = key("Distance of the recorded point from the axis of twisting.", default=4.0, ge=0)
    variation: float = key(
        "Log-normal spread of times and lengths within a trial.", default=0.2, within="[0, 1]"
    )
    tremor_bandwidth_Hz: float = key("Standard deviation of the tremor's spectral peak.", default=1.0, gt=0)
    noise_rms_mm: float = key("White measuring noise of every axis.", default=0.01, ge=0)
    surgeons: dict[str, SyntheticSurgeon] = key("One entry per surgeon named in surgeon.records.", default={})


@settings
class SyntheticTissueSettings:
    """The synthetic tissue, a Kelvin–Boltzmann solid beside a cubic spring, and the load cell."""

    k1_N_per_mm: float = key("Stiffness of the spring parallel to the dashpot.", default=0.405, gt=0)
    k2_N_per_mm: float = key("Stiffness of the spring in series with both.", default=3.24, gt=0)
    relaxation_s: float = key(
        "Time constant b/(k1 + k2) of the relaxation at held position.", default=0.035, within="(0, 100]"
    )
    cubic_N_per_mm3: float = key(
        "Hardening that no linear model can describe: force per cube of the position.", default=0.0202
    )
    noise_variance_share: float = key(
        "White noise of the load cell as a share of the variance of the recorded force.",
        default=0.14,
        within="[0, 1)",
    )
    noise_N: float | None = key(
        "Standard deviation of that noise, the same on every record, in place of its share; null takes the share.",
        default=None,
        ge=0,
    )
    noise_correlation_s: float = key(
        "Correlation time of that noise, which is then a slow disturbance; 0 makes it white.",
        default=0.0,
        within="[0, 100]",
    )
    delay_s: float = key("Time by which the recorded force lags the position.", default=0.0, within="[0, 1]")


@settings
class SyntheticGapSettings:
    """Markers hidden for a moment."""

    count: int = key("Number of gaps in a recording, each in another marker.", default=12, within="[0, 1000]")
    longest_s: float = key("Longest gap.", default=0.15, within="[0, 1]")


@settings
class WorkplaceSettings:
    """Box, pallet and table."""

    box_width_m: float = key("Width of the box between the hands.", default=0.4, within="(0, 2]")
    box_depth_m: float = key("Depth of the box.", default=0.32, within="(0, 2]")
    box_height_m: float = key("Height of the box.", default=0.28, within="(0, 2]")
    pallet_height_m: float = key("Height of the pallet.", default=0.2, within="[0, 2]")
    pallet_distance_m: float = key(
        "Centre of the box ahead of the ankles before the lift.", default=0.28, within="[0, 2]"
    )
    table_height_m: float = key("Height of the table.", default=0.66, within="[0, 2]")
    table_distance_m: float = key(
        "Centre of the box ahead of the ankles after the deposit.", default=0.43, within="[0, 2]"
    )
    walk_m: float = key(
        "Way from the pallet to the table, walked in three steps.", default=0.9, within="[0.2, 5]"
    )


@settings
class HiddenMomentSettings:
    """What Eq. 4.1 leaves out."""

    hand_distance_m: float = key(
        "Distance of the box from the hip while it is held; 0 takes the hand load away.",
        default=0.45,
        within="[0, 2]",
    )
    stiffening_N_m: float = key(
        "Passive stiffness: this moment times exp(angle/stiffening_angle_rad) - 1; 0 takes it away.",
        default=0.0,
        within="[0, 1000]",
    )
    stiffening_angle_rad: float = key(
        "Angle over which the passive moment grows e-fold.", default=0.35, within="[0.05, 10]"
    )


@settings
class MomentTrial:
    """One trial in which a lift is repeated."""

    lift: str = required("One of lifts.")
    pace: float = required("Speed, as a factor of that of the lift.", within="[0.2, 3]")
    repetitions: int = required("How often the lift is done.", within="[1, 50]")
    variation: float = required(
        "Spread of the trunk's inclination between repetitions, as a share of it.", within="[0, 0.3]"
    )
    with_box: bool = required("false: the movement is done without the box.")


@settings
class SyntheticMomentSettings:
    """Moment at the hip: the pendulum of Eq. 4.1 and the effects hidden in it."""

    damping_N_m_s: float = key("Damping b.", default=8.0, unit="N·m·s/rad", within="[0, 1000]")
    noise_N_m: float = key("Standard deviation of the noise.", default=2.0, within="[0, 1000]")
    hidden: HiddenMomentSettings = section(default_factory=HiddenMomentSettings)
    trials: dict[str, MomentTrial] = key(
        "Trials in which one lift is repeated, by name; records of improvement.record_sets in the "
        "folder hip_moment.",
        default={},
    )


@settings
class SyntheticPerson:
    """One synthetic person."""

    mass_kg: float = required("Body mass.", within="(0, 400]")
    height_m: float = required("Stature.", within="[0.5, 2.6]")


@settings
class TrueEvents:
    """True times of the events."""

    lift_off: float = required("The box leaves the pallet.", unit="s", ge=1.4)
    toe_off: float = required("The right toe leaves the ground.", unit="s")
    deposit_start: float = required("The wrists are slowest before they go down.", unit="s")
    release: float = required("The box stands and the hands leave it.", unit="s")


@settings
class SyntheticLift:
    """Movement of one lift."""

    person: str = required("One of people.")
    box_mass_kg: float = required("Mass of the box.", within="[0, 100]")
    lift_flexion_deg: float = required(
        "Inclination of the thorax when the box is grasped.", within="[0, 120]"
    )
    lift_squat_m: float = required("Descent of the hips when the box is grasped.", within="[0, 0.6]")
    deposit_flexion_deg: float = required(
        "Inclination of the thorax at the release beyond that of carrying.", within="[0, 90]"
    )
    deposit_squat_m: float = required("Descent of the hips at the release.", within="[0, 0.6]")
    lateral_bending_deg: float = required("Largest bending to the right.", within="[-45, 45]")
    lateral_sway_m: float = required("Largest shift of the hips to the right.", within="[-0.3, 0.3]")
    hesitation_deg: float = required(
        "Amplitude of corrections of the trunk during the deposit.", within="[0, 20]"
    )
    hesitation_Hz: float = required("Frequency of the corrections.", within="(0, 10]")
    foot_adjustment: bool = required("Whether the left foot shuffles to the box before the lift.")
    events_s: TrueEvents = required("True times of the events.")


GroupName = Annotated[str, Each(pattern=NAME)]
NonNegative = Annotated[float, Each(ge=0)]
Drawn = tuple[float, NonNegative, NonNegative]
"""Mean, standard deviation between persons, standard deviation between the trials of one person."""


def _drawn(meaning: str, default: tuple[float, float, float]):
    return key(f"{meaning} [mean, SD between persons, SD between trials].", default=default)


@settings
class GroupMovement:
    """How people of one group lift; the defaults are an expert's."""

    lift_flexion_deg: Drawn = _drawn("Inclination of the thorax when the box is grasped", (60.0, 8.0, 3.0))
    lift_squat_m: Drawn = _drawn("Descent of the hips when the box is grasped", (0.33, 0.05, 0.02))
    deposit_flexion_deg: Drawn = _drawn("Inclination at the release", (23.0, 5.0, 2.0))
    deposit_squat_m: Drawn = _drawn("Descent of the hips at the release", (0.06, 0.015, 0.007))
    lateral_bending_deg: Drawn = _drawn("Largest bending to the right", (3.8, 1.5, 0.8))
    lateral_sway_m: Drawn = _drawn("Largest shift of the hips to the right", (0.010, 0.004, 0.002))
    hesitation_deg: Drawn = _drawn("Amplitude of corrections during the deposit", (0.4, 0.2, 0.1))
    hesitation_Hz: Drawn = _drawn("Frequency of the corrections", (1.3, 0.2, 0.1))
    foot_adjustment: float = key(
        "Share of the trials in which a foot shuffles to the box first.", default=0.1, within="[0, 1]"
    )
    tempo: Drawn = _drawn("Factor on all durations", (1.0, 0.08, 0.03))


@settings
class CohortGroup(GroupMovement):
    """One group of a cohort: how they lift, and how many they are."""

    persons: int = key("Number of persons.", default=10, within="[1, 100000]")


@settings
class CohortSettings:
    """Synthetic people drawn from distributions, in place of persons and lifts that are named one by one.

    Every value is drawn from a normal distribution without what lies beyond 2.5 standard deviations. A person's numbers
    hang on the twin's seed and the person's name alone: whoever is added changes nobody.
    """

    groups: dict[GroupName, CohortGroup] = key(
        "Groups by their label (experience of the people), e.g. expert and novice.", default={}, min_length=1
    )
    box_masses_kg: Annotated[tuple[Annotated[float, Each(ge=0, le=100)], ...], UNIQUE] = key(
        "Masses of the boxes that everybody lifts.", default=(15.0, 23.0), min_length=1
    )
    trials: int = key("Trials of every person with every box.", default=3, within="[1, 1000]")
    female_share: float = key("Share of women in every group.", default=0.5, within="[0, 1]")
    stature_m: dict[Literal["female", "male"], tuple[float, NonNegative]] = key(
        "Mean and standard deviation by sex (ANSUR II, Gordon et al., 2014).",
        default={"female": (1.628, 0.064), "male": (1.756, 0.069)},
    )
    mass_kg: dict[Literal["female", "male"], tuple[float, NonNegative]] = key(
        "Mean and standard deviation by sex (ANSUR II).",
        default={"female": (67.8, 11.0), "male": (85.5, 14.2)},
    )
    stature_mass_correlation: float = key(
        "Correlation of stature and mass within a sex.", default=0.5, within="(-1, 1)"
    )
    mass_error_kg: float = key(
        "Standard deviation of the body mass that the study declares about the true one; 0 declares the truth.",
        default=0.5,
        within="[0, 20]",
    )
    stature_error_m: float = key(
        "Standard deviation of the stature that the study declares about the true one.",
        default=0.005,
        within="[0, 0.2]",
    )
    durations_s: tuple[Positive, Positive, Positive, Positive] = key(
        "Usual time of reaching for the box, lifting it, carrying it and depositing it; the first is 1.8 s at least.",
        default=(2.25, 1.5, 1.8, 1.25),
    )
    slower_per_kg: float = key(
        "By how much of themselves durations grow with each kilogram beyond the lightest box.",
        default=0.008,
        within="[0, 0.1]",
    )


@settings
class SyntheticLiftingSettings:
    """Synthetic lifting recordings."""

    rate_Hz: float = key("Frames per second.", default=100.0, within="[20, 1000]")
    duration_s: float = key("Length of a recording.", default=9.5, within="[4, 120]")
    marker_noise_mm: float = key(
        "Standard deviation of the white noise on every coordinate.", default=0.5, within="[0, 20]"
    )
    gaps: SyntheticGapSettings = section(default_factory=SyntheticGapSettings)
    workplace: WorkplaceSettings = section(default_factory=WorkplaceSettings)
    hip_moment: SyntheticMomentSettings = section(default_factory=SyntheticMomentSettings)
    people: dict[str, SyntheticPerson] = key(
        "True mass and stature of synthetic people; of anybody else they are what config/subjects declares.",
        default={},
    )
    lifts: dict[str, SyntheticLift] = key(
        "Movement of lifts, by name: <subject>_<box mass>kg, with _2 and so on where a box is lifted again. Any other lift is "
        "drawn as of the person's group.",
        default={},
    )
    groups: dict[GroupName, GroupMovement] = key(
        "How people lift whose lifts are not named, by their label (experience in config/subjects).",
        default={},
    )
    cohort: CohortSettings | None = key(
        "People drawn from distributions, in place of lifting.subjects, people and lifts; null takes those.",
        default=None,
    )


@settings
class TwoHiddenEffectsSettings:
    """A second set of synthetic tissue tests, with dry friction, hardening and little noise."""

    number: int = key("Which draw of tissue, motion and effects.", default=1, ge=0)
    noise_share: float = key(
        "RMS of the noise over that of the force without the effects.", default=0.01, within="(0, 1]"
    )
    residual_over_noise: float = key(
        "RMS that the best Kelvin–Boltzmann model leaves of each effect, over the noise.", default=16.0, gt=0
    )


@settings
class TwinSettings:
    """The synthetic twin: one section per kind of recording."""

    seed: int = key("Seed of every random number of the twin.", default=45, ge=0)
    surgeon: SyntheticSurgeonSettings = section(default_factory=SyntheticSurgeonSettings)
    tissue: SyntheticTissueSettings = section(default_factory=SyntheticTissueSettings)
    lifting: SyntheticLiftingSettings = section(default_factory=SyntheticLiftingSettings)
    two_hidden_effects: TwoHiddenEffectsSettings = section(default_factory=TwoHiddenEffectsSettings)
