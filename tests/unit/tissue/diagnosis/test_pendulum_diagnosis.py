"""Pendulums diagnosed blind: the experiments come from Newton's law, labels are read by assertions only."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of

from lumbar.base.errors import InputError
from lumbar.records.record import Channel
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refine, refined_document
from lumbar.tissue.diagnosis.selection.verdict import details, headline
from lumbar.tissue.effects.catalogue import CATALOGUES, PENDULUM
from lumbar.tissue.models.fitted_model import read_models

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
    assert (diagnosis.verdict, diagnosis.selected) == ("named", (effect,))
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
    assert (diagnosis.verdict, diagnosis.selected) == ("named", (effect,))
    missing = {role for form, roles in diagnosis.not_tried if form.effect == effect for role in roles}
    assert missing


@pytest.mark.parametrize("effect", ["passive_stiffness", "coulomb_friction"])
def test_records_that_do_not_repeat_are_enough(effect):
    _, diagnosis = diagnosed(effect, 1, periodic=False)
    assert diagnosis.experiment.floor is None
    assert diagnosis.complete is None
    assert (diagnosis.verdict, diagnosis.selected) == ("named", (effect,))


@pytest.mark.statistical
@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_accused_where_nothing_is_hidden(seed):
    assert diagnosed("", seed)[1].verdict == "adequate"
    assert diagnosed("", seed, periodic=False)[1].verdict == "adequate"


def test_a_rounded_angle_is_no_effect():
    experiment = make_pendulum_experiment("drag", 5, 8.0)
    records = []
    for record in records_of(experiment.records):
        rounded = replace(record.channels["input"], values=np.round(record["input"], 4))
        records.append(replace(record, channels={**record.channels, "input": rounded}))
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


def test_the_diagnosis_says_what_it_could_not_try():
    _, diagnosis = diagnosed("drag", 0, STRENGTHS[0])
    assert "The pendulum model is missing drag" in headline(diagnosis)
    told = [line for line in details(diagnosis, PENDULUM) if line.startswith("Not tried")]
    assert told == [
        "Not tried: hand load as measured, for want of box_held in the records.",
        "Not tried: variable length as measured, for want of length_m in the records.",
        "Not tried: moving pivot as measured, for want of pivot_acceleration_x_m_s2 and "
        "pivot_acceleration_z_m_s2 in the records.",
    ]
    listed = diagnosis.to_json()["not_tried"]
    assert {"effect": "hand_load", "form": "measured_hanging", "missing_channels": ["box_held"]} in listed
    _, complete = diagnosed("hand_load", 0, STRENGTHS[0])
    assert not any("box_held" in line for line in details(complete, PENDULUM))


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


def test_a_channel_in_some_records_only_is_told():
    first, second, third = records_of(make_pendulum_experiment("drag", 0).records)
    length = Channel(np.ones(len(second)), "length", "m")
    second = replace(second, channels={**second.channels, "length": length})
    with pytest.raises(InputError, match="length is length in m, but missing in sway"):
        diagnose([first, second, third], PENDULUM_BASE)
