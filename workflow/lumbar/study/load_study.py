"""Read YAML files and return a checked study, only settings, or a subject.

The whole configuration is checked before anything runs, and one error lists all wrong keys. Effects in Python are run only if
the study is in the user's project, or if the user trusts it explicitly.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from lumbar.base.errors import Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.lifting import SubjectFile, SubjectSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings, is_data
from lumbar.settings.validation import Origins, overlay, validate
from lumbar.study.consistency import Add, check_consistency, check_effects, how_to_obtain
from lumbar.study.study import (
    LIFTED,
    NEEDS,
    OF_ONE_AXIS,
    OF_SEVERAL_AXES,
    TWIN,
    RecordedLift,
    Study,
    read_artefacts,
)


def load_study(
    config: dict,
    root: Path,
    files: Sequence[str | Path] = (),
    *,
    trust: bool = False,
    shipped: Path | None = None,
) -> Study:
    """Check a merged configuration and return the study it describes.

    Parameters
    ----------
    config : dict
        Merged study and subject files.
    root : Path
        Folder of the project, which contains the subject files. Relative names of files begin here.
    files : sequence of path
        The merged files, in their order: messages name their lines, and faults that merging hides, such as a duplicate
        key, are detected in them.
    trust : bool
        Whether effects in Python are run even if they are not in the project.
    shipped : Path, optional
        Folder of the workflow, if it is not that of the project: subject files and recordings that the project lacks, and the
        sheet of artefacts.

    Raises
    ------
    InputError
        If the study is invalid, with every wrong key or value, missing file and contradiction.
    """
    problems = Problems("configuration")
    paths = [root / file for file in files]  # an absolute path stays as it is
    names = [str(path.relative_to(root) if path.is_relative_to(root) else path) for path in paths]
    read = [read_yaml(path, problems, name) for path, name in zip(paths, names, strict=True)]
    origins = Origins(problems, read, config)
    settings = validate(config, StudySettings, origins)
    folders = (root,) if shipped in (None, root) else (root, shipped)
    subjects, sources = _load_subjects(config, settings, folders, origins)
    if settings is not None:
        _check_chapters(settings, origins.add)
    if settings is not None and not trust:
        _check_code(settings.improvement, paths, folders, origins.add)
    problems.raise_if_any()
    chapters = settings.chapters
    has_lifts, has_axes = bool(LIFTED & set(chapters)), bool(settings.tissue.layout.axes)
    study = Study(
        name=settings.subject.name if settings.subject else settings.study,
        settings=settings,
        subjects=subjects,
        artefacts=[
            row.expanded(
                model=settings.runtime.models,
                record_set=[entry.name for entry in settings.improvement.record_sets],
            )
            for row in read_artefacts(folders[-1] / "config" / "artefacts.tsv")
            if row.chapter in chapters
            and (not row.check or row.check in settings.stability.checks)
            and (row.rule not in OF_ONE_AXIS if has_axes else row.id not in OF_SEVERAL_AXES)
        ],
        data_root=_data_root(settings, folders, origins.add),
        lifts={
            name: RecordedLift(subject, trial, content.static)
            for subject, content in subjects.items()
            for name, trial in content.lifts.items()
            if has_lifts
        },
    )
    check_consistency(study, root, origins, sources)
    problems.raise_if_any()
    return study


DEFAULT_FILES = (Path("config/config.yaml"), Path("config/twin.yaml"))
"""Files of settings that every study of a project overrides."""


def load_study_file(root: Path, file: Path | None = None, *, trust: bool = False) -> Study:
    """Return the study of a project's default files and a study's file. See `load_study` for `trust` and errors."""
    files = [root / path for path in DEFAULT_FILES if (root / path).is_file()]
    files += [] if file is None else [file]
    problems, content = Problems("configuration"), {}
    for path in files:
        content = overlay(content, read_yaml(path, problems).content)
    problems.raise_if_any()
    return load_study(content, root, files, trust=trust)


def _check_chapters(settings: StudySettings, add: Add) -> None:
    chapters = settings.chapters
    if not chapters:
        add("chapters", "none", "a study needs at least one chapter")
    for chapter in chapters:
        missing = [needed for needed in NEEDS.get(chapter, []) if needed not in chapters]
        if missing:
            add("chapters", f"{chapter} without {', '.join(missing)}", "it builds on it: add it")
    if "runtime" in chapters and settings.tissue.layout.axes:
        allowed = (
            "it exports the models of Table 3.1, of one axis: leave it out; lumbar export takes refined.json"
        )
        add("chapters", "runtime with records of several axes", allowed)


def _load_subjects(
    config: dict, settings: StudySettings | None, folders: Sequence[Path], origins: Origins
) -> tuple[dict[str, SubjectSettings], dict[str, Origins]]:
    """Return the study's subjects and the origins of their files, by name, even if the configuration is wrong."""
    if settings is None:
        lifting = config.get("lifting")
        names = lifting.get("subjects") if isinstance(lifting, dict) and "subject" not in config else []
        names = names if isinstance(names, list) else []
        names = [name for name in names if isinstance(name, str) and "/" not in name]
    elif not LIFTED & set(settings.chapters):
        return {}, {}
    elif settings.subject:
        # A file that changes the subject of another one has no name.
        for file in (file for file in origins.files if ("subject", "name") in file.lines):
            _check_copy(folders[0] / file.path, settings.subject.name, origins)
        return {settings.subject.name: settings.subject}, {settings.subject.name: origins}
    elif settings.data == TWIN and settings.twin.lifting.cohort:
        from lumbar.twin.cohort import cohort_subjects

        return cohort_subjects(settings.twin.lifting.cohort, settings.twin.seed), {}
    else:
        names = settings.lifting.subjects
    subjects, sources = {}, {}
    for number, name in enumerate(names):
        path = _find_first(folders, f"config/subjects/{name}.yaml")
        if not path.exists():
            known = ", ".join(
                sorted(item.stem for at in folders for item in at.glob("config/subjects/*.yaml"))
            )
            missing = f"no file config/subjects/{name}.yaml"
            origins.add(f"lifting.subjects.{number}", missing, f"there are: {known}")
            continue
        subject, source = _read_subject(path, f"config/subjects/{name}.yaml", origins.problems)
        if subject is not None and subject.name != name:
            source.add("subject.name", repr(subject.name), f"the file is named {name}.yaml")
        elif subject is not None:
            subjects[name], sources[name] = subject, source
    return subjects, sources


