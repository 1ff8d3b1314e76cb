"""Access control: the server answers only requests with the token, from pages of this machine."""

import http.client
import logging

import pytest
from asking import cookie

from case_tables import cases
from patience import PATIENCE_S

HOST, TOKEN = "127.0.0.1", "token"
PATHS = cases(__file__, "paths")


def test_token_is_needed_only_once(served):
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
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} == set(how)  # it ends with the browser
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
    for action in ("_own/look", "_own/start", f"_own/look?token={token}"):
        assert served.post(f"/{action}", "{}", Cookie=given)[0] == 403
    assert served.get("/records/ws", Cookie=given, **UPGRADE)[0] == 403


def test_upload_without_a_token_is_not_read(served):
    connection = http.client.HTTPConnection(HOST, served.visitors.port, timeout=PATIENCE_S)
    connection.putrequest("POST", "/_own/file?name=a.csv")
    connection.putheader("Content-Length", "90000")
    connection.endheaders()  # and not a byte of the file
    assert connection.getresponse().status == 403


def test_token_is_not_disclosed(served, caplog):
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


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "somewhere.example"},
        {"Host": "127.0.0.1.somewhere.example"},
        {"Origin": "http://somewhere.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
    ],
)
def test_pages_of_other_origins_get_nothing(served, headers):
    for path in PATHS:
        assert served.get(path, **headers)[0] == 403
    assert served.post("/_own/look", "{}", **headers)[0] == 403
    assert served.get("/records/ws", **UPGRADE, **headers)[0] == 403
    token = served.visitors.token
    if "Host" in headers:
        assert "Set-Cookie" not in served.get(f"/?{TOKEN}={token}", **headers)[1]


@pytest.mark.parametrize(
    "path",
    [*cases(__file__, "nowhere"), f"/static/{'x' * 5000}"],
)
def test_paths_outside_are_rejected(served, path, caplog):
    status, _, text = served.get(path)
    assert "Traceback" not in caplog.text
    assert status in (400, 403, 404, 405)
    assert "root:" not in text and "study: a" not in text


def test_other_pages_cannot_frame_or_load_the_page(served):
    for path in ("/records", "/_own?tab=x", "/static/js/bokeh.min.js"):
        _, headers, _ = served.get(path)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
