"""The served page: what it answers, and to whom."""

from __future__ import annotations

import http.client
import json
import threading

import pytest

import lumbar
from lumbar.errors import InputError
from lumbar.page_server.explored_set import ExploredSet
from lumbar.page_server.requests import TabRequests
from lumbar.page_server.server import HOST, new_server
from lumbar.settings.improvement import ImprovementSettings
from lumbar.synthetic.examples import example_records


@pytest.fixture(scope="module")
def explored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explored")
    study = folder / "study.yaml"
    study.write_text("study: a\n", encoding="utf-8")

    def make():
        return lumbar.diagnose(example_records(), settings=ImprovementSettings(most_effects=1))

    return ExploredSet("records", make, folder / "out", study)


@pytest.fixture
def tab(explored):
    return TabRequests(explored)


def asked(tab, action, *effects):
    return tab.answer(json.dumps({"number": 7, "action": action, "effects": list(effects)}))


def test_a_model_that_was_not_fitted_is(tab, explored):
    answer, model = asked(tab, "fit", "coulomb_friction", "inertia")
    refined = lumbar.refine(example_records(), ["coulomb_friction", "inertia"])
    assert (answer["number"], answer["key"]) == (7, "coulomb_friction+inertia")
    assert answer["model"]["test_rms"] == pytest.approx(refined.path[-1].test_rms, rel=1e-9)
    assert len(model.values["other"]) == len(explored.page.records[1].columns["time"])
    assert explored.refitted(["inertia", "coulomb_friction"]) is explored.refitted(
        ["coulomb_friction", "inertia"]
    )


@pytest.mark.parametrize(
    ("action", "effects", "words"),
    [
        ("fit", ["no_such_effect"], "unknown effect"),
        ("fit", "coulomb_friction", "a list of up to"),
        ("fit", ["delay"] * 9, "a list of up to"),
        ("run", [], "unknown request"),
        ("write", [], "no change was shown"),
    ],
)
def test_what_cannot_be_done_is_said(tab, action, effects, words):
    answer, model = tab.answer(json.dumps({"number": 1, "action": action, "effects": effects}))
    assert words in answer["error"]
    assert model is None


def test_effects_are_kept_after_a_look_at_the_change(tab, explored):
    answer, _ = asked(tab, "keep", "coulomb_friction")
    assert "+  effects: [coulomb_friction]" in answer["diff"]
    assert "effects" not in explored.study_file.read_text(encoding="utf-8")
    answer, _ = asked(tab, "write", "coulomb_friction")
    assert "is written" in answer["text"]
    assert lumbar.load_settings(explored.study_file).improvement.effects == ("coulomb_friction",)
    assert "holds these effects already" in asked(tab, "keep", "coulomb_friction")[0]["text"]


@pytest.fixture(scope="module")
def port(explored):
    import asyncio

    started, ports = threading.Event(), []

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        server = new_server([explored], 0)
        server.start()
        ports.extend([server.port, server])
        started.set()
        server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert started.wait(30)
    yield ports[0]
    ports[1].io_loop.add_callback(ports[1].io_loop.stop)
    thread.join(10)


def got(port, path, **headers):
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode(errors="replace")


def test_page_is_served_with_its_buttons(port):
    status, text = got(port, "/records")
    assert status == 200
    assert "Keep these effects in the study" in text


def test_other_hosts_origins_and_paths_are_refused(port):
    assert got(port, "/records", Host="somewhere.example")[0] == 404
    assert got(port, "/static/../../../../etc/passwd")[0] in (400, 403, 404)
    assert got(port, "/static/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd")[0] in (400, 403, 404)
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "x" * 22 + "==",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Protocol": "bokeh, nothing",
    }
    assert got(port, "/records/ws", Origin="http://somewhere.example", **upgrade)[0] == 403


def test_a_taken_port_is_named(port, explored):
    with pytest.raises(InputError, match=f"port {port}: .*--port"):
        new_server([explored], port)
