"""The synthetic twin of the thesis's recordings: one seed, one section per kind of recording."""

from typing import Annotated, Literal

from lumbar.settings.key import NAME, UNIQUE, Each, Positive, key, required, section, settings


@settings
class SyntheticSurgeon:
    """One surgeon."""

    stroke_mm: float = required(gt=0)
    stroke_s: float = required(gt=0)
    tremor_rms_mm: float = required(ge=0)
    tremor_Hz: float = required(within="[4, 20]")


@settings
class SyntheticSurgeonSettings:
    """Synthetic trials of gaining access."""

    rate_Hz: float = key(default=100.0, within="[30, 10000]")
    duration_s: float = key(default=60.0, within="[5, 10000]")
    approach_mm: float = key(default=30.0, ge=0)
    approach_s: float = key(default=2.5, gt=0)
    puncture_mm: float = key(default=6.0, ge=0)
    puncture_s: float = key(default=0.35, gt=0)
    pause_s: float = key(default=0.7, gt=0)
    reposition_mm: float = key(default=12.0, ge=0)
    reposition_s: float = key(default=1.0, gt=0)
    strokes_per_bout: float = key(default=6.0, ge=1)
    gain_mm_per_stroke: float = key(default=0.2, unit="mm", ge=0)
    last_stroke_share: float = key(default=0.4, within="(0, 1]")
    twist_deg: float = key(default=25.0, ge=0)
    lateral_mm: float = key(default=4.0, ge=0)
    variation: float = key(default=0.2, within="[0, 1]")
    tremor_bandwidth_Hz: float = key(default=1.0, gt=0)
    noise_rms_mm: float = key(default=0.01, ge=0)
    surgeons: dict[str, SyntheticSurgeon] = key(default={})


@settings
class SyntheticTissueSettings:
    """The synthetic tissue, a Kelvin–Boltzmann solid beside a cubic spring, and the load cell."""

    k1_N_per_mm: float = key(default=0.405, gt=0)
    k2_N_per_mm: float = key(default=3.24, gt=0)
    relaxation_s: float = key(default=0.035, within="(0, 100]")
    cubic_N_per_mm3: float = key(default=0.0202)
    noise_variance_share: float = key(default=0.14, within="[0, 1)")
    noise_N: float | None = key(default=None, ge=0)
    noise_correlation_s: float = key(default=0.0, within="[0, 100]")
    delay_s: float = key(default=0.0, within="[0, 1]")


@settings
class SyntheticGapSettings:
    """Markers hidden for a moment."""

    count: int = key(default=12, within="[0, 1000]")
    longest_s: float = key(default=0.15, within="[0, 1]")


@settings
class WorkplaceSettings:
    """Box, pallet and table."""

    box_width_m: float = key(default=0.4, within="(0, 2]")
    box_depth_m: float = key(default=0.32, within="(0, 2]")
    box_height_m: float = key(default=0.28, within="(0, 2]")
    pallet_height_m: float = key(default=0.2, within="[0, 2]")
    pallet_distance_m: float = key(default=0.28, within="[0, 2]")
    table_height_m: float = key(default=0.66, within="[0, 2]")
    table_distance_m: float = key(default=0.43, within="[0, 2]")
    walk_m: float = key(default=0.9, within="[0.2, 5]")


@settings
class HiddenMomentSettings:
    """What Eq. 4.1 leaves out."""

    hand_distance_m: float = key(default=0.45, within="[0, 2]")
    stiffening_N_m: float = key(default=0.0, within="[0, 1000]")
    stiffening_angle_rad: float = key(default=0.35, within="[0.05, 10]")


@settings
class MomentTrial:
    """One trial in which a lift is repeated."""

    lift: str = required()
    pace: float = required(within="[0.2, 3]")
    repetitions: int = required(within="[1, 50]")
    variation: float = required(within="[0, 0.3]")
    with_box: bool = required()


@settings
class SyntheticMomentSettings:
    """Moment at the hip: the pendulum of Eq. 4.1 and the effects hidden in it."""

    damping_N_m_s: float = key(default=8.0, unit="N·m·s/rad", within="[0, 1000]")
    noise_N_m: float = key(default=2.0, within="[0, 1000]")
    hidden: HiddenMomentSettings = section(default_factory=HiddenMomentSettings)
    trials: dict[str, MomentTrial] = key(default={})


@settings
class SyntheticPerson:
    """One synthetic person."""

    mass_kg: float = required(within="(0, 400]")
    height_m: float = required(within="[0.5, 2.6]")


@settings
class TrueEvents:
    """True times of the events."""

    lift_off: float = required(unit="s", ge=1.4)
    toe_off: float = required(unit="s")
    deposit_start: float = required(unit="s")
    release: float = required(unit="s")


