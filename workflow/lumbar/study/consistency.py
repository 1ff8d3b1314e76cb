"""Checks of keys of a configuration against each other and against the files that they name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import LumbarError, did_you_mean
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.stability import GROUPS
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.survey import SurveySettings
from lumbar.settings.tissue import TissueSettings
from lumbar.study.study import (
    HIP_MOMENTS,
    TWIN_HIP_MOMENT,
    TWIN_MARKERS,
    Study,
    record_layout,
    record_set,
    recordings_of,
)

if TYPE_CHECKING:
    from lumbar.settings.validation import Origins

Add = Callable[[str | tuple, str, str], None]
"""Function that adds a problem: key, value and what is allowed."""


def _check_names(key: str, names: list[str], add: Add) -> None:
    if not names:
        add(key, "none", "the chapter needs at least one")
    for name, count in Counter(names).items():
        if count > 1:
            add(key, f"{name!r} is repeated", "names must differ")


def _check_survey(survey: SurveySettings, add: Add) -> None:
    models = [model.name for model in survey.layout.models]
    if survey.baseline not in models:
        add("survey.baseline", f"{survey.baseline!r} is not rated", f"models: {', '.join(models)}")
    points, labels = survey.layout.scale_points, len(survey.scale_labels)
    if labels != points:
        add("survey.scale_labels", f"{labels} names", f"survey.layout.scale_points is {points}")


def _check_tissue(tissue: TissueSettings, add: Add) -> None:
    names = [record.name for record in tissue.records]
    _check_names("tissue.records", names, add)
    for number, name in enumerate(tissue.training):
        if name not in names:
            add(f"tissue.training.{number}", f"{name!r} is not a record", f"records: {', '.join(names)}")
    if not tissue.training:
        add("tissue.training", "none", f"name at least one of the records: {', '.join(names)}")
    if tissue.search.selection == "test" and len(names) < 2:
        add("tissue.search.selection", "'test' with a single record", "use training")


def _check_record_sets(settings: StudySettings, root: Path, add: Add) -> None:
    """Check that a set with the base of another system has records, and that sets name existing records and effects."""
    _check_names("improvement.record_sets", [entry.name for entry in settings.improvement.record_sets], add)
    for number, entry in enumerate(settings.improvement.record_sets):
        place, used = f"improvement.record_sets.{number}", record_set(settings, entry.name)
        layout, _ = record_layout(settings, used.base)
        if layout is not settings.tissue.layout and entry.records is None:
            found = f"{entry.name} has the base {entry.base} and no records"
            add(place, found, "those of the tissue chapter are of another system: name records")
        if entry.layout is not None and entry.records is None:
            add(f"{place}.layout", "a layout without records", "it is for records of the set: name them")
        if entry.rate_Hz is not None and entry.layout is None:
            add(f"{place}.rate_Hz", "a rate without a layout", "records of tissue.layout have tissue.rate_Hz")
        names = [record.name for record in used.records]
        for name in [entry.train] if isinstance(entry.train, str) else entry.train or ():
            if name not in names:
                add(f"{place}.train", f"{name!r} is not a record", f"records: {', '.join(names)}")
        if entry.effects:
            key = f"{place}.effects"
            _check_effects(entry.effects, key, settings.improvement.effect_files, used.base, root, add)


def _check_gravity(settings: StudySettings, add: Add) -> None:
    """Check that a pendulum has gravity, by which its effects distinguish masses from distances."""
    sets = settings.improvement.record_sets
    weightless = settings.stability.pendulum.gravity_m_s2 == 0
    if weightless and any(record_set(settings, entry.name).base == "pendulum" for entry in sets):
        words = "record sets whose base is pendulum need gravity: leave them out of improvement.record_sets, or set this key"
        add("stability.pendulum.gravity_m_s2", "0", words)


def _check_groups(study: Study, add: Add) -> None:
    """Check that the compared groups are labels of subjects.

    One subject, or one label, allows no comparison: this is an error if the chapter population needs one.
    """
    if study.settings.subject:
        return
    labels = sorted(set(study.labels.values()))
    groups = study.settings.stability.compare.groups
    unknown = [group for group in groups if group not in labels]
    if unknown and (len(labels) > 1 or groups != GROUPS or study.has("population")):
        allowed = f"labels of the subjects (experience in config/subjects): {', '.join(labels)}"
        add(
            "stability.compare.groups", f"no subject has the label {' or '.join(map(repr, unknown))}", allowed
        )


def check_effects(improvement: ImprovementSettings, root: Path, add: Add) -> None:
    """Check that the effects of a study are known, and that its files of effects and bases are valid.

    Parameters
    ----------
    root : Path
        Folder to which the study's files of effects are relative.
    add : callable
        Adds a problem: key, value and what is allowed.
    """
    files = {f"effect_files.{number}": file for number, file in enumerate(improvement.effect_files)}
    for place, file in {**improvement.base_files, **files}.items():
        if set("{}") & set(file):
            add(f"improvement.{place}", repr(file), _NO_BRACES)
    for place, file in improvement.base_files.items():
        from lumbar.tissue.effects.catalogue import read_base

        try:
            read_base(root / file)
        except (LumbarError, OSError) as error:
            add(f"improvement.{place}", str(error), "")
    if improvement.effects or files:
        place = "improvement.effects"
        _check_effects(improvement.effects, place, improvement.effect_files, improvement.base, root, add)


_NO_BRACES = "no braces, which Snakemake takes for wildcards: rename it"


def _check_effects(
    effects: Sequence[str], key: str, files: Sequence[str], base: str, root: Path, add: Add
) -> None:
    from lumbar.tissue.effects.catalogue import catalogue_with

    try:
        known = catalogue_with([str(root / file) for file in files], base)
    except (LumbarError, OSError) as error:
        add("improvement.effect_files", str(error), "")
        return
    for number, name in enumerate(effects):
        if name not in known:
            allowed = f"effects: {', '.join(known)}; improvement.effect_files may define more"
            add(f"{key}.{number}", f"{name!r} is not an effect{did_you_mean(name, known)}", allowed)


def _check_twin_lifts(study: Study, sources: Mapping[str, Origins]) -> None:
    """Check that the twin can make all that people declare of their lifts."""
    twin = study.settings.twin.lifting
    for person, lifts in study.lifts_by_person.items():
        for number, (name, lift) in enumerate(lifts.items()):
            made = {
                "markers": TWIN_MARKERS.format(lift=name),
                "hip_moment": TWIN_HIP_MOMENT.format(lift=name),
            }
            for key, recorded in made.items():
                found, place = getattr(lift.trial, key), ("subject", "trials", number, key)
                if found not in (None, recorded):
                    sources[person].add(place, repr(found), f"the twin records it as {recorded}")
        if study.subjects[person].static:
            sources[person].add(
                "subject.static", repr(study.subjects[person].static), "the twin records none"
            )
        group, drawn = study.subjects[person].experience, [name for name in lifts if name not in twin.lifts]
        if drawn and group not in twin.groups:
            words = (
                f"the twin moves {', '.join(drawn)} as people of a label do; it knows {', '.join(twin.groups) or 'none'}: "
                f"add {group} to twin.lifting.groups in config/twin.yaml, or these lifts to twin.lifting.lifts"
            )
            sources[person].add("subject.experience", repr(group), words)


def _check_twin_movements(settings: StudySettings, add: Add) -> None:
    """Check that lifts and trials of the twin name people and lifts that it has, and records of hip moments its trials."""
    twin, way = settings.twin.lifting, ("twin", "lifting")
    trials = twin.hip_moment.trials
    for name, lift in twin.lifts.items():
        if lift.person not in twin.people:
            add((*way, "lifts", name, "person"), repr(lift.person), f"people: {', '.join(twin.people)}")
    for name, trial in trials.items():
        if trial.lift not in twin.lifts:
            place = (*way, "hip_moment", "trials", name, "lift")
            add(place, repr(trial.lift), f"lifts: {', '.join(twin.lifts)}")
    for number, entry in enumerate(settings.improvement.record_sets):
        for item, record in enumerate(entry.records or ()):
            if record.file.startswith(HIP_MOMENTS) and record.name not in trials:
                place = ("improvement", "record_sets", number, "records", item, "name")
                add(place, repr(record.name), f"twin.lifting.hip_moment.trials: {', '.join(trials)}")


def check_consistency(study: Study, root: Path, origins: Origins, sources: Mapping[str, Origins]) -> None:
    """Check names, references between keys and that every given recording is there and inside the root.

    Whether an object store has a recording is asked by Snakemake.
    `root` is the project's folder; `origins` know files and lines of the keys, `sources` those of every person's file.
    """
    settings, add = study.settings, origins.add
    if study.has("surgeon"):
        _check_names("surgeon.records", [record.name for record in settings.surgeon.records], add)
    if study.has("tissue"):
        _check_tissue(settings.tissue, add)
        trained_on = settings.runtime.trained_on
        if study.has("runtime") and trained_on not in settings.tissue.training:
            add("runtime.trained_on", f"{trained_on!r} is not trained on", "take one of tissue.training")
        check_effects(settings.improvement, root, add)
    if study.has("improvement"):
        _check_record_sets(settings, root, add)
        _check_gravity(settings, add)
    if study.has("survey"):
        _check_survey(settings.survey, add)
    if (study.has("lifting") or study.has("population")) and not study.lifts:
        add("lifting.subjects", "none", "the chapter needs a file of config/subjects at least")
    for name, subject in study.subjects.items():
        if not subject.trials:
            add("lifting.subjects", f"{name} has no trials", "list its recordings in config/subjects")
    if study.has("stability") or study.has("population"):
        _check_groups(study, add)
    if study.has("stability"):
        checks = settings.stability.checks
        if "cvxpy" in checks and "thesis_method" not in checks:
            add(
                "stability.checks",
                "cvxpy without thesis_method",
                "it checks the programmes of that method: choose both",
            )
    if study.synthetic:
        _check_twin_movements(settings, add)
        if not study.cohort:
            _check_twin_lifts(study, sources)
    _check_recordings(study, add)


def _check_recordings(study: Study, add: Add) -> None:
    for chapter, files in recordings_of(study).items():
        for name in files:
            path = Path(name)
            place = f"{study.data_root or 'twin'}/{name}"
            if set("{}") & set(place):
                add(chapter, f"file {place!r}", _NO_BRACES)
            elif path.is_absolute() or ".." in path.parts:
                add(chapter, f"file {name!r}", "recordings are named relative to data_root, without '..'")
            elif isinstance(study.data_root, Path):
                found = (study.data_root / path).resolve()
                if not found.is_relative_to(study.data_root):
                    add(chapter, f"{name} leads out of data_root", "copy the file there")
                elif not found.is_file():
                    source = study.settings.data_source
                    words = f"it comes with {source.name} (licence: {source.licence}): {source.obtain}"
                    add(chapter, f"{name} is not in {study.data_root}", words)
