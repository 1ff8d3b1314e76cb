"""The served page, served lifts and the index: what is answered and to whom, the way back, and addresses that lead nowhere."""

import json
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
import yaml
from asking import ask, ended, serving

import lumbar
from case_tables import cases
from column_files import write_records
from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.cli.command import INTERRUPTED
from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import UploadDiagnosis
from lumbar.page_server.served_sets import ExploredSet, ServedLift, ServedSets, StoredVerdict, TabRequests
from lumbar.page_server.server import TOKEN, Visitors, new_server
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.study_settings import StudySettings
from lumbar.twin.examples import example_records


@pytest.fixture
def tab(explored):
    return TabRequests(explored)


def asked(tab, action, *effects):
    return tab.answer(json.dumps({"number": 7, "action": action, "effects": list(effects)}))


def test_a_model_that_was_not_fitted_is(tab, explored):
    answer, models = asked(tab, "fit", "coulomb_friction", "inertia")
    refined = lumbar.refine(example_records(), ["coulomb_friction", "inertia"])
    assert answer["number"] == 7
    assert list(answer["models"]) == ["base", "coulomb_friction", "coulomb_friction+inertia"]
    told = answer["models"]["coulomb_friction+inertia"]
    assert told["located"]["other"]["views"].keys() >= {"frequency", "reversals"}
    assert told["test_rms"] == pytest.approx(refined.path[-1].test_rms, rel=1e-9)
    assert len(models[-1].values["other"]) == len(explored.page.records[1].columns["time"])
    assert explored.refitted(["inertia", "coulomb_friction"]) is explored.refitted(
        ["coulomb_friction", "inertia"]
    )


def test_the_workflow_writes_the_model_that_the_page_shows(explored, tmp_path):
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
    ("text", "words"),
    [*cases(__file__, "not_done"), ("[" * 100_000, "not JSON")],
)
def test_what_cannot_be_done_is_said(tab, text, words):
    answer, models = tab.answer(text if isinstance(text, str) else json.dumps({"number": 1, **text}))
    assert words in answer["error"]
    assert models == []


@pytest.mark.parametrize("where", ["out", "out/pictures", "out/refined.json"])
def test_nothing_is_written_where_a_link_leads(tab, explored, tmp_path, monkeypatch, where):
    """As in a folder that somebody else prepared."""
    monkeypatch.setattr(explored, "output", tmp_path / "out")
    link, elsewhere = tmp_path / where, tmp_path / "elsewhere"
    link.parent.mkdir(exist_ok=True)
    elsewhere.mkdir()
    link.symlink_to(elsewhere)
    assert f"{link}: leads by a link to {elsewhere}" in asked(tab, "save", "coulomb_friction")[0]["error"]
    assert not any(elsewhere.iterdir())
    assert sorted(tmp_path.rglob("*")) == sorted({link.parent, link, elsewhere} - {tmp_path})


def test_page_is_served_when_the_diagnosis_is_made(served, begin):
    begin.clear()
    for _ in range(2):  # however often it is asked for, it is begun once
        status, _, text = served.get("/slow")
        assert (status, "diagnosing the records (0 s)" in text or "reading the records (0 s)" in text) == (
            200,
            True,
        )
    begin.set()
    assert "Your own recordings" in ended(served, "/slow") and 'id="page-data"' in served.get("/slow")[2]


def test_a_diagnosis_that_fails_says_why_and_may_be_tried_again(served, broken):
    for _ in range(2):
        text = ended(served, "/broken")
        assert "no such folder" in text and "try again" in text


def test_a_taken_port_is_named(served, explored):
    with pytest.raises(InputError, match=f"port {served.visitors.port}: .*--port"):
        new_server(Index("", ServedSets([explored])), served.visitors.port, UploadDiagnosis(None, Path()))


def test_the_server_ends_while_it_computes(tmp_path):
    write_records(tmp_path, example_records())
    before = sorted(tmp_path.iterdir())
    command = [sys.executable, "-m", "lumbar", "explore", str(tmp_path), "--port", "0", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, **pipes) as server:
        printed = urlsplit(server.stdout.readline().split()[0])
        visitors = Visitors(printed.port, parse_qs(printed.query)[TOKEN][0])
        assert ask(visitors, "GET", "/records")[0] == 200
        server.send_signal(signal.SIGTERM)  # as Ctrl-C, which what is started in the background ignores
        _, said = server.communicate()
    assert (server.returncode, "Traceback" in said) == (INTERRUPTED, False)
    assert sorted(tmp_path.iterdir()) == before


@pytest.fixture
def get(saved_lift, tmp_path):
    (tmp_path / "a lift").symlink_to(saved_lift[0])
    (tmp_path / "broken").mkdir()

    lifts = [ServedLift(tmp_path / name, StabilitySettings()) for name in ("a lift", "broken")]
    index = Index("lifts", ServedSets([]), lifts)
    with serving(lambda: new_server(index, 0, UploadDiagnosis(None, tmp_path))) as visitors:
        yield partial(ask, visitors, "GET")


