"""What stands at the address of a diagnosis that is not ready: how far it is, why it failed, or the verdict that a run left."""

from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher

from lumbar.base.templates import template
from lumbar.page_server.index import STORED, IndexedHandler
from lumbar.page_server.served_sets import ExploredSet, ServedSets

WAITING, STORED_PAGE = "page_server/waiting.html.jinja", "page_server/stored.html.jinja"


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


class WaitingHandler(IndexedHandler):
    """The verdict that a run left, or how far the diagnosis is, which the first to ask begins."""

    async def get(self, *_path: str) -> None:
        """Show the stored verdict where it holds; else begin the diagnosis, or show how far it is."""
        found = self.index.sets.find(self.request.path, self.request.arguments)
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
        elif found.html:
            self.write(self.index.with_bar(found.html))
        else:
            job = found.job or found.begin()
            if job.error:
                found.job = None  # whoever loads the page again tries again
            told = {"words": job.words, "seconds": round(job.seconds), "error": job.error}
            self.write(template(WAITING).render(**self.index.bar, **told, name=found.words, own=found.own))

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
