"""Read YAML files and return a checked study, or only settings for commands and notebooks.

The whole configuration is checked before anything runs, and one error lists all wrong keys. Effects in Python are run only if
the study is in the user's project, or if the user trusts it explicitly.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from lumbar.base.errors import Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.improvement import ImprovementSettings, is_data
from lumbar.settings.lifting import SubjectSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.validation import Origins, overlay, validate
from lumbar.study.artefacts import (
    LIFTED,
    NEEDS,
    OF_ONE_AXIS,
    OF_SEVERAL_AXES,
    read_artefacts,
)
from lumbar.study.consistency import Add, check_consistency, check_effects
from lumbar.study.study import TWIN, RecordedLift, Study
from lumbar.study.subject_file import read_subject


def load_study(config: dict, root: Path, files: Sequence[str | Path] = (), *, trust: bool = False) -> Study:
    """Check a merged configuration and return the study it describes.

    Parameters
    ----------
    config : dict
        Merged study and subject files.
    root : Path
        Folder of the project: subject files lie below it.
    files : sequence of path
        The merged files, in their order: messages name their lines, and faults that merging hides, such as a duplicate
        key, are detected in them.
    trust : bool
        Whether effects in Python are run wherever they come from.

    Raises
    ------
    InputError
        With every wrong key, wrong value, missing file and contradiction.
    """
    problems = Problems("configuration")
    read = [read_yaml(_below(root, file), problems, _named(root, file)) for file in files]
    origins = Origins(problems, read, config)
    settings = validate(config, StudySettings, origins)
    subjects, sources = _load_subjects(config, settings, root, origins)
    if settings is not None:
        _check_chapters(settings, origins.add)
    if settings is not None and not trust:
        check_code(settings.improvement, [_below(root, file) for file in files], root, origins.add)
    problems.raise_if_any()
    chapters = settings.chapters
    lifts = name_lifts(subjects)
    study = Study(
        name=settings.subject.name if settings.subject else settings.study,
        settings=settings,
        subjects=subjects,
        artefacts=[
            row.expanded(
                model=settings.runtime.models,
                record_set=[entry.name for entry in settings.improvement.record_sets],
            )
            for row in read_artefacts(root / "config" / "artefacts.tsv")
            if row.chapter in chapters
            and (not row.check or row.check in settings.stability.checks)
            and (
                row.rule not in OF_ONE_AXIS if settings.tissue.layout.axes else row.id not in OF_SEVERAL_AXES
            )
        ],
        data_root=_data_root(settings, root, origins.add),
        lifts=lifts if LIFTED & set(chapters) else {},
    )
    check_consistency(study, root, origins, sources)
    problems.raise_if_any()
    return study


DEFAULT_FILES = (Path("config/config.yaml"), Path("config/twin.yaml"))
"""Files below every study of a project."""


def load_study_file(root: Path, file: Path | None = None, *, trust: bool = False) -> Study:
    """Return the study of a project's default files and a study's file; `trust` and errors as in `load_study`."""
    files = [root / path for path in DEFAULT_FILES if (root / path).is_file()]
    files += [] if file is None else [file]
    problems, content = Problems("configuration"), {}
    for path in files:
        content = overlay(content, read_yaml(path, problems).content)
    problems.raise_if_any()
    return load_study(content, root, files, trust=trust)


def _below(root: Path, file: str | Path) -> Path:
    return Path(file) if Path(file).is_absolute() else root / file


def _named(root: Path, file: str | Path) -> str:
    path = _below(root, file)
    return str(path.relative_to(root)) if path.is_relative_to(root) else str(file)


def _check_chapters(settings: StudySettings, add: Add) -> None:
    chapters = settings.chapters
    if not chapters:
        add("chapters", "none", "a study has a chapter at least")
    for chapter in chapters:
        missing = [needed for needed in NEEDS.get(chapter, []) if needed not in chapters]
        if missing:
            add("chapters", f"{chapter} without {', '.join(missing)}", "it builds on it: add it")
    if "runtime" in chapters and settings.tissue.layout.axes:
        add(
            "chapters",
            "runtime with records of several axes",
            "it exports the models of Table 3.1, of one axis: leave it out; lumbar export takes refined.json",
        )


def name_lifts(subjects: dict[str, SubjectSettings]) -> dict[str, RecordedLift]:
    """Return every trial of a study by the name of its lift."""
    return {
        name: RecordedLift(subject, trial, content.static)
        for subject, content in subjects.items()
        for name, trial in content.lifts.items()
    }


def _load_subjects(
    config: dict, settings: StudySettings | None, root: Path, origins: Origins
) -> tuple[dict[str, SubjectSettings], dict[str, Origins]]:
    """Read the study's subject files; those of a configuration that is wrong itself are checked all the same.

    Returns people by name, and the files that each comes from.
    """
    if settings is None:
        names = (
            config.get("lifting", {}).get("subjects", []) if isinstance(config.get("lifting"), dict) else []
        )
        names = [] if "subject" in config or not isinstance(names, list) else names
        names = [name for name in names if isinstance(name, str) and "/" not in name]
    elif not LIFTED & set(settings.chapters):
        return {}, {}
    elif settings.subject:
        return {settings.subject.name: settings.subject}, {settings.subject.name: origins}
    elif settings.data == TWIN and settings.twin.lifting.cohort:
        from lumbar.twin.cohort import cohort_subjects

        return cohort_subjects(settings.twin.lifting.cohort, settings.twin.seed), {}
    else:
        names = settings.lifting.subjects
    subjects, sources = {}, {}
    for number, name in enumerate(names):
        path = root / "config" / "subjects" / f"{name}.yaml"
        if not path.is_file():
            known = ", ".join(sorted(item.stem for item in path.parent.glob("*.yaml")))
            origins.add(
                f"lifting.subjects.{number}", f"no file config/subjects/{name}.yaml", f"there are: {known}"
            )
            continue
        subject, source = read_subject(path, f"config/subjects/{name}.yaml", origins.problems)
        if subject is not None and subject.name != name:
            source.add("subject.name", repr(subject.name), f"the file is named {name}.yaml")
        elif subject is not None:
            subjects[name], sources[name] = subject, source
    return subjects, sources


def _data_root(settings: StudySettings, root: Path, add: Add) -> Path | str | None:
    if settings.data == TWIN:
        return None
    named = os.environ.get("LUMBAR_DATA") or settings.data_root
    source = settings.data_source
    if source is None:
        add("data_source", "missing", "recordings need name, licence and where to obtain them")
        return None
    if named is None:
        words = "set it in the study's YAML or in the environment variable LUMBAR_DATA"
        add("data_root", "not set", words)
        return None
    if "://" in named:
        return named.rstrip("/")
    folder = _below(root, Path(named).expanduser())
    if not folder.is_dir():
        add(
            "data_root",
            f"the folder {folder} does not exist",
            f"it should hold: {source.name} (licence: {source.licence}); obtain it from "
            f"{source.obtain}, then set data_root in the study's YAML or the environment variable "
            "LUMBAR_DATA",
        )
        return None
    return folder.resolve()


def load_settings(*files: str | os.PathLike, trust: bool = False) -> StudySettings:
    """Return the defaults with the settings of YAML files laid over them, in the order given.

    Parameters
    ----------
    *files : path
    trust : bool
        Whether effects in Python are run wherever they come from; otherwise only if they and the files are in the project
        that is the working directory.

    Raises
    ------
    InputError
        With every file that cannot be read, and every wrong key and value of all files.

    Examples
    --------
    >>> import lumbar
    >>> from pathlib import Path
    >>> written = Path("study.yaml").write_text("improvement: {most_effects: 2}")
    >>> lumbar.load_settings("study.yaml").improvement.most_effects
    2
    """
    files, problems = tuple(map(Path, files)), Problems("configuration")
    origins, content = Origins(problems, [read_yaml(path, problems) for path in files]), {}
    for file in origins.files:
        content = overlay(content, file.content)
    settings = validate(content, StudySettings, origins)
    problems.raise_if_any()
    places = [Path(), *(parent for path in reversed(files) for parent in path.resolve().parents)]
    improvement = _with_files_in(settings.improvement, places)
    if not trust:
        project = Path() if DEFAULT_FILES[0].is_file() else None
        check_code(improvement, files, project, origins.add)
        problems.raise_if_any()
    check_effects(improvement, Path(), origins.add)
    problems.raise_if_any()
    return settings.model_copy(update={"improvement": improvement})


def _with_files_in(improvement: ImprovementSettings, folders: Sequence[Path]) -> ImprovementSettings:
    """Return the settings with each file of an effect or base in the first of the folders that has it."""

    def located(name: str) -> str:
        return next((str(folder / name) for folder in folders if (folder / name).is_file()), name)

    def located_base(base: str | None) -> str | None:
        return located(base) if base and is_data(base) else base

    sets = (entry.model_copy(update={"base": located_base(entry.base)}) for entry in improvement.record_sets)
    files = {"effect_files": tuple(map(located, improvement.effect_files)), "record_sets": tuple(sets)}
    return improvement.model_copy(update={**files, "base": located_base(improvement.base)})


def check_code(
    improvement: ImprovementSettings,
    files: Sequence[Path],
    project: Path | None,
    add: Add,
) -> None:
    """Check, before anything is run, that effects in Python and all files of settings are in the user's project.

    A study from another person could otherwise run any code; an effect in YAML is data. `files` are those of the settings;
    `project` is its folder, None outside of any project.
    """
    for number, effect in enumerate(improvement.effect_files):
        if is_data(effect):
            continue
        strange = [
            file
            for file in (*files, Path(project or "", effect))
            if project is None or not file.resolve().is_relative_to(project.resolve())
        ]
        if strange:
            add(
                f"improvement.effect_files.{number}",
                f"{effect} is Python, which would be run, and {strange[0]} is outside of the project in which you work",
                "read it first; then write the effect in YAML, copy study and effect into your project, or say --trust "
                "(lumbar.load_settings: trust=True)",
            )
