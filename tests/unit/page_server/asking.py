"""Servers of the tests, and requests to them."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import threading
from collections.abc import Callable, Iterator
from queue import Queue
from typing import TYPE_CHECKING

from lumbar.page_server.server import HOST, Visitors
from patience import PATIENCE_S, seen

if TYPE_CHECKING:
    from bokeh.server.server import Server


@contextlib.contextmanager
def serving(make: Callable[[], tuple[Server, Visitors]]) -> Iterator[Visitors]:
    """Run the server that `make` returns in a thread of its own; who may come in."""
    handed = Queue()

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            server, visitors = make()
            server.start()
        except BaseException as error:
            handed.put(error)
            raise
        handed.put((server, visitors))
        server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    made = handed.get()
    assert not isinstance(made, BaseException), made
    server, visitors = made
    yield visitors
    server.io_loop.add_callback(server.io_loop.stop)
    thread.join()


def ask(visitors, method, path, body=None, **headers):
    """Send a request with the cookie, unless another is given; underscores of headers stand for hyphens."""
    connection = http.client.HTTPConnection(HOST, visitors.port, timeout=PATIENCE_S)
    headers = {"Cookie": cookie(visitors)} | headers
    connection.request(method, path, body, {name.replace("_", "-"): text for name, text in headers.items()})
    answer = connection.getresponse()
    with contextlib.suppress(ConnectionResetError):  # refused while the body was on its way
        return answer.status, dict(answer.getheaders()), answer.read().decode(errors="replace")
    return answer.status, dict(answer.getheaders()), ""


def cookie(visitors) -> str:
    """The header of a browser that was let in."""
    return f"{visitors.cookie}={visitors.token}"


def ended(served, page: str) -> str:
    """The page of a set once its work has ended."""

    def shown():
        status, _, text = served.get(page)
        assert status == 200
        return "location.reload()" not in text and text

    return seen(shown)
