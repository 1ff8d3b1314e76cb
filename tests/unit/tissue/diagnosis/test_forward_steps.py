"""Steps of the diagnosis of forward records: response of a base, and choice of a sensor."""

from dataclasses import replace

import numpy as np
from force_driven import FORCE_IN, MASS, STIFFNESS, forward_records

import lumbar
from lumbar.tissue.diagnosis.forward import forward_diagnosis
from lumbar.tissue.diagnosis.forward.forward_base import response_of
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState
from lumbar.tissue.models.bases import BASES


def test_sensor_is_not_selected_if_another_set_of_effects_explains_more(monkeypatch):
    diagnosis = lumbar.diagnose(forward_records("coulomb_friction"), train="train", settings=FORCE_IN)
    result, after = (
        diagnosis.result,
        replace(diagnosis.result.model, score=diagnosis.result.model.score + 100.0),
    )
    monkeypatch.setattr(forward_diagnosis, "sensor_candidates", lambda *_: [(result.base, after)])
    for ranking, path in ((result.ranking, [result.base]), ([], [result.base, after])):
        before = replace(result, path=[result.base], ranking=ranking)
        state = DiagnosisState(diagnosis.records, diagnosis.settings, before)
        assert forward_diagnosis.check_motion_sensor(state).result.path == path


def test_response_of_a_base_is_that_of_its_transfer_function():
    linear, nonlinear = np.array([MASS, STIFFNESS, 2.0]), np.array([0.1])
    frequency = np.geomspace(0.01, 100, 50)
    s = 2j * np.pi * frequency
    expected = 1 / (MASS * s**2 + STIFFNESS + 2.0 * s / (s + 1 / 0.1))
    response = response_of(BASES["KB-mass"], linear, nonlinear)
    np.testing.assert_allclose(response(frequency), expected, rtol=1e-9)
