"""Chosen effects written into a study's YAML: into the key of the record set that they were chosen for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import yaml

from lumbar.base.errors import InputError
from lumbar.page_server.study_change import Change, with_value
from lumbar.settings.plain import plain
from lumbar.settings.study_settings import StudySettings
from lumbar.study.study_recordings import is_tissue_chapter

SETS = ("improvement", "record_sets")


def keep_effects(path: Path, settings: StudySettings, name: str, effects: Sequence[str]) -> Change:
    """Set the effects of a record set's model in a study's file; every other character stays.

    Those of the tissue chapter's own records are ``improvement.effects``, which Table 3.1 takes too; those of any other set
    stand in its entry of ``improvement.record_sets``. A study that has its sets from the defaults gets the list written out.

    Parameters
    ----------
    path : Path
        The study's file.
    settings : StudySettings
        The study's, defaults included.
    name : str
        Of the record set.
    effects : sequence of str
        In the order in which they are added.

    Raises
    ------
    InputError
        As `lumbar.page_server.study_change.with_value`.
    """
    sets, effects = settings.improvement.record_sets, list(effects)
    number = next(number for number, entry in enumerate(sets) if entry.name == name)
    if is_tissue_chapter(settings, sets[number]) and sets[number].effects is None:
        return with_value(path, ("improvement", "effects"), effects)
    listed = listed_in(path)
    if listed:
        found = [place for place, entry in enumerate(listed) if entry.get("name") == name]
        if len(found) != 1:
            raise InputError(f"{path}: no record set {name!r} in it any more; start 'lumbar explore' again")
        return with_value(path, (*SETS, found[0], "effects"), effects)
    entries = listed_sets(settings)
    entries[number] = {"name": name, "effects": effects} | entries[number] | {"effects": effects}
    return with_value(path, SETS, entries)


def listed_in(path: Path) -> list[dict]:
    """Record sets that a study's file lists itself, as it stands now; empty where they are those of the defaults.

    Raises
    ------
    InputError
        If the file is no study any more.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        listed = (content.get(SETS[0]) or {}).get(SETS[1]) or []
    except (yaml.YAMLError, AttributeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a study any more; mend it first") from error
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise InputError(f"{path}: {'.'.join(SETS)} is no list of record sets any more; mend it first")
    return listed


def listed_sets(settings: StudySettings) -> list[dict]:
    """Record sets as a study's file lists them: without what is left to the defaults."""
    return [_given(plain(entry)) for entry in settings.improvement.record_sets]


def _given(value):
    """Nested settings without the keys that are null."""
    if isinstance(value, dict):
        return {key: _given(item) for key, item in value.items() if item is not None}
    return [_given(item) for item in value] if isinstance(value, list) else value
