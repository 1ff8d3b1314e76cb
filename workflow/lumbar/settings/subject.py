"""One person, a file of config/subjects."""

from typing import Literal, Self

from pydantic import Field, model_validator

from lumbar.settings.layout import Axis
from lumbar.settings.section import FolderName, Section


class DeclaredEvents(Section):
    """Times set by hand; they replace the detected ones."""

    lift_off_s: float | None = None
    """Box leaves its support."""
    toe_off_s: float | None = None
    """End of the lift."""
    deposit_start_s: float | None = None
    """Start of the deposit."""
    release_s: float | None = None
    """Box is released."""
    reason: str | None = None
    """Why they are set by hand; stands beside the result."""


class TrialSettings(Section):
    """One recorded lift."""

    box_mass_kg: float = Field(ge=0, le=100)
    """Mass of the box."""
    markers: str
    """Marker file (C3D, TRC, CSV, BVH; also .gz)."""
    hip_moment: str | None = None
    """Hip moment beside it (time_s, angle_rad, moment_Nm)."""
    forward: Axis | None = None
    """Axis of the file that points the way the person faces in this trial; null as lifting.markers.forward
    says."""
    window_s: tuple[float, float] | None = None
    """Start and end of the part of the recording that is this lift, on the file's own clock; null takes all
    of it. It is cut after filtering, so that its ends are no ends of the filter."""
    events: DeclaredEvents | Literal["file"] | None = None
    """Times set by hand, which replace the detected ones; or file: the events that the recording's own file
    holds replace them (lifting.events.labels)."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.window_s is not None and not self.window_s[0] < self.window_s[1]:
            raise ValueError("window_s: the start must lie before the end")
        return self


class SubjectSettings(Section):
    """One person (a file of config/subjects); given to the workflow by itself, this person runs alone."""

    name: FolderName
    """The file's name."""
    sex: Literal["female", "male", "unknown"]
    """female, male or unknown; picks the segment table where it differs."""
    mass_kg: float = Field(gt=0, le=400)
    """Body mass."""
    height_m: float = Field(ge=0.5, le=2.6)
    """Stature."""
    experience: str = Field(min_length=1)
    """Label of the group that Table 4.1 (stability.compare) counts the person to, e.g. expert or novice."""
    trials: tuple[TrialSettings, ...] = ()
    """One entry per recorded lift; several with the same box are repeated trials. A study needs one at least."""
    static: str | None = None
    """Marker file of a static trial (C3D, TRC, CSV, BVH; also .gz), below data_root like the others: it
    gives the shape of the pelvis and the box where markers of them are hidden for long."""
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
    """The person; config/subjects/expert.yaml shows what is needed."""
