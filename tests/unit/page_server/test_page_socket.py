"""The line between a page and its document: a page's own messages are taken, and no others."""

import asyncio
import base64
import gzip
import json
import re
from concurrent.futures import ThreadPoolExecutor

import pytest
from asking import cookie, ended
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from lumbar.page_server.trust import HOST
from lumbar.publishing.explorer.plots import REQUEST
from patience import PATIENCE_S


@pytest.fixture(scope="module")
def opened(served):
    """Text of a served page."""
    served.get("/records")
    ended(served, "/records")
    return served.get("/records")[2]


def sent(visitors, opened, *fragments, kind="PATCH-DOC", **header):
    """Send a message as the page does; kind and content of the answer, None where the line was closed."""

    async def talk():
        address = f"{HOST}:{visitors.port}"
        headers = {"Cookie": cookie(visitors), "Origin": f"http://{address}"}
        token = re.search(r'"token":"([^"]+)"', opened)[1]
        line = await websocket_connect(
            HTTPRequest(f"ws://{address}/records/ws", headers=headers), subprotocols=["bokeh", token]
        )
        for _ in range(3):
            await line.read_message()  # the server's greeting
        for fragment in (json.dumps({"msgid": "1", "msgtype": kind} | header), "{}", *fragments):
            await line.write_message(fragment, binary=isinstance(fragment, bytes))
        if (first := await line.read_message()) is None:
            return None
        _, content = [await line.read_message() for _ in range(2)]
        line.close()
        return json.loads(first)["msgtype"], content

    with ThreadPoolExecutor() as aside:  # a browser's test keeps a loop running in this thread
        return aside.submit(asyncio.run, asyncio.wait_for(talk(), PATIENCE_S)).result()


@pytest.fixture(scope="module")
def ask_for(served, opened):
    """Return a function that sets the request of the page, and whether that was taken."""
    kind, document = sent(served.visitors, opened, "{}", kind="PULL-DOC-REQ")
    assert kind == "PULL-DOC-REPLY"
    named = re.search(rf'"id":"(p\d+)","attributes":{{"name":"{REQUEST}"', document)

    def ask(value) -> bool:
        event = {"kind": "ModelChanged", "model": {"id": named[1]}, "attr": "data", "new": value}
        answer = sent(served.visitors, opened, json.dumps({"events": [event]}))
        return answer is not None and answer[0] == "OK"

    return ask


def packed(size: int) -> dict:
    """Zeros as Bokeh packs them."""
    return {"type": "bytes", "data": base64.b64encode(gzip.compress(b"\0" * size, 9)).decode()}


def content(value) -> dict:
    return {"type": "map", "entries": [["content", value]]}


ARRAY = {"type": "ndarray", "array": packed(1000), "order": "little", "dtype": "float64", "shape": [125]}
MODELS = [{"type": "object", "name": "Plot", "id": f"x{number}"} for number in range(50)]
UNFOLDING = [
    packed(20_000_000),
    content(packed(1000)),
    content([packed(1000)]),
    content(ARRAY),
    content(MODELS),
]


def test_a_page_asks(ask_for):
    assert ask_for(content(["{}"]))


@pytest.mark.parametrize("value", UNFOLDING)
def test_what_unfolds_to_more_than_a_page_sends_is_refused(ask_for, value):
    assert not ask_for(value)
    assert ask_for(content(["{}"]))


@pytest.mark.parametrize(
    ("kind", "fragments", "header"),
    [
        ("PUSH-DOC", ["{}"], {}),
        ("SERVER-INFO-REQ", ["{}"], {}),
        ("PATCH-DOC", ["[" * 9000], {}),
        ("PATCH-DOC", ["{}", '{"id": "a"}', b"\0" * 1000], {"num_buffers": 1_000_000}),
    ],
)
def test_other_messages_close_the_line(served, opened, kind, fragments, header):
    assert sent(served.visitors, opened, *fragments, kind=kind, **header) is None
