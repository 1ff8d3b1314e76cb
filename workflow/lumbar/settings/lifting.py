"""Chapters lifting and stability: subjects, from marker files to pendulums, and their basins of attraction."""

import math
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from lumbar.base.yaml_file import shipped_yaml
from lumbar.settings.layout import Alias, Axis, ColumnLayout, MarkerLayout, MeanOfMarkers
from lumbar.settings.section import REJECT_REPEATED, FolderName, Interval, Section, Unique, Word

ALIASES: dict[str, Alias] = {
    **{
        name: tuple(
            MeanOfMarkers.model_construct(mean=tuple(label["mean"])) if isinstance(label, dict) else label
            for label in labels
        )
        for name, labels in shipped_yaml(Path(__file__).parent / "labels" / "aliases.yaml").items()
    },
    **{f"BOX_{number}": f"BOX_{number}" for number in range(1, 9)},
}
"""Labels of common marker sets by standard name."""
REFINING = tuple(name for name in ALIASES if name.endswith(("_MEDIAL", "HEAD_CENTRE")))
"""Markers that only refine results."""
RIGID_BODIES = {
    "box": tuple(f"BOX_{number}" for number in range(1, 9)),
    "pelvis": ("SACRUM", "L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS"),
}
MOMENT_COLUMNS = shipped_yaml(Path(__file__).parent / "labels" / "moment_columns.yaml")


class DeclaredEvents(Section):
    """Times set by hand, which replace the detected ones."""

    lift_off_s: float | None = None
    """Box leaves its support."""
    toe_off_s: float | None = None
    """End of the lift."""
    deposit_start_s: float | None = None
    """Start of the deposit."""
    release_s: float | None = None
    """Box is released."""
    reason: str | None = None
    """Reason for setting them by hand, shown with the result."""


class TrialSettings(Section):
    """One recorded lift."""

    box_mass_kg: float = Field(ge=0, le=100)
    """Mass of the box."""
    markers: str
    """Marker file (C3D, TRC, CSV, BVH; also .gz)."""
    hip_moment: str | None = None
    """File of the hip moment (time_s, angle_rad, moment_Nm)."""
    forward: Axis | None = None
    """Axis of the file in the direction that the subject faces in this trial; null: lifting.markers.forward."""
    window_s: Interval | None = None
    """Start and end of the part of the recording with this lift, on the file's clock; null takes all of it. It
    is cut after filtering, so that the filter does not end there."""
    events: DeclaredEvents | Literal["file"] | None = None
    """Times set by hand, which replace the detected ones; or file: the events in the recording's file replace
    them (lifting.events.labels)."""


class SubjectSettings(Section):
    """One subject (a file of config/subjects); given to the workflow by itself, this subject runs alone."""

    name: FolderName
    """The file's name."""
    sex: Literal["female", "male", "unknown"]
    """female, male or unknown; selects the segment table if it differs between sexes."""
    mass_kg: float = Field(gt=0, le=400)
    """Body mass."""
    height_m: float = Field(ge=0.5, le=2.6)
    """Stature."""
    experience: str = Field(min_length=1)
    """Label of the subject's group in Table 4.1 (stability.compare), e.g. expert or novice."""
    trials: tuple[TrialSettings, ...] = ()
    """One entry per recorded lift; several with the same box are repeated trials. A study needs at least one."""
    static: str | None = None
    """Marker file of a static trial (C3D, TRC, CSV, BVH; also .gz), below data_root like the others. It gives
    the shape of the pelvis and the box if their markers are hidden for long."""
    assumed: tuple[str, ...] = ()
    """Keys of this file that are assumptions and not measurements."""

    @property
    def lifts(self) -> dict[str, TrialSettings]:
        """Trials by the names of their lifts: ``expert_23kg``, and ``expert_23kg_2`` if it is repeated."""
        lifts: dict[str, TrialSettings] = {}
        masses = [trial.box_mass_kg for trial in self.trials]
        for number, trial in enumerate(self.trials):
            name, repetition = (
                f"{self.name}_{trial.box_mass_kg:g}kg",
                masses[: number + 1].count(trial.box_mass_kg),
            )
            lifts[name if repetition == 1 else f"{name}_{repetition}"] = trial
        return lifts


