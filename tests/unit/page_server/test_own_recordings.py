"""Recordings that are given on the page: read, refused in the library's words, diagnosed, written when asked; and their tabs."""

import http.client
import io
import json
import re
import shlex

import numpy as np
import pytest
from asking import cookie, ended

from case_tables import cases
from lumbar.base.errors import InputError
from lumbar.cli.command import build_parser
from lumbar.page_server import own_recordings
from lumbar.page_server.own_recordings import MAX_SESSIONS, UploadDiagnosis, UploadSession, UploadSessions
from lumbar.page_server.recording_preview import OF_SEVERAL_AXES
from lumbar.page_server.server import HOST
from lumbar.twin.examples import example_records
from patience import PATIENCE_S
from space_records import TABLE

SCRIPT = "<img src=x onerror=alert(1)>"


def text_of(record, header="t [ms];pos [m];F"):
    table = np.column_stack([1e3 * record.time, record["input"] / 1e3, record["output"]])
    stream = io.StringIO()
    np.savetxt(stream, table, delimiter=";", header=header, comments="")
    return stream.getvalue().encode()


@pytest.fixture(scope="module")
def contents():
    """Contents of two files in the units of a machine, the force without one."""
    return {f"{record.name}.txt": text_of(record) for record in example_records()}


def test_columns_and_units_are_found_and_what_is_open_is_asked_for(own_tab, contents):
    for name, content in contents.items():
        status, state = own_tab(f"file?name={name}", content)
    assert status == 200
    assert state["fields"]["force_unit"] == [
        "force is column 3 'F', by its name, without a unit; give “Unit of force”, e.g. N"
    ]
    assert [text for name, texts in state["fields"].items() if name != "force_unit" for text in texts] == []
    assert state["columns"][1]["label"] == "column 2 'pos' [m]"
    _, state = own_tab("look", {"choices": {"force_unit": "2 N"}})
    assert all(texts == [] for texts in state["fields"].values()) and state["common"] == ""
    first, record = state["files"][0], example_records()[0]
    assert first["grounds"]["position"] == "column 2 'pos' [m], by its name; unit m, as the file says"
    assert first["header"] == ["time_s", "position_mm", "force_N"]
    assert [float(value) for value in first["rows"][1]] == pytest.approx(
        [record.time[1], record["input"][1], 2 * record["output"][1]], rel=1e-5
    )
    _, state = own_tab("look", {"choices": {"force_unit": "2 N", "position": "3", "force": "2"}})
    assert "mm" not in json.dumps(state["files"][0].get("header"))
    assert any("not of" in text or "unit" in text for texts in state["fields"].values() for text in texts)
    _, state = own_tab("remove", {"file": "other.txt"})
    assert [item["file"] for item in state["files"]] == ["multisine.txt"]


def test_own_recordings_are_diagnosed_as_any_others(own_tab, served, contents, begin):
    for name, content in contents.items():
        own_tab(f"file?name={name}", content)
    wanted = {"choices": {"force_unit": "N"}, "name": "mine", "train": ["other"]}
    begin.clear()
    status, answer = own_tab("start", wanted)
    assert status == 200
    first, (_, answer) = answer["address"], own_tab("start", wanted)  # in its place
    assert served.get(answer["address"])[0] == 200
    begin.set()
    assert "another diagnosis was started in its place" in ended(served, first)
    text = ended(served, answer["address"])
    assert "missing coulomb friction" in text
    assert "other (training)" in text and "multisine (unseen)" in text
    assert not served.own.exists()
    status, answer = own_tab("save", wanted)
    assert status == 200 and "lumbar diagnose" in answer["text"]
    written = {str(path.relative_to(served.own)) for path in served.own.rglob("*") if path.is_file()}
    assert written == {
        f"mine/records/{name}" for name in ("multisine.csv", "other.csv", "study.yaml", "imported.json")
    }


