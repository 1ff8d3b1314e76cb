"""A study: what it is, its chapters, and every section of its configuration."""

from __future__ import annotations

from typing import Annotated, Literal

from lumbar.settings.hidden_effects import HiddenEffectsSettings
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.key import NAME, UNIQUE, key, required, section, settings
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.perturbations import PerturbationsSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.seed import SEED
from lumbar.settings.signals import SignalsSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings
from lumbar.settings.surgeon import SurgeonSettings
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

    study: str = key(
        "study", "Name of the study and of its folder in results/: letters, digits, _ and -.", pattern=NAME
    )
    title: str = key("", "One line that stands in the report.")
    data: Literal["twin", "recordings"] = key(
        "twin",
        "twin: recordings are made, as the section twin says; recordings: they are read from data_root.",
    )
    data_root: str | None = key(
        None,
        "Folder of the recordings, absolute or relative to the project. The environment variable LUMBAR_DATA replaces it.",
    )
    data_source: SourceSettings | None = key(
        None,
        "Where the recordings come from: name, licence and obtain, all three; shown on every table and figure and where "
        "the recordings are absent.",
    )
    chapters: Annotated[tuple[Chapter, ...], UNIQUE] = key(
        (), "Chapters the study can support, in the thesis's order; at least one."
    )
    seed: int = key(SEED, "Seed of bootstraps and simulations (the twin has a seed of its own).", ge=0)
    subject: SubjectSettings | None = key(
        None, "One person; given to the workflow by itself, this person runs alone."
    )
    surgeon: SurgeonSettings = section(SurgeonSettings)
    signals: SignalsSettings = section(SignalsSettings)
    tissue: TissueSettings = section(TissueSettings)
    improvement: ImprovementSettings = section(ImprovementSettings)
    runtime: RuntimeSettings = section(RuntimeSettings)
    survey: SurveySettings = section(SurveySettings)
    lifting: LiftingSettings = section(LiftingSettings)
    stability: StabilitySettings = section(StabilitySettings)
    perturbations: PerturbationsSettings | None = key(
        None, "Trials with and without perturbation; null where a study has none."
    )
    twin: TwinSettings = section(TwinSettings)
    hidden_effects: HiddenEffectsSettings = section(HiddenEffectsSettings)
