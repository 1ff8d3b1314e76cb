"""Models discretised anew: the same forces at common instants, against scipy's first-order hold, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from runtime_models import SETTINGS, entry, models_json, selected
from scipy.signal import cont2discrete, lfilter, ss2tf

from lumbar.errors import NumericalError
from lumbar.fmu.build.linear_model import LinearModel
from lumbar.fmu.build.resampled_model import at_rate
from study_settings import changed

MODELS = {
    "KB": ([1.9, -1.2], [1.0, -0.45]),
    "Maxwell": ([1.5, -1.5], [1.0, -0.7]),
    "two real poles": ([1.9, -2.9, 1.1], [1.0, -1.5, 0.56]),
    "two complex poles": ([1.9, -2.9, 1.1], [1.0, -1.5, 0.6]),
    "a double pole": ([1.0, -1.0, 0.3], [1.0, -1.2, 0.36]),
    "an integrator": ([1.0, -0.5], [1.0, -1.0]),
}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("ratio", [2, 10])
def test_straight_lines_give_the_same_forces_at_the_old_instants(name, ratio):
    model = LinearModel(*map(tuple, MODELS[name]))
    faster = at_rate(model, 0.01, 0.01 / ratio)
    slow = np.cumsum(np.random.default_rng(3).standard_normal(200))
    slow[0] = 0.0
    fast = np.interp(np.arange(199 * ratio + 1) / ratio, np.arange(200), slow)
    expected = lfilter(model.numerator, model.denominator, slow)
    found = lfilter(faster.numerator, faster.denominator, fast)[::ratio]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_a_known_continuous_model_comes_back():
    """Kelvin–Boltzmann from k = 0.8 N/mm, branch 6 N/mm, τ = 0.035 s, by scipy's first-order hold at both rates."""
    a, b, c, d = -1 / 0.035, 1.0, -6.0 / 0.035, 6.8
    coefficients = {}
    for step in (0.01, 0.001):
        discrete = cont2discrete(tuple(np.atleast_2d(item) for item in (a, b, c, d)), step, method="foh")
        numerator, denominator = ss2tf(*discrete[:4])
        coefficients[step] = (tuple(numerator[0]), tuple(denominator))
    found = at_rate(LinearModel(*coefficients[0.01]), 0.01, 0.001)
    np.testing.assert_allclose(found.numerator, coefficients[0.001][0], rtol=1e-10)
    np.testing.assert_allclose(found.denominator, coefficients[0.001][1], rtol=1e-10)


@pytest.mark.parametrize(
    ("numerator", "denominator", "wanted", "words"),
    [
        ([0.0, 0.3], [1.0, -0.35], 0.001, "KB.*a whole sample of 0.01 s late.*runtime.rate_Hz"),
        ([1.0, 0.3], [1.0, 0.35], 0.001, "0 or negative"),
        ([1.0, 0.3, 0.2], [1.0, -0.5], 0.001, "0 or negative"),
        ([1.9, -1.2], [1.0, -0.45], 0.02, "50 is slower than the 100 Hz"),
    ],
)
def test_models_without_a_counterpart_are_named(numerator, denominator, wanted, words):
    model = LinearModel(tuple(numerator), tuple(denominator), name="KB")
    with pytest.raises(NumericalError, match=words):
        at_rate(model, 0.01, wanted)


def test_rate_of_the_configuration_is_that_of_the_fmu():
    content = models_json(entry("KB", [1.9, -1.2], [1.0, -0.45]), entry("IL", [-0.125], [1.0]))
    kb, gain = selected(content, changed(SETTINGS, models=["KB", "IL"], rate_Hz=1000))
    assert kb.sampling_time == gain.sampling_time == 0.001
    assert kb.dynamics.largest_pole == pytest.approx(0.45**0.1)
    assert gain.dynamics.numerator == (-0.125,)
    assert sum(kb.dynamics.numerator) / sum(kb.dynamics.denominator) == pytest.approx(0.7 / 0.55)
