"""A server of two small sets of records, and ways to ask it."""

from __future__ import annotations

import asyncio
import json
import threading
from functools import partial
from types import SimpleNamespace

import pytest
from asking import ask

import lumbar
from lumbar.page_server.explored_set import ExploredSet
from lumbar.page_server.own_recordings import OwnDiagnosis
from lumbar.page_server.server import new_server
from lumbar.page_server.study_change import with_value
from lumbar.settings.improvement import ImprovementSettings
from lumbar.twin.examples import example_records

QUICK = ImprovementSettings(most_effects=1, propose_law=False)


@pytest.fixture(scope="session")
def explored(tmp_path_factory):
    """A set whose effects a study keeps."""
    folder = tmp_path_factory.mktemp("explored")
    study = folder / "study.yaml"
    study.write_text("study: a\n", encoding="utf-8")

    def make():
        return lumbar.diagnose(example_records(), settings=QUICK)

    keep = partial(with_value, study, ("improvement", "effects"))
    return ExploredSet(
        "records",
        make,
        folder / "out",
        lambda effects: keep(list(effects)),
        "study.yaml",
        read=example_records,
    )


@pytest.fixture(scope="session")
def broken(tmp_path_factory):
    """A set that cannot be diagnosed."""
    return ExploredSet("broken", lambda: lumbar.read("no such folder"), tmp_path_factory.mktemp("broken"))


@pytest.fixture(scope="session")
def served(explored, broken, tmp_path_factory):
    """The server: ``get`` and ``post`` return status, headers and text; ``own`` is the folder for own recordings."""
    output = tmp_path_factory.mktemp("own") / "out"
    own = OwnDiagnosis(partial(lumbar.diagnose, settings=QUICK), output)
    started, held = threading.Event(), []

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        server = new_server([explored, broken], 0, own)
        server.start()
        held.append(server)
        started.set()
        server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert started.wait(60)
    port = held[0].port
    yield SimpleNamespace(
        port=port, get=partial(ask, port, "GET"), post=partial(ask, port, "POST"), own=output
    )
    held[0].io_loop.add_callback(held[0].io_loop.stop)
    thread.join(10)


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
