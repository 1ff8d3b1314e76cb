"""Whom the server answers: pages that it served itself, on this machine."""

from __future__ import annotations

from typing import Any

from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.routing import Matcher
from tornado.web import OutputTransform

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
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


class FromHere(Matcher):
    """Matches what another matcher does, of requests that `is_from_here` lets pass; the others find nothing (404)."""

    def __init__(self, other: Matcher):
        self.other = other

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Arguments for the handler; None where it does not answer."""
        return self.other.match(request) if is_from_here(request) else None


class Guarded(OutputTransform):
    """Adds to every answer what tells the browser to keep the page to itself."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool):
        """Add the headers that are not there."""
        for name, value in _HEADERS.items():
            headers.setdefault(name, value)
        return status_code, headers, chunk
