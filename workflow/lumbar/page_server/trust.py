"""Whom the server answers: this machine's browser, once it was given the token that `lumbar explore` printed."""

import secrets
from dataclasses import dataclass, field
from typing import Any

from tornado.httputil import HTTPHeaders, HTTPServerRequest, url_concat
from tornado.log import access_log
from tornado.routing import Matcher
from tornado.web import Finish, OutputTransform, RequestHandler, stream_request_body

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
TOKEN = "token"
"""Name of the token in an address."""
_HEADERS = {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'; object-src 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""The page holds its own scripts; nothing is loaded from elsewhere, nothing is sent there, and nobody frames it."""
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
        """Name of the cookie, which no page of another site can have sent."""
        return f"lumbar_{self.port}"

    def address(self, path: str) -> str:
        """Return the address of a page as a person opens it first."""
        return f"http://{HOST}:{self.port}{url_concat(path, {TOKEN: self.token})}"

    def has_token(self, given: bytes) -> bool:
        """Whether this is the token, in a time that tells nothing of it."""
        return secrets.compare_digest(given, self.token.encode())

    def are_known(self, request: HTTPServerRequest) -> bool:
        """Whether the request has the cookie, to one of this machine's own names, from a page of this server or a person."""
        cookie, origin = request.cookies.get(self.cookie), request.headers.get("Origin")
        is_from_here = request.host_name in NAMES and origin in (None, f"http://{request.host}")
        return cookie is not None and is_from_here and self.has_token(cookie.value.encode())


class Outside(Matcher):
    """Matches what no page of the server is to see; its rule stands before all others."""

    def __init__(self, visitors: Visitors):
        self.visitors = visitors

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Arguments for `DoorHandler`; None where the request is let in."""
        let_in = TOKEN not in request.query_arguments and self.visitors.are_known(request)
        return None if let_in else {}


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
        given = self.request.query_arguments.get(TOKEN, [b""])[-1]
        self.set_header("Cache-Control", "no-store")
        if (
            self.request.method != "GET"
            or self.request.host_name not in NAMES
            or not self.visitors.has_token(given)
        ):
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.set_status(403)
            raise Finish(_NO_TOKEN)
        self.set_cookie(self.visitors.cookie, self.visitors.token, httponly=True, samesite="Strict")
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