class SubjectFile(Section):
    """A file of config/subjects."""

    subject: SubjectSettings
    """The subject; config/subjects/expert.yaml is an example."""


class GapSettings(Section):
    """Treatment of gaps in marker trajectories."""

    maximum_s: float = Field(0.2, ge=0, le=1)
    """Longest gap that a cubic spline bridges; 0 bridges none."""
    longer: Literal["error", "keep"] = "keep"
    """Treatment of longer gaps and of those at the start or end. keep: they stay open, and results that cannot
    be computed for them are left out with the reason. error: a recording is rejected if a marker that the
    pendulums need has such a gap between the first and the last event."""
    rigid: dict[str, tuple[str, ...]] = RIGID_BODIES
    """Rigid bodies by name, each with its markers (standard names, or labels of the file). Gaps that no spline
    bridges are filled from three or more other markers of the body, with its shape in the static trial or in
    the frames that show all of them."""
    rigid_tolerance_m: float = Field(0.02, gt=0, le=0.1)
    """Largest difference (root mean square) between the markers of a rigid body and its shape; a body above it
    fills no gap."""


class FilterSettings(Section):
    """Butterworth low-pass filter of the trajectories, forward and backward."""

    cutoff_Hz: float = Field(6.0, gt=0, le=50)
    """-3 dB frequency of both passes together; each pass is corrected for it."""
    order: int = Field(2, ge=1, le=8)
    """Order of each pass."""


class EventLabels(Section):
    """Labels of events in a C3D file that name the events of a lift; case and spaces do not count."""

    lift_off: tuple[str, ...] = ("lift off", "box off", "pick up")
    """Box leaves its support."""
    toe_off: tuple[str, ...] = ("foot off", "toe off", "LTO", "RTO")
    """End of the lift: the first of these between lift-off and release."""
    deposit_start: tuple[str, ...] = ("deposit start", "start of deposit")
    """Start of the deposit."""
    release: tuple[str, ...] = ("release", "box release", "end of deposit")
    """Box is released."""


class EventSettings(Section):
    """Detection of the events of a lift."""

    deposit_start: Literal["descent", "wrist_minimum"] = "descent"
    """Start of the deposit. descent: the last instant before the box finally goes down; wrist_minimum: the last
    local minimum of the wrists' speed before that, as in the thesis. Table 4.1 shows the thesis's definition
    with its start for every value of this key."""
    taken_from: Literal["detection", "file"] = "detection"
    """detection: by the rules below; file: the events that are marked in the recording's file, as far as it has
    them. The difference is reported for both."""
    labels: EventLabels = Field(default_factory=EventLabels)
    box_speed_m_s: float = Field(0.05, gt=0, le=1)
    """Speed above which the box moves."""
    box_rest_m_s: float = Field(0.02, gt=0, le=1)
    """Speed below which the box rests: its movement starts and ends there."""
    box_sustained_s: float = Field(0.1, ge=0, le=1)
    """Time for which the box must move at its lift-off, and for which the wrists must be away from it at the
    separation."""
    separation_m: float = Field(0.1, gt=0, le=1)
    """Increase of the distance between wrists and centre of the box that separates them."""
    grip_s: float = Field(0.5, gt=0, le=5)
    """Time after lift-off; the median distance between wrists and box in it counts as the grip."""
    toe_speed_m_s: float = Field(0.3, gt=0, le=5)
    """Speed of a toe that leaves the ground."""
    toe_sustained_s: float = Field(0.065, ge=0, le=1)
    """Time for which the toe must keep that speed."""
    rise_m: float = Field(0.02, gt=0, le=1)
    """Rise of the box that counts as lifted; below it the box may slide on its support."""
    hands_rise_m: float = Field(0.25, gt=0, le=2)
    """Rise of the hands that counts as a lift, if the box has no markers."""
    stay_s: float = Field(0.3, gt=0, le=10)
    """Time without descent of the box that counts as a stay. The deposit starts at the end of the last stay, or
    of the last rise."""
    descent_m: float = Field(0.05, gt=0, le=2)
    """Descent of the box (of the wrists if the box has no markers) before the release that counts as a deposit.
    At half of it a descent counts too if it is 1.5 times any other one since the toe-off."""
    prominence_m_s: float = Field(0.05, ge=0, le=2)
    """Depth of a local minimum of the wrists' speed below its surroundings (deposit_start)."""


