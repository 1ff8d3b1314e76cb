"""Sets of records with their diagnosis, and lifts, each computed a single time; requests of the pages of sets."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import pandas as pd
from markupsafe import Markup

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import refuse_links
from lumbar.base.progress import notify_progress
from lumbar.base.yaml_file import read_yaml
from lumbar.interface.lift_page import lift_page
from lumbar.page_server.background import DRAWING, WRITING, Job, page_message
from lumbar.page_server.recording_preview import curve_points
from lumbar.publishing.explorer.explorer_page import ExplorerPage, excitation_facts
from lumbar.publishing.explorer.page_data import PageModel, model_key
from lumbar.settings.lifting import StabilitySettings
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.diagnosis.evidence.evidence import machine_limits

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis
    from lumbar.interface.refinement import Refinement
    from lumbar.records.record import Record


@dataclass(frozen=True)
class StoredVerdict:
    """The diagnosis of one record set in ``results/<study>/improvement``."""

    folder: Path
    settings: Mapping[str, Any] | None = None
    """Current settings of the study as plain data; if None, the stored verdict is always accepted."""
    sources: Sequence[Path] = ()
    """Recordings and files of settings on which the diagnosis depends."""

    @property
    def page(self) -> Path:
        """File of the stored page."""
        return self.folder / "diagnosis.html"

    @property
    def is_current(self) -> bool:
        """True if the page exists, its settings are the current ones, and no source is newer."""
        if not self.page.is_file() or self.settings is None:
            return self.page.is_file()
        date = self.page.stat().st_mtime
        if any(path.is_file() and path.stat().st_mtime > date for path in self.sources):
            return False
        run = self.folder.parents[1] / "run_config.yaml"
        return run.is_file() and read_yaml(run, Problems(str(run))).content == self.settings


@dataclass(eq=False)
class ExploredSet:
    """A set of records, diagnosed when it is first opened."""

    name: str
    make: Callable[[], Diagnosis] | None
    """Function that returns the diagnosis; None if there is only a stored diagnosis."""
    output: Path
    """Folder that the page may write to."""
    upload: str = ""
    """Address of the page on which the records were uploaded; empty for records of a study or folder."""
    title: str = ""
    """Title on terminal and pages; default the name, with blanks."""
    stored: StoredVerdict | None = None
    """Stored diagnosis of a finished study."""
    read_first: Callable[[], Record] | None = None
    """Function that returns a record of the set for its picture; None for no picture."""
    job: Job | None = None
    html: str = ""
    """HTML page of a diagnosis that has no interactive page; empty until it is made."""
    _refits: dict[str, Refinement] = field(default_factory=dict)
    _fitted: dict[str, PageModel] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)
    _preparing: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self):
        self.title = self.title or self.name.replace("_", " ")

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis of the set."""
        return self.make()

    @cached_property
    def sketch(self) -> Markup:
        """Small picture of a record's output over time; empty without recordings."""
        from lumbar.publishing.pages.sketches import course_sketch

        if self.read_first is None:
            return Markup("")
        record = self.read_first()
        return course_sketch(curve_points(record[record.roles("output")[0]], 150))

    @cached_property
    def page(self) -> ExplorerPage:
        """The interactive page."""
        return self.diagnosis.page()

    @cached_property
    def variables(self) -> dict[str, Any]:
        """Variables of the page's template that are common to all tabs."""
        return {**self.page.variables(served=True), "own": self.upload}

    @property
    def ready(self) -> bool:
        """True if the page can be shown immediately."""
        return "variables" in self.__dict__

    def begin(self) -> Job:
        """Start the preparation of the page in the background, if it is not started yet."""
        with self._one_at_a_time:
            if self.job is None:
                self.job = Job(self.prepare)
            return self.job

    def prepare(self) -> None:
        """Diagnose the records and draw the page."""
        with self._preparing:
            notify_progress("diagnosing the records")
            _ = self.diagnosis
            notify_progress("drawing the page")
            with DRAWING:
                if self.diagnosis.no_page_reason:
                    self.html = self.diagnosis.complete_html()
                    return
                _ = self.page.records, self.page.models, self.variables

    def refitted(self, effects: Sequence[str]) -> Refinement:
        """Return the base refitted with these effects; a repeated request gets the stored result. See `lumbar.refine`."""
        with self._one_at_a_time:
            key = model_key(effects)
            if key not in self._refits:
                self._refits[key] = self.diagnosis.refine(effects)
            return self._refits[key]

    def fitted(self, effects: Sequence[str]) -> PageModel:
        """Return the base with these effects as the page draws it, from the diagnosis or from `refitted`."""
        key = model_key(effects)
        if not self._fitted:
            self._fitted.update({model.key: model for model in self.page.models})
        if key not in self._fitted:
            self._fitted[key] = self.page.simulate(self.refitted(effects).path[-1])
        return self._fitted[key]


OWN = "/_own"
"""Address of the page for the user's recordings; no record set's name begins with an underscore."""
RESULT = f"{OWN}/result"
_MAX_UPLOADS = 8
"""Largest number of sets of the user's recordings in memory; if there are more, the oldest is discarded."""


