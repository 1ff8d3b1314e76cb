"""Chapter lifting: subjects, and the way from marker files to the pendulums of the deposit."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from lumbar.base.yaml_file import shipped_yaml
from lumbar.settings.layout import Alias, Axis, ColumnLayout, MarkerLayout, MeanOfMarkers
from lumbar.settings.section import FolderName, Interval, Section, Unique

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
