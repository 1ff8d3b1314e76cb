"""The page for own recordings over HTTP: the page, its tabs and the files they hold, and what it asks."""

import mmap
import secrets
from typing import Any

from tornado.escape import json_encode
from tornado.httputil import url_concat
from tornado.routing import PathMatches, Rule
from tornado.web import Finish, RequestHandler, stream_request_body

from lumbar.base.errors import InputError
from lumbar.base.templates import template
from lumbar.page_server.background import in_background, page_message
from lumbar.page_server.index import INDEX, Index
from lumbar.page_server.own_recordings import MOST_FILE, OwnDiagnosis, OwnRecordings
from lumbar.page_server.recording_preview import FIELDS
from lumbar.page_server.requests import read_request
from lumbar.page_server.served_sets import OWN

MOST_TABS = 16
"""Tabs that are held with files, and as many without."""
MOST_HELD = 300_000_000
"""Bytes of all files that are held or on their way."""


class OwnTabs:
    """The tabs that recordings were given in, each by a name that nobody guesses; the one that was used last comes last.

    To open the page holds nothing and lets no files go: any page of the web can lead a browser there. Files that a person gives
    do, where there is no room else.
    """

    def __init__(self) -> None:
        self._tabs: dict[str, OwnRecordings] = {}
        self._coming = 0

    def new(self) -> str:
        """Return the name of a new tab; of those without files the one that was used longest ago is let go for it."""
        empty = [name for name, tab in self._tabs.items() if not tab.files]
        for name in empty[: max(0, len(empty) - MOST_TABS + 1)]:
            del self._tabs[name]
        name = secrets.token_urlsafe(16)
        self._tabs[name] = OwnRecordings(f"{OWN}?tab={name}")
        return name

    def find(self, name: str) -> OwnRecordings | None:
        """Return a tab's recordings; None where it is not held any more."""
        found = self._tabs.pop(name, None)
        if found is not None:
            self._tabs[name] = found
        return found

    def expect(self, tab: OwnRecordings, name: str, size: int) -> None:
        """Count a file that is on its way to a tab; other tabs that were used longest ago are let go for it.

        Raises
        ------
        InputError
            If there is no room for it, whichever tab is let go.
        """
        taken = tab.size_besides(name) + self._coming
        if taken + size > MOST_HELD:
            raise InputError(
                f"{name:.200}: {size / 1e6:.3g} MB, where this tab holds and expects {taken / 1e6:.3g} MB and "
                f"{MOST_HELD / 1e6:.0f} MB are the most; take a file away, or use lumbar import"
            )
        self._coming += size
        others = {
            key: other.size_besides() for key, other in self._tabs.items() if other.files and other is not tab
        }
        for key in list(others):
            if len(others) < MOST_TABS and taken + size + sum(others.values()) <= MOST_HELD:
                break
            del self._tabs[key], others[key]

    def arrived(self, size: int) -> None:
        """Count a file as held by its tab, or not at all where it did not come whole."""
        self._coming -= size


PAGE = "page_server/own_recordings.html.jinja"
TAB = "X-Lumbar-Tab"
"""Header by which a page says which tab it is; no form of another page can send it."""
_LETS_PASS_S = 5
"""How long the bytes of a file that is refused are taken and dropped."""
_GONE = "this tab is no longer held by the server: load the page again, and give the files once more"


def own_rules(index: Index, own: OwnDiagnosis) -> list[Rule]:
    """Addresses of the page, which the index is too, and of what it asks."""
    tabs = OwnTabs()
    known = {"tabs": tabs, "own": own, "index": index}
    return [
        Rule(PathMatches(f"(?:{INDEX}?|{OWN})"), _PageHandler, known),
        Rule(PathMatches(f"{OWN}/file"), _FileHandler, known),
        Rule(PathMatches(f"{OWN}/(look|remove|start|save)"), _AskHandler, known),
    ]


