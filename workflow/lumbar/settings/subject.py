"""One person, a file of config/subjects."""

from typing import Literal

from lumbar.settings.key import FolderName, key, required, settings


@settings
class DeclaredEvents:
    """Times set by hand; they replace the detected ones."""

    lift_off_s: float | None = key("Box leaves its support.", default=None)
    toe_off_s: float | None = key("End of the lift.", default=None)
    deposit_start_s: float | None = key("Start of the deposit.", default=None)
    release_s: float | None = key("Box is released.", default=None)
    reason: str | None = key("Why they are set by hand; stands beside the result.", default=None)


@settings
class TrialSettings:
    """One recorded lift."""

    box_mass_kg: float = required("Mass of the box.", within="[0, 100]")
    markers: str = required("Marker file (C3D, TRC, CSV, MAT, BVH; also .gz).")
    hip_moment: str | None = key("Hip moment beside it (time_s, angle_rad, moment_Nm).", default=None)
    forces: str | None = key(
        "File with the ground reaction forces of this trial where the marker file holds none (.mot, on the same clock and in "
        "the same axes; or another C3D): the centre of mass is checked against them.",
        default=None,
    )
    window_s: tuple[float, float] | None = key(
        "Start and end of the part of the recording that is this lift, on the file's own clock; null takes all of it. It "
        "is cut after filtering, so that its ends are no ends of the filter.",
        default=None,
    )
    events: DeclaredEvents | Literal["file"] | None = key(
        "Times set by hand, which replace the detected ones; or file: the events that the recording's own file holds replace "
        "them (lifting.events.labels).",
        default=None,
    )

    def __post_init__(self):
        if self.window_s is not None and not self.window_s[0] < self.window_s[1]:
            raise ValueError("window_s: the start must lie before the end")


@settings
class SubjectSettings:
    """One person (a file of config/subjects); given to the workflow by itself, this person runs alone."""

    name: FolderName = required("The file's name.")
    sex: Literal["female", "male", "unknown"] = required(
        "female, male or unknown; picks the segment table where it differs."
    )
    mass_kg: float = required("Body mass.", within="(0, 400]")
    height_m: float = required("Stature.", within="[0.5, 2.6]")
    experience: str = required(
        "Label of the group that Table 4.1 (stability.compare) counts the person to, e.g. expert or novice.",
        min_length=1,
    )
    trials: tuple[TrialSettings, ...] = key(
        "One entry per recorded lift; several with the same box are repeated trials. A study needs one at least.",
        default=(),
    )
    static: str | None = key(
        "Marker file of a static trial (C3D, TRC, CSV, MAT, BVH; also .gz), below data_root like the others: it gives the "
        "shape of the pelvis and the box where markers of them are hidden for long.",
        default=None,
    )
    assumed: tuple[str, ...] = key("Keys of this file that are assumptions and not measurements.", default=())


@settings
class SubjectFile:
    """A file of config/subjects."""

    subject: SubjectSettings = required("The person; config/subjects/expert.yaml shows what is needed.")
