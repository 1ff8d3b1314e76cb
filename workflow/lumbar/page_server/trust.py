"""Access control: the server answers only this machine's browser with the token that `lumbar explore` printed."""

import secrets
from dataclasses import dataclass, field
from typing import Any

from tornado.httputil import HTTPHeaders, HTTPServerRequest, url_concat
from tornado.log import access_log
from tornado.routing import Matcher
from tornado.web import Finish, OutputTransform, RequestHandler, stream_request_body

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
"""The page contains its scripts; nothing is loaded from elsewhere or sent there, and no other page frames it."""
_FORWARD_PAGE = (
    f"<!doctype html><title>lumbar</title><script>const page = new URL(location.href); page.searchParams.delete('{TOKEN}'); "
    "location.replace(page)</script><noscript>The pages of lumbar need JavaScript.</noscript>"
)
_NO_TOKEN = (
    "Open the address that 'lumbar explore' printed where it was started: it ends in a token, which keeps other accounts of "
    "this machine out. The browser must accept this page's cookie."
)


@dataclass(frozen=True)
class Visitors:
    """Admitted visitors: with the token in the address the first time, in a cookie afterwards."""

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
        """Compare with the token in constant time."""
        return secrets.compare_digest(given, self.token.encode())


class Outside(Matcher):
    """Matches requests that are not admitted; its rule is before all others."""

    def __init__(self, visitors: Visitors):
        self.visitors = visitors

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return the arguments for `DoorHandler`; None if the request is admitted.

        It needs the cookie, and must be sent to one of this machine's names by the user or a page of this server.
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
    """Log failed requests by their path only: the rest of the address may contain the token."""
    if handler.get_status() >= 400:
        access_log.warning("%d %s %.200s", handler.get_status(), handler.request.method, handler.request.path)
