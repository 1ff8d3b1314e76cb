"""The study: a checked configuration, its chapters, artefacts and recordings, and how recordings are read."""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, get_args

from lumbar.base.errors import Problems
from lumbar.settings.layout import ColumnLayout
from lumbar.settings.lifting import SubjectSettings, TrialSettings
from lumbar.settings.study_settings import Chapter, StudySettings, record_layout
from lumbar.settings.tissue import RecordSetSettings
from lumbar.settings.twin import CohortSettings
from lumbar.tables.table import SYNTHETIC_TWIN

CHAPTERS: tuple[str, ...] = get_args(Chapter)
NEEDS = {"signals": ["surgeon"], "improvement": ["tissue"], "runtime": ["tissue"], "stability": ["lifting"]}
"""Chapters by name that need other chapters of the same study."""
LIFTED = {"lifting", "population"}
"""Chapters that begin with the recorded lifts."""

OF_ONE_AXIS = {"identify_tissue"}
"""Rules with artefacts for tissue tests along one axis; they are not made for records of several axes."""
OF_SEVERAL_AXES = {"principal_axes"}
"""Artefacts that are made only for tissue tests along several axes."""


@dataclass(frozen=True)
class Artefact:
    """One table, figure or file of the thesis: a row of ``config/artefacts.tsv``."""

    id: str
    """Name of the target, e.g. ``"table_3_1"``."""
    rule: str
    """Rule that makes the artefact."""
    path: str
    """Path below the study's results. ``{csv,tex,html}`` means all three endings; ``{lift}``, ``{model}`` and ``{record_set}``
    mean every lift, exported model and record set of the improvement chapter."""
    chapter: str
    """Chapter of the artefact, one of `CHAPTERS`."""
    label: str = ""
    """Name in the report; empty if the report does not show the artefact."""
    source: str = ""
    """Equations, figure, table or section of the thesis that the artefact reproduces."""
    function: str = ""
    """Dotted name of the Python function that computes the artefact."""
    check: str = ""
    """Check of ``stability.checks`` that the artefact needs; without this check it is not made."""

    def expanded(self, **choices: Iterable[str]) -> Self:
        """Return the artefact with each of the given choices in place of ``{name}``."""
        path = self.path
        for name, values in choices.items():
            joined = ",".join(values)
            path = path.replace(f"{{{name}}}", f"{{{joined}}}" if "," in joined else joined)
        return type(self)(**{**vars(self), "path": path})

    def paths(self, lifts: Iterable[str] = ()) -> list[str]:
        """Return every file of the artefact, below the study's results."""
        return [path for path, _ in self.labelled(lifts)]

    def labelled(self, lifts: Iterable[str] = ()) -> list[tuple[str, str]]:
        """Return every file of the artefact with its name in the report; other names in braces stay."""
        return [
            (path, self.label.replace("{lift}", lift))
            for lift in (lifts if "{lift}" in self.path else [""])
            for path in _expand_braces(self.path.replace("{lift}", lift))
        ]


def _expand_braces(pattern: str) -> list[str]:
    """Return the paths of a pattern such as ``a{b,c}``; a single name in braces is a wildcard and stays."""
    braces = re.search(r"\{([^{}]*,[^{}]*)\}", pattern)
    if braces is None:
        return [pattern]
    before, after = pattern[: braces.start()], pattern[braces.end() :]
    return [path for choice in braces[1].split(",") for path in _expand_braces(before + choice + after)]


def read_artefacts(path: Path) -> list[Artefact]:
    """Read the sheet of artefacts: tab-separated fields of `Artefact` below a header."""
    with path.open(encoding="utf-8", newline="") as stream:
        cells = csv.DictReader(stream, delimiter="\t")
        rows = [Artefact(**{name: text or "" for name, text in row.items()}) for row in cells]
    problems = Problems(str(path))
    for number, row in enumerate(rows):
        place, earlier = f"line {number + 2}", rows[:number]
        if row.chapter not in CHAPTERS:
            problems.add(place, f"chapter {row.chapter!r}", f"allowed: {', '.join(CHAPTERS)}")
        if row.id in [item.id for item in earlier]:
            problems.add(place, f"{row.id!r} is repeated", "ids are names of targets")
        if row.label and row.label in [item.label for item in earlier]:
            problems.add(place, f"label {row.label!r} is repeated", "the report could show one only")
    problems.raise_if_any()
    return rows


