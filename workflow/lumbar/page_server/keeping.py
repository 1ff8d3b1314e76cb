"""What is kept of a session: chosen effects in a study's YAML, recordings below its data root."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from lumbar.base.errors import InputError
from lumbar.page_server.study_change import Change, with_value
from lumbar.records.importing.study_file import common_rate
from lumbar.settings.plain import plain
from lumbar.settings.study_settings import StudySettings
from lumbar.study.study import Study, is_tissue_chapter

if TYPE_CHECKING:
    from lumbar.interface.importing import ImportedRecordings

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
    listed = read_listed_sets(path)
    if listed:
        found = [place for place, entry in enumerate(listed) if entry.get("name") == name]
        if len(found) != 1:
            raise InputError(f"{path}: no record set {name!r} in it any more; start 'lumbar explore' again")
        return with_value(path, (*SETS, found[0], "effects"), effects)
    entries = listed_sets(settings)
    entries[number] = {"name": name, "effects": effects} | entries[number] | {"effects": effects}
    return with_value(path, SETS, entries)


def read_listed_sets(path: Path) -> list[dict]:
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


def keep_records(
    path: Path,
    study: Study,
    name: str,
    imported: ImportedRecordings,
    train: Sequence[str],
    effects: Sequence[str],
) -> Change:
    """Return the change, with its files, that adds a record set to a study, or sets the effects of one that was added before.

    Parameters
    ----------
    path : Path
        The study's file.
    study : Study
        What it held when the server was started.
    name : str
        Of the set, and of the folder of its files below the data root.
    train : sequence of str
        Records that the models are fitted to.

    Raises
    ------
    InputError
        If the study has no data root or no chapter improvement, or if its file names such a set that is another one.
    """
    if study.synthetic:
        raise InputError(
            f"{path}: the recordings of this study are made by the workflow, and no others can be kept in it; write them with "
            "a study of their own on the page where they were given"
        )
    if not study.has("improvement"):
        raise InputError(
            f"{path}: the study has no chapter improvement, which diagnoses records; add it to chapters"
        )
    entry = _entry(name, imported, train, effects)
    if study.settings.improvement.session:
        entry["session"] = False  # as they were diagnosed: files of a person's own need not be of one session
    listed = read_listed_sets(path)
    now = listed or listed_sets(study.settings)
    there = next((number for number, item in enumerate(now) if item.get("name") == name), None)
    if there is None:
        beside = _files(study, name, imported)
        way, value = ((*SETS, len(now)), entry) if listed else (SETS, [*now, entry])
        change = with_value(path, way, value)
        return Change(path, change.before, change.after, beside)
    if {**now[there], "effects": None} != {**entry, "effects": None}:
        raise InputError(f"{path}: has another record set {name!r}; give the recordings another name")
    return with_value(path, (*SETS, there, "effects"), list(effects))


def _entry(
    name: str, imported: ImportedRecordings, train: Sequence[str], effects: Sequence[str]
) -> dict[str, Any]:
    """The record set as the study's file has it."""
    clipped = {"clipped": "accept"} if any(item.clipped for item in imported) else {}
    rate = common_rate(1 / record.sampling_time for record in imported.records)
    return {
        "name": name,
        "train": list(train),
        "effects": list(effects),
        "layout": {"columns": imported[0].columns, **clipped},
        **({} if rate is None else {"rate_Hz": rate}),
        "records": [
            {"name": item.record.name, "file": f"{name}/{item.record.name}.csv"} for item in imported
        ],
    }


def _files(study: Study, name: str, imported: ImportedRecordings) -> dict[Path, str]:
    """Text of the tidy files by their place below the data root."""
    folder = study.data_root / name
    if folder.resolve().parent != study.data_root.resolve():
        raise InputError(f"{folder}: leads out of the study's data root; give the recordings another name")
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: holds files already; give the recordings another name")
    files = {}
    for item in imported:
        text = io.StringIO()
        item.frame().to_csv(text, index=False, lineterminator="\n")
        files[folder / f"{item.record.name}.csv"] = text.getvalue()
    return files
