"""Forward records (force in, motion out): effects are named in the motion's unit, by simulation from force to motion."""

import re
from dataclasses import replace

import numpy as np
import pytest
from force_driven import FORCE_IN, MASS, STIFFNESS, VISCOSITY, ZERO, forward_records, records_behind

import lumbar
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.forward import forward_diagnosis
from lumbar.tissue.diagnosis.forward.forward_base import response_of
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES

KEYWORDS = {"train": "train", "settings": FORCE_IN}


@pytest.fixture(scope="module")
def friction():
    """Return records with Coulomb friction and a model with it."""
    records = forward_records("coulomb_friction")
    return records, lumbar.refine(records, ["coulomb_friction"], base="KV-mass", **KEYWORDS)


def test_one_of_few_candidates_is_named_and_a_worse_sensor_is_not_selected(monkeypatch):
    """A model of the sensor is not selected if another set of effects explains more."""
    catalogue = {name: TISSUE[name] for name in ("hardening_stiffness", "quadratic_damping")}
    settings = DiagnosisSettings("KV-mass", train="train", catalogue=catalogue, most_effects=1, forward=True)
    records = forward_records("quadratic_damping")
    result = diagnose(records, settings)
    assert (result.status, result.selected, result.complete) == ("named", ("quadratic_damping",), True)
    after = replace(result.model, score=result.model.score + 100.0)
    monkeypatch.setattr(forward_diagnosis, "sensor_candidates", lambda *_: [(result.base, after)])
    for ranking, path in ((result.ranking, [result.base]), ([], [result.base, after])):
        state = DiagnosisState(records, settings, replace(result, path=[result.base], ranking=ranking))
        assert forward_diagnosis.check_motion_sensor(state).result.path == path


@pytest.mark.nightly
@pytest.mark.parametrize("hidden", ["hysteresis", "hardening_stiffness"])
def test_hidden_effect_is_named(hidden):
    result = lumbar.diagnose(forward_records(hidden), **KEYWORDS).result
    assert (result.status, result.selected, result.complete) == ("named", (hidden,), True)
    assert result.experiment.output_unit == "mm"


def test_linear_records_need_no_effect_and_give_the_parameters():
    diagnosis = lumbar.diagnose(forward_records("nothing"), **KEYWORDS)
    assert (diagnosis.result.status, diagnosis.selected) == ("adequate", ())
    assert diagnosis.result.base.fit.structure.base.name == "KV-mass"
    expected = {
        "mass": (MASS, "N s^2/mm"),
        "spring_stiffness": (STIFFNESS, "N/mm"),
        "viscosity": (VISCOSITY, "N s/mm"),
    }
    for name, (value, unit) in expected.items():
        parameter = diagnosis.model[name]
        assert parameter.low < value < parameter.high
        assert parameter.unit == unit
    assert diagnosis.model.output.offset == pytest.approx(ZERO, abs=0.001)


@pytest.mark.nightly
def test_friction_is_found_with_its_size():
    diagnosis = lumbar.diagnose(forward_records("coulomb_friction"), **KEYWORDS)
    result = diagnosis.result
    assert (result.status, result.selected, result.complete) == ("named", ("coulomb_friction",), True)
    assert diagnosis.model["coulomb_friction.coulomb_force"].value == pytest.approx(0.25, rel=0.02)
    assert 0.1 < result.base.test_rms < 0.2 and result.experiment.output_unit == "mm"


def test_model_is_saved_and_loaded_but_not_exported(friction, tmp_path):
    records, refined = friction
    refined.save(tmp_path)
    loaded = lumbar.load_models(tmp_path / "refined.json")[-1]
    for record in records:
        np.testing.assert_allclose(loaded.simulate(record), refined.model.simulate(record), atol=1e-6)
    with pytest.raises(lumbar.InputError, match=r"\bstructure: .*improvement\.forward\b"):
        lumbar.export_fmu(refined.model, tmp_path / "fmu")


def test_compare_and_locate_are_in_the_unit_of_the_motion(friction):
    records, refined = friction
    compared = lumbar.compare(records, refined.model)
    assert compared["other"].comparison.vaf.value > 99.9
    assert re.search(r"\d mm\b", str(compared))
    bare = lumbar.refine(records, [], **KEYWORDS)
    assert re.search(r"\d mm\b", str(bare.locate()))


def test_requested_effects_are_added(friction):
    records, refined = friction
    assert [item.fit.structure.effects for item in refined.path] == [(), ("coulomb_friction",)]
    assert refined.path[1].test_rms < 0.1 * refined.path[0].test_rms
    with pytest.raises(lumbar.InputError, match=r"^backlash: .*\bKV-mass\b.*\bcoulomb_friction\b"):
        lumbar.refine(records, ["backlash"], base="KV-mass", **KEYWORDS)


def test_loss_of_a_hardening_spring_is_found():
    records = forward_records("viscoelastic")
    model = lumbar.refine(records, ["hardening_stiffness"], base="KV-mass", **KEYWORDS).model
    for name, value in (("cubic_stiffness", 0.4), ("cubic_damping", 0.02)):
        size = model[f"hardening_stiffness.{name}"]
        assert size.low < value < size.high and size.high < 2 * value


@pytest.mark.nightly
def test_sensor_of_the_absolute_value_is_found(tmp_path):
    diagnosis = lumbar.diagnose(records_behind(np.abs), **KEYWORDS)
    result = diagnosis.result
    assert (result.status, result.selected) == ("named", ("absolute_value",))
    assert not result.is_searched_further
    diagnosis.save(tmp_path, pictures=False)
    with pytest.raises(lumbar.InputError, match=r"refined\.json\b(.|\n)*\bmodels: .*\bdiagnosis\.json\b"):
        lumbar.load_models(tmp_path / "refined.json")
    assert result.model.test_rms < 0.03
    assert result.path[0].test_rms > 5 * result.model.test_rms


def test_response_of_a_base_is_that_of_its_transfer_function():
    linear, nonlinear = np.array([MASS, STIFFNESS, 2.0]), np.array([0.1])
    frequency = np.geomspace(0.01, 100, 50)
    s = 2j * np.pi * frequency
    expected = 1 / (MASS * s**2 + STIFFNESS + 2.0 * s / (s + 1 / 0.1))
    response = response_of(BASES["KB-mass"], linear, nonlinear)
    np.testing.assert_allclose(response(frequency), expected, rtol=1e-9)
