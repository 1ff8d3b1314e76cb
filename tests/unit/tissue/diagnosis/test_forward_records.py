"""Forward records (force in, motion out): what is hidden is named in the motion's unit, by simulation from force to motion."""

import json
from dataclasses import replace

import numpy as np
import pytest
from force_driven import FORCE_IN, MASS, STEP, STIFFNESS, VISCOSITY, ZERO, forward_records, records_behind

import lumbar
from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.forward import forward_diagnosis
from lumbar.tissue.diagnosis.forward.forward_base import response_of
from lumbar.tissue.diagnosis.selection.result import DiagnosisState
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.fmu.build.effect_model import effect_model
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.fitted_model import FittedModel


@pytest.fixture(scope="module")
def friction():
    """Return records with Coulomb friction and their diagnosis."""
    records = forward_records("coulomb_friction")
    return records, lumbar.diagnose(records, train="train", settings=FORCE_IN)


@pytest.mark.nightly
@pytest.mark.parametrize("hidden", ["hysteresis", "hardening_stiffness"])
def test_what_is_hidden_is_named(hidden):
    found = lumbar.diagnose(forward_records(hidden), train="train", settings=FORCE_IN).result
    assert (found.status, found.selected, found.complete) == ("named", (hidden,), True)
    assert found.experiment.output_unit == "mm"


def test_nothing_is_named_where_nothing_is_hidden():
    found = lumbar.diagnose(forward_records("nothing"), train="train", settings=FORCE_IN)
    assert (found.result.status, found.selected) == ("adequate", ())
    assert found.result.base.fit.structure.base.name == "KV-mass"
    values = {item.name: (item.low, item.high, item.unit) for item in found.model.parameters}
    for name, value, unit in (
        ("mass", MASS, "N s^2/mm"), ("spring_stiffness", STIFFNESS, "N/mm"), ("viscosity", VISCOSITY, "N s/mm"),
    ):  # fmt: skip
        low, high, own = values[name]
        assert low < value < high
        assert own == unit
    assert found.model.output.offset == pytest.approx(ZERO, abs=0.001)


@pytest.mark.nightly
def test_the_friction_and_its_size_are_found(friction):
    _, found = friction
    told = found.result.status, found.selected, found.result.complete
    assert told == ("named", ("coulomb_friction",), True)
    assert found.model["coulomb_friction.coulomb_force"].value == pytest.approx(0.25, rel=0.02)
    assert 0.1 < found.result.base.test_rms < 0.2 and found.result.experiment.output_unit == "mm"


def test_the_model_is_written_and_read_back(friction):
    records, found = friction
    entry = json.loads(json.dumps(found.model.to_json()))
    assert entry["structure"]["forward"] is True
    again = FittedModel.from_json(entry, catalogues_with([]))
    for record in records:
        np.testing.assert_allclose(again.simulate(record), found.model.simulate(record), atol=1e-6)


def test_a_model_from_force_to_motion_is_not_exported(friction):
    with pytest.raises(InputError, match="it goes from force to motion"):
        effect_model(friction[1].model, STEP)


def test_compare_and_locate_are_in_the_unit_of_the_motion(friction):
    records, found = friction
    compared = lumbar.compare(records, found.model)
    assert compared["other"].comparison.vaf.value > 99.9
    assert "mm RMS" in str(compared)
    bare = lumbar.refine(records, [], train="train", settings=FORCE_IN)
    assert "mm of the error's" in str(bare.locate())


def test_effects_that_are_asked_for_are_added(friction):
    records, _ = friction
    refined = lumbar.refine(records, ["coulomb_friction"], base="KV-mass", train="train", settings=FORCE_IN)
    assert [item.fit.structure.effects for item in refined.path] == [(), ("coulomb_friction",)]
    assert refined.path[1].test_rms < 0.1 * refined.path[0].test_rms
    with pytest.raises(InputError, match="backlash: it cannot be added to KV-mass from force to motion"):
        lumbar.refine(records, ["backlash"], base="KV-mass", train="train", settings=FORCE_IN)


def test_what_a_hardening_spring_loses_is_found():
    records, effects = forward_records("viscoelastic"), ["hardening_stiffness"]
    found = lumbar.refine(records, effects, base="KV-mass", train="train", settings=FORCE_IN).model
    for name, value in (("cubic_stiffness", 0.4), ("cubic_damping", 0.02)):
        size = found[f"hardening_stiffness.{name}"]
        assert size.low < value < size.high and size.high < 2 * value


@pytest.mark.nightly
def test_a_sensor_that_gives_the_absolute_value(tmp_path):
    diagnosis = lumbar.diagnose(records_behind(np.abs), train="train", settings=FORCE_IN)
    found = diagnosis.result
    assert (found.status, found.selected) == ("named", ("absolute_value",))
    assert not found.is_searched_further
    diagnosis.save(tmp_path, pictures=False)
    with pytest.raises(InputError, match="linear dynamics behind a sensor"):
        lumbar.load_models(tmp_path / "refined.json")
    assert found.model.test_rms < 0.03
    assert found.path[0].test_rms > 5 * found.model.test_rms


def test_no_sensor_is_told_where_a_set_of_effects_that_was_not_selected_explains_more(friction, monkeypatch):
    _, found = friction
    known, after = found.result, replace(found.result.model, score=found.result.model.score + 100.0)
    monkeypatch.setattr(forward_diagnosis, "sensor_candidates", lambda *_: [(known.base, after)])
    for ranking, path in ((known.ranking, [known.base]), ([], [known.base, after])):
        before = replace(known, path=[known.base], ranking=ranking)
        state = DiagnosisState(found.records, found.settings, before)
        assert forward_diagnosis.check_motion_sensor(state).result.path == path


def test_the_response_of_a_base_is_that_of_its_transfer_function():
    linear, nonlinear = np.array([MASS, STIFFNESS, 2.0]), np.array([0.1])
    frequency = np.geomspace(0.01, 100, 50)
    s = 2j * np.pi * frequency
    expected = 1 / (MASS * s**2 + STIFFNESS + 2.0 * s / (s + 1 / 0.1))
    np.testing.assert_allclose(
        response_of(BASES["KB-mass"], linear, nonlinear)(frequency), expected, rtol=1e-9
    )
