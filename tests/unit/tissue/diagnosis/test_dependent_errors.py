"""Intervals of fits whose errors depend on one another, against closed forms and over simulated experiments."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit
from lumbar.tissue.diagnosis.fitting.uncertainty import (
    are_white,
    correlation_times,
    estimates,
    scaled_covariance,
    score_covariance,
)
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

STEP = 0.01
SAMPLES = 4000
STIFFNESS, VISCOSITY = 0.8, 0.05
TISSUE = Structure(BASES["KV"])


def autoregressive(random, size: int, pole: float, columns: int = 1) -> np.ndarray:
    """AR(1) noise of variance 1, shape (size, columns)."""
    white = random.standard_normal((size + 2000, columns))
    return np.sqrt(1 - pole**2) * lfilter([1.0], [1.0, -pole], white, axis=0)[2000:]


def wandering(random, samples: int = SAMPLES) -> Motion:
    """Gaussian motion of 2 mm RMS below 8 Hz."""
    low_pass = butter(4, 8.0, fs=1 / STEP)
    gain = np.sqrt(np.sum(lfilter(*low_pass, np.eye(1, 5000)[0]) ** 2))
    position = lfilter(*low_pass, random.standard_normal(samples + 2000))[2000:] * 2.0 / gain
    return Motion(np.arange(samples) * STEP, position, STEP)


def test_correlation_time_of_an_autoregressive_process():
    """1/2 + Σ ρᵏ = (1 + ρ)/(2 (1 − ρ))."""
    random = np.random.default_rng(1)
    for pole in (0.0, 0.5, 0.9):
        records = [autoregressive(random, 100_000, pole) for _ in range(2)]
        assert correlation_times(records)[0] == pytest.approx(0.5 * (1 + pole) / (1 - pole), rel=0.07)


def test_covariance_of_scores_is_the_sum_over_lags():
    """Bartlett's sum written out, in the time domain; records apart."""
    random = np.random.default_rng(2)
    scores = [autoregressive(random, size, 0.8, 3) for size in (700, 500)]
    mean = np.concatenate(scores).mean(axis=0)
    times = correlation_times([item - mean for item in scores])
    bandwidth = 12 * times.max()
    expected = np.zeros((3, 3))
    for item in scores:
        item = item - mean
        for lag in range(-len(item) + 1, len(item)):
            first, second = (item[lag:], item[: len(item) - lag]) if lag >= 0 else (item[:lag], item[-lag:])
            expected += max(0.0, 1 - abs(lag) / bandwidth) * first.T @ second
    share = bandwidth / 1200
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    expected *= (critical / 1.96) ** 2 / (1 - 2 * times.sum() / 1200)
    np.testing.assert_allclose(score_covariance(scores), expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_critical_values_of_bartletts_window(share):
    """95 % of means lie within them, however small the sample is beside the window (Kiefer and Vogelsang)."""
    random = np.random.default_rng(3)
    size, trials = 300, 4000
    values = random.standard_normal((trials, size))
    centred = values - values.mean(axis=1, keepdims=True)
    window = np.maximum(1 - np.abs(np.subtract.outer(np.arange(size), np.arange(size))) / (share * size), 0)
    ratio = np.abs(values.sum(axis=1)) / np.sqrt(np.einsum("ti,ij,tj->t", centred, window, centred))
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    assert np.mean(ratio < critical) == pytest.approx(0.95, abs=0.012)


@pytest.mark.parametrize("pole", [0.0, 0.2])
def test_white_errors_pass_for_white_and_others_do_not(pole):
    random = np.random.default_rng(4)
    found = [are_white([autoregressive(random, SAMPLES, pole)[:, 0]]) for _ in range(400)]
    assert np.mean(found) == pytest.approx(0.99, abs=0.015) if pole == 0 else not any(found)


def test_white_residuals_keep_the_curvature():
    """s²(JᵀJ)⁻¹, to the last digit."""
    random = np.random.default_rng(5)
    motion = wandering(random)
    force = TISSUE.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
    data = FitData("white", motion, force + 0.1 * random.standard_normal(SAMPLES))
    found = fit(TISSUE, data, np.zeros(0))
    jacobian = found.sensitivities(data)
    expected = found.squared_error / (data.size - 3) * np.linalg.inv(jacobian.T @ jacobian)
    scaled, size = scaled_covariance(found, data)
    np.testing.assert_allclose(scaled / np.outer(size, size), expected, rtol=1e-6)


ERRORS = {
    "white": lambda random, motion: 0.3 * random.standard_normal(SAMPLES),
    "slow": lambda random, motion: 0.3 * autoregressive(random, SAMPLES, 0.9)[:, 0],
    "slower": lambda random, motion: 0.3 * autoregressive(random, SAMPLES, 0.98)[:, 0],
    "hardening": lambda random, motion: 0.02 * motion.position**3,
    "friction": lambda random, motion: 0.4 * np.sign(motion.velocity),
}
"""Noise, and what a spring and dashpot does not know: it is part of the measured force."""
GAUSSIAN = {
    "hardening": ("spring_stiffness", lambda speed: STIFFNESS + 3 * 0.02 * 2.0**2),
    "friction": ("viscosity", lambda speed: VISCOSITY + 0.4 * np.sqrt(2 / np.pi) / speed),
}
"""Parameter that a model error goes to, and where a fit to endless records ends: of Gaussian motions E[z z³]/E[z²] = 3σ² and
E[v sign v]/E[v²] = √(2/π)/σ."""


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ERRORS)
def test_intervals_hold_the_best_parameters(kind):
    """93 to 97 % of them, over 400 experiments, each with a motion and a noise of its own."""
    speed = np.std(wandering(np.random.default_rng(0), 400_000).velocity)
    truth = {"spring_stiffness": STIFFNESS, "viscosity": VISCOSITY}
    if kind in GAUSSIAN:
        name, best = GAUSSIAN[kind]
        truth = {name: best(speed)}
    inside = []
    for seed in range(400):
        random = np.random.default_rng([6, seed])
        motion = wandering(random)
        force = TISSUE.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
        data = FitData(kind, motion, force + ERRORS[kind](random, motion), settling_time=0.0)
        found = {item.name: item for item in estimates(fit(TISSUE, data, np.zeros(0)), data, "mm", "N")}
        inside += [found[name].low <= value <= found[name].high for name, value in truth.items()]
    assert 0.93 <= np.mean(inside) <= 0.97


def test_records_fitted_together_are_independent():
    """The correlation of one record's end with the next one's beginning is none."""
    random = np.random.default_rng(8)
    parts = []
    for name in ("first", "second"):
        motion = wandering(random)
        force = TISSUE.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
        parts.append(FitData(name, motion, force + 0.3 * autoregressive(random, SAMPLES, 0.95)[:, 0]))
    both = JointData.of(parts)
    found = fit(TISSUE, both, np.zeros(0))
    jacobian, errors = found.sensitivities(both), found.whitened_errors(both)
    scores = [
        found.sensitivities(part) * (part.trim(found.simulate(part.motion) - part.force))[:, None]
        for part in parts
    ]
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    scaled, size = scaled_covariance(found, both)
    expected = inverse @ score_covariance(scores) @ inverse
    np.testing.assert_allclose(scaled / np.outer(size, size), expected, rtol=1e-6, atol=1e-12)
    assert len(errors) == sum(map(len, scores))
