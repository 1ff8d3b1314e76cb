"""The page for the user's recordings over HTTP: the page, its tabs with their files, and its requests."""

import secrets
from typing import Any

from tornado.httputil import url_concat
from tornado.routing import PathMatches, Rule
from tornado.web import Finish, RequestHandler

from lumbar.base.errors import InputError
from lumbar.base.templates import template
from lumbar.page_server.background import in_background, page_message
from lumbar.page_server.index import INDEX, Index
from lumbar.page_server.own_recordings import MOST_FILE, OwnDiagnosis, OwnRecordings
from lumbar.page_server.recording_preview import FIELDS
from lumbar.page_server.requests import read_request
from lumbar.page_server.served_sets import OWN

MOST_TABS = 16
"""Most tabs that are kept."""
MOST_HELD = 300_000_000
"""Most bytes of the files of all tabs."""
PAGE = "page_server/own_recordings.html.jinja"
TAB = "X-Lumbar-Tab"
"""Header with the tab of a page; no form of another page can send it."""
_GONE = "this tab is no longer held by the server: load the page again, and give the files once more"


class OwnTabs:
    """The tabs with their recordings, each by a random name."""

    def __init__(self) -> None:
        self._tabs: dict[str, OwnRecordings] = {}

    def new(self) -> str:
        """Return the name of a new tab; of many the oldest is discarded, one without files first."""
        if len(self._tabs) >= MOST_TABS:
            del self._tabs[
                next((name for name, tab in self._tabs.items() if not tab.files), next(iter(self._tabs)))
            ]
        name = secrets.token_urlsafe(16)
        self._tabs[name] = OwnRecordings(f"{OWN}?tab={name}")
        return name

    def find(self, name: str) -> OwnRecordings | None:
        """Return a tab's recordings; None if it is no longer kept."""
        return self._tabs.get(name)

    def check_room(self, size: int) -> None:
        """Raise `InputError` if there is no room for a file."""
        held = sum(tab.size for tab in self._tabs.values())
        if held + size > MOST_HELD:
            raise InputError(
                f"{size / 1e6:.3g} MB, where {held / 1e6:.3g} MB are held and {MOST_HELD / 1e6:.0f} MB are the most of all tabs; "
                "take a file away, or use lumbar import"
            )


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
        shown = {"tab": tab, "nonce": nonce, "labels": FIELDS, "most": MOST_FILE, "at_door": at_door}
        self.write(template(PAGE).render(**shown, **listed))


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
            self.tabs.check_room(len(self.request.body))
            return held.add(self.get_query_argument("name", ""), self.request.body)
        asked = read_request(self.request.body)
        if action == "look":
            return held.look(asked.get("choices") or held.choices)
        if action == "remove":
            return held.remove(str(asked.get("file")))
        if action == "start":
            return {"address": held.start(asked, self.own, self.index.sets)}
        return {"text": held.save(asked, self.own)}