class BoxSettings(Section):
    """Load of the box on the pendulums."""

    share: Literal["by_mass", "whole"] = "by_mass"
    """by_mass: the box is divided among the centres of mass in proportion to the masses of the segments; whole:
    every pendulum carries the whole box."""
    in_position: bool = False
    """true: angle and length are those of the common centre of mass of segment and box; false: those of the segment."""


class LiftingSettings(Section):
    """From marker files to the pendulums of the deposit."""

    subjects: Unique[str] = ()
    """Subjects of the study, in order: files of config/subjects."""
    markers: MarkerLayout = Field(default_factory=lambda: MarkerLayout(aliases=ALIASES, required=()))
    moment_layout: ColumnLayout = Field(default_factory=lambda: ColumnLayout(columns=MOMENT_COLUMNS))
    gaps: GapSettings = Field(default_factory=GapSettings)
    filter: FilterSettings = Field(default_factory=FilterSettings)
    events: EventSettings = Field(default_factory=EventSettings)
    segments: Literal["winter", "de_leva", "dumas"] = "winter"
    """Table of trunk segments: winter (Winter after Dempster, used in the thesis), de_leva (1996) or dumas
    (Dumas and Wojtusch 2018); the last two need the subject's sex. Results by the other tables are reported
    too."""
    segment_ends: Literal["inner", "skin"] = "inner"
    """Ends of the trunk's segments. inner: joint centres, estimated from the markers; if markers for that are
    missing, points on the skin, and the result reports it. skin: the markers C7, T12, L5 and the trochanters,
    as in the thesis. Table 4.1 shows the thesis's definition with its ends for every value of this key."""
    hip_centres: Literal["harrington", "hara", "reed"] = "harrington"
    """Regression of the hip joint centres: harrington (2007), hara (2016; leg from ASIS to ankle) or reed
    (1999)."""
    box: BoxSettings = Field(default_factory=BoxSettings)
    pivot: Literal["mid_ankle", "hip", "L5"] = "mid_ankle"
    """Pivot of the pendulum: midpoint of the ankles, midpoint of the hips, or L5/S1; with segment_ends: skin
    the trochanters and the marker L5. It moves with its markers."""
    frame: Literal["laboratory", "pelvis"] = "laboratory"
    """Axes of the planes: those of the laboratory, or rotated about the vertical so that x is the line of the
    hips at the start of the deposit."""
    points: int = Field(1000, ge=10, le=100000)
    """Number of instants to which a cubic spline resamples the deposit; the real time is kept."""

    def settings_for_trial(self, trial: TrialSettings) -> "LiftingSettings":
        """Return the settings with the axis that the subject faces in a trial.

        Parameters
        ----------
        trial : TrialSettings
            Trial of the subject; without an axis the study's is kept.
        """
        forward = trial.forward or self.markers.forward
        return self.model_copy(update={"markers": self.markers.model_copy(update={"forward": forward})})


GROUPS = ("expert", "novice")
"""Groups that the thesis compares."""
Share = Annotated[float, Field(ge=0, le=10)]
Matrix = tuple[tuple[float, float], tuple[float, float]]
Check = Literal["simulation", "thesis_method", "cvxpy", "proof"]


