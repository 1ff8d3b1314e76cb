"""Server of the pages. It admits only browsers on this machine that have the token printed by `lumbar explore`."""

from __future__ import annotations

import json
import secrets
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from bokeh.document import Document
from bokeh.models import CustomJS
from tornado.httputil import HTTPHeaders, HTTPServerRequest, url_concat
from tornado.log import access_log
from tornado.routing import AnyMatches, Matcher, Rule
from tornado.web import Finish, OutputTransform, RequestHandler, stream_request_body

from lumbar.base.errors import InputError
from lumbar.base.templates import template
from lumbar.page_server.background import run_in_background
from lumbar.page_server.index import Index, IndexedHandler, NotReady, ProgressHandler
from lumbar.page_server.own_recordings import MAX_FILE_BYTES, UploadDiagnosis, upload_rules
from lumbar.page_server.served_sets import RESULT, TabRequests
from lumbar.publishing.explorer.explorer_page import PAGE
from lumbar.publishing.explorer.explorer_pictures import ANSWER, REQUEST

if TYPE_CHECKING:
    from bokeh.server.server import Server

HOST = "127.0.0.1"
_HOST_NAMES = (HOST, "localhost")
TOKEN = "token"
"""Name of the token in an address."""
_HEADERS = {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'; object-src 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""HTTP headers: a page contains its scripts, exchanges no data with other servers, and no other page can frame it."""
_FORWARD_PAGE = (
    f"<!doctype html><title>lumbar</title><script>const page = new URL(location.href); page.searchParams.delete('{TOKEN}'); "
    "location.replace(page)</script><noscript>The pages of lumbar need JavaScript.</noscript>"
)
_NO_TOKEN = (
    "Open the address that 'lumbar explore' printed where it was started: it ends in a token, which keeps other accounts of "
    "this machine out. The browser must accept this page's cookie."
)
_MAX_MESSAGE_BYTES = 10_000
"""Largest message of a page: a request is one line, events of pictures are a few numbers."""
_LOST_SERVER_SCRIPT = """
document.body.removeAttribute("aria-busy");
const message = document.getElementById("message");
message.textContent = "The server was ended: what is here can still be looked at. Start 'lumbar explore' again, then load "
  + "the page again.";
message.className = "bad";
"""
"""Script that a page runs if it has lost its server."""


@dataclass(frozen=True)
class Visitors:
    """Check of visitors: the token is in the address at the first visit, and in a cookie afterwards."""

    port: int
    """Port of the server. A browser sends cookies to every port of a host, so the cookie's name contains it."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    @property
    def cookie(self) -> str:
        """Name of the cookie."""
        return f"lumbar_{self.port}"

    def address(self, path: str) -> str:
        """Return the address of a page with the token."""
        return f"http://{HOST}:{self.port}{url_concat(path, {TOKEN: self.token})}"

    def has_token(self, given: bytes) -> bool:
        """Return whether the given bytes are the token; the comparison takes constant time."""
        return secrets.compare_digest(given, self.token.encode())


class Outside(Matcher):
    """Matches requests that are not admitted; its rule is before all others."""

    def __init__(self, visitors: Visitors):
        self.visitors = visitors

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return the arguments for `DoorHandler`; None if the request is admitted.

        An admitted request has the cookie, and the user or a page of this server sent it to a name of this machine.
        """
        cookie, origin = request.cookies.get(self.visitors.cookie), request.headers.get("Origin")
        is_from_here = request.host_name in _HOST_NAMES and origin in (None, f"http://{request.host}")
        is_known = cookie is not None and is_from_here and self.visitors.has_token(cookie.value.encode())
        return None if is_known and TOKEN not in request.query_arguments else {}


@stream_request_body
class DoorHandler(RequestHandler):
    """Admits requests with the token; rejects all others before a body is read."""

    def initialize(self, visitors: Visitors) -> None:
        """Store the visitors."""
        self.visitors = visitors

    def prepare(self) -> None:
        """Set the cookie and forward to the page's address without the token.

        A page forwards, not a redirect: after a redirect a browser that came from elsewhere (a terminal in a page) would
        not send the cookie. The page is a script, because the part after "#" is not sent to the server.
        """
        given = self.request.query_arguments.get(TOKEN, [b""])[-1]
        self.set_header("Cache-Control", "no-store")
        is_page = self.request.method == "GET" and self.request.host_name in _HOST_NAMES
        if not (is_page and self.visitors.has_token(given)):
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.set_status(403)
            raise Finish(_NO_TOKEN)
        self.set_cookie(self.visitors.cookie, self.visitors.token, httponly=True, samesite="Strict")
        raise Finish(_FORWARD_PAGE)


class SecurityHeaders(OutputTransform):
    """Adds `_HEADERS` to every answer."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool):
        """Add the headers that are missing."""
        for name, value in _HEADERS.items():
            headers.setdefault(name, value)
        return status_code, headers, chunk


def log_rejected(handler: RequestHandler) -> None:
    """Log failed requests with only their path: the rest of the address may contain the token."""
    if handler.get_status() >= 400:
        access_log.warning("%d %s %.200s", handler.get_status(), handler.request.method, handler.request.path)


def new_server(index: Index, port: int, uploads: UploadDiagnosis) -> tuple[Server, Visitors]:
    """Return a server of an index and its pages on the loopback interface, and its visitors.

    Port 0 means any free port; `uploads` diagnoses the user's recordings.

    Raises
    ------
    InputError
        If the port is taken.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    applications = {
        path: Application(FunctionHandler(partial(_fill, path=path, index=index)))
        for path in (*index.sets.named, RESULT)
    }
    try:
        server = Server(
            applications,
            port=port,
            address=HOST,
            allow_websocket_origin=[f"{HOST}:{port}", f"localhost:{port}"] if port else None,
            websocket_max_message_size=_MAX_MESSAGE_BYTES,
            include_headers=[],  # so that a page's session data contain no cookies
            include_cookies=[],
            log_function=log_rejected,
            http_server_kwargs={"max_buffer_size": MAX_FILE_BYTES},
        )
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror or error}; choose another with --port") from error
    visitors = Visitors(server.port)
    _route(server, visitors, index, uploads)
    return server, visitors


