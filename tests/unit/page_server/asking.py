"""Requests to a server of the tests."""

from __future__ import annotations

import contextlib
import http.client

from lumbar.page_server.trust import HOST


def ask(port, method, path, body=None, **headers):
    """Send a request; underscores of headers stand for hyphens."""
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    connection.request(method, path, body, {name.replace("_", "-"): text for name, text in headers.items()})
    answer = connection.getresponse()
    with contextlib.suppress(ConnectionResetError):  # refused while the body was on its way
        return answer.status, dict(answer.getheaders()), answer.read().decode(errors="replace")
    return answer.status, dict(answer.getheaders()), ""
