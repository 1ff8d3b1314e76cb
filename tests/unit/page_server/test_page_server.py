"""The served page: what it answers, and to whom."""

from __future__ import annotations

import http.client
import io
import json
import threading

import numpy as np
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
    answer, models = asked(tab, "fit", "coulomb_friction", "inertia")
    refined = lumbar.refine(example_records(), ["coulomb_friction", "inertia"])
    assert answer["number"] == 7
    assert list(answer["models"]) == ["base", "coulomb_friction", "coulomb_friction+inertia"]
    told = answer["models"]["coulomb_friction+inertia"]
    assert told["located"]["other"]["views"].keys() >= {"depth", "reversals"}
    assert told["test_rms"] == pytest.approx(refined.path[-1].test_rms, rel=1e-9)
    assert len(models[-1].values["other"]) == len(explored.page.records[1].columns["time"])
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
    answer, models = tab.answer(json.dumps({"number": 1, "action": action, "effects": effects}))
    assert words in answer["error"]
    assert models == []


def test_what_tells_a_candidate_from_the_selected_effect_is_computed(tab):
    answer, _ = asked(tab, "separate", "hysteresis")
    motion = np.loadtxt(io.StringIO(answer["excitation"]["file"]), delimiter=",", skiprows=1)
    assert motion.shape[1] == 2 and len(motion) > 100
    assert "coulomb friction from hysteresis" in answer["excitation"]["text"]


def test_a_candidate_that_was_not_put_into_words_is_located(tab):
    answer, _ = asked(tab, "locate", "hysteresis")
    refined = lumbar.refine(example_records(), ["hysteresis"]).locate()
    assert answer["located"]["other"]["headline"] == refined["other"].location.headline


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