@pytest.mark.nightly
def test_recordings_of_several_axes_are_shown_axis_by_axis_and_their_diagnosis_as_it_is_written(
    own_tab, served, begin
):
    _, state = own_tab("file?name=v.csv", TABLE.encode())
    [file] = state["files"]
    for role in ("position", "force"):
        assert all(f"'{role}_{axis}'" in file["found"][role][0] for axis in "xyz")
        assert all(f"'{role}_{axis}'" in file["grounds"][role] for axis in "xyz")
    assert file["found"]["force"][1] == "N"
    quantities = [f"{name} {axis}" for name in ("Position", "Force") for axis in "xyz"]
    assert [curve["label"].split(" (")[0] for curve in file["curves"]] == quantities
    assert file["remark"] == OF_SEVERAL_AXES
    begin.clear()
    _, answer = own_tab("start", {"name": "v"})
    begin.set()
    page = ended(served, answer["address"])
    assert "Stiffness and viscosity in space" in page and "All pages" in page and page.count("<figure>") == 4


def test_records_are_not_written_where_a_link_leads(tmp_path, contents):
    (tmp_path / "own").symlink_to(tmp_path / "elsewhere")
    held = UploadSession("")
    held.add("a.txt", contents["other.txt"])
    with pytest.raises(InputError, match=r"own/mine/records: leads by a link to .*elsewhere"):
        held.save({"choices": {"force_unit": "N"}, "name": "mine"}, UploadDiagnosis(None, tmp_path / "own"))


MALFORMED = {
    "empty": b"",
    "words": b"there is no table here\n" * 50,
    "ragged": b"t_s,pos_mm,F_N\n"
    + b"".join(b"%f,%d\n" % (n / 100, n % 7) if n % 3 else b"1\n" for n in range(300)),
    "nan": b"t_s,pos_mm,F_N\n" + b"".join(b"%f,%d,nan\n" % (n / 100, n % 7) for n in range(300)),
    "infinite": b"t_s,pos_mm,F_N\n" + b"".join(b"%f,%d,inf\n" % (n / 100, n % 7) for n in range(300)),
    "huge": b"t_s,pos_mm,F_N\n" + b"".join(b"%f,%de308,1e308\n" % (n / 100, n % 2) for n in range(300)),
    "constant": b"t_s,pos_mm,F_N\n" + b"".join(b"%f,1,1\n" % (n / 100) for n in range(300)),
    "backward": b"t_s,pos_mm,F_N\n" + b"".join(b"%f,%d,%d\n" % (-n / 100, n % 7, n % 5) for n in range(300)),
    "huge, uneven clock": b"t_s,pos_mm,F_N\n"
    + b"".join(b"%f,%de307,%d\n" % (n / 100 + (n % 5) / 300, n % 2, n % 3) for n in range(300)),
    "hdf5": b"\x89HDF\r\n\x1a\n" + b"\0" * 600,
}


@pytest.mark.parametrize("kind", MALFORMED)
def test_malformed_files_are_refused_in_words(kind):
    held = UploadSession("")
    state = held.add(f"{SCRIPT}.csv", MALFORMED[kind])
    file = state["files"][0]
    told = [*file["wrong"], *(text for texts in state["fields"].values() for text in texts)]
    assert told and all(told)
    assert "record" not in file
    assert not any("Traceback" in text or "program failed" in text for text in told)
    json.dumps(state, allow_nan=False)


