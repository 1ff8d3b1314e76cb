"""State-space form against scipy's direct filtering and against roots of the denominator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import dlsim, lfilter

from lumbar.errors import InputError
from lumbar.models.state_space import from_transfer_function


def simulate(system, inputs):
    if not system.states:
        return system.D * inputs
    matrices = (system.A, system.B[:, None], system.C[None, :], np.array([[system.D]]), 1.0)
    return dlsim(matrices, inputs[:, None])[1][:, 0]


@pytest.mark.parametrize(
    ("numerator", "denominator", "states"),
    [
        ([2.5], [1.0], 0),
        ([1.9, -1.2], [1.0, -0.45], 1),
        ([0.0, 0.3], [1.0, -0.35], 1),
        ([1.9, -2.9, 1.1], [1.0, -1.5, 0.57], 2),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [1.0, -0.5], 4),
        ([1.0], [1.0, -0.5, 0.2, -0.1], 3),
        ([3.8, -2.4], [2.0, -0.9], 1),
        ([1.0, 0.0, 0.0], [1.0, -0.5, 0.0], 1),
        ([0.0], [1.0], 0),
    ],
)
def test_output_is_that_of_the_transfer_function(numerator, denominator, states):
    inputs = np.random.default_rng(1).standard_normal(300)
    system = from_transfer_function(numerator, denominator)
    assert system.states == states
    np.testing.assert_allclose(simulate(system, inputs), lfilter(numerator, denominator, inputs), atol=1e-12)


def test_random_systems_of_high_order():
    generator = np.random.default_rng(2)
    for order in range(1, 13):
        poles = 0.9 * generator.uniform(-1, 1, order)
        denominator, numerator = np.poly(poles), generator.standard_normal(order + 1)
        system = from_transfer_function(numerator, denominator)
        inputs = generator.standard_normal(200)
        expected = lfilter(numerator, denominator, inputs)
        np.testing.assert_allclose(simulate(system, inputs), expected, atol=1e-9 * np.abs(expected).max())


def test_poles_are_the_roots_of_the_denominator():
    system = from_transfer_function([1.0], [1.0, -1.5, 0.57])
    assert system.largest_pole == pytest.approx(np.abs(np.roots([1.0, -1.5, 0.57])).max(), rel=1e-12)
    assert system.stable
    assert not from_transfer_function([0.0, 1.0], [1.0, -1.04]).stable
    assert not from_transfer_function([0.0, 1.0], [1.0, -1.0]).stable


@pytest.mark.parametrize(
    ("numerator", "denominator", "words"),
    [
        ([1.0], [0.0, 1.0], "improper"),
        ([1.0], [], "no coefficients"),
        ([], [1.0], "no coefficients"),
        ([float("nan")], [1.0], "finite"),
        ([1.0], [1.0, float("inf")], "finite"),
    ],
)
def test_impossible_coefficients_are_named(numerator, denominator, words):
    with pytest.raises(InputError, match=words) as caught:
        from_transfer_function(numerator, denominator, "KB")
    assert "KB" in str(caught.value)
