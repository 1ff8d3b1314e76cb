"""Uploads of the user's recordings, with their choices: read, previewed, diagnosed; and their page over HTTP."""

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
from lumbar.page_server.background import WRITING, page_message, run_in_background
from lumbar.page_server.index import INDEX, Index
from lumbar.page_server.recording_preview import FIELDS, assign_problems, preview, table_columns
from lumbar.page_server.served_sets import OWN, ExploredSet, ServedSets, read_request
from lumbar.records.importing.roles import Choices
from lumbar.records.importing.study_file import common_rate
from lumbar.records.sampling import resample
from lumbar.settings.section import NAME

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis

_TEXT_CHOICES = ("time", "position", "force", "time_unit", "position_unit", "force_unit", "table", "encoding")
_SWITCH_CHOICES = ("flip_force", "accept_clipped")
_MAX_TEXT = 200
"""Largest number of characters in a text or a file's name."""
MAX_FILE_BYTES = 50_000_000
MAX_FILES = 12
"""Largest number of files in a session."""
MAX_SESSIONS = 16
MAX_BYTES = 300_000_000
"""Largest number of bytes in the files of all sessions."""
_TAB_HEADER = "X-Lumbar-Tab"
"""HTTP header with the session of a page; forms of other pages cannot send it."""


def checked_choices(choices: Any) -> dict[str, Any]:
    """Return a page's choices as arguments of `lumbar.import_recordings`; errors name the option of the command line."""
    if not isinstance(choices, Mapping):
        raise InputError("choices that are not a mapping")
    checked: dict[str, Any] = {name: True for name in _SWITCH_CHOICES if choices.get(name) is True}
    for name in _TEXT_CHOICES:
        value = choices.get(name)
        if value is None or value == "":
            continue
        if not isinstance(value, str) or len(value) > _MAX_TEXT:
            raise InputError(f"--{name.replace('_', '-')}: a text of up to {_MAX_TEXT} characters is needed")
        checked[name] = value
    if choices.get("rate") not in (None, ""):
        checked["rate"] = _number(choices["rate"], "--rate")
    trim = choices.get("trim")
    if trim not in (None, [], ["", ""], [None, None]):
        if not isinstance(trim, list | tuple) or len(trim) != 2:
            raise InputError("--trim: a start and a stop in seconds are needed")
        checked["trim"] = tuple(
            end if value in (None, "") else _number(value, "--trim")
            for value, end in zip(trim, (-math.inf, math.inf), strict=True)
        )
    Choices(rate=checked.get("rate"), trim=checked.get("trim"))
    return checked


def _number(value: Any, option: str) -> float:
    try:
        number = float(value) if isinstance(value, str | int | float) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    if math.isnan(number):
        raise InputError(f"{option}: {value!s:.40} is not a number")
    return number


def checked_name(name: Any) -> str:
    """Return the name of a set, which is also a folder's name."""
    if not isinstance(name, str) or len(name) > 60 or not re.fullmatch(NAME, name) or is_device(name):
        raise InputError(
            f"name {name!s:.60}: up to 60 letters, digits, _ and - are needed, and no device of Windows"
        )
    return name


@dataclass(frozen=True)
class UploadDiagnosis:
    """Settings for diagnoses of the user's recordings."""

    diagnose: Callable[..., Diagnosis]
    """Function that diagnoses records; its arguments are records, ``train`` and ``source_label``."""
    output: Path
    """Folder for files that the page writes."""


