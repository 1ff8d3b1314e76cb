"""Recordings that a user gives on the page, with their choices: read, previewed, diagnosed, and the page over HTTP."""

from __future__ import annotations

import math
import re
import secrets
import shlex
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tornado.httputil import url_concat
from tornado.routing import PathMatches, Rule
from tornado.web import Finish, RequestHandler

from lumbar.base.errors import InputError
from lumbar.base.files import is_device, refuse_links
from lumbar.base.templates import template
from lumbar.interface.importing import ForeignFile, ImportedRecordings, import_recordings
from lumbar.interface.reading import is_marker_file
from lumbar.page_server.background import WRITING, in_background, page_message
from lumbar.page_server.index import INDEX, Index
from lumbar.page_server.recording_preview import FIELDS, in_fields, preview, tables_columns
from lumbar.page_server.requests import read_request
from lumbar.page_server.served_sets import OWN, ExploredSet, ServedSets
from lumbar.records.importing.raw_table import ReadOptions
from lumbar.records.importing.roles import Choices
from lumbar.records.importing.study_file import common_rate
from lumbar.records.sampling import resample
from lumbar.settings.section import NAME

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis

_TEXTS = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "table", "encoding")
_SWITCHES = ("flip_force", "accept_clipped")
LONGEST_TEXT = 200


def checked_choices(given: Any) -> dict[str, Any]:
    """Return a page's choices as arguments of `lumbar.import_recordings`.

    Raises
    ------
    InputError
        With the option of the command line.
    """
    if not isinstance(given, Mapping):
        raise InputError("choices that are not a mapping")
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
    """Return the name of a set, which is also a folder's name."""
    if not isinstance(given, str) or len(given) > 60 or not re.fullmatch(NAME, given) or is_device(given):
        raise InputError(
            f"name {given!s:.60}: up to 60 letters, digits, _ and - are needed, and no device of Windows"
        )
    return given


MAX_FILE = 50_000_000
"""Most bytes of one file."""
MAX_FILES = 12
"""Most files of a tab."""
_MARKERS = (
    "{name} holds markers of a movement, not force over position. Its page is made in the terminal: lumbar lift {quoted} "
    "--subject PERSON.yaml --output lift --page lift.html (lumbar new-study writes PERSON.yaml, to be filled in)"
)


@dataclass(frozen=True)
class OwnDiagnosis:
    """Diagnosis of recordings that are given on the page."""

    diagnose: Callable[..., Diagnosis]
    """Function of records, ``train`` and ``source_label``."""
    output: Path
    """Folder for files that the page writes."""


