"""Recordings that a person gives on the page, with what was chosen of them: held in memory, read, looked at, diagnosed."""

from __future__ import annotations

import math
import re
import shlex
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import is_device, refuse_links
from lumbar.interface.importing import ForeignFile, ImportedRecordings, import_recordings
from lumbar.interface.reading import is_marker_file
from lumbar.page_server.background import WRITING, page_message
from lumbar.page_server.recording_preview import FIELDS, in_fields, preview, tables_columns
from lumbar.page_server.served_sets import ExploredSet, ServedSets
from lumbar.records.importing.raw_table import Asked
from lumbar.records.importing.roles import Choices
from lumbar.records.importing.study_file import common_rate
from lumbar.records.record import Record
from lumbar.records.sampling import resample
from lumbar.settings.section import NAME

if TYPE_CHECKING:
    from lumbar.interface.diagnosed import Diagnosis

_TEXTS = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "table", "encoding")
_SWITCHES = ("flip_force", "accept_clipped")
LONGEST_TEXT = 200


def checked_choices(given: Any) -> dict[str, Any]:
    """Return what a page chose as arguments of `lumbar.import_recordings`.

    Raises
    ------
    InputError
        Naming the option as the command line does.
    """
    if not isinstance(given, Mapping):
        raise InputError("choices that are no mapping")
    chosen: dict[str, Any] = {}
    for name in _TEXTS:
        value = given.get(name)
        option = f"--{name.replace('_', '-')}"
        if value is None or value == "":
            continue
        if not isinstance(value, str) or len(value) > LONGEST_TEXT:
            raise InputError(f"{option}: words of up to {LONGEST_TEXT} characters are needed")
        chosen[name] = value
    for name in _SWITCHES:
        if given.get(name) is True:
            chosen[name] = True
    if given.get("rate") not in (None, ""):
        chosen["rate"] = _number(given["rate"], "--rate")
    if given.get("trim") not in (None, [], ["", ""], [None, None]):
        chosen["trim"] = _trim(given["trim"])
    Choices(rate=chosen.get("rate"), trim=chosen.get("trim"))
    return chosen


def _trim(given: Any) -> tuple[float, float]:
    if not isinstance(given, list | tuple) or len(given) != 2:
        raise InputError("--trim: a start and a stop in seconds are needed")
    start, stop = (
        default if value in (None, "") else _number(value, "--trim")
        for value, default in zip(given, (-math.inf, math.inf), strict=True)
    )
    return start, stop


def _number(value: Any, option: str) -> float:
    try:
        found = float(value) if isinstance(value, str | int | float) else math.nan
    except (ValueError, OverflowError):
        found = math.nan
    if math.isnan(found):
        raise InputError(f"{option}: {value!s:.40} is no number")
    return found


def checked_name(given: Any) -> str:
    """Return the name of a set, which names a folder."""
    if not isinstance(given, str) or len(given) > 60 or not re.fullmatch(NAME, given) or is_device(given):
        raise InputError(
            f"name {given!s:.60}: up to 60 letters, digits, _ and - are needed, and no device of Windows"
        )
    return given


def checked_training(given: Any, records: Sequence[Record]) -> list[str]:
    """Return the names of the records to fit on; the longest where none is named.

    Raises
    ------
    InputError
        If one is unknown, or none is left to test on.
    """
    names = [record.name for record in records]
    if not given:
        return [max(records, key=lambda record: record.duration).name]
    if not isinstance(given, list) or not all(name in names for name in given):
        raise InputError(f"training {given!s:.80}: the records are {', '.join(names)}")
    return [name for name in names if name in given]


MOST_FILE = 50_000_000
"""Bytes of one file."""
MOST_FILES = 12
"""Files of a tab."""
_MARKERS = (
    "{name} holds markers of a movement, not force over position. Its page is made in the terminal: lumbar lift {quoted} "
    "--subject PERSON.yaml --output lift --page lift.html (lumbar new-study writes PERSON.yaml, to be filled in)"
)


@dataclass(frozen=True)
class OwnDiagnosis:
    """How recordings that are given on the page are diagnosed."""

    diagnose: Callable[..., Diagnosis]
    """Takes records, ``train`` and ``source_label``; returns the diagnosis."""
    output: Path
    """Folder below which files are written when they are asked for."""


