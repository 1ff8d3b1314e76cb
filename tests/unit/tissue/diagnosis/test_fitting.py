"""Fits of a base with effects: separable least squares, gradients, intervals, correlated errors, states of a fit."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from periodic_records import moved, record, softening_record
from scipy.optimize import lsq_linear
from scipy.signal import butter, lfilter

from case_tables import cases
from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting import joint_fit
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, fit, fit_base, shape_bounds, solve_linear
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.fitting.uncertainty import (
    are_white,
    correlation_times,
    estimates,
    project_out,
    scaled_covariance,
    score_covariance,
    tangent_basis,
)
from lumbar.tissue.diagnosis.law.law_validation import alternate
from lumbar.tissue.diagnosis.noise.periods import fold_periods
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.sentences import details
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.structure import Structure, forces_of

STEP = 0.01
FORMS = {form.key: form for effect in TISSUE.values() for form in effect.forms}


def excitation(seed=0, seconds=40):
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, STEP)
    lines = np.arange(1, 41) * 0.1
    position = np.cos(2 * np.pi * np.outer(time, lines) + random.uniform(0, 6.28, 40)) @ lines**-0.5
    return Motion(time, 5 * position / np.abs(position).max(), STEP)


def experiment(key, linear, nonlinear, noise=0.01, seed=0):
    motion = excitation(seed)
    structure = Structure(BASES["KB"], (FORMS[key],) if key else ())
    clean = structure.simulate(motion, np.array([0.6, 1.2, *linear]), np.array([0.15, *nonlinear]))
    random = np.random.default_rng([seed, 1])
    force = clean + noise * clean.std() * random.standard_normal(len(clean))
    return FitData("test", motion, force, settling=50)


def test_second_relaxation_is_found_where_the_first_leads_to_its_bound():
    """Short impacts: the base alone takes a time between both, so the best start of the second is the faster one."""
    random = np.random.default_rng(3)
    parts = [np.zeros(40)]
    for width in random.integers(6, 26, 14):
        pulse = np.sin(np.pi * np.arange(width) / width) ** 2
        parts += [random.uniform(1, 5) * pulse, np.zeros(random.integers(60, 160))]
    position = np.concatenate(parts)
    motion = Motion(STEP / 2 * np.arange(len(position)), position, STEP / 2)
    structure = Structure(BASES["KB"], (FORMS["second_relaxation/maxwell_branch"],))
    true = np.array([0.59, 3.7])
    clean = structure.simulate(motion, np.array([0.86, 0.64, 1.5]), true)
    data = FitData("test", motion, clean + 0.007 * random.standard_normal(len(clean)), settling=0)
    found = add(fit_base(Structure(BASES["KB"]), data), structure.forms[0], data)
    assert found.squared_error <= fit(structure, data, true).squared_error * 1.001


@pytest.mark.parametrize("seed", range(20))
def test_amplitudes_are_those_of_bounded_solver(seed):
    random = np.random.default_rng(seed)
    design = random.standard_normal((60, 5)) * 10.0 ** random.uniform(-3, 3, 5)
    force = random.standard_normal(60)
    signs = tuple(random.integers(-1, 2, 5).tolist())
    bounds = ([0 if sign > 0 else -np.inf for sign in signs], [0 if sign < 0 else np.inf for sign in signs])
    expected = lsq_linear(design, force, bounds, method="bvls", tol=1e-14).x
    errors = [np.sum((design @ item - force) ** 2) for item in (solve_linear(design, force, signs), expected)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-8)


CASES = cases(__file__, "cases")


@pytest.mark.parametrize("key", CASES)
def test_effect_and_base_are_recovered_together(key):
    linear, nonlinear = CASES[key]
    data = experiment(key, linear, nonlinear, noise=0.001)
    base = fit_base(Structure(BASES["KB"]), data)
    found = add(base, FORMS[key], data)
    assert found.converged
    assert found.squared_error < 0.2 * base.squared_error
    assert found.linear == pytest.approx([0.6, 1.2, *linear], rel=0.03, abs=2e-3)
    assert found.nonlinear == pytest.approx([0.15, *nonlinear], rel=0.03)


@pytest.mark.parametrize("key", FORMS)
def test_larger_model_fits_worse_only_at_bound(key):
    """A delay, play or limit of zero size is outside its range: such forms contain the smaller model only in the limit."""
    data = experiment("", (), ())
    base = fit_base(Structure(BASES["KB"]), data)
    found = add(base, FORMS[key], data)
    worse = found.squared_error > base.squared_error * (1 + 1e-4)
    if FORMS[key].place is Place.PARALLEL or not worse:
        assert not worse
        return
    low, high = shape_bounds(found.structure, data, found.nonlinear)
    at_bound = np.isclose(found.nonlinear, low, rtol=1e-3) | np.isclose(found.nonlinear, high, rtol=1e-3)
    assert at_bound[1:].any() and found.converged


@pytest.mark.parametrize(("key", "ratio"), [("coulomb_friction/coulomb", 1.0), ("backlash/play", 7.0)])
def test_optimiser_that_ends_worse_has_not_converged(monkeypatch, key, ratio):
    """Parallel forms keep the smaller model's error; others show their own."""
    data = experiment("", (), ())
    base = fit_base(Structure(BASES["KB"]), data)

    def failing(structure, data, start):
        return Fit(structure, np.ones(len(structure.signs)), np.array([0.3, 0.5]), 7.0 * base.squared_error)

    monkeypatch.setattr(joint_fit, "fit", failing)
    found = add(base, FORMS[key], data)
    assert not found.converged
    assert found.squared_error == pytest.approx(ratio * base.squared_error)
    if ratio == 1.0:
        assert np.allclose(found.simulate(data.motion), base.simulate(data.motion))