def _route(server: Server, visitors: Visitors, index: Index, uploads: UploadDiagnosis) -> None:
    """Add access control and the server's pages before Bokeh's, and remove unused handlers."""
    from bokeh.server.views.autoload_js_handler import AutoloadJsHandler
    from bokeh.server.views.metadata_handler import MetadataHandler
    from bokeh.server.views.root_handler import RootHandler

    application = server._tornado
    inner = application.wildcard_router.rules
    inner[:] = [
        rule for rule in inner if rule.target not in (AutoloadJsHandler, MetadataHandler, RootHandler)
    ]
    arguments = {"index": index}
    application.default_router.rules[:0] = [
        Rule(Outside(visitors), DoorHandler, {"visitors": visitors}),
        Rule(NotReady(index.sets), ProgressHandler, arguments),
        *upload_rules(index, uploads),
        *index.rules(),
    ]
    inner.append(Rule(AnyMatches(), IndexedHandler, arguments))
    application.add_transform(SecurityHeaders)


def _fill(document: Document, path: str, index: Index) -> None:
    """Fill a tab's document if its set is ready; `ProgressHandler` answers for others."""
    explored = index.sets.find(path, document.session_context.request.arguments)
    if explored is None or not explored.ready:
        return
    page = explored.page
    page.fill(document)
    document.title = page.title
    document.template = template(PAGE)
    document.template_variables.update(explored.variables | index.bar)
    document.config.notify_connection_status = False  # Bokeh's message promises that the connection returns
    document.js_on_event("connection_lost", CustomJS(code=_LOST_SERVER_SCRIPT))
    requests = TabRequests(explored)

    def answer(_attribute, _old, new) -> None:
        text = str((new.get("content") or [""])[0])
        document.add_next_tick_callback(partial(_answer, document, requests, text))

    document.get_model_by_name(REQUEST).on_change("data", answer)


async def _answer(document: Document, requests: TabRequests, text: str) -> None:
    """Answer without blocking other tabs."""
    content, models = await run_in_background(requests.answer, text)
    for model in models:
        for record in model.errors:
            for kind, columns in (("record", model.errors), ("spectrum", model.density)):
                source = document.get_model_by_name(f"{kind}:{record}")
                if model.key not in source.data:
                    source.add(columns[record], model.key)
    document.get_model_by_name(ANSWER).data = {"content": [json.dumps(content)]}