TWIN = "twin"
TWIN_MARKERS, TWIN_HIP_MOMENT = "lifting/{lift}.c3d", "lifting/{lift}_hip_moment.csv"
"""Files of a lift of the twin, below the folder of the twin's recordings."""
HIP_MOMENTS = "hip_moment/"
"""Folder with the twin's trials of the hip moment."""


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
    """Name of the results folder: name of the study, or of the subject if only one subject runs."""
    settings: StudySettings
    """The merged configuration."""
    subjects: dict[str, SubjectSettings]
    """Subject files by name, in the study's order."""
    artefacts: list[Artefact]
    """Artefacts of the study's chapters."""
    data_root: Path | str | None
    """Folder of the recordings, or an address in an object store; None if the twin makes them."""
    lifts: dict[str, RecordedLift] = field(default_factory=dict)
    """Recorded lifts by name, e.g. ``expert_23kg``."""

    @property
    def synthetic(self) -> bool:
        """True if the twin makes the data."""
        return self.settings.data == TWIN

    @property
    def data_label(self) -> str:
        """Label of the source of the data on every table and figure."""
        return SYNTHETIC_TWIN if self.synthetic else self.settings.data_source.name

    def recording(self, path: str) -> str:
        """Path or address of a recording named in the configuration; relative to the working directory if the twin makes it."""
        if self.synthetic:
            return f"results/{self.name}/twin/{path}"
        return f"{self.data_root}/{path}" if self.remote else str(self.data_root / path)

    @property
    def remote(self) -> bool:
        """True if the recordings are objects of a store, which Snakemake copies for each job."""
        return isinstance(self.data_root, str)

    @property
    def labels(self) -> dict[str, str]:
        """Label of every subject; Table 4.1 compares people by label."""
        return {name: subject.experience for name, subject in self.subjects.items()}

    @property
    def cohort(self) -> CohortSettings | None:
        """Distributions from which the study's subjects are drawn; None if the subjects are given."""
        return self.settings.twin.lifting.cohort if self.synthetic else None

    @property
    def lifts_by_person(self) -> dict[str, dict[str, RecordedLift]]:
        """Lifts of every person by name."""
        return {
            person: {name: lift for name, lift in self.lifts.items() if lift.subject == person}
            for person in self.subjects
        }

    def has(self, chapter: str) -> bool:
        """Return whether the study includes a chapter."""
        return chapter in self.settings.chapters


def recordings_of(study: Study) -> dict[str, list[str]]:
    """Return the file names of the recordings of each chapter, as given in the configuration."""
    settings, lifts = study.settings, study.lifts.values()
    recordings = [(lift.trial.markers, lift.trial.hip_moment, lift.static) for lift in lifts]
    sets = settings.improvement.record_sets
    files = {
        "surgeon": [record.file for record in settings.surgeon.records],
        "tissue": [record.file for record in settings.tissue.records],
        "improvement": [record.file for entry in sets for record in entry.records or ()],
        "survey": [settings.survey.file],
        "lifting": [file for trial in recordings for file in trial if file is not None],
    }
    read = {*settings.chapters, *(["lifting"] if LIFTED & set(settings.chapters) else [])}
    return {chapter: names for chapter, names in files.items() if names and chapter in read}


