"""What the server shows, each made once: sets of records with their diagnosis, of a study, folder or the page; and lifts."""

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
from lumbar.base.progress import going_on
from lumbar.base.yaml_file import read_yaml
from lumbar.interface.lift_page import lift_page
from lumbar.page_server.background import DRAWING, Job
from lumbar.publishing.explorer.shown import ShownModel, model_key
from lumbar.settings.stability import StabilitySettings

if TYPE_CHECKING:
    from lumbar.interface.diagnosed import Diagnosis
    from lumbar.interface.refinement import Refinement
    from lumbar.publishing.explorer.explorer_page import ExplorerPage


@dataclass(frozen=True)
class StoredVerdict:
    """The diagnosis of one record set in ``results/<study>/improvement``."""

    folder: Path
    settings: Mapping[str, Any] | None = None
    """The study's as they are now, as plain data; None takes the verdict as it stands."""
    sources: Sequence[Path] = ()
    """Recordings and files of settings."""

    @property
    def page(self) -> Path:
        """Its page as a file."""
        return self.folder / "diagnosis.html"

    @property
    def made(self) -> str:
        """When it was made."""
        return f"{datetime.fromtimestamp(self.page.stat().st_mtime):%Y-%m-%d %H:%M}"

    @property
    def holds(self) -> bool:
        """Whether it is there and of these settings and recordings: the run had the same settings, no file is newer."""
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
        """What it says."""
        # Here, not above: the server listens before Matplotlib is read.
        from lumbar.publishing.study_report.contents import diagnosis_sentence

        return diagnosis_sentence(read_json(self.folder / "diagnosis.json"))


@dataclass(eq=False)
class ExploredSet:
    """A set of records, diagnosed when it is first looked at."""

    name: str
    make: Callable[[], Diagnosis] | None
    """Without arguments; returns the diagnosis. None: there is the stored one alone."""
    output: Path
    """Folder that the page may write to."""
    own: str = ""
    """Address of the page on which the records were given; empty for those of a study or folder."""
    title: str = ""
    """Of a set that is not called by its name."""
    stored: StoredVerdict | None = None
    """The diagnosis that a study's run may have left."""
    job: Job | None = None
    html: str = ""
    """Page of a diagnosis that one cannot look around in, once it is made."""
    _refits: dict[str, Refinement] = field(default_factory=dict)
    _fitted: dict[str, ShownModel] = field(default_factory=dict)
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)
    _preparing: threading.Lock = field(default_factory=threading.Lock)

    @property
    def words(self) -> str:
        """What terminal and pages call it."""
        return self.title or self.name.replace("_", " ")

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis of the set."""
        return self.make()

    @cached_property
    def page(self) -> ExplorerPage:
        """Its page."""
        return self.diagnosis.page()

    @cached_property
    def variables(self) -> dict[str, Any]:
        """What the page's template shows; the same for every tab."""
        return {**self.page.variables(served=True), "own": self.own}

    @property
    def ready(self) -> bool:
        """Whether the page can be shown at once."""
        return "variables" in self.__dict__

    def begin(self) -> Job:
        """Prepare the page beside the server, once."""
        with self._one_at_a_time:
            if self.job is None:
                self.job = Job(self.prepare)
            return self.job

    def prepare(self) -> None:
        """Diagnose the records and draw the page."""
        with self._preparing:
            going_on("diagnosing the records")
            _ = self.diagnosis
            going_on("drawing the page")
            with DRAWING:
                if self.diagnosis.without_page:
                    self.html = self.diagnosis.written()
                    return
                _ = self.page.records, self.page.models, self.variables

    def refitted(self, effects: Sequence[str]) -> Refinement:
        """The base with these effects, fitted once: every tab that asks again gets the same one.

        Raises
        ------
        InputError, NumericalError
            As `lumbar.refine`.
        """
        with self._one_at_a_time:
            key = model_key(effects)
            if key not in self._refits:
                self._refits[key] = self.diagnosis.with_effects(effects)
            return self._refits[key]

    def fitted(self, effects: Sequence[str]) -> ShownModel:
        """The base with these effects as the page draws it: of the diagnosis, where it has them, else fitted; as `refitted`."""
        key = model_key(effects)
        if not self._fitted:
            self._fitted.update({model.key: model for model in self.page.models})
        if key not in self._fitted:
            self._fitted[key] = self.page.shown(self.refitted(effects).path[-1])
        return self._fitted[key]


OWN = "/_own"
"""Address of the page for own recordings; no record set's name begins so."""
RESULT = f"{OWN}/result"
MOST_OWN = 8
"""Sets of own recordings that are held; the oldest is let go for one more."""


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
        """Whether this is the address of own recordings' results."""
        return path.rstrip("/") == RESULT

    def find(self, path: str, arguments: Mapping[str, list[bytes]]) -> ExploredSet | None:
        """Return the set that an address shows; None for any other."""
        if not self.is_own(path):
            return self.given.get(path.rstrip("/"))
        asked = arguments.get("set") or [b""]
        return self._own.get(asked[-1].decode(errors="replace"))

    def add_own(self, explored: ExploredSet) -> str:
        """Hold a set of own recordings; return the address of its page."""
        while len(self._own) >= MOST_OWN:
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
    """That `lumbar lift` or a study wrote; its name is the lift's."""
    settings: StabilitySettings
    source_label: str = ""
    """Words for the source of the data; empty for those of the lift."""
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def address(self) -> str:
        """Path of the page on the server."""
        return f"/lifts/{quote(self.folder.absolute().name)}"

    @cached_property
    def _html(self) -> str:
        return lift_page(self.folder, settings=self.settings, source_label=self.source_label).to_html()

    def html(self) -> str:
        """Return the page, made once."""
        with self._one_at_a_time:
            return self._html
