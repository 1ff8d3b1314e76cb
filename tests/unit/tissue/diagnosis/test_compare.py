"""Comparison of a model with records by the public function: definitions, noise floor, and the table."""

import numpy as np
import pandas as pd
import pytest
from effect_entries import base_model, record_of_model
from periodic_records import multisine, noise

import lumbar

MODEL = base_model()


def periodic(error=0.0, seed: int = 1):
    """Return a record of ten periods with noise of 0.3 N and an error in proportion to the position."""
    position = multisine(10, seed=seed)
    added = error * position / np.std(position) + 0.3 * noise(len(position), seed + 10_000)
    return record_of_model(MODEL, position, lambda z, v, t: added, "multisine")


def aperiodic():
    return record_of_model(MODEL, noise(3000, 1, 0.97), lambda z, v, t: 0.3 * noise(3000, 2), "noise")


def test_values_follow_their_definitions():
    test = aperiodic()
    result = lumbar.compare([test], MODEL)["noise"].comparison
    measured, residual = test["output"][50:], (test["output"] - MODEL.simulate(test))[50:]
    assert result.samples == 2950
    assert result.rms.value == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert result.vaf.value == pytest.approx(100 * (1 - np.var(residual) / np.var(measured)))
    assert result.fit.value == pytest.approx(100 * (1 - np.sqrt(np.mean(residual**2)) / np.std(measured)))
    assert result.mean_residual.value == pytest.approx(np.mean(np.abs(residual)))
    for estimate in (result.rms, result.vaf, result.fit, result.mean_residual):
        assert estimate.low < estimate.value < estimate.high
    assert result.explainable_rms is None and result.is_noise is None


def test_noise_and_explainable_error_add_up():
    test = periodic(0.4)
    result = lumbar.compare([test], MODEL)["multisine"].comparison
    assert result.floor_from == "multisine"
    assert result.explainable_rms == pytest.approx(0.4, rel=0.03)
    assert result.rms.value**2 == pytest.approx(result.explainable_rms**2 + result.floor.rms**2)
    variance = np.var(test["output"][50:])
    assert result.explainable_percent == pytest.approx(100 * 0.16 / variance, rel=0.06)
    assert result.explainable_vaf == pytest.approx(100 * (1 - 0.16 / (variance - 0.09)), abs=0.03)
    assert not result.is_noise


def test_true_model_leaves_noise():
    result = lumbar.compare([periodic()], MODEL)["multisine"].comparison
    assert result.is_noise
    assert result.explainable_vaf > 99.9


def test_table_has_comparisons_of_all_records(tmp_path):
    comparisons = lumbar.compare([periodic(), aperiodic()], MODEL, train="multisine")
    comparisons.save(tmp_path)
    table, results = pd.read_csv(tmp_path / "compare.csv"), [item.comparison for item in comparisons.reports]
    assert list(table["record"]) == ["multisine", "noise"]
    assert list(table["noise_floor_from"]) == ["multisine", "multisine"]
    assert table["rms"].tolist() == pytest.approx([item.rms.value for item in results])
    assert table["vaf_percent"].tolist() == pytest.approx([item.vaf.value for item in results])
    lumbar.compare([aperiodic()], MODEL).save(tmp_path)
    assert pd.read_csv(tmp_path / "compare.csv")["noise_floor_rms"].isna().all()
