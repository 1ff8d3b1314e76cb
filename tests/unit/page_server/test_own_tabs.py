"""The tabs of the page for own recordings: what they hold and how much, and which is let go."""

import http.client
import json
import select
import socket

import pytest
from asking import ask, cookie, serving

from lumbar.base.errors import InputError
from lumbar.page_server import own_handlers, server
from lumbar.page_server.index import Index
from lumbar.page_server.own_handlers import MOST_TABS, OwnTabs
from lumbar.page_server.own_recordings import OwnDiagnosis
from lumbar.page_server.served_sets import ServedSets
from lumbar.page_server.trust import HOST
from patience import PATIENCE_S, seen


@pytest.fixture
def tabs(monkeypatch):
    monkeypatch.setattr(own_handlers, "MOST_HELD", 100)
    return OwnTabs()


def with_file(tabs, size, name="a.csv"):
    """Name of a new tab with a file of so many bytes."""
    tab = tabs.new()
    held = tabs.find(tab)
    tabs.expect(held, name, size)
    held.files[name] = b"x" * size
    tabs.arrived(size)
    return tab


def test_opening_the_page_lets_no_files_go(tabs):
    full, empty = with_file(tabs, 60), tabs.new()
    others = [tabs.new() for _ in range(2 * MOST_TABS)]
    assert tabs.find(full).files and tabs.find(empty) is None
    assert [tabs.find(name) is not None for name in others] == [False] * MOST_TABS + [True] * MOST_TABS


def test_a_file_that_is_given_takes_the_room_of_the_tab_used_longest_ago(tabs):
    first, second, third = with_file(tabs, 40), with_file(tabs, 30), with_file(tabs, 20)
    tabs.find(first)
    fourth = with_file(tabs, 35)
    assert [tabs.find(name) is not None for name in (first, second, third, fourth)] == [
        True,
        False,
        True,
        True,
    ]
    tabs.expect(tabs.find(fourth), "a.csv", 100)  # in the place of the other
    assert tabs.find(first) is tabs.find(third) is None
    with pytest.raises(InputError, match=r"b.csv: .*this tab holds and expects"):
        tabs.expect(tabs.find(fourth), "b.csv", 1)


def test_many_tabs_may_hold_little(tabs):
    names = [with_file(tabs, 1) for _ in range(MOST_TABS + 3)]
    assert [tabs.find(name) is not None for name in names] == [False] * 3 + [True] * MOST_TABS


@pytest.fixture
def small_server(monkeypatch, tmp_path):
    """Start a server that holds 40 MB and waits so long for the rest of a request."""
    monkeypatch.setattr(own_handlers, "MOST_HELD", 40_000_000)

    def start(slowest_s: float):
        monkeypatch.setattr(server, "SLOWEST_S", slowest_s)
        return serving(lambda: server.new_server(Index("", ServedSets([])), 0, OwnDiagnosis(None, tmp_path)))

    return start


def new_tab(visitors) -> str:
    return ask(visitors, "GET", "/_own")[1]["Location"].partition("tab=")[2]


def begun(visitors, tab: str, name: str, size: int) -> socket.socket:
    """A file that begins to be sent."""
    line = socket.create_connection((HOST, visitors.port), timeout=PATIENCE_S)
    head = f"POST /_own/file?name={name} HTTP/1.1\r\nHost: {HOST}:{visitors.port}\r\nX-Lumbar-Tab: {tab}\r\n"
    line.sendall(f"{head}Cookie: {cookie(visitors)}\r\nContent-Length: {size}\r\n\r\n1,2,3\n".encode())
    return line


def test_stalled_files_count(small_server):
    with small_server(PATIENCE_S) as visitors:
        tab = new_tab(visitors)
        lines = [begun(visitors, tab, f"{number}.csv", 19_000_000) for number in range(3)]
        refused, *_ = select.select(lines, [], [], PATIENCE_S)  # whichever the server reads last
        assert [b"413" in line.recv(100) for line in refused] == [True]
        for line in lines:
            line.close()


def test_stalled_files_are_ended_and_leave_their_room(small_server):
    with small_server(0.5) as visitors:
        tab = new_tab(visitors)
        assert begun(visitors, tab, "a.csv", 39_000_000).recv(100) == b""

        def taken():
            name, file = "/_own/file?name=c.csv", b"1,2\n" * 500_000
            return ask(visitors, "POST", name, file, X_Lumbar_Tab=tab)[0] == 200

        assert seen(taken)


def test_a_large_file_is_refused_before_it_is_read(served, own_tab):
    status, answer = own_tab("look", {})
    assert status == 200
    connection = http.client.HTTPConnection(HOST, served.visitors.port, timeout=PATIENCE_S)
    connection.putrequest("POST", "/_own/file?name=large.csv")
    connection.putheader("Content-Length", str(200_000_000))
    connection.putheader("X-Lumbar-Tab", "any")
    connection.putheader("Cookie", cookie(served.visitors))
    connection.endheaders()  # and not a byte of the file
    answer = connection.getresponse()
    assert answer.status == 413
    assert "large.csv: larger than 50 MB" in answer.read().decode()
    for size, expected in (("-1", (400, 411)), ("x", (400, 411)), ("9" * 5000, (400, 413))):
        assert served.post("/_own/file?name=a.csv", b"", Content_Length=size)[0] in expected
    assert served.post("/_own/file?name=a.csv", b"", Transfer_Encoding="chunked")[0] == 411


def test_tabs_do_not_see_each_other(served, own_tab):
    own_tab("file?name=a.txt", b"1,2")
    status, headers, _ = served.get("/_own?tab=guessed")
    assert status == 302
    tab = headers["Location"].partition("tab=")[2]
    status, _, text = served.post("/_own/look", "{}", X_Lumbar_Tab=tab)
    assert (status, json.loads(text)["files"]) == (200, [])
    assert served.post("/_own/look", "{}", X_Lumbar_Tab="guessed")[0] == 410
    assert served.post("/_own/look", "{}")[0] == 410
