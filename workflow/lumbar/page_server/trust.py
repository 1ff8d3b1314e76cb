"""Whom the server answers: pages that it served itself, to whoever was given its token, on this machine."""

import secrets
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote

from tornado.httputil import HTTPHeaders, HTTPServerRequest, url_concat
from tornado.log import access_log
from tornado.routing import Matcher
from tornado.web import Finish, HTTPError, OutputTransform, RequestHandler, stream_request_body

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
TOKEN = "token"
"""Name of the token in an address."""
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'; object-src 'none'"
)
"""The page holds its own scripts; nothing is loaded from elsewhere, nothing is sent there, and nobody frames it."""
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_TO_THE_PAGE = (
    f"<!doctype html><title>lumbar</title><script>const page = new URL(location.href); page.searchParams.delete('{TOKEN}'); "
    "location.replace(page)</script><noscript>The pages of lumbar need JavaScript.</noscript>"
)
_NO_TOKEN = (
    "Open the address that 'lumbar explore' printed where it was started: it ends in a token, which keeps other accounts of "
    "this machine out. The browser must accept this page's cookie."
)


@dataclass(frozen=True)
class Visitors:
    """Who may come in: whoever has the token in the address once, and in a cookie from then on."""

    port: int
    """Of the server. A browser sends cookies to every port of a host, so this one's name holds it."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

    @property
    def cookie(self) -> str:
        """Name of the cookie."""
        return f"lumbar_{self.port}"

    def address(self, path: str) -> str:
        """Return the address of a page as a person opens it first."""
        return f"http://{HOST}:{self.port}{url_concat(path, {TOKEN: self.token})}"

    def are_known(self, request: HTTPServerRequest) -> bool:
        """Whether the request has the cookie."""
        cookie = request.cookies.get(self.cookie)
        return cookie is not None and self._is_right(cookie.value.encode())

    def brings_token(self, request: HTTPServerRequest) -> bool:
        """Whether a page is opened with the token in its address."""
        given = request.query_arguments.get(TOKEN, [b""])[-1]
        return request.method == "GET" and self._is_right(given)

    def _is_right(self, given: bytes) -> bool:
        return secrets.compare_digest(given, self.token.encode())


def is_from_here(request: HTTPServerRequest) -> bool:
    """Whether a request is addressed to this machine's own names, and sent by a page of this server or by a person.

    A page of elsewhere whose name was made to lead here has another host; one that sends requests here has another
    origin, or is told by the browser to come from another site.
    """
    if request.host_name not in NAMES:
        return False
    origin = request.headers.get("Origin")
    if origin is not None and origin != f"http://{request.host}":
        return False
    foreign = request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
    followed = request.method == "GET" and request.headers.get("Sec-Fetch-Dest") == "document"
    return followed or not foreign


def _leads_somewhere(request: HTTPServerRequest) -> bool:
    """Whether the request may be answered at all; no file is called with a NUL."""
    return is_from_here(request) and "\0" not in unquote(request.path)


class Outside(Matcher):
    """Matches what no page of the server is to see; its rule stands before all others."""

    def __init__(self, visitors: Visitors):
        self.visitors = visitors

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Arguments for `DoorHandler`; None where the request is let in."""
        known = TOKEN not in request.query_arguments and self.visitors.are_known(request)
        return None if known and _leads_somewhere(request) else {}


@stream_request_body
class DoorHandler(RequestHandler):
    """Lets in whoever brings the token; refuses all others before a body is read."""

    def initialize(self, visitors: Visitors) -> None:
        """Take who may come in."""
        self.visitors = visitors

    def prepare(self) -> None:
        """Hand out the cookie and lead to the page, whose address no longer holds the token.

        A page of our own leads there, not a redirect: after one, a browser that came from elsewhere (a terminal in a page)
        would keep the cookie back. It is a script, for what follows "#" never comes to the server.
        """
        request = self.request
        if not _leads_somewhere(request):
            raise HTTPError(404)
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        if not self.visitors.brings_token(request):
            self.set_status(403)
            raise Finish(_NO_TOKEN)
        self.set_cookie(self.visitors.cookie, self.visitors.token, httponly=True, samesite="Strict")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        raise Finish(_TO_THE_PAGE)


class Guarded(OutputTransform):
    """Adds to every answer what tells the browser to keep the page to itself."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool):
        """Add the headers that are not there."""
        for name, value in _HEADERS.items():
            headers.setdefault(name, value)
        return status_code, headers, chunk


def log_refused(handler: RequestHandler) -> None:
    """Tell of requests that were not answered; without what follows the path, which may hold the token."""
    if handler.get_status() >= 400:
        access_log.warning("%d %s %.200s", handler.get_status(), handler.request.method, handler.request.path)