class PendulumSettings(Section):
    """The pendulum of Eq. 4.1."""

    sign: Literal["hanging", "inverted"] = "inverted"
    """Sign of the gravity term in the headline of Table 4.1 and in the figures: inverted (−), as people stand,
    or hanging (+), as Eq. 4.1 is published. Table 4.1 shows the thesis's definition and all signs for every
    value of this key."""
    time: Literal["real", "unit"] = "real"
    """Duration of the trajectories in the headline: real, as recorded, or unit, one second for every deposit."""
    mass: Literal["with_box", "without_box"] = "with_box"
    """Mass of the pendulum in the headline, with or without the box."""
    damping_N_m_s: float = Field(1.0, ge=0, le=1000, json_schema_extra={"unit": "N·m·s/rad"})
    """Damping b."""
    gravity_m_s2: float = Field(9.81, ge=0, le=30)
    """Gravitational acceleration: of the basins, of the effects on a pendulum, and of the twin's hip moments."""


class RegulatorSettings(Section):
    """Weights of the linear-quadratic regulator on angle (rad) and angular velocity (rad/s), equal for all subjects."""

    state_weight: Matrix = ((1.0, 0.0), (0.0, 0.1))
    """Q, symmetric and positive semidefinite, per second."""
    control_weight: float = Field(0.003, gt=0)
    """R in 1/(N²·m²·s), positive."""
    terminal_weight: Matrix = ((100.0, 0.0), (0.0, 10.0))
    """Qf, symmetric and positive definite; the goal set is x̄ᵀ·Qf·x̄ ≤ goal_level."""

    @field_validator("state_weight", "terminal_weight")
    @classmethod
    def _check_definite(cls, weight: Matrix, info: ValidationInfo) -> Matrix:
        (first, upper), (lower, last) = weight
        if upper != lower:
            raise ValueError(f"{[*map(list, weight)]} is not symmetric")
        lowest = (first + last - math.hypot(first - last, 2 * upper)) / 2
        definite = info.field_name == "terminal_weight"
        if lowest < 0 or (definite and lowest == 0):
            kind = "definite" if definite else "semidefinite"
            raise ValueError(f"smallest eigenvalue {lowest:g}; it must be positive {kind}")
        return weight


class ProofSettings(Section):
    """Proof between the knots by interval branch-and-bound (check ``proof``)."""

    margin_1_s: float = Field(0.005, gt=0, le=100)
    """Margin, in 1/s, by which ρ̇/ρ of the proved funnel exceeds the largest V̇/ρ on its boundary; its area is
    about 1 − margin·T/2 of the exact one."""


class ThesisMethodSettings(Section):
    """The thesis's bilinear alternation (Eqs 4.5–4.7) under the thesis's definitions (check ``thesis_method``)."""

    knots: int = Field(1000, ge=2, le=10000)
    """Knots of the alternation (the thesis: 1000); the nearest number that divides the basin's knots evenly is used."""
    initial_level: float = Field(1.0, gt=0, le=1000000.0)
    """First guess of ρ at every knot."""
    ratio: float = Field(0.8, ge=0.1, le=0.99)
    """Ratio of the geometric progression that decreases ρ."""
    alternations: int = Field(2, ge=1, le=20)
    """Alternations (the thesis: 2). From the second one few knots have a multiplier, and ρ jumps there (columns
    jumped_knots, largest_jump, mean_area_after_4)."""


class AttackSettings(Section):
    """Simulated starts in every basin (check ``simulation``)."""

    starts: int = Field(200, ge=2, le=1000000)
    """Starts per basin, half on the boundary, half inside."""
    control_overstated: float = Field(1.0, ge=0.01, le=10)
    """Negative control: factor on |d ln ρ/dt| by which ρ falls too fast, so that starts must leave."""


