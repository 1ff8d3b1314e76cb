"""A study: what it is, its chapters, and every section of its configuration."""

from typing import Literal

from pydantic import Field

from lumbar.settings.layout import ColumnLayout
from lumbar.settings.lifting import LiftingSettings, StabilitySettings, SubjectSettings
from lumbar.settings.runtime import RuntimeSettings, SurveySettings
from lumbar.settings.section import SEED, FolderName, Section, Unique
from lumbar.settings.tissue import (
    ImprovementSettings,
    SignalsSettings,
    SurgeonSettings,
    TissueSettings,
    system_of,
)
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
    """Source of the recordings, shown on every table and figure and if the recordings are missing."""

    name: str
    """Name of the data set as shown on tables and figures."""
    licence: str
    """Licence of the data."""
    obtain: str
    """Place to get the files."""


class StudySettings(Section):
    """The whole configuration of a study."""

    study: FolderName = "study"
    """Name of the study and of its folder in results/: letters, digits, _ and -."""
    title: str = ""
    """One line for the report."""
    data: Literal["twin", "recordings"] = "twin"
    """twin: recordings are made as the section twin defines; recordings: they are read from data_root."""
    data_root: str | None = None
    """Folder of the recordings, absolute or relative to the project, or an address in an object store such as
    s3://lab/recordings. The environment variable LUMBAR_DATA replaces it."""
    data_source: SourceSettings | None = None
    """Source of the recordings: name, licence and obtain, all three; shown on every table and figure and if the
    recordings are missing."""
    chapters: Unique[Chapter] = ()
    """Chapters that the study supports, in the thesis's order; at least one."""
    seed: int = Field(SEED, ge=0)
    """Seed of bootstraps and simulations; the twin has its own seed."""
    subject: SubjectSettings | None = None
    """One subject; given to the workflow by itself, this subject runs alone."""
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
    """Return the layout of a base model's records, and the rate (Hz) to which they are resampled.

    Parameters
    ----------
    settings : StudySettings
        Settings of the study.
    base : str
        Name of a base, or a YAML file.
    """
    if system_of(base) == "pendulum":
        return settings.lifting.moment_layout, None
    layout = settings.tissue.layout
    if settings.improvement.forward and layout.clipped == "refuse":
        layout = layout.model_copy(update={"clipped": "accept_load"})
    return layout, settings.tissue.rate_Hz
