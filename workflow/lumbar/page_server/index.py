"""The one door: what the server shows, on its index, in the bar of every page, and where an address leads nowhere."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.routing import PathMatches, Rule
from tornado.web import HTTPError, RequestHandler

from lumbar.base.templates import template
from lumbar.page_server.background import in_background, page_message
from lumbar.page_server.served_sets import OWN, ExploredSet, ServedLift, ServedSets

INDEX, RESULTS, STORED = "/", "/_results/", "/_stored/"
REPORT = "report.html"
LOST = "page_server/lost.html.jinja"
_AS_TEXT = {".csv", ".json", ".log", ".tex", ".tsv", ".yaml"}
_NO_SCRIPT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
_APART = "sandbox allow-scripts allow-downloads; default-src 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'self'"
"""A study that was run may come from elsewhere: its pages run no script, or apart from the server's own, whom they cannot ask."""
_PIECE = 1_000_000


@dataclass(frozen=True)
class Index:
    """All pages of the server."""

    place: str
    """Study or folder."""
    sets: ServedSets
    lifts: Sequence[ServedLift] = ()
    results: Path | None = None
    """``results/<study>``, served as it lies there; None without a study."""

    @property
    def report(self) -> str:
        """Address of the study's report; empty where none is made."""
        return f"{RESULTS}{REPORT}" if self.results and (self.results / REPORT).is_file() else ""

    @property
    def bar(self) -> dict[str, Any]:
        """What the bar of a page shows."""
        menu = [
            (INDEX, "All pages"),
            *([(self.report, "Report")] if self.report else []),
            (OWN, "Your own recordings"),
        ]
        return {"place": self.place, "menu": menu}

    def listed(self, with_words: bool = False) -> dict[str, Any]:
        """What the index lists; `with_words`: and what is known of every set, which reads the verdicts."""
        return {
            **self.bar,
            "sets": [
                (address, found.words, _known(found) if with_words else "")
                for address, found in self.sets.given.items()
            ],
            "lifts": [(lift.address, lift.folder.absolute().name.replace("_", " ")) for lift in self.lifts],
            "report": self.report,
            "study": self.results is not None,
        }

    def lost(self, title: str, words: str) -> str:
        """Return the page that stands where there is none, with the way to those that there are."""
        return template(LOST).render(title=title, words=words, **self.listed())

    def with_bar(self, text: str, framed: bool = False) -> str:
        """Return a page that is a file too with the bar that leads to the others in place of its own; `framed`: with none."""
        bar = "" if framed else template("tables/header.html.jinja").render(**self.bar)
        before, _, rest = text.partition('<header class="top">')
        _, end, after = rest.partition("</header>")
        return before + bar + after if end else text

    def rules(self) -> list[Rule]:
        """Addresses of lifts and of what a study's run left."""
        known = {"index": self}
        lifts = ((re.escape(lift.address), {**known, "lift": lift}) for lift in self.lifts)
        return [
            *(Rule(PathMatches(f"{address}$"), _LiftHandler, given) for address, given in lifts),
            Rule(PathMatches(f"{RESULTS}(.*)"), _ResultHandler, known),
            Rule(PathMatches(f"{STORED}(.*)"), _StoredHandler, known),
        ]


def _known(explored: ExploredSet) -> str:
    """What is known of a set without computing anything."""
    if explored.ready or explored.html:
        return explored.diagnosis.headline
    if explored.stored is not None and explored.stored.holds:
        return explored.stored.sentence
    if explored.job is not None and not explored.job.done:
        return "Being diagnosed."
    again = explored.stored is not None and explored.stored.page.is_file()
    return (
        "Settings or recordings have changed since it was diagnosed: opening it diagnoses it again."
        if again
        else "Not diagnosed yet: opening it does so."
    )


class IndexedHandler(RequestHandler):
    """Answers with the way to what there is."""

    def initialize(self, index: Index) -> None:
        """Take what there is."""
        self.index = index

    async def get(self, *_path: str) -> None:
        """Say that nothing is here."""
        raise HTTPError(404)

    def write_error(self, status_code: int, **_details) -> None:
        """Lead on from an address that leads nowhere."""
        self.finish(self.index.lost("Nothing is at this address", "These pages there are:"))


class _LiftHandler(IndexedHandler):
    """Answers with the page of a lift, or with why there is none."""

    def initialize(self, index: Index, lift: ServedLift) -> None:
        """Take the lift."""
        self.index, self.lift = index, lift

    async def get(self) -> None:
        """Answer while other pages go on."""
        try:
            self.write(self.index.with_bar(await in_background(self.lift.html)))
        except Exception as error:
            self.set_status(500)
            self.write(self.index.lost("This lift cannot be shown", page_message(error)))


class _ResultHandler(IndexedHandler):
    """A file of the study's results; of pages that the server makes itself its own."""

    async def get(self, path: str) -> None:
        """Send it, or lead to the server's own page."""
        parts = Path(path).parts
        own = {("lifts", f"{lift.folder.absolute().name}.html"): lift.address for lift in self.index.lifts}
        own |= {("improvement", address[1:], "diagnosis.html"): address for address in self.index.sets.given}
        if parts in own:
            self.redirect(own[parts])
            return
        root = None if self.index.results is None else self.index.results.resolve()
        file = None if root is None else (root / path).resolve()
        if file is None or not file.is_relative_to(root) or not file.is_file():
            raise HTTPError(404)
        self.set_header("Content-Security-Policy", _NO_SCRIPT)
        if file.suffix == ".html":
            self.write(self.index.with_bar(file.read_text(encoding="utf-8")))
            return
        kind = {".svg": "image/svg+xml", ".pdf": "application/pdf"}.get(
            file.suffix, "application/octet-stream"
        )
        self.set_header("Content-Type", "text/plain; charset=utf-8" if file.suffix in _AS_TEXT else kind)
        with file.open("rb") as content:
            while piece := content.read(_PIECE):
                self.write(piece)
                await self.flush()


class _StoredHandler(IndexedHandler):
    """The page of a diagnosis as the study's run left it, inside of a page of the server."""

    async def get(self, path: str) -> None:
        """Send it."""
        found = self.index.sets.given.get(f"/{path}")
        if found is None or found.stored is None or not found.stored.page.is_file():
            raise HTTPError(404)
        self.set_header("Content-Security-Policy", _APART)
        self.write(self.index.with_bar(found.stored.page.read_text(encoding="utf-8"), framed=True))
