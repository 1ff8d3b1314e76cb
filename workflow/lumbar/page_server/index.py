"""Index of the server's pages: its entries, the bar of every page, and answers for stored, unfinished and unknown pages."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, PathMatches, Rule
from tornado.web import HTTPError, RequestHandler

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.base.templates import template
from lumbar.page_server.background import page_message, run_in_background
from lumbar.page_server.served_sets import OWN, RESULT, ExploredSet, ServedLift, ServedSets

INDEX, RESULTS, STORED = "/", "/_results/", "/_stored/"
_REPORT = "report.html"
_TYPES = {
    **dict.fromkeys((".csv", ".json", ".log", ".tex", ".tsv", ".yaml"), "text/plain; charset=utf-8"),
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
}
_NO_SCRIPT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
_SANDBOX = "sandbox allow-scripts allow-downloads; default-src 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'self'"
"""Security policy of pages with scripts: a study may be untrusted, so its scripts cannot call the server."""
_PIECE_BYTES = 1_000_000


@dataclass(frozen=True)
class Index:
    """All pages of the server."""

    place: str
    """Name of the study or folder."""
    sets: ServedSets
    lifts: Sequence[ServedLift] = ()
    results: Path | None = None
    """``results/<study>``, served unchanged; None without a study."""
    first: str = INDEX
    """Address of the page that is opened first."""

    @property
    def report(self) -> str:
        """Address of the study's report; empty if there is no report."""
        return f"{RESULTS}{_REPORT}" if self.results and (self.results / _REPORT).is_file() else ""

    @property
    def bar(self) -> dict[str, Any]:
        """Variables of the bar of a page."""
        report = [(self.report, "Report")] if self.report else []
        return {"place": self.place, "menu": [(INDEX, "All pages"), *report, (OWN, "Your own recordings")]}

    def entries(self, with_sketches: bool = False) -> dict[str, Any]:
        """Return the entries of the index; if requested, with a small picture of each and the state of every set."""
        return {
            **self.bar,
            "sets": [
                (address, item.title, *(_show_set(item) if with_sketches else ("", "")))
                for address, item in self.sets.named.items()
            ],
            "lifts": [
                (lift.address, lift.name.replace("_", " "), lift.sketch if with_sketches else "")
                for lift in self.lifts
            ],
            "report": self.report,
            "study": self.results is not None,
        }

    def not_found_page(self, title: str, message: str) -> str:
        """Return a page with a message and links to the known pages."""
        return template("page_server/lost.html.jinja").render(title=title, words=message, **self.entries())

    def add_bar(self, text: str, framed: bool = False) -> str:
        """Return a page with the server's bar instead of its header; in a frame, a page has neither bar nor header."""
        bar = "" if framed else template("tables/header.html.jinja").render(**self.bar)
        before, _, rest = text.partition('<header class="top">')
        _, end, after = rest.partition("</header>")
        return before + bar + after if end else text

    def rules(self) -> list[Rule]:
        """Return the rules of lifts and of a study's results."""
        arguments = {"index": self}
        return [
            *(
                Rule(PathMatches(f"{re.escape(lift.address)}$"), _LiftHandler, {**arguments, "lift": lift})
                for lift in self.lifts
            ),
            Rule(PathMatches(f"{RESULTS}(.*)"), _ResultHandler, arguments),
            Rule(PathMatches(f"{STORED}(.*)"), _StoredHandler, arguments),
        ]


def _show_set(explored: ExploredSet) -> tuple[Markup, str]:
    """Return a small picture of a set and its state, without a diagnosis: the page of the set names the missing effects."""
    # Imported here because the server listens before the pictures' libraries are imported.
    from lumbar.publishing.pages.sketches import ladder_sketch
    from lumbar.publishing.study_report.main_results import format_fall

    stored, diagnosis = explored.stored, None
    if explored.ready or explored.html:
        diagnosis = explored.diagnosis.result.to_json()
    elif stored is not None and stored.is_current:
        diagnosis = read_json(stored.folder / "diagnosis.json")
    if diagnosis is not None:
        return ladder_sketch(diagnosis), f"Error of the {diagnosis['base']} model: {format_fall(diagnosis)}"
    state = "Not diagnosed yet: opening does so"
    if explored.job is not None and not explored.job.done:
        state = "Being diagnosed"
    elif stored is not None and stored.page.is_file():
        state = "Settings or recordings have changed: opening diagnoses it again"
    try:
        return explored.sketch, state
    except InputError as error:
        return Markup(""), page_message(error)


