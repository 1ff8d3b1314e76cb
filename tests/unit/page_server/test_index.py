"""The one door: the index, the way back from every page, addresses that lead nowhere, and what a study's run left."""

import json
import os
from functools import partial
from pathlib import Path

import pytest
import yaml
from asking import ask, serving

from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import OwnDiagnosis
from lumbar.page_server.served_sets import ExploredSet, ServedLift, ServedSets
from lumbar.page_server.server import new_server
from lumbar.page_server.stored import StoredVerdict
from lumbar.settings.plain import plain
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.study_settings import StudySettings

SETTINGS = plain(StudySettings())
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
    with serving(lambda: new_server(index, 0, OwnDiagnosis(None, Path("out")))) as visitors:
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
    assert "KB is missing coulomb friction." in page
    assert page.count("Not diagnosed yet") == 1
    assert 'id="choose"' in page  # files can be dropped


def test_every_page_leads_back(door):
    for path in (
        "/records",
        "/lifts/a_lift",
        "/_results/report.html",
        "/_own?tab=x",
        "/nowhere",
        "/_own/result",
    ):
        status, headers, page = door(path)
        if status == 302:
            page = door(headers["Location"])[2]
        assert '<header class="top"><b><a href="/">' in page, path


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
    assert kept.holds
    assert not StoredVerdict(kept.folder, SETTINGS | {"seed": 1}, [recording]).holds
    assert not StoredVerdict(results / "improvement" / "none", SETTINGS).holds
    made = kept.page.stat().st_mtime
    os.utime(recording, (made + 1, made + 1))
    assert not kept.holds
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
