"""Settings of the project's own studies, for tests: as the workflow reads them, changed where a test wants it."""

from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import lumbar
from lumbar.base.errors import Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.lifting import SubjectSettings
from lumbar.settings.section import Section
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.validation import Origins, overlay, validate
from lumbar.study.load_study import load_study
from running import PROJECT

Kind = TypeVar("Kind", bound=Section)


def study_config(*files: str) -> dict:
    """Return files of config/, by default those of the default study, laid over each other."""
    problems, content = Problems("configuration"), {}
    for name in ("config.yaml", "twin.yaml", *files):
        content = overlay(content, read_yaml(PROJECT / "config" / name, problems).content)
    problems.raise_if_any()
    return content


@cache
def study_settings(*files: str) -> StudySettings:
    """Return the settings of the default study, with files of config/ laid over them."""
    problems = Problems("configuration")
    settings = validate(study_config(*files), StudySettings, Origins(problems))
    problems.raise_if_any()
    return settings


def artefact_paths(config: dict, root: Path, chapters: tuple[str, ...] = ()) -> list[str]:
    """Return the files of the artefacts of these chapters (default: all), below the study's results."""
    study = load_study(config, root)
    made = [item for item in study.artefacts if not chapters or item.chapter in chapters]
    return [path for artefact in made for path in artefact.paths(study.lifts)]


@cache
def subject_settings(name: str) -> SubjectSettings:
    """Return a person of config/subjects."""
    return lumbar.load_subject(PROJECT / "config" / "subjects" / f"{name}.yaml")


def changed(settings: Kind, **changes: Any) -> Kind:
    """Return settings with some keys changed; sections are dicts of what changes in them."""
    return type(settings).model_validate(overlay(settings.model_dump(mode="json"), changes))
