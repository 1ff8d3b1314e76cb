"""The page's memory while it is attacked, as the system counts it, and when that is over."""

import json
import re
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import parse_qs, quote, urlsplit

import pytest
from asking import ask, cookie
from forged_files import SECRET, write_forged
from test_trust import packed, sent

from column_files import write_records
from lumbar.page_server.own_handlers import MOST_HELD
from lumbar.page_server.trust import HOST, TOKEN, Visitors
from lumbar.records.child_process import MEMORY, SECONDS
from lumbar.twin.examples import example_records
from patience import PATIENCE_S, seen

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(
        not Path("/proc/self/status").exists(), reason="only Linux tells a process's memory so"
    ),
]
MB = 1_000_000


@pytest.fixture
def server(tmp_path):
    """The server of a folder of records, as users start it, and who may come in."""
    write_records(tmp_path, example_records())
    command = [sys.executable, "-m", "lumbar", "explore", str(tmp_path), "--port", "0", "--no-browser"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        printed = urlsplit(server.stdout.readline().split()[0])
        visitors = Visitors(printed.port, parse_qs(printed.query)[TOKEN][0])
        assert ask(visitors, "GET", "/records")[0] == 200
        seen(lambda: json.loads(ask(visitors, "GET", "/_progress?page=/records")[2])["done"], every_s=0.5)
        yield server, visitors
        server.terminate()


def memory(server) -> int:
    """Resident memory in bytes."""
    status = Path(f"/proc/{server.pid}/status").read_text(encoding="utf-8")
    return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status)[1])


def begun(visitors, path: str, size: int, *headers: str) -> socket.socket:
    """A request whose body is 1 kB longer than what comes of it."""
    line = socket.create_connection((HOST, visitors.port), timeout=PATIENCE_S)
    head = [
        f"POST {path} HTTP/1.1",
        f"Host: {HOST}:{visitors.port}",
        f"Content-Length: {size + 1000}",
        *headers,
    ]
    line.sendall("\r\n".join([*head, "", ""]).encode())
    with suppress(ConnectionError):  # refused
        line.sendall(b"1,2,3\n" * (size // 6))
    return line


def test_memory_comes_back(server):
    process, visitors = server
    page = ask(visitors, "GET", "/records")[2]
    tab = ask(visitors, "GET", "/_own")[1]["Location"].partition("tab=")[2]
    known = f"Cookie: {cookie(visitors)}"
    before, peak = memory(process), 0
    with ExitStack() as lines:
        for number in range(60):
            path = f"/_own/file?name={number}.csv"
            lines.enter_context(begun(visitors, path, 20 * MB, known, f"X-Lumbar-Tab: {tab}"))
            peak = max(peak, memory(process))
        for _ in range(200):
            lines.enter_context(begun(visitors, "/_own/look", 90_000, known))
            lines.enter_context(begun(visitors, "/_own/look", 90_000))
            peak = max(peak, memory(process))
    assert peak < before + MOST_HELD + 100 * MB
    for message in (
        '{"events": [' + json.dumps(packed(670 * MB)) + "]}",
        json.dumps({"a": [{}] * 3000}),
        "[" * 9000,
    ):
        for _ in range(20):
            assert sent(visitors, page, message) is None
            peak = max(peak, memory(process))
    assert peak < before + MOST_HELD + 100 * MB
    assert seen(lambda: memory(process) < before + 100 * MB)
    assert ask(visitors, "GET", "/records")[0] == 200


def test_forged_files_on_the_page(server, tmp_path_factory):
    """Each is given to the page as a browser gives it: refused in words or shown, and forgotten."""
    process, visitors = server
    folder = tmp_path_factory.mktemp("forged")
    names = [path.name for path in write_forged(folder, drawn_too=270, seed=28)]
    assert len(names) >= 300
    tab = ask(visitors, "GET", "/_own")[1]["Location"].partition("tab=")[2]
    before, peak, refused = memory(process), 0, 0
    for name in names:
        content = (folder / "files" / name).read_bytes()
        begun_at = time.monotonic()
        status, _, told = ask(visitors, "POST", f"/_own/file?name={quote(name)}", content, X_Lumbar_Tab=tab)
        seconds, peak = time.monotonic() - begun_at, max(peak, memory(process))
        assert status in (200, 400, 413), (name, told[:300])
        answer = json.loads(told)
        refused += "error" in answer or any(file.get("messages") for file in answer["files"])
        assert SECRET[:9].decode() not in told and "Traceback" not in told, (name, told[:300])
        assert seconds < 2 * SECONDS, (name, seconds)  # of the child, and of a machine that does other work
        ask(visitors, "POST", "/_own/remove", json.dumps({"name": name}), X_Lumbar_Tab=tab)
    assert refused > len(names) / 3
    assert not (folder / "marker").exists()
    assert peak < before + MEMORY
    assert seen(lambda: memory(process) < before + 100 * MB)
    assert ask(visitors, "GET", "/records")[0] == 200