class IndexedHandler(RequestHandler):
    """Answers unknown addresses with links to the known pages."""

    def initialize(self, index: Index, lift: ServedLift | None = None) -> None:
        """Store the index, and the lift of a lift's page."""
        self.index, self.lift = index, lift

    async def get(self, *_path: str) -> None:
        """Reject the request."""
        raise HTTPError(404)

    def write_error(self, status_code: int, **_details) -> None:
        """Write the page for an unknown address."""
        self.finish(self.index.not_found_page("Nothing is at this address", "The server has these pages:"))


class _LiftHandler(IndexedHandler):
    """Answers with the page of a lift, or the reason why the lift has no page."""

    async def get(self) -> None:
        try:
            self.write(self.index.add_bar(await run_in_background(self.lift.html)))
        except Exception as error:
            self.set_status(500)
            self.write(self.index.not_found_page("This lift cannot be shown", page_message(error)))


class _ResultHandler(IndexedHandler):
    """Answers with a file of the study's results, or redirects to the server's page that replaces the file."""

    async def get(self, path: str) -> None:
        parts = Path(path).parts
        pages = {("lifts", f"{lift.name}.html"): lift.address for lift in self.index.lifts}
        pages |= {
            ("improvement", address[1:], "diagnosis.html"): address for address in self.index.sets.named
        }
        if parts in pages:
            self.redirect(pages[parts])
            return
        root = None if self.index.results is None else self.index.results.resolve()
        file = None if root is None else (root / path).resolve()
        if file is None or not file.is_relative_to(root) or not file.is_file():
            raise HTTPError(404)
        self.set_header("Content-Security-Policy", _NO_SCRIPT)
        if file.suffix == ".html":
            self.write(self.index.add_bar(file.read_text(encoding="utf-8")))
            return
        self.set_header("Content-Type", _TYPES.get(file.suffix, "application/octet-stream"))
        with file.open("rb") as content:
            while piece := content.read(_PIECE_BYTES):
                self.write(piece)
                await self.flush()


class _StoredHandler(IndexedHandler):
    """Answers with the stored page of a diagnosis, shown inside a page of the server."""

    async def get(self, path: str) -> None:
        explored = self.index.sets.named.get(f"/{path}")
        if explored is None or explored.stored is None or not explored.stored.page.is_file():
            raise HTTPError(404)
        self.set_header("Content-Security-Policy", _SANDBOX)
        self.write(self.index.add_bar(explored.stored.page.read_text(encoding="utf-8"), framed=True))


class NotReady(Matcher):
    """Matches the address of a set with a page that is not ready."""

    def __init__(self, sets: ServedSets):
        self.sets = sets

    def match(self, request: HTTPServerRequest) -> dict | None:
        """Return the arguments for the handler; None if the page is ready or is not the page of a set."""
        explored = self.sets.find(request.path, request.arguments)
        if explored is None:
            return {} if request.path.rstrip("/") == RESULT else None
        return None if explored.ready else {}


class ProgressHandler(IndexedHandler):
    """Answers with a stored verdict or with the progress of the diagnosis, which the first request starts."""

    async def get(self, *_path: str) -> None:
        """Show the stored verdict if it is current; else start the diagnosis or show its progress."""
        explored = self.index.sets.find(self.request.path, self.request.arguments)
        if explored is None:
            self.set_status(404)
            message = (
                "The server was restarted, or newer recordings took their place. Give them again, or open:"
            )
            self.write(self.index.not_found_page("These recordings are no longer available", message))
            return
        self.set_header("Cache-Control", "no-store")
        stored, bar = explored.stored, self.index.bar
        computes = explored.job is not None or self.get_query_argument("compute", None) is not None
        if explored.make is None or (stored is not None and stored.is_current and not computes):
            date = f"{datetime.fromtimestamp(stored.page.stat().st_mtime):%Y-%m-%d %H:%M}"
            page = {"title": explored.title, "made": date, "address": f"{STORED}{explored.name}"}
            page["computable"] = explored.make is not None
            self.write(template("page_server/stored.html.jinja").render(**bar, **page))
        elif explored.html:
            self.write(self.index.add_bar(explored.html))
        else:
            job = explored.job or explored.begin()
            if job.error:
                explored.job = None  # loading the page again tries again
            page = {"words": job.progress, "seconds": round(job.seconds), "error": job.error}
            page |= {"name": explored.title, "own": explored.upload}
            self.write(template("page_server/waiting.html.jinja").render(**bar, **page))