@dataclass(eq=False)
class UploadSession:
    """Files of one browser tab with their choices."""

    address: str
    """Address of the tab's page."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Contents by file name."""
    choices: dict[str, Any] = field(default_factory=dict)
    """Last choices of the user, as arguments of `lumbar.import_recordings`."""
    _explored: ExploredSet | None = None
    _read: dict[tuple[str, Choices], ForeignFile] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def add(self, name: str, content: bytes) -> dict[str, Any]:
        """Add a file, at most `MAX_FILES` and no markers; return the result of `preview`."""
        name = re.split(r"[/\\]", name)[-1][:_MAX_TEXT]
        with self._one_at_a_time:
            if not name:
                raise InputError("a file without a name")
            if is_marker_file(Path(name)):
                raise InputError(
                    f"{name} holds markers of a movement, not force over position. Its page is made in the terminal: lumbar "
                    f"lift {shlex.quote(name)} --subject PERSON.yaml --output lift --page lift.html (lumbar new-study writes "
                    "PERSON.yaml, to be filled in)"
                )
            if len(self.files.keys() - {name}) >= MAX_FILES:
                raise InputError(f"{name}: the limit is {MAX_FILES} files; remove one")
            self._discard_file(name)
            self.files[name] = content
        return self.preview(self.choices)

    def remove(self, name: str) -> dict[str, Any]:
        """Remove a file; return the result of `preview`."""
        with self._one_at_a_time:
            self._discard_file(name)
            self.files.pop(name, None)
        return self.preview(self.choices)

    def _discard_file(self, name: str) -> None:
        self._read = {key: file for key, file in self._read.items() if key[0] != name}

    def preview(self, choices: Mapping[str, Any]) -> dict[str, Any]:
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
                assign_problems(str(error), wrong)
            files, counts = [], []
            for name in self.files:
                shown: dict[str, Any] = {"file": name, "columns": [], "wrong": []}
                count = 0
                try:
                    file = self._read_foreign_file(name)
                    shown["columns"] = table_columns(file.table)
                    imported = import_recordings([file], **self.choices)
                    shown, count = shown | preview(imported), len(imported)
                except Exception as error:
                    shown["wrong"] = assign_problems(page_message(error), wrong)
                files.append(shown)
                counts.append(count)
            common = ""
            if sum(counts) > 1 and all(counts):  # a single recording agrees with itself
                try:
                    self._imported()
                except InputError as error:
                    common = str(error)
            trim = [end if math.isfinite(end) else None for end in self.choices.get("trim", ())]
            return {
                "files": files,
                "columns": next((item["columns"] for item in files if item["columns"]), []),
                "fields": {name: list(dict.fromkeys(texts)) for name, texts in wrong.items()},
                "common": common,
                "choices": self.choices | {"trim": trim},  # JSON has no infinity
            }

    def _read_foreign_file(self, name: str) -> ForeignFile:
        choice = Choices(table=self.choices.get("table"), encoding=self.choices.get("encoding"))
        if (name, choice) not in self._read:
            self._read[name, choice] = ForeignFile.from_content(name, self.files[name], choice)
        return self._read[name, choice]

    def _imported(self) -> ImportedRecordings:
        """Return all files as recordings that agree in quantities and units."""
        if not self.files:
            raise InputError("no recordings yet: drop files on the page, or choose them")
        imported = import_recordings([self._read_foreign_file(name) for name in self.files], **self.choices)
        _ = imported.records
        return imported

    def start(self, request: Mapping[str, Any], uploads: UploadDiagnosis, served: ServedSets) -> str:
        """Start the diagnosis, cancel a running diagnosis of this session, and return the address of its page.

        The request has ``choices``, ``train`` (names of records; the longest if empty) and ``name`` of the set.
        """
        with self._one_at_a_time:
            self.choices = checked_choices(request.get("choices") or {})
            imported, name = self._imported(), checked_name(request.get("name"))
            # One model needs one rate: the lowest of the records.
            rate = common_rate(1 / record.sampling_time for record in imported.records)
            records = [record if rate is None else resample(record, rate) for record in imported.records]
            names, train = [record.name for record in records], request.get("train")
            if train and not (isinstance(train, list) and all(name in names for name in train)):
                raise InputError(f"training {train!s:.80}: the records are {', '.join(names)}")
            longest = max(records, key=lambda record: record.duration).name
            train = [name for name in names if name in (train or [longest])]
            make = partial(uploads.diagnose, records, train=train, source_label=f"own recordings {name}")
            if self._explored is not None and self._explored.job is not None:
                self._explored.job.cancel()
            self._explored = ExploredSet(name, make, uploads.output / name, upload=self.address)
            self._explored.begin()
            return served.add_upload(self._explored)

    def save(self, request: Mapping[str, Any], uploads: UploadDiagnosis) -> str:
        """Write tidy records and their study, as ``lumbar import`` does; return the next command."""
        with self._one_at_a_time, WRITING:
            self.choices = checked_choices(request.get("choices") or {})
            imported, name = self._imported(), checked_name(request.get("name"))
            folder = uploads.output / name / "records"
            refuse_links(folder)
            study = imported.save(folder)
            return f"{len(imported)} records and {study.name} written to {study.parent}; next: {imported.next_command(study)}"


