"""Servers of the tests, and requests to them."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import io
import threading
from collections.abc import Callable, Iterator
from queue import Queue
from typing import TYPE_CHECKING

import numpy as np

from lumbar.page_server.server import HOST, Visitors
from patience import PATIENCE_S, wait_until

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
    """Send a request with the cookie, unless another is given; underscores in the names of headers are hyphens."""
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


def text_of(record, header="t [ms];pos [m];F") -> bytes:
    """Content of a text file of a record in the units of a machine."""
    table = np.column_stack([1e3 * record.time, record["input"] / 1e3, record["output"]])
    stream = io.StringIO()
    np.savetxt(stream, table, delimiter=";", header=header, comments="")
    return stream.getvalue().encode()


def ended(served, page: str) -> str:
    """The page of a set as soon as its work has ended."""

    def finished_page():
        status, _, text = served.get(page)
        assert status == 200
        return "location.reload()" not in text and text

    return wait_until(finished_page)
