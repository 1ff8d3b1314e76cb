"""One person, a file of config/subjects."""

from typing import Literal

from pydantic import Field

from lumbar.settings.layout import Axis
from lumbar.settings.section import FolderName, Interval, Section


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