class UploadSessions(dict[str, UploadSession]):
    """Sessions by a random name."""

    def new(self) -> str:
        """Return the name of a new session; if there are too many, discard the oldest, preferably one without files."""
        if len(self) >= MAX_SESSIONS:
            del self[next((name for name, session in self.items() if not session.files), next(iter(self)))]
        name = secrets.token_urlsafe(16)
        self[name] = UploadSession(f"{OWN}?tab={name}")
        return name


def upload_rules(index: Index, uploads: UploadDiagnosis) -> list[Rule]:
    """Return the routing rules of the page, which the index also shows, and of its requests."""
    arguments = {"sessions": UploadSessions(), "uploads": uploads, "index": index}
    return [
        Rule(PathMatches(f"(?:{INDEX}?|{OWN})"), _PageHandler, arguments),
        Rule(PathMatches(f"{OWN}/(file|look|remove|start|save)"), _ActionHandler, arguments),
    ]


class _UploadHandler(RequestHandler):
    def initialize(self, sessions: UploadSessions, uploads: UploadDiagnosis, index: Index) -> None:
        self.sessions, self.uploads, self.index = sessions, uploads, index


class _PageHandler(_UploadHandler):
    async def get(self) -> None:
        """Show the page of a session, with the index above it at the index's address; or redirect to a new session."""
        tab, at_door = self.get_query_argument("tab", ""), self.request.path != OWN
        if tab not in self.sessions:
            self.redirect(url_concat(INDEX if at_door else OWN, {"tab": self.sessions.new()}))
            return
        entries = await run_in_background(self.index.entries, True) if at_door else self.index.bar
        nonce = secrets.token_urlsafe(16)
        self.set_header("Cache-Control", "no-store")
        self.set_header(
            "Content-Security-Policy",
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; connect-src 'self'; img-src data:; "
            "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        )
        page = {"tab": tab, "nonce": nonce, "labels": FIELDS, "most": MAX_FILE_BYTES, "at_door": at_door}
        self.write(template("page_server/own_recordings.html.jinja").render(**page, **entries))


class _ActionHandler(_UploadHandler):
    async def post(self, action: str) -> None:
        try:
            session = self.sessions.get(self.request.headers.get(_TAB_HEADER, ""))
            if session is None:
                self.set_status(410)
                raise InputError(
                    "the server has discarded this session: load the page again, and give the files again"
                )
            self.write(await run_in_background(self._answer, session, action))
        except Exception as error:
            if self.get_status() == 200:
                self.set_status(400)
            raise Finish({"error": page_message(error)}) from error

    def _answer(self, session: UploadSession, action: str) -> dict[str, Any]:
        if action == "file":
            files = [file for other in list(self.sessions.values()) for file in list(other.files.values())]
            size, used = len(self.request.body), sum(map(len, files))
            if used + size > MAX_BYTES:
                raise InputError(
                    f"{size / 1e6:.3g} MB: the limit of all tabs is {MAX_BYTES / 1e6:.0f} MB ({used / 1e6:.3g} MB in use); "
                    "remove a file, or use lumbar import"
                )
            return session.add(self.get_query_argument("name", ""), self.request.body)
        request = read_request(self.request.body)
        if action == "look":
            return session.preview(request.get("choices") or session.choices)
        if action == "remove":
            return session.remove(str(request.get("file")))
        if action == "start":
            return {"address": session.start(request, self.uploads, self.index.sets)}
        return {"text": session.save(request, self.uploads)}
