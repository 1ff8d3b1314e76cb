"""Diagnosis of labelled blind experiments, tissues and pendulums, and of known records: labels are read by assertions only."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from periodic_records import multisine, noise, record

import lumbar
from lumbar.base.errors import InputError, NumericalError
from lumbar.interface.reading import read
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refine, refined_document
from lumbar.tissue.diagnosis.selection.sentences import explain
from lumbar.tissue.diagnosis.selection.thresholds import NullDistribution, null_distribution, number_of_forms
from lumbar.tissue.effects.catalogue import CATALOGUES, PENDULUM, TISSUE
from lumbar.tissue.models.fitted_model import read_models
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of


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
    assert case(name).status == ("named" if labels[name]["effects"] else "adequate")


@pytest.mark.statistical
def test_every_effect_is_found_and_nothing_is_accused_where_nothing_is_hidden(blind, labels):
    """One effect is named, both of two are found; what explains everything leaves noise."""
    for name, label in labels.items():
        found, hidden = blind[name], label["effects"]
        assert set(found.selected) == set(hidden), name
        assert len(hidden) > 1 or found.status == ("named" if hidden else "adequate"), name
        assert (found.refined_status, found.complete, found.further) == ("adequate", True, None), name
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


def test_result_lists_the_steps_and_the_one_that_decided(case):
    found = case("case_03")
    assert [item["step"] for item in found.to_json()["steps"]] == [item.step for item in found.steps]
    assert [item.step for item in found.steps][:5] == [
        "repair sensor faults",
        "estimate the noise floor",
        "check direction and signs",
        "choose the base",
        "select effects",
    ]
    assert found.decided_by.step == "find ties" and found.decided_by.status == found.status == "named"
    assert [line.split(":")[0] for line in explain(found)] == [item.step for item in found.steps]
    assert [line.endswith("[decided: named]") for line in explain(found)].count(True) == 1


def test_exchanged_channels_with_a_sensor_fault_are_reported_and_saved(shared, tmp_path):
    records = read(shared / "hidden_effects" / "case_03")
    exchanged = [item.with_values(input=item["output"], output=item["input"]) for item in records]
    diagnosis = lumbar.diagnose(exchanged)
    assert diagnosis.result.orientation.kind == "direction" and not diagnosis.selected
    assert diagnosis.result.decided_by.step == "check direction and signs"
    diagnosis.save(tmp_path, pictures=False)
    assert {item.name for item in tmp_path.iterdir()} >= {"diagnosis.json", "diagnosis.html", "refined.json"}


def test_diagnosed_again_the_second_effect_is_named(shared):
    """The search may take one effect; the catalogue holds the other one, and it must not be denied."""
    records = read(shared / "hidden_effects" / "case_13")
    one_of_two = diagnose(records, DiagnosisSettings(most_effects=1))
    assert (one_of_two.status, one_of_two.selected) == ("named", ("hardening_stiffness",))
    assert (one_of_two.refined_status, one_of_two.complete) == ("named", False)
    assert one_of_two.further.effects == ("hardening_stiffness", "coulomb_friction")
    assert one_of_two.to_json()["further"] == "coulomb_friction"


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
    records = [
        synthetic(name, lambda time, position: 0.6 * position, seed) for name, seed in (("a", 1), ("b", 2))
    ]
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
        assert 0.9 <= null_distribution(system).forms / number_of_forms(catalogue) <= 1


@pytest.mark.parametrize(("floors", "after"), [(1.05, "adequate"), (1.15, "adequate"), (1.30, "unexplained")])
def test_completeness_and_the_status_of_the_refined_model_follow_from_one_rule(floors, after):
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
    assert (found.refined_status, found.complete, found.further) == (after, after == "adequate", None)


def springs(stiffness: dict[str, np.ndarray | float]) -> list:
    made = []
    for seed, (name, value) in enumerate(stiffness.items()):
        position = multisine(4, 500, range(1, 8), seed)
        made.append(record(position, value * position + 0.01 * noise(len(position), seed + 5), name))
    return made


def told(records, kind: str, **settings):
    found = diagnose(records, DiagnosisSettings(base="LE", train="a", most_effects=1, **settings))
    return found, [item for item in found.findings if item.kind == kind]


def test_the_model_is_tried_the_other_way_where_only_training_is_explained():
    _, (finding,) = told(springs({"a": 0.8, "b": 0.9, "c": 0.9}), "trained_otherwise")
    spread = float(np.std(multisine(4, 500, range(1, 8), 0)))
    assert finding.value == pytest.approx(0.1 * spread, rel=0.05)
    assert finding.unit == "N"


def test_nothing_is_tried_where_unseen_records_are_explained_too():
    assert not told(springs({"a": 0.8, "b": 0.8}), "trained_otherwise")[1]


def test_records_that_hardly_move_are_not_trained_on():
    records = springs({"a": 0.8, "b": 0.9})
    small = records[1].with_values(input=0.02 * records[1]["input"], output=0.04 * records[1]["output"])
    assert not told([records[0], small], "trained_otherwise")[1]


@pytest.mark.nightly
def test_one_session_is_suggested_where_the_stiffness_falls_cycle_by_cycle():
    worn = np.repeat(0.9 * 0.99 ** np.arange(8), 500)
    _, (finding,) = told(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness")
    assert finding.value == pytest.approx(0.9 * 0.99**7, rel=0.01) and finding.unit == "N/mm"
    rest = springs({"a": worn[:2000], "b": worn[:2000]})
    assert not told(rest, "falling_stiffness")[1]
    assert not told(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness", session=True)[1]


PENDULUM_BASE = DiagnosisSettings(base="pendulum")
STRENGTHS = (4.0, 8.0, 16.0)


@cache
def diagnosed(effect, seed, strength=8.0, columns=True, periodic=True):
    experiment = make_pendulum_experiment(effect, seed, strength, columns, periodic)
    return experiment, diagnose(records_of(experiment.records), PENDULUM_BASE)


@pytest.mark.statistical
@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize(("seed", "strength"), list(enumerate(STRENGTHS)))
def test_every_effect_is_named(effect, seed, strength):
    experiment, diagnosis = diagnosed(effect, seed, strength)
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))
    assert diagnosis.model.test_rms < 1.25 * experiment.noise_rms
    floor = diagnosis.experiment.floor
    if effect in ("hand_load", "variable_length", "moving_pivot"):
        # The angle repeats; box, length and pivot do not, and what differs between periods is theirs.
        assert floor is None
        assert diagnosis.complete is None
    else:
        assert diagnosis.complete
        assert floor.rms == pytest.approx(experiment.noise_rms, rel=0.1)


@pytest.mark.parametrize("effect", ["hand_load", "variable_length", "moving_pivot"])
@pytest.mark.parametrize("seed", range(2))
def test_box_length_and_pivot_are_named_from_the_angle_alone(effect, seed):
    _, diagnosis = diagnosed(effect, seed, columns=False)
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))
    missing = {role for form, roles in diagnosis.not_tried if form.effect == effect for role in roles}
    assert missing


@pytest.mark.parametrize("effect", ["passive_stiffness", "coulomb_friction"])
def test_records_that_do_not_repeat_are_enough(effect):
    _, diagnosis = diagnosed(effect, 1, periodic=False)
    assert diagnosis.experiment.floor is None
    assert diagnosis.complete is None
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))


@pytest.mark.statistical
@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_accused_where_nothing_is_hidden(seed):
    assert diagnosed("", seed)[1].status == "adequate"
    assert diagnosed("", seed, periodic=False)[1].status == "adequate"


def test_a_rounded_angle_is_no_effect():
    experiment = make_pendulum_experiment("drag", 5, 8.0)
    records = []
    for swing in records_of(experiment.records):
        rounded = replace(swing.channels["input"], values=np.round(swing["input"], 4))
        records.append(replace(swing, channels={**swing.channels, "input": rounded}))
    diagnosis = diagnose(records, PENDULUM_BASE)
    assert diagnosis.selected == ("drag",)
    assert diagnosis.complete


@pytest.mark.parametrize(
    ("effect", "names"),
    [
        ("hand_load", {"box_mass": "box_kg", "hand_distance": "box_m"}),
        ("variable_length", {"moving_mass": "body_kg"}),
    ],
)
def test_masses_and_distances_are_found(effect, names):
    experiment, diagnosis = diagnosed(effect, 2, 16.0)
    found = {item.name: item for item in diagnosis.ranking[0].estimates}
    for name, truth in names.items():
        spread = (found[name].high - found[name].low) / 2
        assert abs(found[name].value - experiment.truth[truth]) < 2 * spread
        assert spread < 0.2 * found[name].value


def test_refinement_and_its_model_as_plain_data():
    experiment = make_pendulum_experiment("moving_pivot", 2, 12.0)
    records = records_of(experiment.records)
    prepared, ladder = refine(records, ["moving_pivot"], PENDULUM_BASE)
    assert ladder[1].test_rms < 0.2 * ladder[0].test_rms
    content = json.loads(json.dumps(refined_document(ladder, prepared, "test")))
    model = read_models(content, CATALOGUES)[1]
    assert model.name == "pendulum+moving_pivot"
    assert model == fitted_model(ladder[1], prepared)
    again = model.simulate(records[1])
    assert np.sqrt(np.mean((again - records[1]["output"])[50:] ** 2)) < 1.1 * experiment.noise_rms
    own = DiagnosisSettings(base="pendulum", catalogue={"drag": PENDULUM["drag"]})
    with pytest.raises(InputError, match="unknown effect moving_pivot; known are drag"):
        refine(records, ["moving_pivot"], own)


def test_an_effect_that_needs_what_was_not_recorded_is_refused():
    measured = replace(PENDULUM["variable_length"], forms=PENDULUM["variable_length"].forms[:2])
    settings = DiagnosisSettings(base="pendulum", catalogue={"variable_length": measured})
    records = records_of(make_pendulum_experiment("drag", 0).records)
    with pytest.raises(
        InputError, match="variable_length needs channels that the records do not have: length"
    ):
        refine(records, ["variable_length"], settings)


def test_a_constant_moment_is_the_persons_and_no_zero_of_a_sensor():
    records = records_of(make_pendulum_experiment("drag", 0).records)
    pulled = []
    for item in records:
        moment = item.channels["output"]
        channels = {**item.channels, "output": replace(moment, values=moment.values + 30.0)}
        pulled.append(replace(item, channels=channels))
    _free, (model,) = refine(records, [], PENDULUM_BASE)
    _held, (without_zero,) = refine(pulled, [], PENDULUM_BASE)
    assert (model.fit.zero, without_zero.fit.zero) == (0.0, 0.0)
    assert without_zero.train_rms > model.train_rms + 10
