"""Whom the server answers: who brought the token once, from this machine's own pages; and which messages of a page it takes."""

import asyncio
import base64
import gzip
import http.client
import json
import logging
import re
from concurrent.futures import ThreadPoolExecutor

import pytest
from asking import cookie, ended
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from case_tables import cases
from lumbar.page_server.trust import HOST, TOKEN
from lumbar.publishing.explorer.plots import REQUEST
from patience import PATIENCE_S

PATHS = cases(__file__, "paths")


def test_the_token_is_asked_for_once(served):
    token = served.visitors.token
    assert (
        served.visitors.address("/records") == f"http://{HOST}:{served.visitors.port}/records?{TOKEN}={token}"
    )
    status, headers, text = served.get(f"/_own?tab=a&{TOKEN}={token}", Cookie="")
    assert status == 200 and "location.replace(page)" in text
    assert token not in text
    assert headers["Referrer-Policy"] == "no-referrer"
    given, *how = headers["Set-Cookie"].split("; ")
    assert given == cookie(served.visitors)
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} == set(how)  # no end: it goes with the browser
    assert served.get("/static/js/bokeh.min.js", Cookie=f"a=b; {given}")[0] == 200
    assert (
        served.get(f"//somewhere.example/?{TOKEN}={token}", Cookie="")[2] == text
    )  # leads to its own host alone


@pytest.mark.parametrize(
    "wrong", ["", "x", "lumbar_1={token}", "{name}=", "{name}={token}x", "{name}=\xe9", "{name}={half}"]
)
def test_other_accounts_of_the_machine_get_nothing(served, wrong):
    name, token = served.visitors.cookie, served.visitors.token
    given = wrong.format(name=name, token=token, half=token[: len(token) // 2])
    for path in PATHS:
        status, headers, text = served.get(path, Cookie=given)
        assert status == 403 and "Set-Cookie" not in headers
        assert "lumbar explore" in text and token not in text
    for path in (
        "/records?token=",
        "/records?token=%ff",
        f"/records?token={token}x",
        f"/records?token={token}&token=",
    ):
        assert served.get(path, Cookie=given)[0] == 403
    for action in ("_own/look", "_own/start", "_cancel?page=/records", f"_own/look?token={token}"):
        assert served.post(f"/{action}", "{}", Cookie=given)[0] == 403
    assert served.get("/records/ws", Cookie=given, **UPGRADE)[0] == 403


def test_a_stranger_s_file_is_not_awaited(served):
    connection = http.client.HTTPConnection(HOST, served.visitors.port, timeout=PATIENCE_S)
    connection.putrequest("POST", "/_own/file?name=a.csv")
    connection.putheader("Content-Length", "90000")
    connection.endheaders()  # and not a byte of the file
    assert connection.getresponse().status == 403


def test_nobody_is_told_the_token(served, caplog):
    token = served.visitors.token
    with caplog.at_level(logging.WARNING):
        served.get(f"/records?{TOKEN}={token}x")
        served.get(f"/nowhere?{TOKEN}={token}&a=1")
        served.get("/nowhere?a=1")
    assert "403 GET /records" in caplog.text and token not in caplog.text and "?" not in caplog.text
    assert token not in repr(served.visitors)
    served.get("/records")
    page = served.get("/records")[2]
    assert token not in page and "Cookie" not in page


UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec_WebSocket_Key": "x" * 22 + "==",
    "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Protocol": "bokeh, nothing",
}


ELSEWHERE = [
    {"Host": "somewhere.example"},
    {"Host": "127.0.0.1.somewhere.example"},
    {"Origin": "http://somewhere.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:1"},
    {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "image"},
    {"Sec_Fetch_Site": "same-site", "Sec_Fetch_Dest": "iframe"},
]


@pytest.mark.parametrize("headers", ELSEWHERE)
def test_pages_of_elsewhere_get_nothing(served, headers):
    for path in PATHS:
        assert served.get(path, **headers)[0] == 404
    if "Sec_Fetch_Dest" not in headers or headers["Sec_Fetch_Dest"] != "image":
        assert served.post("/_cancel?page=/records", "", **headers)[0] == 404
    assert served.get("/records/ws", **UPGRADE, **headers)[0] in (403, 404)


@pytest.mark.parametrize(
    "path",
    [*cases(__file__, "nowhere"), f"/static/{'x' * 5000}"],
)
def test_paths_lead_nowhere(served, path, caplog):
    status, _, text = served.get(path)
    assert "Traceback" not in caplog.text
    assert status in (400, 403, 404, 405)
    assert "root:" not in text and "study: a" not in text


def test_nobody_frames_the_page_or_loads_into_it(served):
    for path in ("/records", "/_own?tab=x", "/static/js/bokeh.min.js"):
        _, headers, _ = served.get(path)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"


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
