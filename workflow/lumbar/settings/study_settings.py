"""A study: what it is, its chapters, and every section of its configuration."""

from typing import Annotated, Literal

from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.key import SEED, UNIQUE, FolderName, key, required, section, settings
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.population import PopulationSettings
from lumbar.settings.pushes import PerturbationsSettings, PushesSettings
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
    "perturbations",
    "population",
    "pushes",
    "claims",
]


@settings
class SourceSettings:
    """Where the recordings come from; shown on every table and figure and where the recordings are absent."""

    name: str = required("Name of the data set as it stands on tables and figures.")
    licence: str = required("Licence of the data.")
    obtain: str = required("Where to get the files.")


@settings
class StudySettings:
    """The whole configuration of a study."""

    study: FolderName = key(
        "Name of the study and of its folder in results/: letters, digits, _ and -.",
        default="study",
    )
    title: str = key("One line that stands in the report.", default="")
    data: Literal["twin", "recordings"] = key(
        "twin: recordings are made, as the section twin says; recordings: they are read from data_root.",
        default="twin",
    )
    data_root: str | None = key(
        "Folder of the recordings, absolute or relative to the project, or a place in an object store such as "
        "s3://lab/recordings. The environment variable LUMBAR_DATA replaces it.",
        default=None,
    )
    data_source: SourceSettings | None = key(
        "Where the recordings come from: name, licence and obtain, all three; shown on every table and figure and where "
        "the recordings are absent.",
        default=None,
    )
    chapters: Annotated[tuple[Chapter, ...], UNIQUE] = key(
        "Chapters the study can support, in the thesis's order; at least one.", default=()
    )
    seed: int = key(
        "Seed of bootstraps and simulations (the twin has a seed of its own).", default=SEED, ge=0
    )
    subject: SubjectSettings | None = key(
        "One person; given to the workflow by itself, this person runs alone.", default=None
    )
    surgeon: SurgeonSettings = section(default_factory=SurgeonSettings)
    signals: SignalsSettings = section(default_factory=SignalsSettings)
    tissue: TissueSettings = section(default_factory=TissueSettings)
    improvement: ImprovementSettings = section(default_factory=ImprovementSettings)
    runtime: RuntimeSettings = section(default_factory=RuntimeSettings)
    survey: SurveySettings = section(default_factory=SurveySettings)
    lifting: LiftingSettings = section(default_factory=LiftingSettings)
    stability: StabilitySettings = section(default_factory=StabilitySettings)
    perturbations: PerturbationsSettings | None = key(
        "Trials with and without perturbation; null where a study has none.", default=None
    )
    population: PopulationSettings = section(default_factory=PopulationSettings)
    pushes: PushesSettings = section(default_factory=PushesSettings)
    twin: TwinSettings = section(default_factory=TwinSettings)
