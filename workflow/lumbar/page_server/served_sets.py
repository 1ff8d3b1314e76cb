"""Sets of records with their diagnosis, from a study, folder or the page, and lifts: each is computed a single time."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from lumbar.base.errors import Problems
from lumbar.base.files import read_json
from lumbar.base.progress import notify_progress
from lumbar.base.yaml_file import read_yaml
from lumbar.interface.lift_page import lift_page
from lumbar.page_server.background import DRAWING, Job
from lumbar.publishing.explorer.page_data import ModelData, model_key
from lumbar.settings.stability import StabilitySettings

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Diagnosis
    from lumbar.interface.refinement import Refinement
    from lumbar.publishing.explorer.explorer_page import ExplorerPage


@dataclass(frozen=True)
class StoredVerdict:
    """The diagnosis of one record set in ``results/<study>/improvement``."""

    folder: Path
    settings: Mapping[str, Any] | None = None
    """The study's present settings as plain data; None accepts the stored verdict."""
    sources: Sequence[Path] = ()
    """Recordings and files of settings."""

    @property
    def page(self) -> Path:
        """File of its page."""
        return self.folder / "diagnosis.html"

    @property
    def made(self) -> str:
        """Date and time of the page."""
        return f"{datetime.fromtimestamp(self.page.stat().st_mtime):%Y-%m-%d %H:%M}"

    @property
    def holds(self) -> bool:
        """Whether the page exists with the same settings and no newer recording."""
        if not self.page.is_file():
            return False
        if self.settings is None:
            return True
        made = self.page.stat().st_mtime
        if any(path.is_file() and path.stat().st_mtime > made for path in self.sources):
            return False
        run = self.folder.parents[1] / "run_config.yaml"
        return run.is_file() and read_yaml(run, Problems(str(run))).content == self.settings

    @property
    def sentence(self) -> str:
        """Result of the diagnosis in one sentence."""
        # Imported here since the server listens before Matplotlib is imported.
        from lumbar.publishing.study_report.contents import diagnosis_sentence

        return diagnosis_sentence(read_json(self.folder / "diagnosis.json"))


@dataclass(eq=False)
class ExploredSet:
    """A set of records, diagnosed when it is first looked at."""

    name: str
    make: Callable[[], Diagnosis] | None
    """Returns the diagnosis; None if there is only the stored one."""
    output: Path
    """Folder that the page may write to."""
    own: str = ""
    """Address of the page on which the records were given; empty for records of a study or folder."""
    title: str = ""
    """Title if it differs from the name."""
    stored: StoredVerdict | None = None
    """The diagnosis of a finished study."""
    job: Job | None = None
    html: str = ""
    """Page of a diagnosis without an interactive page, as soon as it is made."""
    _refits: dict[str, Refinement] = field(default_factory=dict)
    _fitted: dict[str, ModelData] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)
    _preparing: threading.Lock = field(default_factory=threading.Lock)

    @property
    def words(self) -> str:
        """Title on terminal and pages."""
        return self.title or self.name.replace("_", " ")

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis of the set."""
        return self.make()

    @cached_property
    def page(self) -> ExplorerPage:
        """The interactive page."""
        return self.diagnosis.page()

    @cached_property
    def variables(self) -> dict[str, Any]:
        """Variables of the page's template, common to all tabs."""
        return {**self.page.variables(served=True), "own": self.own}

    @property
    def ready(self) -> bool:
        """Whether the page can be shown immediately."""
        return "variables" in self.__dict__

    def begin(self) -> Job:
        """Start the preparation of the page in the background, unless it was started."""
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
        """Return the base refitted with these effects; a repeated request gets the first result.

        Raises
        ------
        InputError, NumericalError
            As `lumbar.refine`.
        """
        with self._one_at_a_time:
            key = model_key(effects)
            if key not in self._refits:
                self._refits[key] = self.diagnosis.refine(effects)
            return self._refits[key]

    def fitted(self, effects: Sequence[str]) -> ModelData:
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
MAX_OWN = 8
"""Most sets of the user's recordings that are kept; the oldest is discarded."""


class ServedSets:
    """Sets by the address of their page.

    Parameters
    ----------
    given : sequence of ExploredSet
    """

    def __init__(self, given: Sequence[ExploredSet]):
        self.given = {f"/{explored.name}": explored for explored in given}
        self._own: dict[str, ExploredSet] = {}

    def is_own(self, path: str) -> bool:
        """Whether this is the address of results of the user's recordings."""
        return path.rstrip("/") == RESULT

    def find(self, path: str, arguments: Mapping[str, list[bytes]]) -> ExploredSet | None:
        """Return the set that an address shows; None if it shows none."""
        if not self.is_own(path):
            return self.given.get(path.rstrip("/"))
        asked = arguments.get("set") or [b""]
        return self._own.get(asked[-1].decode(errors="replace"))

    def add_own(self, explored: ExploredSet) -> str:
        """Keep a set of the user's recordings; return the address of its page."""
        while len(self._own) >= MAX_OWN:
            oldest = next(iter(self._own))
            job = self._own.pop(oldest).job
            if job is not None:
                job.cancel()
        name = secrets.token_urlsafe(16)
        self._own[name] = explored
        return f"{RESULT}?set={name}"


@dataclass(eq=False)
class ServedLift:
    """A saved lift and its page."""

    folder: Path
    """Folder that `lumbar lift` or a study wrote; its name is the lift's."""
    settings: StabilitySettings
    source_label: str = ""
    """Origin of the data; empty for that of the lift."""
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def address(self) -> str:
        """Path of the page on the server."""
        return f"/lifts/{quote(self.folder.absolute().name)}"

    @cached_property
    def _html(self) -> str:
        return lift_page(self.folder, settings=self.settings, source_label=self.source_label).to_html()

    def html(self) -> str:
        """Return the page, computed on the first call."""
        with self._one_at_a_time:
            return self._html