class _OwnHandler(RequestHandler):
    def initialize(self, tabs: OwnTabs, own: OwnDiagnosis, index: Index) -> None:
        """Take what Tornado hands over."""
        self.tabs, self.own, self.index = tabs, own, index

    def recordings(self) -> OwnRecordings:
        """What the tab that asks holds."""
        found = self.tabs.find(self.request.headers.get(TAB, ""))
        if found is None:
            self.refuse(410, _GONE)
        return found

    def refuse(self, status: int, words: str) -> None:
        """Answer with a message, and end."""
        self.set_status(status)
        raise Finish({"error": words})


class _PageHandler(_OwnHandler):
    async def get(self) -> None:
        """Show the page of a tab; one that is not known, or none, begins anew. The index stands above a new one."""
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
        self.write(
            template(PAGE).render(
                tab=tab,
                nonce=nonce,
                labels=FIELDS,
                most=MOST_FILE,
                kept_in=self.own.study,
                at_door=at_door,
                **listed,
            )
        )


@stream_request_body
class _FileHandler(_OwnHandler):
    """One file, piece by piece; what is too large is refused before it is read."""

    body: mmap.mmap | None = None
    """What has come, in memory of its own: the system has it back as soon as it is let go."""

    async def prepare(self) -> None:
        """Refuse what is not to be taken, before the body comes."""
        size = self.request.headers.get("Content-Length", "")
        self.set_header("Connection", "close")
        if self.request.method != "POST":
            self.refuse(405, "POST is needed")
        if not (size.isascii() and size.isdecimal()):
            self.refuse(411, "a file of unknown size")
        self.expected = int(size[:20])
        self.request.connection.set_max_body_size(self.expected)
        try:
            self._admit(self.get_query_argument("name", "") or "the file")
        except Finish as refused:
            await self._answer_early(json_encode(refused.args[0]))

    def _admit(self, name: str) -> None:
        if self.expected > MOST_FILE:
            self.refuse(413, too_large(name))
        self.held = self.recordings()
        try:
            self.tabs.expect(self.held, name, self.expected)
        except InputError as error:
            self.refuse(413, str(error))
        self.body = mmap.mmap(-1, max(1, self.expected))

    async def _answer_early(self, answer: str) -> None:
        """Answer at once, then let pass by for a while what still comes: a line that is closed over bytes that nobody took is
        reset, and the answer may go with it.
        """
        self.request.connection.set_body_timeout(_LETS_PASS_S)
        self.set_header("Content-Type", "application/json")
        self.set_header("Content-Length", len(answer.encode()))
        self.write(answer)
        await self.flush()

    def on_finish(self) -> None:
        """Let the file go: its tab has it, or it was refused."""
        if self.body is not None:
            self.tabs.arrived(self.expected)
            self.body.close()
            self.body = None

    def on_connection_close(self) -> None:
        """Let go what came of the file."""
        super().on_connection_close()
        self.on_finish()

    def data_received(self, chunk: bytes) -> None:
        """Take a piece."""
        if self.body is not None:
            self.body.write(chunk)

    async def post(self) -> None:
        """Read the file, unless it was refused."""
        if self.body is None:
            return
        name = self.get_query_argument("name", "")
        content = self.body[: self.expected]
        try:
            self.write(await in_background(self.held.add, name, content))
        except Exception as error:
            self.refuse(400, page_message(error))


def too_large(name: str) -> str:
    """Why a file is not taken."""
    return (
        f"{name:.200}: larger than {MOST_FILE / 1e6:.0f} MB, the most that the page takes; nothing of it was read. Give a part, "
        "or use lumbar import, which reads files where they are"
    )


class _AskHandler(_OwnHandler):
    async def post(self, action: str) -> None:
        """Do what the page asks."""
        held = self.recordings()
        try:
            asked = read_request(self.request.body)
            self.write(await in_background(self._answer, held, action, asked))
        except Exception as error:
            self.refuse(400, page_message(error))

    def _answer(self, held: OwnRecordings, action: str, asked: dict[str, Any]) -> dict[str, Any]:
        if action == "look":
            return held.look(asked.get("choices") or held.choices)
        if action == "remove":
            return held.remove(str(asked.get("file")))
        if action == "start":
            return {"address": held.start(asked, self.own, self.index.sets)}
        if action == "save":
            return {"text": held.save(asked, self.own)}
        raise InputError(f"{action}: unknown request")
