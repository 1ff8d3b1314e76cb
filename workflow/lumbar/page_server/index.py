"""Index of the server's pages: its entries, the bar of every page, and answers for stored, waiting and unknown pages."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, PathMatches, Rule
from tornado.web import HTTPError, RequestHandler

from lumbar.base.templates import template
from lumbar.page_server.background import in_background, page_message
from lumbar.page_server.served_sets import OWN, ExploredSet, ServedLift, ServedSets

INDEX, RESULTS, STORED = "/", "/_results/", "/_stored/"
REPORT = "report.html"
LOST, WAITING, STORED_PAGE = (f"page_server/{name}.html.jinja" for name in ("lost", "waiting", "stored"))
_AS_TEXT = {".csv", ".json", ".log", ".tex", ".tsv", ".yaml"}
_NO_SCRIPT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
_APART = "sandbox allow-scripts allow-downloads; default-src 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'self'"
"""A finished study may come from elsewhere: its pages run no script, or scripts that cannot call the server."""
_PIECE = 1_000_000


@dataclass(frozen=True)
class Index:
    """All pages of the server."""

    place: str
    """Study or folder."""
    sets: ServedSets
    lifts: Sequence[ServedLift] = ()
    results: Path | None = None
    """``results/<study>``, served unchanged; None without a study."""
    first: str = INDEX
    """Address that is opened first."""

    @property
    def report(self) -> str:
        """Address of the study's report; empty without one."""
        return f"{RESULTS}{REPORT}" if self.results and (self.results / REPORT).is_file() else ""

    @property
    def bar(self) -> dict[str, Any]:
        """Variables of the bar of a page."""
        menu = [
            (INDEX, "All pages"),
            *([(self.report, "Report")] if self.report else []),
            (OWN, "Your own recordings"),
        ]
        return {"place": self.place, "menu": menu}

    def listed(self, with_words: bool = False) -> dict[str, Any]:
        """Return the entries of the index; with `with_words` also the state of every set, which reads the verdicts."""
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
        """Return the page for an unknown address, with links to the known pages."""
        return template(LOST).render(title=title, words=words, **self.listed())

    def with_bar(self, text: str, framed: bool = False) -> str:
        """Return a page with the server's bar instead of its header; with `framed` without any."""
        bar = "" if framed else template("tables/header.html.jinja").render(**self.bar)
        before, _, rest = text.partition('<header class="top">')
        _, end, after = rest.partition("</header>")
        return before + bar + after if end else text

    def rules(self) -> list[Rule]:
        """Return the rules of lifts and of a study's results."""
        known = {"index": self}
        lifts = ((re.escape(lift.address), {**known, "lift": lift}) for lift in self.lifts)
        return [
            *(Rule(PathMatches(f"{address}$"), _LiftHandler, given) for address, given in lifts),
            Rule(PathMatches(f"{RESULTS}(.*)"), _ResultHandler, known),
            Rule(PathMatches(f"{STORED}(.*)"), _StoredHandler, known),
        ]


def _known(explored: ExploredSet) -> str:
    """Return the state of a set without computing anything."""
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
    """Answers unknown addresses with links to the known pages."""

    def initialize(self, index: Index) -> None:
        """Store the index."""
        self.index = index

    async def get(self, *_path: str) -> None:
        """Reject the request."""
        raise HTTPError(404)

    def write_error(self, status_code: int, **_details) -> None:
        """Write the page for an unknown address."""
        self.finish(self.index.lost("Nothing is at this address", "These pages there are:"))


class _LiftHandler(IndexedHandler):
    """Answers with the page of a lift, or the reason why it has none."""

    def initialize(self, index: Index, lift: ServedLift) -> None:
        """Store index and lift."""
        self.index, self.lift = index, lift

    async def get(self) -> None:
        """Answer without blocking other pages."""
        try:
            self.write(self.index.with_bar(await in_background(self.lift.html)))
        except Exception as error:
            self.set_status(500)
            self.write(self.index.lost("This lift cannot be shown", page_message(error)))


class _ResultHandler(IndexedHandler):
    """Answers with a file of the study's results, or redirects to the server's page instead of it."""

    async def get(self, path: str) -> None:
        """Send the file or redirect."""
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
    """Answers with the stored page of a diagnosis, shown inside a page of the server."""

    async def get(self, path: str) -> None:
        """Send the page."""
        found = self.index.sets.given.get(f"/{path}")
        if found is None or found.stored is None or not found.stored.page.is_file():
            raise HTTPError(404)
        self.set_header("Content-Security-Policy", _APART)
        self.write(self.index.with_bar(found.stored.page.read_text(encoding="utf-8"), framed=True))


class NotReady(Matcher):
    """Matches the address of a set with a page that is not ready."""

    def __init__(self, sets: ServedSets):
        self.sets = sets

    def match(self, request: HTTPServerRequest) -> dict | None:
        """Return the arguments for the handler; None if the page is ready or no page of a set."""
        found = self.sets.find(request.path, request.arguments)
        if found is None:
            return {} if self.sets.is_own(request.path) else None
        return None if found.ready else {}


class WaitingHandler(IndexedHandler):
    """Answers with a stored verdict or with the progress of the diagnosis, which the first request starts."""

    async def get(self, *_path: str) -> None:
        """Show the stored verdict if it is current; else start the diagnosis or show its progress."""
        found = self.index.sets.find(self.request.path, self.request.arguments)
        if found is None:
            self.set_status(404)
            words = (
                "The server was started anew, or others were given since. Give them once more, or look at:"
            )
            self.write(self.index.lost("These recordings are no longer held", words))
            return
        self.set_header("Cache-Control", "no-store")
        asked_for = found.job is not None or self.get_query_argument("compute", None) is not None
        if found.make is None or (found.stored is not None and found.stored.holds and not asked_for):
            self.write(
                template(STORED_PAGE).render(
                    **self.index.bar,
                    title=found.words,
                    made=found.stored.made,
                    address=f"{STORED}{found.name}",
                    computable=found.make is not None,
                )
            )
        elif found.html:
            self.write(self.index.with_bar(found.html))
        else:
            job = found.job or found.begin()
            if job.error:
                found.job = None  # loading the page again tries again
            state = {"words": job.words, "seconds": round(job.seconds), "error": job.error}
            self.write(template(WAITING).render(**self.index.bar, **state, name=found.words, own=found.own))