SAMPLES = 4000
STIFFNESS, VISCOSITY = 0.8, 0.05
VISCOELASTIC = Structure(BASES["KV"])


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


def test_correlation_time_of_autoregressive_process():
    """1/2 + Σ ρᵏ = (1 + ρ)/(2 (1 − ρ))."""
    random = np.random.default_rng(1)
    for pole in (0.0, 0.5, 0.9):
        records = [autoregressive(random, 100_000, pole) for _ in range(2)]
        assert correlation_times(records)[0] == pytest.approx(0.5 * (1 + pole) / (1 - pole), rel=0.07)


def test_covariance_of_scores_is_bartletts_sum_over_lags():
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


@pytest.mark.parametrize("pole", [0.0, 0.2])
def test_only_white_errors_pass_test_of_whiteness(pole):
    random = np.random.default_rng(4)
    white = [are_white([autoregressive(random, SAMPLES, pole)[:, 0]]) for _ in range(400)]
    assert np.mean(white) == pytest.approx(0.99, abs=0.015) if pole == 0 else not any(white)


def test_covariance_of_white_residuals_is_inverse_curvature():
    random = np.random.default_rng(5)
    motion = wandering(random)
    force = VISCOELASTIC.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
    data = FitData("white", motion, force + 0.5 + 0.1 * random.standard_normal(SAMPLES))
    found = fit(VISCOELASTIC, data, np.zeros(0))
    jacobian = found.sensitivities(data)
    expected = found.squared_error / (data.size - 3) * np.linalg.inv(jacobian.T @ jacobian)
    assert abs(found.zero - 0.5) < 1.96 * np.sqrt(expected[-1, -1]) < 0.005
    scaled, size = scaled_covariance(found, data)
    np.testing.assert_allclose(scaled / np.outer(size, size), expected, rtol=1e-6)


ERRORS = {
    "white": lambda random, motion: 0.3 * random.standard_normal(SAMPLES),
    "slow": lambda random, motion: 0.3 * autoregressive(random, SAMPLES, 0.9)[:, 0],
    "slower": lambda random, motion: 0.3 * autoregressive(random, SAMPLES, 0.98)[:, 0],
    "hardening": lambda random, motion: 0.02 * motion.position**3,
    "friction": lambda random, motion: 0.4 * np.sign(motion.velocity),
}
"""Noise, or a force that a spring and dashpot does not explain."""
GAUSSIAN = {
    "hardening": ("spring_stiffness", lambda speed: STIFFNESS + 3 * 0.02 * 2.0**2),
    "friction": ("viscosity", lambda speed: VISCOSITY + 0.4 * np.sqrt(2 / np.pi) / speed),
}
"""Parameter that a model error changes, and its limit in long records: in Gaussian motions E[z z³]/E[z²] = 3σ² and
E[v sign v]/E[v²] = √(2/π)/σ."""


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ERRORS)
def test_intervals_cover_best_parameters(kind):
    """93 to 97 % of them, over 400 experiments with different motions and noises."""
    speed = np.std(wandering(np.random.default_rng(0), 400_000).velocity)
    truth = {"spring_stiffness": STIFFNESS, "viscosity": VISCOSITY}
    if kind in GAUSSIAN:
        name, best = GAUSSIAN[kind]
        truth = {name: best(speed)}
    inside = []
    for seed in range(400):
        random = np.random.default_rng([6, seed])
        motion = wandering(random)
        force = VISCOELASTIC.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
        data = FitData(kind, motion, force + ERRORS[kind](random, motion))
        found = {item.name: item for item in estimates(fit(VISCOELASTIC, data, np.zeros(0)), data, "mm", "N")}
        inside += [found[name].low <= value <= found[name].high for name, value in truth.items()]
    assert 0.93 <= np.mean(inside) <= 0.97


def test_scores_of_joint_records_are_independent():
    random = np.random.default_rng(8)
    parts = []
    for name in ("first", "second"):
        motion = wandering(random)
        force = VISCOELASTIC.simulate(motion, np.array([STIFFNESS, VISCOSITY]), np.zeros(0))
        parts.append(FitData(name, motion, force + 0.3 * autoregressive(random, SAMPLES, 0.95)[:, 0]))
    both = JointData.join(parts)
    found = fit(VISCOELASTIC, both, np.zeros(0))
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