@dataclass(eq=False)
class OwnRecordings:
    """Files of one tab with their choices."""

    address: str
    """Address of the tab's page."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Contents by file name."""
    choices: dict[str, Any] = field(default_factory=dict)
    """Last choices, as arguments of `lumbar.import_recordings`."""
    _explored: ExploredSet | None = None
    _read: dict[tuple[str, ReadOptions], ForeignFile] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(map(len, list(self.files.values())))

    def add(self, name: str, content: bytes) -> dict[str, Any]:
        """Add a file; return the result of `look`.

        Raises
        ------
        InputError
            If it cannot be kept: no name, markers, too many files.
        """
        name = re.split(r"[/\\]", name)[-1][:LONGEST_TEXT]
        with self._one_at_a_time:
            if not name:
                raise InputError("a file without a name")
            if is_marker_file(Path(name)):
                raise InputError(_MARKERS.format(name=name, quoted=shlex.quote(name)))
            if len(self.files.keys() - {name}) >= MAX_FILES:
                raise InputError(f"{name}: {MAX_FILES} files are held at most; take one away")
            self._forget(name)
            self.files[name] = content
        return self.look(self.choices)

    def remove(self, name: str) -> dict[str, Any]:
        """Remove a file; return the result of `look`."""
        with self._one_at_a_time:
            self._forget(name)
            self.files.pop(name, None)
        return self.look(self.choices)

    def _forget(self, name: str) -> None:
        self._read = {key: found for key, found in self._read.items() if key[0] != name}

    def look(self, choices: Mapping[str, Any]) -> dict[str, Any]:
        """Read all files as for a diagnosis and return their preview, guesses and faults.

        Returns
        -------
        dict
            ``files`` (see `lumbar.page_server.recording_preview.preview`), ``columns`` of the first file, ``fields`` (faults
            by field), ``common`` (fault of the files together), ``choices``.
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
                # JSON has no infinity.
                "choices": self.choices
                | {"trim": [end if math.isfinite(end) else None for end in self.choices.get("trim", ())]},
            }

    def _file(self, name: str, wrong: dict[str, list[str]]) -> tuple[dict[str, Any], int]:
        """Return the preview of a file and its number of recordings; faults of fields go to `wrong`."""
        shown: dict[str, Any] = {"file": name, "columns": [], "wrong": []}
        try:
            read = self._foreign(name)
            shown["columns"] = tables_columns(read.table)
            imported = import_recordings([read], **self.choices)
            return shown | preview(imported), len(imported)
        except Exception as error:
            return shown | {"wrong": in_fields(page_message(error), wrong)}, 0

    def _foreign(self, name: str) -> ForeignFile:
        asked = ReadOptions(self.choices.get("table"), self.choices.get("encoding"))
        if (name, asked) not in self._read:
            self._read[name, asked] = ForeignFile.of_content(name, self.files[name], asked)
        return self._read[name, asked]

    def _imported(self) -> ImportedRecordings:
        """Return all files as recordings that agree in quantities and units."""
        if not self.files:
            raise InputError("no recordings yet: drop files on the page, or choose them")
        imported = import_recordings([self._foreign(name) for name in self.files], **self.choices)
        _ = imported.records
        return imported

    def start(self, asked: Mapping[str, Any], own: OwnDiagnosis, served: ServedSets) -> str:
        """Start the diagnosis, cancel a running one of this tab, and return the address of its page.

        Parameters
        ----------
        asked : dict
            ``choices``, ``train`` (names of records; none takes the longest) and ``name`` of the set.

        Raises
        ------
        InputError
            If a choice cannot be used.
        """
        with self._one_at_a_time:
            self.choices = checked_choices(asked.get("choices") or {})
            imported, name = self._imported(), checked_name(asked.get("name"))
            # One model needs one rate: the lowest of the records.
            rate = common_rate(1 / record.sampling_time for record in imported.records)
            records = [record if rate is None else resample(record, rate) for record in imported.records]
            names, train = [record.name for record in records], asked.get("train")
            if train and not (isinstance(train, list) and all(name in names for name in train)):
                raise InputError(f"training {train!s:.80}: the records are {', '.join(names)}")
            longest = max(records, key=lambda record: record.duration).name
            train = [name for name in names if name in (train or [longest])]
            make = partial(own.diagnose, records, train=train, source_label=f"own recordings {name}")
            if self._explored is not None and self._explored.job is not None:
                self._explored.job.cancel()
            self._explored = ExploredSet(name, make, own.output / name, own=self.address)
            self._explored.begin()
            return served.add_own(self._explored)

    def save(self, asked: Mapping[str, Any], own: OwnDiagnosis) -> str:
        """Write tidy records and their study, as ``lumbar import`` does; return the next command."""
        with self._one_at_a_time, WRITING:
            self.choices = checked_choices(asked.get("choices") or {})
            imported, name = self._imported(), checked_name(asked.get("name"))
            folder = own.output / name / "records"
            refuse_links(folder)
            study = imported.save(folder)
            return f"{len(imported)} records and {study.name} written to {study.parent}; next: {imported.next_command(study)}"


MAX_TABS = 16
"""Most tabs that are kept."""
MAX_HELD = 300_000_000
"""Most bytes of the files of all tabs."""
_PAGE = "page_server/own_recordings.html.jinja"
TAB = "X-Lumbar-Tab"
"""Header with the tab of a page; no form of another page can send it."""
_GONE = "this tab is no longer held by the server: load the page again, and give the files once more"


class OwnTabs:
    """The tabs with their recordings, each by a random name."""

    def __init__(self) -> None:
        self._tabs: dict[str, OwnRecordings] = {}

    def new(self) -> str:
        """Return the name of a new tab; of many the oldest is discarded, one without files first."""
        if len(self._tabs) >= MAX_TABS:
            del self._tabs[
                next((name for name, tab in self._tabs.items() if not tab.files), next(iter(self._tabs)))
            ]
        name = secrets.token_urlsafe(16)
        self._tabs[name] = OwnRecordings(f"{OWN}?tab={name}")
        return name

    @property
    def size(self) -> int:
        """Bytes of the files of all tabs."""
        return sum(tab.size for tab in self._tabs.values())

    def find(self, name: str) -> OwnRecordings | None:
        """Return a tab's recordings; None if it is no longer kept."""
        return self._tabs.get(name)