class ServedSets:
    """Record sets by the address of their page: `named` sets of a study or folder, and sets of the user's recordings."""

    def __init__(self, sets: Sequence[ExploredSet]):
        self.named = {f"/{explored.name}": explored for explored in sets}
        self._uploads: dict[str, ExploredSet] = {}

    def find(self, path: str, arguments: Mapping[str, list[bytes]]) -> ExploredSet | None:
        """Return the set at an address; None for an unknown address."""
        if path.rstrip("/") != RESULT:
            return self.named.get(path.rstrip("/"))
        names = arguments.get("set") or [b""]
        return self._uploads.get(names[-1].decode(errors="replace"))

    def add_upload(self, explored: ExploredSet) -> str:
        """Store a set of the user's recordings; return the address of its page."""
        while len(self._uploads) >= _MAX_UPLOADS:
            oldest = next(iter(self._uploads))
            job = self._uploads.pop(oldest).job
            if job is not None:
                job.cancel()
        name = secrets.token_urlsafe(16)
        self._uploads[name] = explored
        return f"{RESULT}?set={name}"


@dataclass(eq=False)
class ServedLift:
    """A saved lift and its page."""

    folder: Path
    """Folder that `lumbar lift` or a study wrote; its name is the name of the lift."""
    settings: StabilitySettings
    source_label: str = ""
    """Name of the source of the data; empty for the source of the lift."""
    _html: str = ""
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def name(self) -> str:
        """Name of the lift."""
        return self.folder.absolute().name

    @cached_property
    def sketch(self) -> Markup:
        """Small picture of the lift; empty if its tables are incomplete, for which its page has the reason."""
        from lumbar.publishing.pages.sketches import lift_sketch

        body = self.folder / "body.csv"
        return lift_sketch(pd.read_csv(body)) if body.is_file() else Markup("")

    @property
    def address(self) -> str:
        """Path of the page on the server."""
        return f"/lifts/{quote(self.name)}"

    def html(self) -> str:
        """Return the page, computed on the first call."""
        with self._one_at_a_time:
            if not self._html:
                page = lift_page(self.folder, settings=self.settings, source_label=self.source_label)
                self._html = page.to_html()
            return self._html


MAX_EFFECTS = 8
"""Largest number of effects of a requested model."""
_ACTIONS = ("fit", "separate", "save")


@dataclass(eq=False)
class TabRequests:
    """The requests of one tab, answered one after the other."""

    explored: ExploredSet
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def answer(self, text: str) -> tuple[dict[str, Any], list[PageModel]]:
        """Answer a request in JSON with ``number``, ``action`` and ``effects``.

        Returns
        -------
        dict
            Answer for the page; ``error`` if the request failed.
        list of PageModel
            New models, which the pictures must show.
        """
        number = None
        try:
            request = read_request(text)
            number, action, effects = request.get("number"), request.get("action"), request.get("effects", [])
            if not isinstance(number, int):
                raise InputError("a request without a number")
            if action not in _ACTIONS:
                raise InputError(f"{action!r}: unknown request; there are: {', '.join(_ACTIONS)}")
            with self._one_at_a_time:
                needed = (
                    f"{effects!r:.80}: a list of up to {MAX_EFFECTS} effects is needed, none of them twice"
                )
                if not isinstance(effects, list) or len(effects) > MAX_EFFECTS:
                    raise InputError(needed)
                known = self.explored.diagnosis.candidates
                wrong = [name for name in effects if not isinstance(name, str) or name not in known]
                if wrong:
                    raise InputError(f"unknown effect {wrong[0]!r:.80}")
                if len(set(effects)) < len(effects):
                    raise InputError(needed)
                content, models = self._perform_action(action, effects)
        except Exception as error:
            return {"number": number, "error": page_message(error)}, []
        return {"number": number, **content}, models

    def _perform_action(self, action: str, effects: list[str]) -> tuple[dict, list[PageModel]]:
        explored = self.explored
        if action == "fit":
            # Every step of the path: what the page has already it keeps.
            models = [explored.fitted(effects[:count]) for count in range(len(effects) + 1)]
            refits = [explored.refitted(effects[:count]) for count in range(len(effects) + 1)]
            facts = {
                model.key: explored.page.facts(model, refit.path[-1], refit.path[0], refit.experiment)
                for model, refit in zip(models, refits, strict=True)
            }
            return {"models": facts, "effects": effects}, models
        if action == "save":
            written = save_refinement(explored.refitted(effects), explored.output)
            return {"text": f"{len(written)} files written to {explored.output}."}, []
        diagnosis = explored.diagnosis
        verdict = replace(diagnosis.result, tied_with=[explored.refitted(effects).path[-1]])
        limits = machine_limits(diagnosis.study.signals.machine, verdict.experiment)
        excitation = None if diagnosis.settings.forward else separating_excitation(verdict, limits)
        if excitation is None:
            raise InputError(
                "no excitation can be named: the force is the records' input, or an effect depends on a further channel"
            )
        return {"excitation": excitation_facts(excitation, verdict)}, []


def read_request(text: str | bytes) -> dict[str, Any]:
    """Return a page's request, a mapping in JSON."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError("a request that is not JSON") from error
    if not isinstance(content, dict):
        raise InputError("a request that is not a mapping")
    return content


def save_refinement(refit: Refinement, folder) -> list[str]:
    """Write the model, its tables, figures and FMUs; return the names of the files."""
    from lumbar.interface.device import export_fmu

    refuse_links(folder)
    with WRITING, DRAWING:
        refit.save(folder)
        refit.compare().save(folder)
        refit.locate().save(folder)
        export_fmu(refit.model, folder, source_label=refit.source_label)
    return sorted(path.name for path in folder.iterdir() if path.is_file())
