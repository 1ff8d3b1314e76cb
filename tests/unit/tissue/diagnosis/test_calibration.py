"""The calibration's own arithmetic: what counts as held, as named and as coloured."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from calibration_records import CONDITIONS, KNOWN, NOISES, effect_experiment, null_records
from calibration_tables import coverage, null_lines


def interval(noise: str, value: float, half: float) -> dict:
    own = {"effect": "delay", "noise": noise, "owner": np.nan, "parameter": "spring_stiffness", "refused": ""}
    return {**own, "true": 1.0, "value": value, "low": value - half, "high": value + half}


def test_an_interval_holds_the_truth_or_not():
    rows = [
        interval("white", 1.1, 0.2),
        interval("AR(1)", 1.1, 0.1),  # its end is the truth
        interval("1/f", 0.9, 0.05),
        {"effect": "delay", "noise": "1/f", "refused": "the fit did not converge"},
    ]
    found = coverage(pd.DataFrame(rows)).set_index("noise")
    assert found["held"].to_dict() == {"white": 1, "coloured": 1, "all": 2}
    assert found["count"].to_dict() == {"white": 1, "coloured": 2, "all": 3}
    assert set(found["owner"]) == {""}
    assert found.loc["coloured", "bias"] == pytest.approx(1.96 * (1 - 2) / 2)  # of two the median is the mean


def test_nulls_are_counted_by_condition():
    row = {"condition": "jitter", "verdict": "adequate", "named": "", "p_value": 0.03}
    named = {**row, "verdict": "named", "named": "backlash", "p_value": 0.001}
    lines = null_lines(pd.DataFrame([row, row, row, named]))
    cells = next(line for line in lines if line.startswith("| jitter")).strip("| ").split(" | ")
    assert cells[1:] == ["4", "1: 25.0 % (4.6–69.9)", "0", "4", "1"]


@pytest.mark.parametrize("known", KNOWN, ids=lambda item: item.label)
def test_known_effects_give_every_parameter_of_the_fitted_form(known):
    truth = effect_experiment(known, "white", 0).truth
    form = known.form
    assert {name for owner, name in truth if owner} == {item.name for item in (*form.linear, *form.nonlinear)}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_position_fault_leaves_the_force_as_it_was(condition):
    """The force repeats up to its noise of 3 % at most; the position where its sensor is sound, rounds or has another clock."""
    training, unseen = null_records(condition, "KV", 0)
    assert len(training) == (6 if condition == "clock skew" else 3) * len(unseen)
    position, force = (np.split(training[name], len(training) // 1000)[1:3] for name in ("input", "output"))
    repeats = condition in (*NOISES, "quantised position", "clock skew")
    assert np.allclose(*position, atol=1e-9) is repeats
    if condition != "clock skew":
        assert np.std(force[0] - force[1]) < np.sqrt(2) * 0.06 * np.std(force[0])
