"""The served page and served lifts: what is answered, and to whom."""

import io
import json
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from asking import ask, ended, serving

import lumbar
from column_files import write_records
from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.cli.command import INTERRUPTED
from lumbar.page_server.index import Index
from lumbar.page_server.own_recordings import OwnDiagnosis
from lumbar.page_server.requests import TabRequests
from lumbar.page_server.served_sets import ServedLift, ServedSets
from lumbar.page_server.server import new_server
from lumbar.page_server.trust import TOKEN, Visitors
from lumbar.page_server.waiting import HEIGHT, Sketch
from lumbar.settings.stability import StabilitySettings
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
    assert told["located"]["other"]["views"].keys() >= {"depth", "reversals"}
    assert told["test_rms"] == pytest.approx(refined.path[-1].test_rms, rel=1e-9)
    assert len(models[-1].values["other"]) == len(explored.page.records[1].columns["time"])
    assert explored.refitted(["inertia", "coulomb_friction"]) is explored.refitted(
        ["coulomb_friction", "inertia"]
    )


def test_the_workflow_writes_the_model_that_the_page_shows(explored, tmp_path):
    shown = {item.key: item for item in explored.page.models}
    for key in ("base", "coulomb_friction", "inertia"):
        effects = [] if key == "base" else [key]
        fitted = explored.diagnosis.with_effects(effects).path[-1]
        assert (fitted.train_rms, fitted.test_rms) == (shown[key].train_rms, shown[key].test_rms)
    fitted = explored.refitted(["inertia", "coulomb_friction"]).path[-1]  # maybe in the order of another tab
    explored.diagnosis.save(tmp_path, pictures=False, effects=fitted.effects)
    scores = read_json(tmp_path / "refined.json")["models"][-1]["scores"]
    assert (scores["train_rms"], scores["test_rms"]) == (fitted.train_rms, fitted.test_rms)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ({"action": "fit", "effects": ["no_such_effect"]}, "unknown effect"),
        ({"action": "fit", "effects": [{"a": 1}]}, "unknown effect"),
        ({"action": "fit", "effects": "coulomb_friction"}, "a list of up to"),
        ({"action": "fit", "effects": ["delay"] * 9}, "a list of up to"),
        ({"action": "fit", "effects": ["delay", "delay"]}, "none of them twice"),
        ({"action": "run"}, "unknown request"),
        ({"action": ["fit"]}, "unknown request"),
        ({"action": "write"}, "no change was shown"),
        ({"action": "fit", "number": "1"}, "without a number"),
        ("[" * 100_000, "not JSON"),
        ("[1]", "no mapping"),
        ("", "not JSON"),
    ],
)
def test_what_cannot_be_done_is_said(tab, text, words):
    answer, models = tab.answer(text if isinstance(text, str) else json.dumps({"number": 1, **text}))
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
    path = tab.explored.output.parent / "study.yaml"
    answer, _ = asked(tab, "keep", "coulomb_friction")
    assert "+  effects: [coulomb_friction]" in answer["diff"]
    assert "effects" not in path.read_text(encoding="utf-8")
    with ThreadPoolExecutor(2) as pool:  # two clicks at once
        first, second = pool.map(lambda _: asked(tab, "write", "coulomb_friction")[0], range(2))
    done, refused = (first, second) if "text" in first else (second, first)
    assert "is written" in done["text"]
    assert "no change was shown" in refused["error"]
    assert lumbar.load_settings(path).improvement.effects == ("coulomb_friction",)
    assert "holds this already" in asked(tab, "keep", "coulomb_friction")[0]["text"]


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


def test_a_record_is_sketched_between_its_extremes():
    record = example_records()[0]
    sketch = Sketch.of(record)
    up = np.array([float(point.split(",")[1]) for point in sketch.points.split()])
    values = record["output"]
    assert (up.min(), up.max()) == (0, HEIGHT)
    first = HEIGHT * (values.max() - values[:3]) / np.ptp(values)  # 1200 samples in 500 stretches
    extremes = first[np.sort([first.argmin(), first.argmax()])]  # in the order of their times
    assert up[:2] == pytest.approx(extremes, abs=0.06)
    assert f"from {values.min():.3g} to {values.max():.3g} N in 24 s" in sketch.words


def test_page_is_served_when_the_diagnosis_is_made(served, begin):
    begin.clear()
    status, _, text = served.get("/slow")
    assert (status, 'id="cancel"' in text) == (200, True)
    assert text.count("<polyline") == len(example_records())
    begin.set()
    assert ended(served, "/slow")["error"] == ""
    assert "Your own recordings" in served.get("/slow")[2]


def test_effects_can_be_kept_where_a_study_is_served(served):
    served.get("/records")
    ended(served, "/records")
    assert "Keep these effects in the study" in served.get("/records")[2]


def test_a_diagnosis_that_fails_says_why_and_may_be_tried_again(served, broken):
    for _ in range(2):
        status, _, text = served.get("/broken")
        assert status == 200 and "Try again" in text
        assert "no such folder" in ended(served, "/broken")["error"]


def test_long_messages_are_not_read(served):
    assert served.post("/_own/look", b"", Content_Length="2000000")[0] == 400  # which never come


def test_a_taken_port_is_named(served, explored):
    with pytest.raises(InputError, match=f"port {served.visitors.port}: .*--port"):
        new_server(Index("", ServedSets([explored])), served.visitors.port, OwnDiagnosis(None, Path()))


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
    with serving(lambda: new_server(index, 0, OwnDiagnosis(None, tmp_path))) as visitors:
        yield partial(ask, visitors, "GET")


def test_every_lift_has_its_address(get, saved_lift):
    status, _, page = get("/lifts/a%20lift")
    below_the_bar = [text.partition("<main>")[2] for text in (page, saved_lift[1])]
    assert status == 200 and below_the_bar[0] == below_the_bar[1] != ""
    status, _, words = get("/lifts/broken")
    assert status == 500 and "no body.csv" in words
    assert get("/lifts/another")[0] == 404
    assert get("/lifts/a%20lift", Host="somewhere.example")[0] == 404