def _read_subject(path: Path, name: str, problems: Problems) -> tuple[SubjectSettings | None, Origins]:
    """Read a subject file with the origins of its keys; None if it cannot be used, with the reasons in `problems`."""
    before = len(problems.entries)
    file = read_yaml(path, problems, name)
    origins = Origins(problems, [file])
    checked = validate(file.content, SubjectFile, origins) if len(problems.entries) == before else None
    return (checked.subject if checked else None), origins


def _check_copy(path: Path, name: str, origins: Origins) -> None:
    """Add a problem if a file has the name of the subject of another file next to it: their results would share a folder."""
    if path.parent.joinpath(f"{name}.yaml").is_file() and path.stem != name:
        origins.add("subject.name", repr(name), f"{name}.yaml has this name: write name: {path.stem}")


def load_subject(path: str | os.PathLike) -> SubjectSettings:
    """Return the subject of a subject file.

    Examples
    --------
    >>> import lumbar
    >>> from pathlib import Path
    >>> person = "name: ann, sex: female, mass_kg: 61, height_m: 1.68, experience: novice"
    >>> trials = "trials: [{box_mass_kg: 15, markers: ann.c3d}]"
    >>> written = Path("ann.yaml").write_text(f"subject: {{{person}, {trials}}}")
    >>> lumbar.load_subject("ann.yaml").trials[0].markers
    'ann.c3d'
    """
    problems = Problems("subject")
    subject, origins = _read_subject(Path(path), str(path), problems)
    if subject is not None:
        _check_copy(Path(path), subject.name, origins)
    problems.raise_if_any()
    return subject