def test_every_lift_has_its_address(get, saved_lift):
    status, _, page = get("/lifts/a%20lift")
    below_the_bar = [text.partition("<main>")[2] for text in (page, saved_lift[1])]
    assert status == 200 and below_the_bar[0] == below_the_bar[1] != ""
    status, _, words = get("/lifts/broken")
    assert status == 500 and "no body.csv" in words
    assert get("/lifts/another")[0] == 404
    assert get("/lifts/a%20lift", Host="somewhere.example")[0] == 403


SETTINGS = StudySettings().model_dump(mode="json")
BAR = '<header class="top"><b>lumbar</b>\n</header>'


def must_not_be_made():
    raise AssertionError("a verdict that is there was computed again")


@pytest.fixture(scope="module")
def results(explored, tmp_path_factory):
    """Results of a study: a report, a diagnosis of the records, settings, and a link out of it."""
    project = tmp_path_factory.mktemp("project")
    results = project / "results" / "study"
    explored.diagnosis.save(results / "improvement" / "records", pictures=False)
    (results / "run_config.yaml").write_text(yaml.safe_dump(SETTINGS), encoding="utf-8")
    (results / "report.html").write_text(
        f"<!DOCTYPE html><body>{BAR}<main>all of it</main>", encoding="utf-8"
    )
    (project / "secret.txt").write_text("a secret", encoding="utf-8")
    (results / "out.txt").symlink_to(project / "secret.txt")
    return results


@pytest.fixture(scope="module")
def recording(results):
    """A recording that is older than the diagnosis."""
    path = results.parent / "recording.csv"
    path.write_text("time_s\n", encoding="utf-8")
    os.utime(path, (1, 1))
    return path


@pytest.fixture(scope="module")
def door(results, recording, saved_lift, tmp_path_factory):
    """Ask a server of these results."""
    stored = StoredVerdict(results / "improvement" / "records", SETTINGS, [recording])
    sets = ServedSets(
        [
            ExploredSet("records", must_not_be_made, Path("out"), stored=stored),
            ExploredSet("others", must_not_be_made, Path("out")),
        ]
    )
    (folder := tmp_path_factory.mktemp("lifts") / "a_lift").symlink_to(saved_lift[0])
    index = Index("study", sets, [ServedLift(folder, StabilitySettings())], results)
    with serving(lambda: new_server(index, 0, UploadDiagnosis(None, Path("out")))) as visitors:
        yield partial(ask, visitors, "GET")


def index_of(door) -> str:
    """The index, which begins with a tab for files that are dropped on it."""
    status, headers, _ = door("/")
    assert status == 302 and headers["Location"].startswith("/?tab=")
    return door(headers["Location"])[2]


def test_the_index_leads_to_all_that_there_is_and_says_what_is_known(door):
    page = index_of(door)
    for address in ("/records", "/others", "/lifts/a_lift", "/_results/report.html", "/_own"):
        assert f'href="{address}"' in page
    assert "KB model is missing coulomb friction." in page
    assert page.count("Not diagnosed yet") == 1
    assert 'id="choose"' in page  # files can be dropped


@pytest.mark.parametrize(
    "path", ["/nowhere", "/records/nowhere", "/_results/nowhere.html", "/_results/", "/_stored/others"]
)
def test_an_unknown_address_says_where_one_may_go(door, path):
    status, _, page = door(path)
    assert status == 404
    assert 'href="/records"' in page and 'href="/lifts/a_lift"' in page and 'href="/_own"' in page


def test_a_verdict_in_the_results_is_shown_at_once_and_can_ask_the_server_nothing(door, results):
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


def test_a_verdict_of_other_settings_or_recordings_is_not_taken(results, recording):
    kept = StoredVerdict(results / "improvement" / "records", SETTINGS, [recording])
    assert kept.is_current
    assert not StoredVerdict(kept.folder, SETTINGS | {"seed": 1}, [recording]).is_current
    assert not StoredVerdict(results / "improvement" / "none", SETTINGS).is_current
    made = kept.page.stat().st_mtime
    os.utime(recording, (made + 1, made + 1))
    assert not kept.is_current
    os.utime(recording, (1, 1))


def test_files_of_the_results_run_no_script_and_no_others_are_sent(door):
    status, headers, page = door("/_results/report.html")
    assert (status, "all of it" in page) == (200, True)
    assert headers["Content-Security-Policy"].startswith("default-src 'none';")
    status, headers, text = door("/_results/improvement/records/diagnosis.json")
    assert (status, headers["Content-Type"]) == (200, "text/plain; charset=utf-8")
    assert json.loads(text)["selected"] == ["coulomb_friction"]
    for path in ("out.txt", "../../secret.txt", "..%2f..%2fsecret.txt", "%2fetc%2fpasswd", "improvement"):
        status, _, text = door(f"/_results/{path}")
        assert status == 404 and "a secret" not in text and "root:" not in text


def test_the_report_s_links_lead_to_the_pages_of_the_server(door):
    assert door("/_results/improvement/records/diagnosis.html")[1]["Location"] == "/records"
    assert door("/_results/lifts/a_lift.html")[1]["Location"] == "/lifts/a_lift"
