"""Settings read from files where there is no study's folder: for commands, notebooks and scripts of one's own."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lumbar.settings.study_settings import StudySettings
    from lumbar.settings.subject import SubjectSettings


def load_settings(*files: str | os.PathLike) -> StudySettings:
    """Return the defaults with the settings of YAML files laid over them, in the order given.

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
    from lumbar.base.errors import Problems
    from lumbar.base.yaml_file import read_yaml, way_of
    from lumbar.settings.study_settings import StudySettings
    from lumbar.study.consistency import check_effects
    from lumbar.study.validation import Origins, laid_over, validated

    files, problems = tuple(map(Path, files)), Problems("configuration")
    read = [read_yaml(path, problems) for path in files]
    origins, content = Origins(read), {}
    for file in read:
        content = laid_over(content, file.content)
    settings = validated(content, StudySettings, problems, origins)
    problems.raise_if_any()
    places = [Path(), *(parent for path in reversed(files) for parent in path.resolve().parents)]
    own = tuple(_first_found(file, places) for file in settings.improvement.effect_files)
    improvement = replace(settings.improvement, effect_files=own)

    def add(key: str, found: str, allowed: str) -> None:
        problems.add(origins.place(way_of(key)), found, allowed)

    check_effects(improvement, Path(), add)
    problems.raise_if_any()
    return replace(settings, improvement=improvement)


def _first_found(file: str, folders: list[Path]) -> str:
    """Path of a file that is named relative to where the user is, or to a folder above the settings that name it."""
    return next((str(folder / file) for folder in folders if (folder / file).is_file()), file)


def load_subject(path: str | os.PathLike) -> SubjectSettings:
    """Return the person of a subject file.

    Raises
    ------
    InputError
        As `load_settings`.

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
    from lumbar.base.errors import Problems
    from lumbar.study.load_study import read_subject

    problems = Problems("subject")
    subject = read_subject(Path(path), str(path), problems)
    problems.raise_if_any()
    return subject
