"""A server of two small sets of records, and ways to ask it."""

import json
import os
import threading
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from asking import ask, serving, text_of

import lumbar
from lumbar.base.errors import InputError
from lumbar.page_server.background import THREAD_NAME
from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import UploadDiagnosis
from lumbar.page_server.served_sets import ExploredSet, ServedLift, ServedSets, StoredVerdict
from lumbar.page_server.server import new_server
from lumbar.settings.lifting import StabilitySettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings
from lumbar.twin.examples import example_records
from patience import PATIENCE_S

SETTINGS = StudySettings().model_dump(mode="json")
BAR = '<header class="top"><b>lumbar</b>\n</header>'
QUICK = StudySettings(improvement=ImprovementSettings(most_effects=1, propose_law=False))


@pytest.fixture(scope="session")
def explored(tmp_path_factory):
    """A set of two records."""

    def make():
        return lumbar.diagnose(example_records(), settings=QUICK)

    return ExploredSet("records", make, tmp_path_factory.mktemp("explored") / "out")


@pytest.fixture(scope="session")
def broken(tmp_path_factory):
    """A set that cannot be diagnosed."""
    return ExploredSet("broken", lambda: lumbar.read("absent_folder"), tmp_path_factory.mktemp("broken"))


@pytest.fixture(scope="session")
def begin():
    """Set: diagnoses on the server go on. A test that asks while one is made clears it first."""
    event = threading.Event()
    event.set()
    return event


@pytest.fixture(scope="module", autouse=True)
def _nothing_is_drawn_after_the_module(begin):
    """Wait for the servers' work: Matplotlib draws one figure at a time in a process."""
    yield
    begin.set()
    for thread in threading.enumerate():
        if thread.name == THREAD_NAME:
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


@pytest.fixture(scope="session")
def slow(explored, begin, tmp_path_factory):
    """A set of the same records that is not diagnosed before it may."""

    def make():
        begin.wait()
        return explored.diagnosis

    return ExploredSet("slow", make, tmp_path_factory.mktemp("slow"))


@pytest.fixture(scope="session")
def served(explored, slow, broken, begin, tmp_path_factory):
    """The server: ``get`` and ``post`` return status, headers and text; ``output`` is the folder for uploads."""
    output = tmp_path_factory.mktemp("own") / "out"

    def diagnose(records, **how):
        begin.wait()
        return lumbar.diagnose(records, settings=QUICK, **how)

    index = Index("some records", ServedSets([explored, slow, broken]))
    with serving(lambda: new_server(index, 0, UploadDiagnosis(diagnose, output))) as visitors:
        get, post = (partial(ask, visitors, method) for method in ("GET", "POST"))
        yield SimpleNamespace(visitors=visitors, get=get, post=post, output=output)


@pytest.fixture
def upload(served):
    """Return a function that sends a request of a new upload session."""
    _, headers, _ = served.get("/_own")
    tab = headers["Location"].partition("tab=")[2]

    def ask(action, body, **headers):
        content = body if isinstance(body, bytes) else json.dumps(body)
        status, _, text = served.post(f"/_own/{action}", content, X_Lumbar_Tab=tab, **headers)
        return status, json.loads(text)

    return ask


@pytest.fixture(scope="session")
def texts(examples):
    """Contents of two files in the units of a machine, the force without one."""
    return {f"{record.name}.txt": text_of(record) for record in examples}


@pytest.fixture
def get(saved_lift, tmp_path):
    (tmp_path / "a lift").symlink_to(saved_lift[0])
    (tmp_path / "broken").mkdir()

    lifts = [ServedLift(tmp_path / name, StabilitySettings()) for name in ("a lift", "broken")]
    index = Index("lifts", ServedSets([]), lifts)
    with serving(lambda: new_server(index, 0, UploadDiagnosis(None, tmp_path))) as visitors:
        yield partial(ask, visitors, "GET")


def must_not_be_made():
    raise AssertionError("a verdict that is there was computed again")


def refuse_record():
    raise InputError("others.csv: no column of force")


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
            ExploredSet("others", must_not_be_made, Path("out"), read_first=refuse_record),
        ]
    )
    (folder := tmp_path_factory.mktemp("lifts") / "a_lift").symlink_to(saved_lift[0])
    index = Index("study", sets, [ServedLift(folder, StabilitySettings())], results)
    with serving(lambda: new_server(index, 0, UploadDiagnosis(None, Path("out")))) as visitors:
        yield partial(ask, visitors, "GET")
