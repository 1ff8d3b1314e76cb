"""Servers of the tests, and requests to them."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import threading
from collections.abc import Callable, Iterator
from queue import Queue
from typing import TYPE_CHECKING

from lumbar.page_server.trust import HOST
from patience import PATIENCE_S, seen

if TYPE_CHECKING:
    from bokeh.server.server import Server


@contextlib.contextmanager
def serving(make: Callable[[], Server]) -> Iterator[int]:
    """Run the server that `make` returns in a thread of its own; its port."""
    handed = Queue()

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            server = make()
            server.start()
        except BaseException as error:
            handed.put(error)
            raise
        handed.put(server)
        server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    server = handed.get()
    assert not isinstance(server, BaseException), server
    yield server.port
    server.io_loop.add_callback(server.io_loop.stop)
    thread.join()


def ask(port, method, path, body=None, **headers):
    """Send a request; underscores of headers stand for hyphens."""
    connection = http.client.HTTPConnection(HOST, port, timeout=PATIENCE_S)
    connection.request(method, path, body, {name.replace("_", "-"): text for name, text in headers.items()})
    answer = connection.getresponse()
    with contextlib.suppress(ConnectionResetError):  # refused while the body was on its way
        return answer.status, dict(answer.getheaders()), answer.read().decode(errors="replace")
    return answer.status, dict(answer.getheaders()), ""


def ended(served, page: str) -> dict:
    """What is said of a page's work once it has ended."""
    page, _, asked_for = page.partition("?")

    def state():
        status, _, text = served.get(f"/_progress?page={page}&{asked_for}")
        assert status == 200
        return (found := json.loads(text))["done"] and found

    return seen(state)
