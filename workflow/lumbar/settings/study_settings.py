"""A study: what it is, its chapters, and every section of its configuration."""

from typing import Literal

from pydantic import Field

from lumbar.settings.improvement import ImprovementSettings, system_of
from lumbar.settings.layout import ColumnLayout
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.section import SEED, FolderName, Section, Unique
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


class SourceSettings(Section):
    """Where the recordings come from; shown on every table and figure and where the recordings are absent."""

    name: str
    """Name of the data set as it stands on tables and figures."""
    licence: str
    """Licence of the data."""
    obtain: str
    """Where to get the files."""


class StudySettings(Section):
    """The whole configuration of a study."""

    study: FolderName = "study"
    """Name of the study and of its folder in results/: letters, digits, _ and -."""
    title: str = ""
    """One line that stands in the report."""
    data: Literal["twin", "recordings"] = "twin"
    """twin: recordings are made, as the section twin says; recordings: they are read from data_root."""
    data_root: str | None = None
    """Folder of the recordings, absolute or relative to the project, or a place in an object store such as
    s3://lab/recordings. The environment variable LUMBAR_DATA replaces it."""
    data_source: SourceSettings | None = None
    """Where the recordings come from: name, licence and obtain, all three; shown on every table and figure
    and where the recordings are absent."""
    chapters: Unique[Chapter] = ()
    """Chapters the study can support, in the thesis's order; at least one."""
    seed: int = Field(SEED, ge=0)
    """Seed of bootstraps and simulations (the twin has a seed of its own)."""
    subject: SubjectSettings | None = None
    """One person; given to the workflow by itself, this person runs alone."""
    surgeon: SurgeonSettings = Field(default_factory=SurgeonSettings)
    signals: SignalsSettings = Field(default_factory=SignalsSettings)
    tissue: TissueSettings = Field(default_factory=TissueSettings)
    improvement: ImprovementSettings = Field(default_factory=ImprovementSettings)
    runtime: RuntimeSettings = Field(default_factory=RuntimeSettings)
    survey: SurveySettings = Field(default_factory=SurveySettings)
    lifting: LiftingSettings = Field(default_factory=LiftingSettings)
    stability: StabilitySettings = Field(default_factory=StabilitySettings)
    twin: TwinSettings = Field(default_factory=TwinSettings)


def record_layout(settings: StudySettings, base: str) -> tuple[ColumnLayout, float | None]:
    """Layout of a base model's records, and the rate (Hz) to which they are resampled."""
    if system_of(base) == "pendulum":
        return settings.lifting.moment_layout, None
    return settings.tissue.layout, settings.tissue.rate_Hz