@settings
class SyntheticLift:
    """Movement of one lift."""

    person: str = required()
    box_mass_kg: float = required(within="[0, 100]")
    lift_flexion_deg: float = required(within="[0, 120]")
    lift_squat_m: float = required(within="[0, 0.6]")
    deposit_flexion_deg: float = required(within="[0, 90]")
    deposit_squat_m: float = required(within="[0, 0.6]")
    lateral_bending_deg: float = required(within="[-45, 45]")
    lateral_sway_m: float = required(within="[-0.3, 0.3]")
    hesitation_deg: float = required(within="[0, 20]")
    hesitation_Hz: float = required(within="(0, 10]")
    foot_adjustment: bool = required()
    events_s: TrueEvents = required()


GroupName = Annotated[str, Each(pattern=NAME)]
NonNegative = Annotated[float, Each(ge=0)]
Drawn = tuple[float, NonNegative, NonNegative]
"""Mean, standard deviation between persons, standard deviation between the trials of one person."""


@settings
class GroupMovement:
    """How people of one group lift; the defaults are an expert's."""

    lift_flexion_deg: Drawn = key(default=(60.0, 8.0, 3.0))
    lift_squat_m: Drawn = key(default=(0.33, 0.05, 0.02))
    deposit_flexion_deg: Drawn = key(default=(23.0, 5.0, 2.0))
    deposit_squat_m: Drawn = key(default=(0.06, 0.015, 0.007))
    lateral_bending_deg: Drawn = key(default=(3.8, 1.5, 0.8))
    lateral_sway_m: Drawn = key(default=(0.010, 0.004, 0.002))
    hesitation_deg: Drawn = key(default=(0.4, 0.2, 0.1))
    hesitation_Hz: Drawn = key(default=(1.3, 0.2, 0.1))
    foot_adjustment: float = key(default=0.1, within="[0, 1]")
    tempo: Drawn = key(default=(1.0, 0.08, 0.03))


@settings
class CohortGroup(GroupMovement):
    """One group of a cohort: how they lift, and how many they are."""

    persons: int = key(default=10, within="[1, 100000]")


@settings
class CohortSettings:
    """Synthetic people drawn from distributions, in place of persons and lifts that are named one by one.

    Every value is drawn from a normal distribution without what lies beyond 2.5 standard deviations. A person's numbers
    hang on the twin's seed and the person's name alone: whoever is added changes nobody.
    """

    groups: dict[GroupName, CohortGroup] = key(default={}, min_length=1)
    box_masses_kg: Annotated[tuple[Annotated[float, Each(ge=0, le=100)], ...], UNIQUE] = key(
        default=(15.0, 23.0), min_length=1
    )
    trials: int = key(default=3, within="[1, 1000]")
    female_share: float = key(default=0.5, within="[0, 1]")
    stature_m: dict[Literal["female", "male"], tuple[float, NonNegative]] = key(
        default={"female": (1.628, 0.064), "male": (1.756, 0.069)}
    )
    mass_kg: dict[Literal["female", "male"], tuple[float, NonNegative]] = key(
        default={"female": (67.8, 11.0), "male": (85.5, 14.2)}
    )
    stature_mass_correlation: float = key(default=0.5, within="(-1, 1)")
    mass_error_kg: float = key(default=0.5, within="[0, 20]")
    stature_error_m: float = key(default=0.005, within="[0, 0.2]")
    durations_s: tuple[Positive, Positive, Positive, Positive] = key(default=(2.25, 1.5, 1.8, 1.25))
    slower_per_kg: float = key(default=0.008, within="[0, 0.1]")


@settings
class SyntheticLiftingSettings:
    """Synthetic lifting recordings."""

    rate_Hz: float = key(default=100.0, within="[20, 1000]")
    duration_s: float = key(default=9.5, within="[4, 120]")
    marker_noise_mm: float = key(default=0.5, within="[0, 20]")
    gaps: SyntheticGapSettings = section(default_factory=SyntheticGapSettings)
    workplace: WorkplaceSettings = section(default_factory=WorkplaceSettings)
    hip_moment: SyntheticMomentSettings = section(default_factory=SyntheticMomentSettings)
    people: dict[str, SyntheticPerson] = key(default={})
    lifts: dict[str, SyntheticLift] = key(default={})
    groups: dict[GroupName, GroupMovement] = key(default={})
    cohort: CohortSettings | None = key(default=None)


@settings
class TwoHiddenEffectsSettings:
    """A second set of synthetic tissue tests, with dry friction, hardening and little noise."""

    number: int = key(default=1, ge=0)
    noise_share: float = key(default=0.01, within="(0, 1]")
    residual_over_noise: float = key(default=16.0, gt=0)


@settings
class TwinSettings:
    """The synthetic twin: one section per kind of recording."""

    seed: int = key(default=45, ge=0)
    surgeon: SyntheticSurgeonSettings = section(default_factory=SyntheticSurgeonSettings)
    tissue: SyntheticTissueSettings = section(default_factory=SyntheticTissueSettings)
    lifting: SyntheticLiftingSettings = section(default_factory=SyntheticLiftingSettings)
    two_hidden_effects: TwoHiddenEffectsSettings = section(default_factory=TwoHiddenEffectsSettings)
