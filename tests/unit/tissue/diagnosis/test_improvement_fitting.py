"""Joint fits against other solvers, known parameters and the smaller models they contain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from lumbar.tissue.diagnosis.fitting import joint_fit
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, fit, fit_base, shape_bounds, solve_linear
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

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
    return FitData("test", motion, clean + noise * clean.std() * random.standard_normal(len(clean)))


@pytest.mark.parametrize("seed", range(20))
def test_amplitudes_against_a_bounded_solver(seed):
    random = np.random.default_rng(seed)
    design = random.standard_normal((60, 5)) * 10.0 ** random.uniform(-3, 3, 5)
    force = random.standard_normal(60)
    signs = tuple(random.integers(-1, 2, 5).tolist())
    bounds = ([0 if sign > 0 else -np.inf for sign in signs], [0 if sign < 0 else np.inf for sign in signs])
    expected = lsq_linear(design, force, bounds, method="bvls", tol=1e-14).x
    found = solve_linear(design, force, signs)
    error = [np.sum((design @ item - force) ** 2) for item in (found, expected)]
    assert error[0] == pytest.approx(error[1], rel=1e-8)


def test_base_is_recovered_without_noise():
    found = fit_base(Structure(BASES["KB"]), experiment("", (), (), noise=0.0))
    assert found.linear == pytest.approx([0.6, 1.2], rel=1e-6)
    assert found.nonlinear == pytest.approx([0.15], rel=1e-6)


CASES = {
    "hardening_stiffness/cubic": ((0.02,), ()),
    "coulomb_friction/coulomb": ((0.8,), (0.5,)),
    "hysteresis/dahl": ((1.0,), (0.7,)),
    "hysteresis/bouc_wen": ((1.0,), (0.7,)),
    "hysteresis/bouc_wen_general": ((1.0,), (0.7, 1.2)),
    "second_relaxation/maxwell_branch": ((0.5,), (2.0,)),
    "delay/pure": ((), (0.013,)),
    "backlash/play": ((), (0.6,)),
    "contact_loss/sharp": ((), (3.0,)),
    "saturation/sharp": ((), (4.0,)),
    "saturation/soft": ((), (8.0,)),
    "softening/path": ((0.3,), (150.0,)),
    "drift/settling": ((1.0,), (12.0,)),
    "periodic_disturbance/sine": ((0.4, -0.2), (0.533,)),
    "quadratic_damping/sinh": ((0.5,), (20.0,)),
}


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


# A delay, play or soft limit of zero size is outside its range, so these do not contain the base.
CONTAINING = sorted(set(FORMS) - {"delay/pure", "backlash/play", "saturation/soft"})


@pytest.mark.parametrize("key", CONTAINING)
def test_a_larger_model_never_fits_worse(key):
    data = experiment("", (), ())
    base = fit_base(Structure(BASES["KB"]), data)
    assert add(base, FORMS[key], data).squared_error <= base.squared_error * (1 + 1e-4)


@pytest.mark.parametrize("key", [form.key for form in FORMS.values() if form.place is not Place.PARALLEL])
def test_a_form_that_is_the_smaller_model_in_the_limit_is_worse_only_at_a_bound(key):
    data = experiment("", (), ())
    base = fit_base(Structure(BASES["KB"]), data)
    found = add(base, FORMS[key], data)
    low, high = shape_bounds(found.structure, data, found.nonlinear)
    at_bound = np.isclose(found.nonlinear, low, rtol=1e-3) | np.isclose(found.nonlinear, high, rtol=1e-3)
    worse = found.squared_error > base.squared_error * (1 + 1e-6)
    assert not worse or (at_bound[1:].any() and found.converged)


@pytest.mark.parametrize(("key", "kept"), [("coulomb_friction/coulomb", 1.0), ("backlash/play", 7.0)])
def test_an_optimiser_that_ends_worse_has_not_converged(monkeypatch, key, kept):
    """Parallel forms keep the smaller model's error; others show their own."""
    data = experiment("", (), ())
    base = fit_base(Structure(BASES["KB"]), data)

    def failing(structure, data, start):
        nonlinear = np.array([0.3, 0.5])
        return Fit(
            structure, np.ones(len(structure.signs)), nonlinear, 7.0 * base.squared_error, converged=True
        )

    monkeypatch.setattr(joint_fit, "fit", failing)
    found = add(base, FORMS[key], data)
    assert not found.converged
    assert found.squared_error == pytest.approx(kept * base.squared_error)
    if kept == 1.0:
        assert np.allclose(found.simulate(data.motion), base.simulate(data.motion))


@pytest.mark.statistical
def test_intervals_hold_the_truth():
    inside = np.zeros(4)
    for seed in range(60):
        data = experiment("hardening_stiffness/cubic", (0.02,), (), noise=0.05, seed=seed)
        structure = Structure(BASES["KB"], (FORMS["hardening_stiffness/cubic"],))
        found = estimates(fit(structure, data, np.array([0.15])), data, "mm", "N")
        truth = (0.6, 1.2, 0.02, 0.15)
        inside += [item.low <= value <= item.high for item, value in zip(found, truth, strict=True)]
    assert (inside >= 51).all()  # 60 × 95 % = 57; below 51 with a probability of 0.1 %
    assert [item.unit for item in found] == ["N/mm", "N/mm", "N/mm^3", "s"]


def test_whitening_is_applied_to_design_and_force():
    data = experiment("", (), (), noise=0.02)
    coloured = FitData("test", data.motion, data.force, np.array([1.0, -0.9]))
    found = fit_base(Structure(BASES["KB"]), coloured)
    assert found.linear == pytest.approx([0.6, 1.2], rel=0.05)