def test_names_are_names_and_no_paths(own_tab, served, tmp_path):
    record = example_records()[0]
    content = text_of(record, f"t [ms];{SCRIPT} pos [m];F [N]")
    for name in (
        "../../../etc/cron.d/x.txt",
        "/etc/passwd.txt",
        "..%5C..%5Cx.txt",
        "con.txt",
        f"%3Cb%3E{'x' * 500}",
    ):
        status, state = own_tab(f"file?name={name}", content)
        assert status == 200
    assert all("/" not in item["file"] and len(item["file"]) <= 200 for item in state["files"])
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+", item["record"]) for item in state["files"])
    assert "con_" in [item["record"] for item in state["files"]]  # a device on Windows
    assert SCRIPT in json.dumps(state)  # as it stands: the page shows it as text
    for name in ("../x", "/etc", "a/b", "", ".hidden", "x" * 61, "con", "Lpt1", 7, None, "a\0"):
        for action in ("start", "save"):
            status, answer = own_tab(action, {"choices": {}, "name": name})
            assert status == 400 and "letters, digits" in answer["error"]


@pytest.mark.parametrize(
    "choices",
    cases(__file__, "wrong_choices"),
)
def test_wrong_choices_are_told_beside_their_field(contents, choices):
    held = UploadSession("")
    held.add("a.txt", text_of(example_records()[0], "t [ms];pos [m];F [N]"))
    state = held.preview(choices)
    assert state["fields"][next(iter(choices))]
    json.dumps(state, allow_nan=False)


@pytest.mark.parametrize("name", ["a lift.c3d", "walk.trc.gz", "walk.BVH"])
def test_markers_are_answered_with_the_command_that_makes_their_page(name):
    with pytest.raises(InputError, match="holds markers of a movement") as told:
        UploadSession("").add(name, b"whatever")
    command = shlex.split(re.search(r"(lumbar lift .*) \(", str(told.value))[1])
    assert command[2] == name
    options = build_parser().parse_args(command[1:])
    assert (str(options.page), str(options.subject)) == ("lift.html", "PERSON.yaml")


def test_too_many_files_are_refused(monkeypatch):
    held = UploadSession("")
    held.add("a.csv", b"x")
    held.add("a.csv", b"y")  # in its place
    monkeypatch.setattr(own_recordings, "MAX_FILES", 1)
    with pytest.raises(InputError, match="limit is 1 files"):
        held.add("b.csv", b"")


def test_a_file_beyond_what_all_tabs_may_hold_is_refused(own_tab, served, monkeypatch):
    monkeypatch.setattr(own_recordings, "MAX_BYTES", 100)
    status, answer = own_tab("file?name=a.csv", b"1,2\n" * 100)
    assert status == 400 and "remove a file" in answer["error"]
    assert own_tab("look", {})[1]["files"] == []


def test_a_file_larger_than_any_is_not_read(served, own_tab):
    connection = http.client.HTTPConnection(HOST, served.visitors.port, timeout=PATIENCE_S)
    connection.putrequest("POST", "/_own/file?name=large.csv")
    connection.putheader("Content-Length", str(200_000_000))
    connection.putheader("Cookie", cookie(served.visitors))
    connection.endheaders()  # and not a byte of the file
    assert connection.getresponse().status == 400


def test_of_many_tabs_one_without_files_is_let_go_first():
    tabs = UploadSessions()
    full, empty = tabs.new(), tabs.new()
    tabs.get(full).files["a.csv"] = b"x"
    others = [tabs.new() for _ in range(MAX_SESSIONS - 1)]
    assert tabs.get(full) is not None and tabs.get(empty) is None
    for name in others:
        tabs.get(name).files["a.csv"] = b"x"
    newest = tabs.new()
    assert tabs.get(full) is None and all(map(tabs.get, [*others, newest]))


def test_tabs_do_not_see_each_other(served, own_tab):
    own_tab("file?name=a.txt", b"1,2")
    status, headers, _ = served.get("/_own?tab=guessed")
    assert status == 302
    tab = headers["Location"].partition("tab=")[2]
    status, _, text = served.post("/_own/look", "{}", X_Lumbar_Tab=tab)
    assert (status, json.loads(text)["files"]) == (200, [])
    assert served.post("/_own/look", "{}", X_Lumbar_Tab="guessed")[0] == 410
    assert served.post("/_own/look", "{}")[0] == 410
