"""A study: what it is, its chapters, and every section of its configuration."""

from typing import Annotated, Literal

from lumbar.settings.improvement import ImprovementSettings, system_of
from lumbar.settings.key import SEED, UNIQUE, FolderName, key, required, section, settings
from lumbar.settings.layout import ColumnLayout
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.signals import SignalsSettings, SurgeonSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings
from lumbar.settings.survey import SurveySettings
from lumbar.settings.tissue import TissueSettings
from lumbar.settings.twin import TwinSettings

Chapter = Literal[
    "surgeon",
    "signals",
    "tissue",
    "improvement",
    "runtime",
    "survey",
    "lifting",
    "stability",
    "population",
    "claims",
]


@settings
class SourceSettings:
    """Where the recordings come from; shown on every table and figure and where the recordings are absent."""

    name: str = required()
    licence: str = required()
    obtain: str = required()


@settings
class StudySettings:
    """The whole configuration of a study."""

    study: FolderName = key(default="study")
    title: str = key(default="")
    data: Literal["twin", "recordings"] = key(default="twin")
    data_root: str | None = key(default=None)
    data_source: SourceSettings | None = key(default=None)
    chapters: Annotated[tuple[Chapter, ...], UNIQUE] = key(default=())
    seed: int = key(default=SEED, ge=0)
    subject: SubjectSettings | None = key(default=None)
    surgeon: SurgeonSettings = section(default_factory=SurgeonSettings)
    signals: SignalsSettings = section(default_factory=SignalsSettings)
    tissue: TissueSettings = section(default_factory=TissueSettings)
    improvement: ImprovementSettings = section(default_factory=ImprovementSettings)
    runtime: RuntimeSettings = section(default_factory=RuntimeSettings)
    survey: SurveySettings = section(default_factory=SurveySettings)
    lifting: LiftingSettings = section(default_factory=LiftingSettings)
    stability: StabilitySettings = section(default_factory=StabilitySettings)
    twin: TwinSettings = section(default_factory=TwinSettings)


def record_layout(settings: StudySettings, base: str) -> tuple[ColumnLayout, float | None]:
    """Layout of a base model's records, and the rate (Hz) to which they are resampled."""
    if system_of(base) == "pendulum":
        return settings.lifting.moment_layout, None
    return settings.tissue.layout, settings.tissue.rate_Hz
