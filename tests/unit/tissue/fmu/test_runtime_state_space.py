"""State-space form against scipy's direct filtering and against roots of the denominator."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.signal import lfilter

from lumbar.tissue.models.state_space import observer_form
from lumbar.tissue.models.transfer_function import TransferFunction


def simulate(system, inputs):
    return control.forced_response(system, inputs=inputs).outputs


@pytest.mark.parametrize(
    ("numerator", "denominator", "states"),
    [
        ([2.5], [1.0], 0),
        ([1.9, -1.2], [1.0, -0.45], 1),
        ([0.0, 0.3], [1.0, -0.35], 1),
        ([1.9, -2.9, 1.1], [1.0, -1.5, 0.57], 2),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [1.0, -0.5], 4),
        ([1.0], [1.0, -0.5, 0.2, -0.1], 3),
        ([1.0, 0.0, 0.0], [1.0, -0.5, 0.0], 1),
        ([0.0], [1.0], 0),
    ],
)
def test_output_is_that_of_the_transfer_function(numerator, denominator, states):
    inputs = np.random.default_rng(1).standard_normal(300)
    system = observer_form(TransferFunction(tuple(numerator), tuple(denominator)))
    assert system.nstates == states
    np.testing.assert_allclose(simulate(system, inputs), lfilter(numerator, denominator, inputs), atol=1e-12)


def test_random_systems_of_high_order():
    generator = np.random.default_rng(2)
    for order in range(1, 13):
        poles = 0.9 * generator.uniform(-1, 1, order)
        denominator, numerator = np.poly(poles), generator.standard_normal(order + 1)
        system = observer_form(TransferFunction(tuple(numerator), tuple(denominator)))
        inputs = generator.standard_normal(200)
        expected = lfilter(numerator, denominator, inputs)
        np.testing.assert_allclose(simulate(system, inputs), expected, atol=1e-9 * np.abs(expected).max())


def test_transfer_function_is_that_of_python_control():
    """Observer form and `control.tf`, which know nothing of each other, respond alike at every frequency."""
    numerator, denominator = (1.9, -2.9, 1.1), (1.0, -1.5, 0.57)
    z = np.exp(1j * np.linspace(0.01, np.pi, 50))
    system = observer_form(TransferFunction(numerator, denominator), 0.01)
    assert system.dt == 0.01
    np.testing.assert_allclose(system(z), control.tf(numerator, denominator, 0.01)(z), rtol=1e-10)
    np.testing.assert_allclose(np.sort(system.poles()), np.sort(np.roots(denominator)), rtol=1e-12)
