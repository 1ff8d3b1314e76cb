"""Checks of keys of a configuration against each other and against the files that they name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.errors import LumbarError, did_you_mean
from lumbar.settings.lifting import GROUPS
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings
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
"""Function that adds a problem, with key, value and allowed values."""


def _check_names(key: str, names: list[str], add: Add) -> None:
    if not names:
        add(key, "none", "the chapter needs at least one")
    for name, count in Counter(names).items():
        if count > 1:
            add(key, f"{name!r} is repeated", "names must differ")


def _check_tissue(study: Study, add: Add) -> None:
    tissue, trained_on = study.settings.tissue, study.settings.runtime.trained_on
    names = [record.name for record in tissue.records]
    _check_names("tissue.records", names, add)
    for number, name in enumerate(tissue.training):
        if name not in names:
            add(f"tissue.training.{number}", f"{name!r} is not a record", f"records: {', '.join(names)}")
    if not tissue.training:
        add("tissue.training", "none", f"name at least one of the records: {', '.join(names)}")
    if tissue.search.selection == "test" and len(names) < 2:
        add("tissue.search.selection", "'test' with a single record", "use training")
    if study.has("runtime") and trained_on not in tissue.training:
        add("runtime.trained_on", f"{trained_on!r} is not trained on", "take one of tissue.training")


def _check_record_sets(settings: StudySettings, root: Path, add: Add) -> None:
    """Check that sets name existing records and effects, and that a set with the base of another system has its own records."""
    sets = settings.improvement.record_sets
    _check_names("improvement.record_sets", [entry.name for entry in sets], add)
    for number, entry in enumerate(sets):
        place, used = f"improvement.record_sets.{number}", record_set(settings, entry.name)
        layout, _ = record_layout(settings, used.base)
        if layout is not settings.tissue.layout and entry.records is None:
            problem = f"{entry.name} has the base {entry.base} and no records"
            add(place, problem, "those of the tissue chapter are of another system: name records")
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
    # The effects on a pendulum distinguish masses from distances by its gravity.
    is_weightless = settings.stability.pendulum.gravity_m_s2 == 0
    if is_weightless and any(record_set(settings, entry.name).base == "pendulum" for entry in sets):
        allowed = "record sets with the base pendulum need gravity: leave them out of improvement.record_sets, or set this key"
        add("stability.pendulum.gravity_m_s2", "0", allowed)


def _check_lifting(study: Study, add: Add) -> None:
    checks, chapters = study.settings.stability.checks, set(study.settings.chapters)
    if {"lifting", "population"} & chapters and not study.lifts:
        add("lifting.subjects", "none", "the chapter needs at least one file of config/subjects")
    for name, subject in study.subjects.items():
        if not subject.trials:
            add("lifting.subjects", f"{name} has no trials", "list its recordings in config/subjects")
    if {"stability", "population"} & chapters:
        _check_groups(study, add)
    if "stability" in chapters and "cvxpy" in checks and "thesis_method" not in checks:
        allowed = "it checks the programmes of that method: choose both"
        add("stability.checks", "cvxpy without thesis_method", allowed)


def _check_groups(study: Study, add: Add) -> None:
    """Check that the compared groups are labels of subjects.

    One subject, or one label, allows no comparison: this is an error in a study with the chapter population.
    """
    if study.settings.subject:
        return
    labels = sorted(set(study.labels.values()))
    groups = study.settings.stability.compare.groups
    unknown = [group for group in groups if group not in labels]
    if unknown and (len(labels) > 1 or groups != GROUPS or study.has("population")):
        problem = f"no subject has the label {' or '.join(map(repr, unknown))}"
        allowed = f"labels of the subjects (experience in config/subjects): {', '.join(labels)}"
        add("stability.compare.groups", problem, allowed)


def check_effects(improvement: ImprovementSettings, root: Path, add: Add) -> None:
    """Check that the effects of a study are known, and that its files of effects and bases below `root` are valid."""
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
        place, base = "improvement.effects", improvement.base
        _check_effects(improvement.effects, place, improvement.effect_files, base, root, add)


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
    """Check that the twin can make all recordings and movements that the subjects declare."""
    twin = study.settings.twin.lifting
    for person, lifts in study.lifts_by_person.items():
        subject, add = study.subjects[person], sources[person].add
        for number, (name, lift) in enumerate(lifts.items()):
            for key, file in (("markers", TWIN_MARKERS), ("hip_moment", TWIN_HIP_MOMENT)):
                declared, recorded = getattr(lift.trial, key), file.format(lift=name)
                if declared not in (None, recorded):
                    place = ("subject", "trials", number, key)
                    add(place, repr(declared), f"the twin records it as {recorded}")
        if subject.static:
            add("subject.static", repr(subject.static), "the twin records none")
        drawn = [name for name in lifts if name not in twin.lifts]
        if drawn and person not in twin.people:
            truth = f"{person}: {{mass_kg: {subject.mass_kg:g}, height_m: {subject.height_m:g}}}"
            add("subject.name", f"the twin has no person {person}", f"add {truth} to twin.lifting.people")
        if drawn and subject.experience not in twin.groups:
            allowed = (
                f"the twin has no movement of this label for {', '.join(drawn)}, only of {', '.join(twin.groups) or 'none'}: add "
                f"{subject.experience} to twin.lifting.groups in config/twin.yaml, or these lifts to twin.lifting.lifts"
            )
            add("subject.experience", repr(subject.experience), allowed)


def _check_twin_movements(settings: StudySettings, add: Add) -> None:
    """Check that lifts and trials of the twin name its people and lifts, and records of hip moments name its trials."""
    twin, path = settings.twin.lifting, ("twin", "lifting")
    trials = twin.hip_moment.trials
    for name, lift in twin.lifts.items():
        if lift.person not in twin.people:
            add((*path, "lifts", name, "person"), repr(lift.person), f"people: {', '.join(twin.people)}")
    for name, trial in trials.items():
        if trial.lift not in twin.lifts:
            place = (*path, "hip_moment", "trials", name, "lift")
            add(place, repr(trial.lift), f"lifts: {', '.join(twin.lifts)}")
    for number, entry in enumerate(settings.improvement.record_sets):
        for item, record in enumerate(entry.records or ()):
            if record.file.startswith(HIP_MOMENTS) and record.name not in trials:
                place = ("improvement", "record_sets", number, "records", item, "name")
                add(place, repr(record.name), f"twin.lifting.hip_moment.trials: {', '.join(trials)}")


def check_consistency(study: Study, root: Path, origins: Origins, sources: Mapping[str, Origins]) -> None:
    """Check names, references between keys and that every given recording exists inside the project's folder `root`.

    Snakemake checks recordings in an object store. `origins` are files and lines of the keys; `sources` are the origins of
    every subject file.
    """
    settings, add = study.settings, origins.add
    if study.has("surgeon"):
        _check_names("surgeon.records", [record.name for record in settings.surgeon.records], add)
    if study.has("tissue"):
        _check_tissue(study, add)
        check_effects(settings.improvement, root, add)
    if study.has("improvement"):
        _check_record_sets(settings, root, add)
    if study.has("survey"):
        survey, labels = settings.survey, len(settings.survey.scale_labels)
        models, points = [model.name for model in survey.layout.models], survey.layout.scale_points
        if survey.baseline not in models:
            add("survey.baseline", f"{survey.baseline!r} is not rated", f"models: {', '.join(models)}")
        if labels != points:
            add("survey.scale_labels", f"{labels} names", f"survey.layout.scale_points is {points}")
    _check_lifting(study, add)
    if study.synthetic:
        _check_twin_movements(settings, add)
        if not study.cohort:
            _check_twin_lifts(study, sources)
    _check_recordings(study, add)


def _check_recordings(study: Study, add: Add) -> None:
    root, missing = study.data_root, []
    for chapter, name in (
        (chapter, name) for chapter, files in recordings_of(study).items() for name in files
    ):
        place = f"{root or 'twin'}/{name}"
        if set("{}") & set(place):
            add(chapter, f"file {place!r}", _NO_BRACES)
        elif Path(name).is_absolute() or ".." in Path(name).parts:
            add(chapter, f"file {name!r}", "recordings are named relative to data_root, without '..'")
        elif isinstance(root, Path):
            path = (root / name).resolve()
            if not path.is_relative_to(root):
                add(chapter, f"{name} leads out of data_root", "copy the file there")
            elif not path.is_file():
                missing.append(name)
    if missing:
        add("data_root", f"{root} does not contain {', '.join(missing)}", how_to_obtain(study.settings))


def how_to_obtain(settings: StudySettings) -> str:
    """Return how to obtain the recordings of a study, for a message."""
    source = settings.data_source
    return f"obtain {source.name} (licence: {source.licence}) from {source.obtain}"
