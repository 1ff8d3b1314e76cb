"""One person, a file of config/subjects."""

from typing import Literal

from lumbar.settings.key import FolderName, key, required, settings
from lumbar.settings.layout import Axis


@settings
class DeclaredEvents:
    """Times set by hand; they replace the detected ones."""

    lift_off_s: float | None = key(default=None)
    toe_off_s: float | None = key(default=None)
    deposit_start_s: float | None = key(default=None)
    release_s: float | None = key(default=None)
    reason: str | None = key(default=None)


@settings
class TrialSettings:
    """One recorded lift."""

    box_mass_kg: float = required(within="[0, 100]")
    markers: str = required()
    hip_moment: str | None = key(default=None)
    forward: Axis | None = key(default=None)
    window_s: tuple[float, float] | None = key(default=None)
    events: DeclaredEvents | Literal["file"] | None = key(default=None)

    def __post_init__(self):
        if self.window_s is not None and not self.window_s[0] < self.window_s[1]:
            raise ValueError("window_s: the start must lie before the end")


@settings
class SubjectSettings:
    """One person (a file of config/subjects); given to the workflow by itself, this person runs alone."""

    name: FolderName = required()
    sex: Literal["female", "male", "unknown"] = required()
    mass_kg: float = required(within="(0, 400]")
    height_m: float = required(within="[0.5, 2.6]")
    experience: str = required(min_length=1)
    trials: tuple[TrialSettings, ...] = key(default=())
    static: str | None = key(default=None)
    assumed: tuple[str, ...] = key(default=())


@settings
class SubjectFile:
    """A file of config/subjects."""

    subject: SubjectSettings = required()
