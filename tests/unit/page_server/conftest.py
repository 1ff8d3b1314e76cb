"""A server of two small sets of records, and ways to ask it."""

import json
import threading
from functools import partial
from types import SimpleNamespace

import pytest
from asking import ask, serving

import lumbar
from lumbar.page_server.background import THREAD_NAME
from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import UploadDiagnosis
from lumbar.page_server.served_sets import ExploredSet, ServedSets
from lumbar.page_server.server import new_server
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.twin.examples import example_records
from patience import PATIENCE_S

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
    return ExploredSet("broken", lambda: lumbar.read("no such folder"), tmp_path_factory.mktemp("broken"))


@pytest.fixture(scope="session")
def begin():
    """Set: diagnoses on the server go on. A test that asks while one is made clears it first."""
    event = threading.Event()
    event.set()
    return event


@pytest.fixture(scope="module", autouse=True)
def _nothing_is_drawn_after_the_module(begin):
    """What the servers began is waited for: Matplotlib draws one figure at a time in a process."""
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
    """The server: ``get`` and ``post`` return status, headers and text; ``own`` is the folder for own recordings."""
    output = tmp_path_factory.mktemp("own") / "out"

    def diagnose(records, **how):
        begin.wait()
        return lumbar.diagnose(records, settings=QUICK, **how)

    index = Index("some records", ServedSets([explored, slow, broken]))
    with serving(lambda: new_server(index, 0, UploadDiagnosis(diagnose, output))) as visitors:
        get, post = (partial(ask, visitors, method) for method in ("GET", "POST"))
        yield SimpleNamespace(visitors=visitors, get=get, post=post, own=output)


@pytest.fixture
def own_tab(served):
    """Return a function that asks for something of a new tab with own recordings."""
    _, headers, _ = served.get("/_own")
    tab = headers["Location"].partition("tab=")[2]

    def ask(action, body, **headers):
        content = body if isinstance(body, bytes) else json.dumps(body)
        status, _, text = served.post(f"/_own/{action}", content, X_Lumbar_Tab=tab, **headers)
        return status, json.loads(text)

    return ask
