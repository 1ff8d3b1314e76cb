"""Passive fits: against non-negative least squares, the condition they are held to, and records of known springs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls
from tissue_fits import COEFFICIENTS

from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.passive_fit import (
    Branches,
    DeviceCondition,
    fit_branches,
    fit_passive,
    unit_branch,
)
from lumbar.tissue.haptics.passive_models import takes_energy
from lumbar.tissue.haptics.passivity import required_damping
from lumbar.tissue.identification.arx_search import IdentificationData
from lumbar.tissue.models.first_order import FirstOrder, undiscretise
from lumbar.tissue.models.transfer_function import TransferFunction

PERIOD = 0.01


def data_of(structure: TransferFunction, noise: float = 0.0) -> IdentificationData:
    rng = np.random.default_rng(6)
    inputs = np.convolve(rng.standard_normal(3000), np.ones(5) / 5)[:3000]
    inputs -= inputs.mean()
    outputs = structure.simulate(inputs) + noise * rng.standard_normal(3000)
    return IdentificationData("drawn", inputs, outputs, 0.0, 0.0, PERIOD, 50)


TRUTH = Branches((0.5, 3.0, 0.4), (np.inf, 0.034, 0.8))


def test_a_branch_is_the_ramp_invariant_maxwell_element():
    found = undiscretise(unit_branch(0.034, PERIOD), PERIOD)
    assert found == FirstOrder(
        k=pytest.approx(0, abs=1e-12), nu=pytest.approx(0.034), gamma=pytest.approx(0.034)
    )


def test_branches_add_up():
    inputs = np.random.default_rng(7).standard_normal(400)
    apart = sum(
        k * unit_branch(time, PERIOD).simulate(inputs)
        for k, time in zip(TRUTH.stiffnesses, TRUTH.times, strict=True)
    )
    np.testing.assert_allclose(TRUTH.transfer_function(PERIOD).simulate(inputs), apart, atol=1e-9)


def test_stiffnesses_are_those_of_non_negative_least_squares():
    data = data_of(TRUTH.transfer_function(PERIOD), noise=0.3)
    times = [np.inf, *np.geomspace(0.01, 5.0, 9)]
    found, error = fit_branches(data, times)
    regressors = np.column_stack([unit_branch(time, PERIOD).simulate(data.inputs) for time in times])[50:]
    expected, norm = nnls(regressors, data.outputs[50:])
    assert error == pytest.approx(norm**2, rel=1e-6)
    np.testing.assert_allclose(
        found.stiffnesses, expected[expected > 1e-4 * expected.max()], rtol=1e-2, atol=1e-3
    )


def test_a_passive_truth_is_found():
    found = fit_passive(data_of(Branches((0.5, 3.0), (np.inf, 0.034)).transfer_function(PERIOD)), True, 1)
    np.testing.assert_allclose(found.stiffnesses, (0.5, 3.0), rtol=1e-3)
    assert found.times[1] == pytest.approx(0.034, rel=1e-3)


@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("delay", [0.0, 0.0007])
@pytest.mark.parametrize("average", [1, 3])
def test_the_device_is_passive_with_what_was_fitted_for_it(rate, delay, average):
    """At the limit where the condition binds, well within where it does not; delays are cones."""
    data = data_of(TRUTH.transfer_function(PERIOD), noise=0.1)
    kernel = np.full(average, 1000.0 / average)
    rendering = SampledModel("", kernel, np.ones(1), 1.0 / rate).late(delay)
    found = fit_passive(data, True, None, DeviceCondition(5.5, rendering))
    structure = found.transfer_function(1.0 / rate)
    numerator = np.convolve(structure.numerator, rendering.numerator)
    needed = required_damping(
        replace(rendering, numerator=numerator, denominator=np.array(structure.denominator))
    )
    assert needed.damping <= 5.5
    free = fit_passive(data, True, None).transfer_function(1.0 / rate)
    wanted = required_damping(
        replace(
            rendering,
            numerator=np.convolve(free.numerator, rendering.numerator),
            denominator=np.array(free.denominator),
        )
    )
    if wanted.damping > 5.6:
        assert needed.damping > 5.4


@pytest.mark.parametrize(("name", "takes"), [("MW", False), ("Maxwell", True), ("KB", True), ("HO", False)])
def test_which_models_of_the_thesis_take_energy(name, takes):
    """Against the work of sampled sines, trapezoid by trapezoid."""
    structure = TransferFunction(*COEFFICIENTS[name])
    assert takes_energy(structure) == takes
    works = []
    for angle in np.linspace(0.05, 3.1, 60):
        positions = np.sin(angle * np.arange(6000))
        force = structure.simulate(positions)
        work = (force[1:] + force[:-1]) / 2 * np.diff(positions)
        works.append(float(work[3000:].sum()))
    assert (min(works) > -1e-6 * max(map(abs, works))) == takes


def test_a_spring_that_pushes_gives_out_energy():
    assert not takes_energy(Branches((-0.5, 3.0), (np.inf, 0.034)).transfer_function(PERIOD))
    assert takes_energy(Branches((0.0, 3.0), (np.inf, 0.034)).transfer_function(PERIOD))


def test_random_networks_take_energy():
    rng = np.random.default_rng(8)
    for _ in range(50):
        times = np.exp(rng.uniform(np.log(0.002), np.log(5.0), 3))
        network = Branches(tuple(rng.uniform(0.1, 3.0, 4)), (np.inf, *times))
        assert takes_energy(network.transfer_function(PERIOD))