@dataclass(eq=False)
class OwnRecordings:
    """Files of one tab, and what was said of them."""

    address: str
    """Of the tab's page."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Contents by file name."""
    choices: dict[str, Any] = field(default_factory=dict)
    """What was chosen last, as arguments of `lumbar.import_recordings`."""
    _explored: ExploredSet | None = None
    _read: dict[tuple[str, Asked], ForeignFile] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(map(len, list(self.files.values())))

    def add(self, name: str, content: bytes) -> dict[str, Any]:
        """Hold a file more; return what `look` does.

        Raises
        ------
        InputError
            If it cannot be held: without a name, markers, too many.
        """
        name = re.split(r"[/\\]", name)[-1][:LONGEST_TEXT]
        with self._one_at_a_time:
            if not name:
                raise InputError("a file without a name")
            if is_marker_file(Path(name)):
                raise InputError(_MARKERS.format(name=name, quoted=shlex.quote(name)))
            if len(self.files.keys() - {name}) >= MOST_FILES:
                raise InputError(f"{name}: {MOST_FILES} files are held at most; take one away")
            self._forget(name)
            self.files[name] = content
        return self.look(self.choices)

    def remove(self, name: str) -> dict[str, Any]:
        """Hold a file no longer; return what `look` does."""
        with self._one_at_a_time:
            self._forget(name)
            self.files.pop(name, None)
        return self.look(self.choices)

    def _forget(self, name: str) -> None:
        self._read = {key: found for key, found in self._read.items() if key[0] != name}

    def look(self, choices: Mapping[str, Any]) -> dict[str, Any]:
        """Read all files as they would be diagnosed, and say what was found, guessed and wrong.

        Returns
        -------
        dict
            ``files`` (see `lumbar.page_server.recording_preview.preview`), ``columns`` of the first file, ``fields`` (by
            field, what is wrong with it), ``common`` (what is wrong with the files together), ``choices``.
        """
        with self._one_at_a_time:
            wrong: dict[str, list[str]] = {name: [] for name in FIELDS}
            try:
                self.choices = checked_choices(choices)
            except InputError as error:
                in_fields(str(error), wrong)
            read = [self._file(name, wrong) for name in self.files]
            files, counts = [shown for shown, _ in read], [count for _, count in read]
            common = ""
            if sum(counts) > 1 and all(counts):  # a recording alone agrees with itself
                try:
                    self._imported()
                except InputError as error:
                    common = str(error)
            columns = next((item["columns"] for item in files if item["columns"]), [])
            return {
                "files": files,
                "columns": columns,
                "fields": {name: list(dict.fromkeys(texts)) for name, texts in wrong.items()},
                "common": common,
                "choices": self.choices | {"trim": [_finite(end) for end in self.choices.get("trim", ())]},
            }

    def _file(self, name: str, wrong: dict[str, list[str]]) -> tuple[dict[str, Any], int]:
        """What is told of one file, and how many recordings it holds; what a field decides goes to `wrong`."""
        shown: dict[str, Any] = {"file": name, "columns": [], "wrong": []}
        try:
            read = self._foreign(name)
            shown["columns"] = tables_columns(read.table)
            imported = import_recordings([read], **self.choices)
            return shown | preview(imported), len(imported)
        except Exception as error:
            return shown | {"wrong": in_fields(page_message(error), wrong)}, 0

    def _foreign(self, name: str) -> ForeignFile:
        asked = Asked(self.choices.get("table"), self.choices.get("encoding"))
        if (name, asked) not in self._read:
            self._read[name, asked] = ForeignFile.of_content(name, self.files[name], asked)
        return self._read[name, asked]

    def _imported(self) -> ImportedRecordings:
        """All files as recordings that agree in quantities and units."""
        if not self.files:
            raise InputError("no recordings yet: drop files on the page, or choose them")
        imported = import_recordings([self._foreign(name) for name in self.files], **self.choices)
        _ = imported.records
        return imported

    def start(self, asked: Mapping[str, Any], own: OwnDiagnosis, served: ServedSets) -> str:
        """Begin the diagnosis, in place of one of this tab that is under way; return the address of its page.

        Parameters
        ----------
        asked : dict
            ``choices``, ``train`` (names of records; none takes the longest) and ``name`` of the set.

        Raises
        ------
        InputError
            If what was asked for cannot be used.
        """
        with self._one_at_a_time:
            self.choices = checked_choices(asked.get("choices") or {})
            imported, name = self._imported(), checked_name(asked.get("name"))
            # One model needs one rate: the lowest of the records.
            rate = common_rate(1 / record.sampling_time for record in imported.records)
            records = [record if rate is None else resample(record, rate) for record in imported.records]
            train = checked_training(asked.get("train"), records)
            make = partial(own.diagnose, records, train=train, source_label=f"own recordings {name}")
            if self._explored is not None and self._explored.job is not None:
                self._explored.job.cancel()
            self._explored = ExploredSet(name, make, own.output / name, own=self.address)
            self._explored.begin()
            return served.add_own(self._explored)

    def save(self, asked: Mapping[str, Any], own: OwnDiagnosis) -> str:
        """Write tidy records and a study of their own, as ``lumbar import`` does; return what to do next."""
        with self._one_at_a_time, WRITING:
            self.choices = checked_choices(asked.get("choices") or {})
            imported, name = self._imported(), checked_name(asked.get("name"))
            folder = own.output / name / "records"
            refuse_links(folder)
            study = imported.save(folder)
            return f"{len(imported)} records and {study.name} written to {study.parent}; next: {imported.next_command(study)}"


def _finite(value: float) -> float | None:
    """The number as JSON has it."""
    return value if math.isfinite(value) else None
