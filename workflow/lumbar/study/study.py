"""The study: a checked configuration, and the places its files come from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from lumbar.settings.study_settings import StudySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings
from lumbar.settings.twin import CohortSettings
from lumbar.study.artefacts import Artefact
from lumbar.tables.table import SYNTHETIC_TWIN

TWIN = "twin"


@dataclass(frozen=True)
class RecordedLift:
    """One trial of one person."""

    subject: str
    trial: TrialSettings
    static: str | None = None


@dataclass(frozen=True)
class Study:
    """A checked configuration."""

    name: str
    """Name of the results folder: the study's, or the subject's where one person runs alone."""
    settings: StudySettings
    """The merged configuration."""
    subjects: dict[str, SubjectSettings]
    """Subject files by name, in the study's order."""
    artefacts: list[Artefact]
    """Those of the study's chapters."""
    data_root: Path | str | None
    """Folder of the recordings, or the address of a place in an object store; None where the twin makes them."""
    lifts: dict[str, RecordedLift] = field(default_factory=dict)
    """By name, e.g. ``expert_23kg``."""

    @property
    def synthetic(self) -> bool:
        """Whether the data are made by the twin."""
        return self.settings.data == TWIN

    @property
    def data_label(self) -> str:
        """The words that say, on every table and figure, where the data come from."""
        return SYNTHETIC_TWIN if self.synthetic else self.settings.data_source.name

    def recording(self, path: str) -> str:
        """Path or address of a recording named in the configuration; relative to the working directory if made here."""
        if self.synthetic:
            return f"results/{self.name}/twin/{path}"
        return f"{self.data_root}/{path}" if self.remote else str(self.data_root / path)

    @property
    def remote(self) -> bool:
        """Whether the recordings are objects of a store, which Snakemake brings to each job."""
        return isinstance(self.data_root, str)

    def subject_of(self, lift: str) -> SubjectSettings:
        """The subject of a lift by itself: another trial, another label or the static trial's name do not change this lift."""
        return replace(self.subjects[self.lifts[lift].subject], trials=(), experience="", static=None)

    @property
    def labels(self) -> dict[str, str]:
        """Label of every subject by which Table 4.1 compares people."""
        return {name: subject.experience for name, subject in self.subjects.items()}

    @property
    def cohort(self) -> CohortSettings | None:
        """The distributions that the study's people are drawn from, where they are."""
        return self.settings.twin.lifting.cohort if self.synthetic else None

    @property
    def lifts_by_person(self) -> dict[str, dict[str, RecordedLift]]:
        """Lifts of every person by name."""
        found: dict[str, dict[str, RecordedLift]] = {person: {} for person in self.subjects}
        for name, lift in self.lifts.items():
            found[lift.subject][name] = lift
        return found

    def has(self, chapter: str) -> bool:
        """Whether the study includes a chapter."""
        return chapter in self.settings.chapters