def record_set(settings: StudySettings, name: str) -> RecordSetSettings:
    """Return a record set of the improvement chapter with its base, records and effects; the study's values replace missing ones.

    ``effects`` of the result is None if the study names no effects; the diagnosis then selects effects.
    """
    chapter = settings.improvement
    entry = next(item for item in chapter.record_sets if item.name == name)
    # A set that is read and fitted as the tissue chapter's model has the effects of the study.
    has_same_base = entry.base in (None, chapter.base) and entry.session in (None, chapter.session)
    effects = entry.effects
    if effects is None and entry.records is None and entry.train is None and has_same_base:
        effects = chapter.effects or None
    base, records = entry.base or chapter.base, entry.records or settings.tissue.records
    return entry.model_copy(update={"base": base, "records": records, "effects": effects})


def settings_of_set(settings: StudySettings, name: str) -> StudySettings:
    """Return the settings of a study with base, training records, session and layout of a record set."""
    chapter, entry = settings.improvement, record_set(settings, name)
    session = chapter.session if entry.session is None else entry.session
    layout, rate = set_layout(settings, name)
    fit = {"base": entry.base, "train": entry.train or chapter.train, "session": session}
    tissue = settings.tissue.model_copy(update={"layout": layout, "rate_Hz": rate})
    return settings.model_copy(update={"improvement": chapter.model_copy(update=fit), "tissue": tissue})


def set_layout(settings: StudySettings, name: str) -> tuple[ColumnLayout, float | None]:
    """Return the layout of a record set's files (default: its base's layout) and the rate (Hz) to which they are resampled."""
    entry = record_set(settings, name)
    return record_layout(settings, entry.base) if entry.layout is None else (entry.layout, entry.rate_Hz)


def reading_plan(study: Study, chapters: Iterable[str]) -> list[dict]:
    """Return the plan for reading every recording of these chapters, for `lumbar.records.checking.check_recordings`.

    The plan contains only the settings of reading, so that another mass of a subject or another setting of an analysis causes
    no new reading.

    Returns
    -------
    list of dict
        ``chapter``, ``set``, ``reader``, ``path`` and ``layout`` of each file, and ``name``, ``period_s``, ``trim_s`` and
        ``rate_Hz`` of column files if they are configured; plain data, as parameters of a job.
    """
    settings, plan = study.settings, []
    for chapter in chapters:
        if chapter == "lifting":
            plan += _lift_readings(study)
        elif chapter == "improvement":
            for entry in settings.improvement.record_sets:
                layout, rate = set_layout(settings, entry.name)
                plan += [
                    {**_column_reading(study, chapter, record, layout, rate), "set": entry.name}
                    for record in entry.records or ()
                ]
        elif chapter == "survey":
            layout, path = (
                settings.survey.layout.model_dump(mode="json"),
                study.recording(settings.survey.file),
            )
            plan.append({"chapter": chapter, "reader": "ratings", "path": path, "layout": layout})
        else:
            part = getattr(settings, chapter)
            readings = (part.layout, part.rate_Hz)
            plan += [_column_reading(study, chapter, record, *readings) for record in part.records]
    return plan


def _column_reading(study: Study, chapter: str, record, layout: ColumnLayout, rate: float | None) -> dict:
    reading = {
        "chapter": chapter,
        "set": chapter,
        "reader": "columns",
        "path": study.recording(record.file),
        "layout": layout.model_dump(mode="json"),
        "name": record.name,
        "period_s": getattr(record, "period_s", None),
        "trim_s": list(trim) if (trim := getattr(record, "trim_s", None)) else None,
        "rate_Hz": rate,
    }
    return {key: value for key, value in reading.items() if value is not None}


def _lift_readings(study: Study) -> list[dict]:
    lifting = study.settings.lifting
    moment = lifting.moment_layout.model_dump(mode="json")
    moments = {"chapter": "lifting", "set": "hip moments", "reader": "columns", "layout": moment}
    plan = []
    for name, lift in study.lifts.items():
        markers = lifting.settings_for_trial(lift.trial).markers.model_dump(mode="json")
        path = study.recording(lift.trial.markers)
        plan.append({"chapter": "lifting", "reader": "markers", "path": path, "layout": markers})
        if lift.trial.hip_moment:
            path = study.recording(lift.trial.hip_moment)
            plan.append({**moments, "path": path, "name": f"hip moment of {name}"})
    return plan
