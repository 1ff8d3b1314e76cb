"""The page that stands where a diagnosis is still being made: how far it is, and a button that ends it."""

from dataclasses import dataclass

from tornado.httputil import HTTPServerRequest, url_concat
from tornado.routing import Matcher
from tornado.web import HTTPError, RequestHandler

from lumbar.base.errors import LumbarError
from lumbar.base.templates import template
from lumbar.page_server.index import STORED, Index
from lumbar.page_server.recording_preview import drawn
from lumbar.page_server.served_sets import ExploredSet, ServedSets
from lumbar.records.record import Record

WIDTH, HEIGHT = 1000, 120
_COLUMNS = 500


@dataclass(frozen=True)
class Sketch:
    """The measured output of a record over time, along one axis."""

    words: str
    """Record, quantity, range and duration."""
    points: str
    """Of an SVG polyline in a box of `WIDTH` by `HEIGHT`."""

    @classmethod
    def of(cls, record: Record, role: str) -> "Sketch":
        """Draw the samples of one of its channels."""
        channel = record.along(role)
        ends = drawn(channel.values, _COLUMNS)
        points = " ".join(f"{WIDTH * x:.1f},{HEIGHT * (1 - y):.1f}" for x, y in ends)
        words = (
            f"{record.name}: {channel.quantity} from {channel.values.min():.3g} to {channel.values.max():.3g} {channel.unit} "
            f"in {record.duration:.3g} s"
        )
        return cls(words, points)


WAITING, STORED_PAGE = "page_server/waiting.html.jinja", "page_server/stored.html.jinja"
PROGRESS, CANCEL = "/_progress", "/_cancel"


class NotReady(Matcher):
    """Matches the address of a set whose page cannot be shown at once."""

    def __init__(self, sets: ServedSets):
        self.sets = sets

    def match(self, request: HTTPServerRequest) -> dict | None:
        """Arguments for the handler; None where the page is ready, or is no page of a set."""
        found = self.sets.find(request.path, request.arguments)
        if found is None:
            return {} if self.sets.is_own(request.path) else None
        return None if found.ready else {}


class _SetsHandler(RequestHandler):
    def initialize(self, index: Index) -> None:
        """Take what there is."""
        self.index, self.sets = index, index.sets


class WaitingHandler(_SetsHandler):
    """The verdict that a run left, or the page in waiting, which begins the work."""

    def get(self) -> None:
        """Show the stored verdict where it holds; else begin the diagnosis, or show how far it is."""
        found = self.sets.find(self.request.path, self.request.arguments)
        if found is None:
            self.set_status(404)
            title = "These recordings are no longer held"
            words = (
                "The server was started anew, or others were given since. Give them once more, or look at:"
            )
            self.write(self.index.lost(title, words))
            return
        self.set_header("Cache-Control", "no-store")
        asked_for = found.job is not None or self.get_query_argument("compute", None) is not None
        if found.make is None or (found.stored is not None and found.stored.holds and not asked_for):
            self._show(found)
            return
        if found.html:
            self.write(self.index.with_bar(found.html))
            return
        found.begin()
        asked = {"page": self.request.path, "set": self.get_query_argument("set", "")}
        self.write(
            template(WAITING).render(
                **self.index.bar,
                name=found.words,
                own=found.own,
                records=_sketches(found),
                progress=url_concat(PROGRESS, asked),
                cancel=url_concat(CANCEL, asked),
            )
        )

    def _show(self, found: ExploredSet) -> None:
        self.write(
            template(STORED_PAGE).render(
                **self.index.bar,
                title=found.words,
                made=found.stored.made,
                address=f"{STORED}{found.name}",
                computable=found.make is not None,
            )
        )


def _sketches(explored: ExploredSet) -> list[Sketch]:
    """The records of a set; none where they cannot be read, which its job tells."""
    try:
        return [Sketch.of(record, role) for record in explored.read() for role in record.roles("output")]
    except LumbarError:
        return []


class _AskedHandler(_SetsHandler):
    """A question about the set of a page that is named."""

    @property
    def explored(self) -> ExploredSet:
        """The set that is asked about."""
        found = self.sets.find(self.get_query_argument("page"), self.request.arguments)
        if found is None or found.job is None:
            raise HTTPError(404)
        return found


class ProgressHandler(_AskedHandler):
    """How far a diagnosis is."""

    def get(self) -> None:
        """Say it."""
        job = self.explored.job
        self.set_header("Cache-Control", "no-store")
        self.write({"words": job.words, "seconds": job.seconds, "done": job.done, "error": job.error})


class CancelHandler(_AskedHandler):
    """The button that ends a diagnosis."""

    def post(self) -> None:
        """End it."""
        self.explored.job.cancel()
        self.write({})