def _find_first(folders: Sequence[Path], name: str) -> Path:
    """Return the path below the first folder that contains it, else below the first folder."""
    return next((folder / name for folder in folders if (folder / name).exists()), folders[0] / name)


def _data_root(settings: StudySettings, folders: Sequence[Path], add: Add) -> Path | str | None:
    """Return the folder or address of the recordings; None if the twin makes the recordings or the folder is missing."""
    if settings.data == TWIN:
        return None
    root_name, source = os.environ.get("LUMBAR_DATA") or settings.data_root, settings.data_source
    if source is None:
        add("data_source", "missing", "recordings need name, licence and where to obtain them")
        return None
    if root_name is None:
        add("data_root", "not set", f"set it in {_DATA_ROOT}")
        return None
    if "://" in root_name:
        return root_name.rstrip("/")
    folder = _find_first(folders, str(Path(root_name).expanduser()))
    if folder.is_dir():
        return folder.resolve()
    add("data_root", f"no folder {folder}", f"{how_to_obtain(settings)}, or set data_root in {_DATA_ROOT}")
    return None


_DATA_ROOT = "the study's YAML or in the environment variable LUMBAR_DATA"


def load_settings(*files: str | os.PathLike, trust: bool = False) -> StudySettings:
    """Return the defaults, overridden by YAML files in the order given.

    Parameters
    ----------
    *files : path
        Files of settings.
    trust : bool
        Whether effects in Python are always run; otherwise only if they and the files are in the project
        that is the working directory.

    Raises
    ------
    InputError
        If files are invalid, with every unreadable file, and every wrong key and value.

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
    improvement = _locate_files(settings.improvement, places)
    if not trust:
        project = (Path(),) if DEFAULT_FILES[0].is_file() else ()
        _check_code(improvement, files, project, origins.add)
        problems.raise_if_any()
    check_effects(improvement, Path(), origins.add)
    problems.raise_if_any()
    return settings.model_copy(update={"improvement": improvement})


def _locate_files(improvement: ImprovementSettings, folders: Sequence[Path]) -> ImprovementSettings:
    """Return the settings with the path of each effect and base file in the first folder that contains the file."""

    def locate(name: str) -> str:
        return next((str(folder / name) for folder in folders if (folder / name).is_file()), name)

    def locate_base(base: str | None) -> str | None:
        return locate(base) if base and is_data(base) else base

    sets = (entry.model_copy(update={"base": locate_base(entry.base)}) for entry in improvement.record_sets)
    files = {"effect_files": tuple(map(locate, improvement.effect_files)), "record_sets": tuple(sets)}
    return improvement.model_copy(update={**files, "base": locate_base(improvement.base)})


def _check_code(
    improvement: ImprovementSettings, files: Sequence[Path], project: Sequence[Path], add: Add
) -> None:
    """Check, before anything is run, that effects in Python and the `files` of settings are in the folders of the user's project.

    A study from another person could otherwise run any code; an effect in YAML is data. Outside of any project there is no
    folder.
    """
    folders = [folder.resolve() for folder in project]
    for number, effect in enumerate(improvement.effect_files):
        paths = () if is_data(effect) else (*files, Path(*project[:1], effect))
        foreign = [path for path in paths if not any(map(path.resolve().is_relative_to, folders))]
        if foreign:
            add(
                f"improvement.effect_files.{number}",
                f"{effect} is Python, which would be run, and {foreign[0]} is outside of the project in which you work",
                "read it first; then write the effect in YAML, copy study and effect into your project, or give --trust "
                "(lumbar.load_settings: trust=True)",
            )
