"""What the verbs on records are given: the settings of a study, and words that say where the data come from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.study_settings import StudySettings

NOT_SAID = "source not said"


def data_label(given: str, sources: Iterable[str]) -> str:
    """Return what was given; else the folder that the files come from, or a file alone.

    Parameters
    ----------
    sources : iterable of str
        Files; empty for what was read from none.

    Examples
    --------
    >>> data_label("", ["recordings/tissue/chirp.csv", "recordings/tissue/noise.csv"])
    'tissue'
    >>> data_label("", ["answers.csv"])
    'answers.csv'
    >>> data_label("", [""])
    'source not said'
    """
    files = [Path(source).resolve() for source in dict.fromkeys(sources) if source]
    names = [file.name for file in files] if len(files) == 1 else [file.parent.name for file in files]
    return given or ", ".join(dict.fromkeys(names)) or NOT_SAID


def label_of(given: str, records: Iterable[Record]) -> str:
    """Return `data_label` of records.

    Raises
    ------
    InputError
        If these are no records.
    """
    found: list = [records] if isinstance(records, str | Path) else list(records)
    if not all(isinstance(item, Record) for item in found):
        raise InputError(f"records is {records!r:.80}: give records, e.g. lumbar.read('recordings')")
    return data_label(given, (record.source for record in found))


def settings_or_default(given: StudySettings | None) -> StudySettings:
    """Return the settings of a study that were given, or the defaults.

    Raises
    ------
    InputError
        If they are those of a part of a study.
    """
    if not isinstance(given, StudySettings | None):
        raise InputError(
            f"settings is an object of class {type(given).__name__}: give those of a whole study, as lumbar.load_settings "
            "returns them, or StudySettings(improvement=ImprovementSettings(most_effects=1))"
        )
    return given or StudySettings()
