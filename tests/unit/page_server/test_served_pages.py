"""Pages over HTTP: uploads, diagnoses, lifts, the index, and unknown addresses."""

import http.client
import json
import re
import signal
import subprocess
import sys
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import pytest
from asking import ask, cookie, ended, text_of

from column_files import write_records
from patience import PATIENCE_S
from refusing import has_tokens
from space_records import TABLE

SCRIPT = "<img src=x onerror=alert(1)>"


def test_columns_and_units_are_found_and_missing_units_requested(upload, texts, examples):
    for name, content in texts.items():
        status, state = upload(f"file?name={name}", content)
    assert status == 200
    (asked,) = state["fields"]["force_unit"]
    assert has_tokens(asked, "column 3 'F'…unit")
    assert [text for name, texts in state["fields"].items() if name != "force_unit" for text in texts] == []
    assert state["columns"][1]["label"] == "column 2 'pos' [m]"
    _, state = upload("look", {"choices": {"force_unit": "2 N"}})
    assert all(texts == [] for texts in state["fields"].values()) and state["common"] == ""
    first, record = state["files"][0], examples[0]
    assert has_tokens(first["grounds"]["position"], "column 2 'pos' [m]…unit m")
    assert first["header"] == ["time_s", "position_mm", "force_N"]
    assert [float(value) for value in first["rows"][1]] == pytest.approx(
        [record.time[1], record["input"][1], 2 * record["output"][1]], rel=1e-5
    )
    _, state = upload("look", {"choices": {"force_unit": "2 N", "position": "3", "force": "2"}})
    assert "mm" not in json.dumps(state["files"][0].get("header"))
    assert any(texts for texts in state["fields"].values())
    _, state = upload("remove", {"file": "other.txt"})
    assert [item["file"] for item in state["files"]] == ["multisine.txt"]


def test_uploads_are_diagnosed_like_other_records(upload, served, texts, begin):
    for name, content in texts.items():
        upload(f"file?name={name}", content)
    wanted = {"choices": {"force_unit": "N"}, "name": "mine", "train": ["other"]}
    begin.clear()
    status, answer = upload("start", wanted)
    assert status == 200
    first, (_, answer) = answer["address"], upload("start", wanted)  # in its place
    assert served.get(answer["address"])[0] == 200
    begin.set()
    assert "another diagnosis" in ended(served, first)
    text = ended(served, answer["address"])
    assert "coulomb friction" in text
    assert "other (training)" in text and "multisine (unseen)" in text
    assert not served.output.exists()
    status, answer = upload("save", wanted)
    assert status == 200 and "lumbar diagnose" in answer["text"]  # the command
    written = {str(path.relative_to(served.output)) for path in served.output.rglob("*") if path.is_file()}
    assert written == {
        f"mine/records/{name}" for name in ("multisine.csv", "other.csv", "study.yaml", "imported.json")
    }


@pytest.mark.nightly
def test_recordings_of_several_axes_are_shown_axis_by_axis(upload, served, begin):
    _, state = upload("file?name=v.csv", TABLE.encode())
    [file] = state["files"]
    for role in ("position", "force"):
        assert all(f"'{role}_{axis}'" in file["found"][role][0] for axis in "xyz")
        assert all(f"'{role}_{axis}'" in file["grounds"][role] for axis in "xyz")
    assert file["found"]["force"][1] == "N"
    quantities = [f"{name} {axis}" for name in ("Position", "Force") for axis in "xyz"]
    assert [curve["label"].split(" (")[0] for curve in file["curves"]] == quantities
    assert "axes" in file["remark"]
    begin.clear()
    _, answer = upload("start", {"name": "v"})
    begin.set()
    page = ended(served, answer["address"])
    assert "N/mm" in page and 'href="/"' in page and page.count("<figure>") == 4


def test_names_are_not_paths(upload, examples):
    content = text_of(examples[0], f"t [ms];{SCRIPT} pos [m];F [N]")
    for name in (
        "../../../etc/cron.d/x.txt",
        "/etc/passwd.txt",
        "..%5C..%5Cx.txt",
        "con.txt",
        f"%3Cb%3E{'x' * 500}",
    ):
        status, state = upload(f"file?name={name}", content)
        assert status == 200
    assert all("/" not in item["file"] and len(item["file"]) <= 200 for item in state["files"])
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+", item["record"]) for item in state["files"])
    assert "con_" in [item["record"] for item in state["files"]]  # a device on Windows
    assert SCRIPT in json.dumps(state)  # as it stands: the page shows it as text
    for name in ("../x", "/etc", "a/b", "", ".hidden", "x" * 61, "con", "Lpt1", 7, None, "a\0"):
        for action in ("start", "save"):
            status, answer = upload(action, {"choices": {}, "name": name})
            assert status == 400 and answer["error"].startswith("name")


def test_file_beyond_the_limit_of_all_tabs_is_rejected(upload, served, monkeypatch):
    monkeypatch.setattr("lumbar.page_server.own_recordings.MAX_BYTES", 100)
    status, answer = upload("file?name=a.csv", b"1,2\n" * 100)
    assert status == 400 and has_tokens(answer["error"], "0.0004 MB…MB…lumbar import")
    assert upload("look", {})[1]["files"] == []


def test_too_large_file_is_not_read(served, upload):
    connection = http.client.HTTPConnection("127.0.0.1", served.visitors.port, timeout=PATIENCE_S)
    connection.putrequest("POST", "/_own/file?name=large.csv")
    connection.putheader("Content-Length", str(200_000_000))
    connection.putheader("Cookie", cookie(served.visitors))
    connection.endheaders()  # and not a byte of the file
    assert connection.getresponse().status == 400


