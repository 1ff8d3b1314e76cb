"""Which recordings a study reads, and how."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from lumbar.settings.plain import plain
from lumbar.study.chapters import LIFTED
from lumbar.study.study import Study

if TYPE_CHECKING:
    from lumbar.settings.improvement import RecordSetSettings
    from lumbar.settings.layout import ColumnLayout
    from lumbar.settings.study_settings import StudySettings


def recordings_of(study: Study) -> dict[str, list[str]]:
    """File names of the recordings each chapter reads, as the configuration gives them."""
    settings = study.settings
    files = {
        "surgeon": [record.file for record in settings.surgeon.records],
        "tissue": [record.file for record in settings.tissue.records],
        "improvement": [
            record.file for entry in settings.improvement.record_sets for record in entry.records or ()
        ],
        "survey": [settings.survey.file],
        "lifting": [
            file
            for lift in study.lifts.values()
            for file in (lift.trial.markers, lift.trial.hip_moment, lift.trial.forces, lift.static)
            if file is not None
        ],
    }
    if settings.perturbations:
        files["perturbations"] = [*settings.perturbations.unperturbed, *settings.perturbations.perturbed]
    lifted = not LIFTED.isdisjoint(study.settings.chapters)
    return {
        chapter: names
        for chapter, names in files.items()
        if names and (lifted if chapter == "lifting" else study.has(chapter))
    }


def record_layout(settings: StudySettings, base: str) -> tuple[ColumnLayout, float | None]:
    """Layout of a base model's records, and the rate (Hz) to which they are resampled.

    Raises
    ------
    InputError
        For an unknown base.
    """
    from lumbar.tissue.models.bases import system_of

    if system_of(base) == "pendulum":
        return settings.lifting.moment_layout, None
    return settings.tissue.layout, settings.tissue.rate_Hz


def record_set(settings: StudySettings, name: str) -> RecordSetSettings:
    """Return a record set of the improvement chapter with its base, records and effects, its own or the study's.

    Its ``effects`` are None where the study names none: its model is then the one that the diagnosis selects.
    """
    chapter = settings.improvement
    entry = next(item for item in chapter.record_sets if item.name == name)
    effects = entry.effects
    if effects is None and is_tissue_chapter(settings, entry):
        effects = chapter.effects or None
    base, records = entry.base or chapter.base, entry.records or settings.tissue.records
    return replace(entry, base=base, records=records, effects=effects)


def settings_of_set(settings: StudySettings, name: str) -> StudySettings:
    """Settings of a study with a record set's own base, training records and session in the place of the study's."""
    chapter, entry = settings.improvement, record_set(settings, name)
    session = chapter.session if entry.session is None else entry.session
    own = replace(chapter, base=entry.base, train=entry.train or chapter.train, session=session)
    return replace(settings, improvement=own)


def is_tissue_chapter(settings: StudySettings, entry: RecordSetSettings) -> bool:
    """Whether a record set is read and fitted as the tissue chapter's model with ``improvement.effects``."""
    chapter = settings.improvement
    same_base = entry.base in (None, chapter.base) and entry.session in (None, chapter.session)
    return entry.records is None and entry.train is None and same_base


def set_layout(settings: StudySettings, name: str) -> tuple[ColumnLayout, float | None]:
    """Layout of a record set's files, its own or that of its base, and the rate (Hz) to which they are resampled."""
    entry = record_set(settings, name)
    return record_layout(settings, entry.base) if entry.layout is None else (entry.layout, entry.rate_Hz)


def reading_plan(study: Study, chapters: Iterable[str]) -> list[dict]:
    """How every recording of these chapters is read, for `lumbar.records.checking.check_recordings`.

    Holds what reading needs and nothing else of the configuration, so that a subject's mass or an analysis
    setting does not call for reading again.

    Returns
    -------
    list of dict
        ``chapter``, ``set``, ``reader``, ``path`` and ``layout`` of each file, and ``name``, ``period_s``, ``trim_s`` and
        ``rate_Hz`` of column files where the configuration gives them; plain data, as parameters of a job are.
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
        elif chapter == "perturbations":
            trials, layout = settings.perturbations, plain(settings.perturbations.markers)
            plan += [
                _marker_reading(study, chapter, name, layout)
                for name in (*trials.unperturbed, *trials.perturbed)
            ]
        elif chapter == "survey":
            path, layout = study.recording(settings.survey.file), plain(settings.survey.layout)
            plan.append({"chapter": chapter, "reader": "ratings", "path": path, "layout": layout})
        else:
            own = getattr(settings, chapter)
            plan += [
                _column_reading(study, chapter, record, own.layout, own.rate_Hz) for record in own.records
            ]
    return plan


def _column_reading(study: Study, chapter: str, record, layout: ColumnLayout, rate: float | None) -> dict:
    reading = {
        "chapter": chapter,
        "set": chapter,
        "reader": "columns",
        "path": study.recording(record.file),
        "layout": plain(layout),
        "name": record.name,
        "period_s": getattr(record, "period_s", None),
        "trim_s": plain(getattr(record, "trim_s", None)),
        "rate_Hz": rate,
    }
    return {key: value for key, value in reading.items() if value is not None}


def _marker_reading(study: Study, chapter: str, file: str, layout: dict) -> dict:
    return {"chapter": chapter, "reader": "markers", "path": study.recording(file), "layout": layout}


def _lift_readings(study: Study) -> list[dict]:
    lifting = study.settings.lifting
    markers, moment = plain(lifting.markers), plain(lifting.moment_layout)
    moments = {"chapter": "lifting", "set": "hip moments", "reader": "columns", "layout": moment}
    plan = []
    for name, lift in study.lifts.items():
        plan.append(_marker_reading(study, "lifting", lift.trial.markers, markers))
        if lift.trial.hip_moment:
            path = study.recording(lift.trial.hip_moment)
            plan.append({**moments, "path": path, "name": f"hip moment of {name}"})
    return plan
