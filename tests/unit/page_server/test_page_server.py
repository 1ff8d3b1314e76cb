"""Requests of a page, upload sessions and stored verdicts without HTTP."""

import json
import os
import re
import shlex
from pathlib import Path

import pytest
from asking import text_of

import lumbar
from case_tables import cases
from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.cli.command import build_parser
from lumbar.page_server import own_recordings
from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import MAX_SESSIONS, UploadDiagnosis, UploadSession, UploadSessions
from lumbar.page_server.served_sets import ServedSets, StoredVerdict, TabRequests
from lumbar.page_server.server import new_server
from lumbar.twin.examples import example_records
from refusing import has_tokens

SETTINGS = lumbar.StudySettings().model_dump(mode="json")


@pytest.fixture
def tab(explored):
    return TabRequests(explored)


def request(tab, action, *effects):
    return tab.answer(json.dumps({"number": 7, "action": action, "effects": list(effects)}))


def test_requested_model_is_fitted(tab, explored):
    answer, models = request(tab, "fit", "coulomb_friction", "inertia")
    refined = lumbar.refine(example_records(), ["coulomb_friction", "inertia"])
    assert answer["number"] == 7
    assert list(answer["models"]) == ["base", "coulomb_friction", "coulomb_friction+inertia"]
    facts = answer["models"]["coulomb_friction+inertia"]
    assert facts["located"]["other"]["views"].keys() >= {"frequency", "reversals"}
    assert facts["test_rms"] == pytest.approx(refined.path[-1].test_rms, rel=1e-9)
    assert len(models[-1].errors["other"]) == len(explored.page.records[1].columns["time"])
    assert explored.refitted(["inertia", "coulomb_friction"]) is explored.refitted(
        ["coulomb_friction", "inertia"]
    )


def test_saved_model_is_the_model_of_the_page(explored, tmp_path):
    shown = {item.key: item for item in explored.page.models}
    for key in ("base", "coulomb_friction", "inertia"):
        effects = [] if key == "base" else [key]
        fitted = explored.diagnosis.refine(effects).path[-1]
        assert (fitted.train_rms, fitted.test_rms) == (shown[key].train_rms, shown[key].test_rms)
    fitted = explored.refitted(["inertia", "coulomb_friction"]).path[-1]  # maybe in the order of another tab
    explored.diagnosis.save(tmp_path, pictures=False, effects=fitted.effects)
    scores = read_json(tmp_path / "refined.json")["models"][-1]["scores"]
    assert (scores["train_rms"], scores["test_rms"]) == (fitted.train_rms, fitted.test_rms)


@pytest.mark.parametrize(
    ("text", "message"),
    [*cases(__file__, "not_done"), ("[" * 100_000, "JSON")],
)
def test_impossible_requests_are_answered_with_a_message(tab, text, message):
    answer, models = tab.answer(text if isinstance(text, str) else json.dumps({"number": 1, **text}))
    assert has_tokens(answer["error"], message)
    assert models == []


@pytest.mark.parametrize("where", ["out", "out/pictures", "out/refined.json"])
def test_nothing_is_written_through_a_link(tab, explored, tmp_path, monkeypatch, where):
    """As in a folder that another user prepared."""
    monkeypatch.setattr(explored, "output", tmp_path / "out")
    link, elsewhere = tmp_path / where, tmp_path / "elsewhere"
    link.parent.mkdir(exist_ok=True)
    elsewhere.mkdir()
    link.symlink_to(elsewhere)
    error = request(tab, "save", "coulomb_friction")[0]["error"]
    assert error.startswith(f"{link}: ") and str(elsewhere) in error
    assert not any(elsewhere.iterdir())
    assert sorted(tmp_path.rglob("*")) == sorted({link.parent, link, elsewhere} - {tmp_path})


def test_taken_port_is_an_error(served, explored):
    with pytest.raises(InputError, match=f"port {served.visitors.port}: .*--port"):
        new_server(Index("", ServedSets([explored])), served.visitors.port, UploadDiagnosis(None, Path()))


def test_verdict_of_other_settings_or_recordings_is_not_current(results, recording):
    stored = StoredVerdict(results / "improvement" / "records", SETTINGS, [recording])
    assert stored.is_current
    assert not StoredVerdict(stored.folder, SETTINGS | {"seed": 1}, [recording]).is_current
    assert not StoredVerdict(results / "improvement" / "none", SETTINGS).is_current
    made = stored.page.stat().st_mtime
    os.utime(recording, (made + 1, made + 1))
    assert not stored.is_current
    os.utime(recording, (1, 1))


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


def test_records_are_not_written_through_a_link(tmp_path, texts):
    (tmp_path / "own").symlink_to(tmp_path / "elsewhere")
    session = UploadSession("")
    session.add("a.txt", texts["other.txt"])
    with pytest.raises(InputError, match=r"own/mine/records: .*elsewhere"):
        session.save(
            {"choices": {"force_unit": "N"}, "name": "mine"}, UploadDiagnosis(None, tmp_path / "own")
        )


@pytest.mark.parametrize("kind", MALFORMED)
def test_malformed_files_are_rejected_with_a_message(kind):
    session = UploadSession("")
    state = session.add("<img src=x>.csv", MALFORMED[kind])
    file = state["files"][0]
    faults = [*file["wrong"], *(text for texts in state["fields"].values() for text in texts)]
    assert faults and all(faults)
    assert "record" not in file
    assert not any("Traceback" in text or "lumbar explore" in text for text in faults)
    json.dumps(state, allow_nan=False)


@pytest.mark.parametrize(
    "choices",
    cases(__file__, "wrong_choices"),
)
def test_wrong_choices_are_reported_at_their_field(examples, choices):
    session = UploadSession("")
    session.add("a.txt", text_of(examples[0], "t [ms];pos [m];F [N]"))
    state = session.preview(choices)
    assert state["fields"][next(iter(choices))]
    json.dumps(state, allow_nan=False)


@pytest.mark.parametrize("name", ["a lift.c3d", "walk.trc.gz", "walk.BVH"])
def test_markers_are_answered_with_the_command_for_their_page(name):
    with pytest.raises(InputError, match=rf"{re.escape(name)} .*\bmarkers\b") as raised:
        UploadSession("").add(name, b"whatever")
    command = shlex.split(re.search(r"(lumbar lift .*) \(", str(raised.value))[1])
    assert command[2] == name
    options = build_parser().parse_args(command[1:])
    assert (str(options.page), str(options.subject)) == ("lift.html", "PERSON.yaml")


def test_too_many_files_are_rejected(monkeypatch):
    session = UploadSession("")
    session.add("a.csv", b"x")
    session.add("a.csv", b"y")  # in its place
    monkeypatch.setattr(own_recordings, "MAX_FILES", 1)
    with pytest.raises(InputError, match=r"b\.csv: .*\b1\b"):
        session.add("b.csv", b"")


def test_session_without_files_is_discarded_first():
    tabs = UploadSessions()
    full, empty = tabs.new(), tabs.new()
    tabs.get(full).files["a.csv"] = b"x"
    others = [tabs.new() for _ in range(MAX_SESSIONS - 1)]
    assert tabs.get(full) is not None and tabs.get(empty) is None
    for name in others:
        tabs.get(name).files["a.csv"] = b"x"
    newest = tabs.new()
    assert tabs.get(full) is None and all(map(tabs.get, [*others, newest]))