def test_tabs_do_not_see_each_other(served, upload):
    upload("file?name=a.txt", b"1,2")
    status, headers, _ = served.get("/_own?tab=guessed")
    assert status == 302
    tab = headers["Location"].partition("tab=")[2]
    status, _, text = served.post("/_own/look", "{}", X_Lumbar_Tab=tab)
    assert (status, json.loads(text)["files"]) == (200, [])
    assert served.post("/_own/look", "{}", X_Lumbar_Tab="guessed")[0] == 410
    assert served.post("/_own/look", "{}")[0] == 410


def test_page_is_served_when_the_diagnosis_is_complete(served, begin):
    begin.clear()
    for _ in range(2):  # repeated requests start it only once
        status, _, text = served.get("/slow")
        assert status == 200 and "(0 s)" in text and 'id="page-data"' not in text
    begin.set()
    assert 'href="/_own"' in ended(served, "/slow") and 'id="page-data"' in served.get("/slow")[2]


def test_failed_diagnosis_gives_a_reason_and_can_be_repeated(served, broken):
    for _ in range(2):
        text = ended(served, "/broken")
        assert "absent_folder" in text


def test_server_ends_while_it_computes(examples, tmp_path):
    write_records(tmp_path, examples)
    before = sorted(tmp_path.iterdir())
    command = [sys.executable, "-m", "lumbar", "explore", str(tmp_path), "--port", "0", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, **pipes) as server:
        printed = urlsplit(server.stdout.readline().split()[0])
        token = parse_qs(printed.query)["token"][0]
        visitors = SimpleNamespace(port=printed.port, cookie=f"lumbar_{printed.port}", token=token)
        assert ask(visitors, "GET", "/records")[0] == 200
        server.send_signal(signal.SIGTERM)  # as Ctrl-C, which what is started in the background ignores
        _, errors = server.communicate()
    assert (server.returncode, "Traceback" in errors) == (130, False)
    assert sorted(tmp_path.iterdir()) == before


def test_lifts_have_addresses(get, saved_lift):
    status, _, page = get("/lifts/a%20lift")
    below_the_bar = [text.partition("<main>")[2] for text in (page, saved_lift[1])]
    assert status == 200 and below_the_bar[0] == below_the_bar[1] != ""
    status, _, message = get("/lifts/broken")
    assert status == 500 and "body.csv" in message
    assert get("/lifts/another")[0] == 404
    assert get("/lifts/a%20lift", Host="somewhere.example")[0] == 403


def index_of(door) -> str:
    """The index, which begins with a tab for files that are dropped on it."""
    status, headers, _ = door("/")
    assert status == 302 and headers["Location"].startswith("/?tab=")
    return door(headers["Location"])[2]


def test_index_begins_with_files_and_shows_sets_without_their_result(door):
    page = index_of(door)
    for address in ("/records", "/others", "/lifts/a_lift", "/_results/report.html", "/_own"):
        assert f'href="{address}"' in page
    assert page.index('id="choose"') < page.index('href="/records"')  # files are dropped before all else
    assert page.count('class="sketch"') == 3  # ladder, lift and report; the other set cannot be read
    assert "Error of the KB model: " in page and "coulomb friction" not in page
    assert "others.csv: no column of force" in page


@pytest.mark.parametrize(
    "path", ["/nowhere", "/records/nowhere", "/_results/nowhere.html", "/_results/", "/_stored/others"]
)
def test_unknown_address_links_the_known_pages(door, path):
    status, _, page = door(path)
    assert status == 404
    assert 'href="/records"' in page and 'href="/lifts/a_lift"' in page and 'href="/_own"' in page


def test_stored_verdict_is_shown_without_access_to_the_server(door, results):
    status, _, page = door("/records")
    assert (status, 'src="/_stored/records"' in page) == (200, True)
    assert 'sandbox="allow-scripts allow-downloads"' in page
    status, headers, stored = door("/_stored/records")
    whole = (results / "improvement" / "records" / "diagnosis.html").read_text(encoding="utf-8")
    assert stored.partition("<main>")[2] == whole.partition("<main>")[2] != ""
    assert (
        '<header class="top">' in whole and '<header class="top">' not in stored
    )  # the frame's page has the bar
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts allow-downloads;")
    assert "allow-same-origin" not in page + headers["Content-Security-Policy"]


def test_only_files_of_the_results_are_sent_without_scripts(door):
    status, headers, page = door("/_results/report.html")
    assert (status, "all of it" in page) == (200, True)
    assert headers["Content-Security-Policy"].startswith("default-src 'none';")
    status, headers, text = door("/_results/improvement/records/diagnosis.json")
    assert (status, headers["Content-Type"]) == (200, "text/plain; charset=utf-8")
    assert json.loads(text)["selected"] == ["coulomb_friction"]
    for path in ("out.txt", "../../secret.txt", "..%2f..%2fsecret.txt", "%2fetc%2fpasswd", "improvement"):
        status, _, text = door(f"/_results/{path}")
        assert status == 404 and "a secret" not in text and "root:" not in text


def test_links_of_the_report_lead_to_pages_of_the_server(door):
    assert door("/_results/improvement/records/diagnosis.html")[1]["Location"] == "/records"
    assert door("/_results/lifts/a_lift.html")[1]["Location"] == "/lifts/a_lift"