def test_fit_that_did_not_converge_is_reported():
    records = []
    for name, motion in (("a", excitation(1)), ("b", excitation(2, 12))):
        noise = 0.02 * np.random.default_rng(9).standard_normal(len(motion))
        force = 0.8 * motion.position + 0.01 * motion.position**3 + noise
        records.append(record(motion.position, force, name))
    result = diagnose(records)
    assert result.model.fit.converged
    stopped = replace(result.model, fit=replace(result.model.fit, converged=False))
    added = {*details(replace(result, path=[result.base, stopped]), TISSUE)} - {*details(result, TISSUE)}
    assert len(added) == 1


def test_period_of_more_than_half_the_record_is_rejected():
    position = excitation(seconds=20).position
    with pytest.raises(InputError, match=r"\b1\.33\b.*\b15 s\b.*\b2\b"):
        fold_periods(record(position, position), 15.0)


@pytest.mark.nightly
def test_search_for_faults_of_long_record_needs_little_memory():
    random = np.random.default_rng(12)
    slow, fast = (np.sin(2 * np.pi * line * np.arange(1_000_000) / 1000.0) for line in (0.37, 1.1))
    position = slow + 0.5 * fast + 1e-3 * random.standard_normal(len(slow))
    long = record(position, 0.4 * slow + 0.01 * random.standard_normal(len(slow)), step=1e-3)
    tracemalloc.start()
    _, faults = repair([long])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [item.kind for item in faults] == ["position_noise"]
    assert peak < 300e6


WORN, CLIPPED = FORMS["softening/path"], FORMS["saturation/sharp"]


def test_joint_records_do_not_share_path_memory_or_limits():
    motions = [Motion(np.arange(900) * STEP, moved(seed)[:900], STEP) for seed in (1, 2)]
    structure = Structure(BASES["KB"], (WORN, CLIPPED))
    numbers = np.array([0.8, 1.0, -0.3]), np.array([0.1, 200.0, 3.0])
    joint = structure.simulate(JoinedMotions(tuple(motions)), *numbers)
    single = [structure.simulate(motion, *numbers) for motion in motions]
    np.testing.assert_array_equal(joint, np.concatenate(single))
    columns = forces_of(WORN, JoinedMotions(tuple(motions)), np.array([200.0]))
    assert columns.shape == (1800, 1)
    assert columns[900, 0] == forces_of(WORN, motions[1], np.array([200.0]))[0, 0]


def test_start_of_every_record_does_not_count():
    motion, whitening = Motion(np.arange(400) * STEP, moved(3)[:400], STEP), np.array([1.0, -0.5])
    parts = [FitData(name, motion, np.zeros(400), whitening, 50) for name in ("first", "second")]
    joint = JointData.join(parts)
    signal = np.arange(800.0)
    assert joint.name == "first+second"
    assert joint.size == 700
    np.testing.assert_array_equal(joint.trim(signal), np.concatenate([signal[50:400], signal[450:]]))
    white = np.concatenate([parts[0].whiten(signal[:400]), parts[1].whiten(signal[400:])])
    np.testing.assert_array_equal(joint.whiten(signal), white)
    early, later = joint.split(0.5)
    assert (len(early.force), early.size, later.size) == (400, 300, 400)


def test_linear_joint_fit_is_least_squares_of_stacked_records():
    records = [softening_record("a", 4), softening_record("b", 5, 30.0)]
    training = prepare([*records, softening_record("c", 6)], ["a", "b"]).training
    found = fit_base(Structure(BASES["KV"]), training)
    rows, force = [], []
    for item in records:
        velocity = Motion.from_record(item).velocity
        rows.append(np.column_stack([item["input"], velocity, np.ones(len(item))])[50:])
        force.append(item["output"][50:])
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(force), rcond=None)[0]
    np.testing.assert_allclose([*found.linear, found.zero], expected, rtol=1e-6)
    worn = add(found, WORN, training)
    assert worn.linear[0] == pytest.approx(0.8, abs=0.01)
    assert worn.linear[2] == pytest.approx(0.3, abs=0.02)


def test_tangent_basis_and_errors_allow_zero_of_every_record():
    records = [softening_record(name, seed, 8.0) for name, seed in (("a", 7), ("b", 8), ("c", 9))]
    steps = zip(records, (5, -3, 1), strict=True)
    shifted = [one.with_values(output=one["output"] + step) for one, step in steps]
    errors = []
    for items in (records, shifted):
        experiment = prepare(items, ["a", "b"]).allow_own_zeros()
        fit = fit_base(Structure(BASES["KV"]), experiment.training)
        together = [experiment.training, *experiment.tests]
        basis = tangent_basis(fit, together)
        assert basis.shape[1] == 2 + 3  # stiffness and damping, and the zero of each record
        assert np.abs(project_out(basis, np.repeat([5.0, -3.0, 1.0], 760))).max() < 1e-9
        errors.append(np.concatenate([fit.errors(item) for item in together]))
        choosing = alternate(experiment)[0]
        assert np.mean(fit.errors(choosing.tests[0])) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(*errors, atol=1e-6)
