"""The diagnosis on labelled blind experiments and on records with known truth: labels are read by assertions only."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from periodic_records import record

from lumbar.base.errors import InputError, NumericalError
from lumbar.interface.reading import read
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.refine import refine
from lumbar.tissue.diagnosis.selection.thresholds import NullDistribution, null_distribution
from lumbar.tissue.diagnosis.selection.verdict import details, headline
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE


@pytest.fixture(scope="module")
def case(shared):
    """Return a function that diagnoses a blind experiment, without its labels."""
    return cache(lambda name: diagnose(read(shared / "hidden_effects" / name)))


@pytest.fixture(scope="module")
def blind(shared, case):
    """Diagnoses of all blind experiments."""
    return {folder.name: case(folder.name) for folder in sorted((shared / "hidden_effects").glob("case_*"))}


@pytest.fixture(scope="module")
def labels(shared):
    return json.loads((shared / "hidden_effects" / "labels.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["case_03", "case_13", "case_14"])
def test_one_effect_both_of_two_and_none_are_told(case, labels, name):
    assert set(case(name).selected) == set(labels[name]["effects"])
    assert case(name).verdict == ("named" if labels[name]["effects"] else "adequate")
    assert headline(case(name)).startswith("Nothing is missing") == (not labels[name]["effects"])


@pytest.mark.statistical
def test_every_effect_is_found_and_nothing_is_accused_where_nothing_is_hidden(blind, labels):
    """One effect is named, both of two are found; what explains everything leaves noise."""
    for name, label in labels.items():
        found, hidden = blind[name], label["effects"]
        assert set(found.selected) == set(hidden), name
        assert len(hidden) > 1 or found.verdict == ("named" if hidden else "adequate"), name
        assert (found.verdict_after, found.complete, found.further) == ("adequate", True, None), name
        assert found.experiment.floor.rms == pytest.approx(label["noise_rms_N"], rel=0.1)
        assert not hidden or found.ranking[0].p_value <= 0.01, name
    assert {len(label["effects"]) for label in labels.values()} == {0, 1, 2}
    ratio = [blind[name].model.test_rms / label["noise_rms_N"] for name, label in labels.items()]
    assert np.median(ratio) <= 1.05 and max(ratio) <= 1.25


def test_json_keeps_the_contract(case):
    content = case("case_03").to_json()
    assert content["schema"] == "lumbar.diagnosis/1"
    assert {
        "schema", "base", "train", "unit", "verdict", "complete", "selected", "tied_with", "noise_floor_rms",
        "explainable_share_removed", "ranking", "ladder",
    } <= set(content)  # fmt: skip
    first = content["ranking"][0]
    assert {"effects", "train_rms", "test_rms", "p_value", "parameters"} <= set(first)
    assert {"value", "low", "high", "unit"} <= set(first["parameters"]["coulomb_force"])
    assert [rung["effects"] for rung in content["ladder"]] == [[], ["coulomb_friction"]]
    assert content["ladder"][1]["test_rms"] < content["ladder"][0]["test_rms"]


def test_diagnosed_again_the_second_effect_is_named(shared):
    """The search may take one effect; the catalogue holds the other one, and it must not be denied."""
    records = read(shared / "hidden_effects" / "case_13")
    one_of_two = diagnose(records, DiagnosisSettings(most_effects=1))
    assert (one_of_two.verdict, one_of_two.selected) == ("named", ("hardening_stiffness",))
    assert (one_of_two.verdict_after, one_of_two.complete) == ("named", False)
    assert one_of_two.further.effects == ("hardening_stiffness", "coulomb_friction")
    assert one_of_two.to_json()["further"] == "coulomb_friction"
    said = [line for line in details(one_of_two, TISSUE) if line.startswith("Diagnosed again")]
    assert [line.split(":")[0] for line in said] == ["Diagnosed again, coulomb friction is missing too"]


def synthetic(name, force, seed, seconds=40):
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, 0.01)
    lines = np.arange(1, 41) * 0.1
    position = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 6.28, 40)) @ lines**-0.5
    position *= 5 / np.abs(position).max()
    clean = force(time, position)
    values = clean + 0.01 * random.standard_normal(len(time))
    return record(position, values, name, source=name)


def test_what_refinement_cannot_add_is_refused():
    records = [synthetic(name, lambda time, position: 0.6 * position, 1) for name in "ab"]
    with pytest.raises(InputError, match="unknown effect"):
        refine(records, ["glue"], DiagnosisSettings())
    with pytest.raises(NumericalError, match="leave it out"):
        refine(records, ["delay"], DiagnosisSettings(base="LE"))


def test_p_values_of_the_null_table():
    table = NullDistribution(np.sort(np.random.default_rng(1).chisquare(2, 2000)), 28)
    assert table.p_value(-1.0) == 1.0
    assert table.p_value(np.log(2) * 2) == pytest.approx(0.5, abs=0.04)
    assert table.p_value(40.0) == pytest.approx(np.exp(-20), rel=0.5)
    assert table.p_value(10.0, forms=56) == pytest.approx(2 * table.p_value(10.0))
    assert len(null_distribution().ratios) >= 200
    for system, catalogue in CATALOGUES.items():
        # Of candidates that have come since, the probability grows in proportion.
        assert (
            0.9
            <= null_distribution(system).forms / sum(len(effect.forms) for effect in catalogue.values())
            <= 1
        )


@pytest.mark.parametrize(
    ("floors", "after", "said"),
    [
        (1.05, "adequate", "What is left is noise as far as can be told"),
        (1.15, "adequate", "Diagnosed again, none of the most promising further effects passes"),
        (1.30, "unexplained", "Diagnosed again, something unexplained is left and none of the most"),
    ],
)
def test_completeness_and_the_verdict_on_the_refined_model_follow_from_one_rule(floors, after, said):
    """A refined model whose unseen error is a given number of noise floors, and a catalogue without further effects."""

    def stiffening(time, position):
        return 0.6 * position + 0.01 * position**3

    catalogue = {"hardening_stiffness": TISSUE["hardening_stiffness"]}
    records = [synthetic("a", stiffening, 1), synthetic("b", stiffening, 2, 40)]
    settings = DiagnosisSettings(base="LE", catalogue=catalogue)
    floor = diagnose(records, settings).experiment.floor.rms
    other = np.sin(np.arange(len(records[1])) * 0.37) * np.sqrt(2 * (floors**2 - 1)) * floor
    force = replace(records[1].channels["output"], values=records[1]["output"] + other)
    disturbed = replace(records[1], channels={**records[1].channels, "output": force})
    found = diagnose([records[0], disturbed], settings)
    assert found.model.test_rms / found.experiment.floor.rms == pytest.approx(floors, abs=0.03)
    assert (found.verdict_after, found.complete, found.further) == (after, after == "adequate", None)
    assert any(line.startswith(said) for line in details(found, catalogue))


def test_a_long_search_says_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr("lumbar.base.progress._EVERY_S", 0.0)
    catalogue = {name: TISSUE[name] for name in ("hardening_stiffness", "drift")}
    records = [synthetic("a", lambda time, position: 0.6 * position, 1)]
    diagnose(records, DiagnosisSettings(base="LE", catalogue=catalogue))
    assert "forms of effects fitted beside LE: 1 of " in capsys.readouterr().err