class LimitSettings(Section):
    """Torque that foot or hips allow a pendulum, for the pushes on the page of a lift."""

    foot_ahead_m: float = Field(0.2, gt=0, le=0.5)
    """Length of the foot ahead of the ankle: about the ankles u ≥ −m·g times this, or the heel lifts. A foot is
    0.152 of the height long (Winter 2009, Figure 4.1), a quarter of it behind the ankle."""
    foot_behind_m: float = Field(0.06, gt=0, le=0.5)
    """Length of the foot behind the ankle: u ≤ m·g times this, or the toes lift."""
    feet_half_width_m: float = Field(0.17, gt=0, le=1)
    """Half the distance between the feet's outer borders, which limits the torque about the ankles to the
    sides."""
    hip_extension_N_m: float = Field(440.0, gt=0, le=10000)
    """Largest backward torque of both hips (isometric strength of young men, 0.161 of body weight times height
    per leg; Anderson, Madigan and Nussbaum 2007). Each pendulum about the hips or L5 may use all of it."""
    hip_flexion_N_m: float = Field(310.0, gt=0, le=10000)
    """Largest forward torque of both hips (0.113 of body weight times height per leg; same source)."""
    hip_abduction_N_m: float = Field(200.0, gt=0, le=10000)
    """Largest torque of both hips to a side: an assumption, 100 N·m per leg."""


class CompareSettings(Section):
    """Groups that Table 4.1 compares."""

    groups: Annotated[tuple[Word, Word], REJECT_REPEATED] = Field(
        GROUPS, json_schema_extra={"uniqueItems": True}
    )
    """Two labels of subjects (experience in their files): the table compares the first with the second,
    100(A_first − A_second)/A_second."""


class MeasureSettings(Section):
    """Measures of movement (margin of stability, impulse to a step, capturability, posture, moment about L5/S1)."""

    functional_share: float = Field(0.6, gt=0, le=1)
    """Functional base of support: its distance from the centre as a share of that of the whole base (0.6 with
    loads, Holbein and Redfern 1997; 1 uses the whole)."""
    contact_height_m: float = Field(0.03, gt=0, le=0.2)
    """Height above its lowest level below which heel or toe are on the ground."""
    contact_speed_m_s: float = Field(0.3, gt=0, le=5)
    """Speed below which heel or toe are on the ground."""


class StabilitySettings(Section):
    """From pendulum states to basins of attraction."""

    pendulum: PendulumSettings = Field(default_factory=PendulumSettings)
    regulator: RegulatorSettings = Field(default_factory=RegulatorSettings)
    goal_level: float = Field(1.0, gt=0, le=1000000.0)
    """ρ at the end of the trajectory."""
    knots: int = Field(1000, ge=50, le=100000)
    """Instants at which a basin is computed (the thesis: 1000; between 505 and 1000 areas change by some 1e-8
    of them)."""
    fewer_knots: int = Field(334, ge=50, le=100000)
    """Instants for the range of Table 4.1 under other weights, its null control and parts, the check with
    cvxpy, the basins of a cohort, and the figure that compares methods."""
    checks: Unique[Check] = get_args(Check)
    """Checks of the exact basins. simulation: starts that must stay inside; thesis_method: Eqs 4.5–4.7 as the
    thesis solves them; cvxpy: some of its programmes again as Eq. 4.6 is written; proof: interval arithmetic
    between the knots."""
    proof: ProofSettings = Field(default_factory=ProofSettings)
    thesis_method: ThesisMethodSettings = Field(default_factory=ThesisMethodSettings)
    attack: AttackSettings = Field(default_factory=AttackSettings)
    limits: LimitSettings = Field(default_factory=LimitSettings)
    compare: CompareSettings = Field(default_factory=CompareSettings)
    measures: MeasureSettings = Field(default_factory=MeasureSettings)
    lyapunov_shares: tuple[Share, ...] = Field((0.0, 0.1, 0.25, 0.5, 1.0), min_length=1)
    """Shares λ of the decay Q + KᵀRK for the search of the best Lyapunov function; 1 is the Riccati solution."""
    sensitivity_factor: float = Field(2.0, ge=1.01, le=100)
    """Factor by which Q, R and b are divided and multiplied for the range in Table 4.1."""
