"""Statistics behind the location of errors: lines, trends, correlations, reversals, and their sizes under noise only."""

import json

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, noisy_record, record, relaxing_force
from scipy.signal import lfilter
from scipy.stats import kendalltau

from lumbar.interface.reading import read
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.candidate_causes import cross_correlation, rank_causes
from lumbar.tissue.diagnosis.residuals.locate import Location, residual_after, residual_of
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversals
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.residuals.time_frequency import (
    EVEN,
    EXCITED,
    ODD,
    excited_lines,
    line_classes,
    mann_kendall_p,
)


def locate(record, simulated, *noise, **start):
    residual = residual_after(record, simulated, *noise, **start)
    return Location.of_residual(record.name, residual, rank_causes([residual]))


def test_lines_are_found_and_classed():
    lines = np.array([line for line in range(1, 50, 2) if line % 9 != 0])
    result = excited_lines(multisine(1, 500, lines))
    assert list(result) == list(lines)
    classes = line_classes(result, 60)
    assert classes[9] == classes[27] == classes[51] == ODD
    assert classes[0] == classes[2] == classes[58] == EVEN
    assert classes[1] == EXCITED
    assert excited_lines(multisine(1, 500) + 1e-4 * noise(500, 1)).tolist() == list(range(1, 26))


@pytest.mark.statistical
@pytest.mark.parametrize(("pole", "repeating"), [(0.0, True), (0.9, True), (0.0, False)])
def test_sizes_under_the_null(pole, repeating):
    """At the 5 % level no test of a true model's residual rejects in clearly more than 5 % of the cases."""
    trials = 300 if pole == 0.0 and repeating else 150
    p_values: dict[str, list[float]] = {}
    accused = 0
    for seed in range(trials):
        test = noisy_record(6, 0.3, seed, pole, samples=160)
        floor = noise_floor(test, period=1.6)
        location = locate(test, relaxing_force(test["input"]), floor, "" if repeating else "another")
        accused += not location.is_noise
        for name, value in location.p_values.items():
            p_values.setdefault(name, []).append(value)
        for kind in ("p even", "p odd"):
            p_values.setdefault(kind, []).append(location.views["candidate causes"].numbers[kind])
    # Three standard errors, and a little for the noise's spectrum being estimated.
    scatter = 3 * np.sqrt(0.05 * 0.95 / trials)
    allowed = 0.05 + scatter + (0.01 if pole == 0 else 0.03)
    rejected = {name: np.mean(np.array(values) < 0.05) for name, values in p_values.items()}
    assert max(rejected.values()) <= allowed, rejected
    assert accused / trials <= 0.05 + scatter


def test_mann_kendall_agrees_with_kendalls_tau():
    values = noise(40, 3) + 0.03 * np.arange(40)
    assert mann_kendall_p(values) == pytest.approx(kendalltau(np.arange(40), values).pvalue, abs=0.02)
    assert mann_kendall_p(np.arange(10.0)) < 0.001


def test_cross_correlation_is_the_sum_it_says():
    test = noisy_record(6, 0.3, 2)
    residual = residual_after(test, relaxing_force(test["input"]), noise_floor(test))
    signal = residual.position - residual.position.mean()
    result = cross_correlation(residual, signal)
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    direct = [np.sum(residual.values * np.roll(signal, lag)) / scale for lag in result.lags]
    assert result.values == pytest.approx(direct, abs=1e-12)
    assert result.limit == pytest.approx(1.96 / np.sqrt(len(signal)), rel=0.1)


def test_reversals_of_a_noisy_triangle():
    position = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, -1, 200), np.linspace(-1, 0.5, 150)])
    turns, directions = reversals(position + 0.01 * noise(450, 1))
    assert directions.tolist() == [-1, 1]
    assert turns == pytest.approx([100, 300], abs=4)


def test_velocity_of_a_noisy_position_is_steadied():
    time = np.arange(2000) * STEP
    position = 5 * np.sin(2 * np.pi * 0.5 * time)
    expected = 5 * np.pi * np.cos(2 * np.pi * 0.5 * time)
    assert steady_velocity(position, STEP)[5:-5] == pytest.approx(expected[5:-5], abs=0.01)
    noisy = steady_velocity(position + 0.05 * noise(2000, 1), STEP)
    assert np.std(noisy - expected) < 0.15 * np.std(expected)


FIRST_VIEWS = {
    "hardening_stiffness": {"depth"},
    "quadratic_stiffness": {"depth"},
    "coulomb_friction": {"position and velocity"},
    "depth_dependent_damping": {"position and velocity"},
    "delay": {"linear dynamics"},
    "inertia": {"linear dynamics"},
    "second_relaxation": {"linear dynamics"},
    "softening": {"time"},
    "periodic_disturbance": {"time"},
    "drift": {"time"},
    "contact_loss": {"depth", "position and velocity"},
    "saturation": {"depth", "position and velocity"},
    "quadratic_damping": {"position and velocity"},
    "hysteresis": {"reversals"},
    "backlash": {"reversals"},
}
"""Causes of the force of each effect."""


@pytest.mark.statistical
def test_hidden_effects(shared):
    """On all records together what comes first is what the hidden effect depends on; on a chirp alone it often is not."""
    labels = json.loads((shared / "hidden_effects" / "labels.json").read_text())
    for case, label in labels.items():
        seen = read(shared / "hidden_effects" / case)
        tests = [seen[name] for name in ("multisine", "noise", "chirp")]
        step = tests[0].sampling_time
        # The base model with its true time constant, stiffnesses by least squares.
        decay = np.exp(-step / label["tau_s"])
        held = label["tau_s"] * (1 - decay) / step
        columns = {}
        for test in tests:
            position = test["input"]
            branch = lfilter([held, -held], [1, -decay], position - position[0])
            columns[test.name] = np.column_stack([position, branch])
        stiffness = np.linalg.lstsq(columns["multisine"][50:], tests[0]["output"][50:], rcond=None)[0]
        experiment = prepare(tests, "multisine")
        residuals = [residual_of(test, columns[test.name] @ stiffness, experiment) for test in tests]
        first = locate(tests[0], columns["multisine"] @ stiffness, experiment.floor, start=0.5)
        if not label["effects"]:
            assert first.is_noise or first.is_all_but_noise, case
        else:
            causes = rank_causes(residuals)
            views = set().union(*(FIRST_VIEWS[name] for name in label["effects"]))
            assert causes[0].name in views, (case, label["effects"], causes)


def test_position_at_rest_with_a_noise_floor_has_no_relation_to_the_error():
    position = np.minimum(np.arange(2000) / 40, 1.0)
    hold = record(position, 0.7 * position + 0.02 * noise(2000, 1), "hold")
    floor = noise_floor(noisy_record(10, 0.02, 1))
    location = locate(hold, 0.5 * position, floor, "multisine", start=0.5)
    assert (
        location.shares["depth"] == location.shares["reversals"] == location.views["frequency"].share == 0.0
    )
    assert location.causes[0].name == "constant offset"