def own_rules(index: Index, own: OwnDiagnosis) -> list[Rule]:
    """Return the rules of the page, which the index shows too, and of its requests."""
    known = {"tabs": OwnTabs(), "own": own, "index": index}
    return [
        Rule(PathMatches(f"(?:{INDEX}?|{OWN})"), _PageHandler, known),
        Rule(PathMatches(f"{OWN}/(file|look|remove|start|save)"), _AskHandler, known),
    ]


class _OwnHandler(RequestHandler):
    def initialize(self, tabs: OwnTabs, own: OwnDiagnosis, index: Index) -> None:
        """Store Tornado's arguments."""
        self.tabs, self.own, self.index = tabs, own, index


class _PageHandler(_OwnHandler):
    async def get(self) -> None:
        """Show the page of a tab, or redirect to a new tab. At the index's address the index is above it."""
        tab, at_door = self.get_query_argument("tab", ""), self.request.path != OWN
        if self.tabs.find(tab) is None:
            self.redirect(url_concat(INDEX if at_door else OWN, {"tab": self.tabs.new()}))
            return
        listed = await in_background(self.index.listed, True) if at_door else self.index.bar
        nonce = secrets.token_urlsafe(16)
        self.set_header("Cache-Control", "no-store")
        self.set_header(
            "Content-Security-Policy",
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; connect-src 'self'; img-src data:; "
            "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        )
        shown = {"tab": tab, "nonce": nonce, "labels": FIELDS, "most": MAX_FILE, "at_door": at_door}
        self.write(template(_PAGE).render(**shown, **listed))


class _AskHandler(_OwnHandler):
    async def post(self, action: str) -> None:
        """Answer a request of the page."""
        held = self.tabs.find(self.request.headers.get(TAB, ""))
        if held is None:
            self._refuse(410, _GONE)
        try:
            self.write(await in_background(self._answer, held, action))
        except Exception as error:
            self._refuse(400, page_message(error))

    def _refuse(self, status: int, words: str) -> None:
        self.set_status(status)
        raise Finish({"error": words})

    def _answer(self, held: OwnRecordings, action: str) -> dict[str, Any]:
        if action == "file":
            size, kept = len(self.request.body), self.tabs.size
            if kept + size > MAX_HELD:
                raise InputError(
                    f"{size / 1e6:.3g} MB, where {kept / 1e6:.3g} MB are held and {MAX_HELD / 1e6:.0f} MB are the most of all "
                    "tabs; take a file away, or use lumbar import"
                )
            return held.add(self.get_query_argument("name", ""), self.request.body)
        asked = read_request(self.request.body)
        if action == "look":
            return held.look(asked.get("choices") or held.choices)
        if action == "remove":
            return held.remove(str(asked.get("file")))
        if action == "start":
            return {"address": held.start(asked, self.own, self.index.sets)}
        return {"text": held.save(asked, self.own)}
