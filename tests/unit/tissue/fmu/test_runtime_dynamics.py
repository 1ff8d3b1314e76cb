"""The dynamics of an FMU: discretised again against its first-order hold, and rejected rates."""

import numpy as np
import pytest
from runtime_models import SETTINGS, entry, models_json, selected
from scipy.signal import dlsim, lfilter

from lumbar.base.errors import NumericalError
from lumbar.tissue.fmu.build.linear_model import LinearModel, resample_model
from study_settings import changed

pytestmark = pytest.mark.filterwarnings("ignore::scipy.signal.BadCoefficients")  # numerators begin with zeros
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
def test_straight_lines_give_equal_forces_at_the_old_instants(name, ratio):
    model = LinearModel(*map(tuple, MODELS[name]))
    faster = resample_model(model, 0.01, 0.01 / ratio)
    slow = np.cumsum(np.random.default_rng(3).standard_normal(200))
    slow[0] = 0.0
    fast = np.interp(np.arange(199 * ratio + 1) / ratio, np.arange(200), slow)
    expected = lfilter(model.numerator, model.denominator, slow)
    forces = lfilter(faster.numerator, faster.denominator, fast)[::ratio]
    np.testing.assert_allclose(forces, expected, atol=1e-9 * np.abs(expected).max())


DELAYED = {
    "MW": ([0.0, 0.265], [1.0, -0.372]),
    "a delayed gain": ([0.0, 0.7], [1.0]),
    "two samples late": ([0.0, 0.0, 1.9, -2.9, 1.1], [1.0, -1.5, 0.6]),
}


@pytest.mark.parametrize("name", DELAYED)
@pytest.mark.parametrize(("old", "new"), [(1, 10), (1, 3), (2, 5), (100, 781)])
def test_delay_keeps_its_duration(name, old, new):
    """Whole samples or not: exact for straight lines with corners where instants of both rates meet."""
    model = LinearModel(*map(tuple, DELAYED[name]))
    faster = resample_model(model, 0.01, 0.01 * old / new)
    assert faster.delay == int((len(model.numerator) - np.flatnonzero(model.numerator).size) * new / old)
    corners = np.cumsum(np.random.default_rng(4).standard_normal(12))
    corners[0] = 0.0
    slow = np.interp(np.arange(11 * old + 1) / old, np.arange(12), corners)
    fast = np.interp(np.arange(11 * new + 1) / new, np.arange(12), corners)
    padded = [*model.denominator, *[0.0] * (len(model.numerator) - len(model.denominator))]
    _, expected = dlsim((model.numerator, padded, 0.01), slow)
    forces = faster.response(fast)
    whole = faster.transfer_function
    np.testing.assert_allclose(lfilter(whole.numerator, whole.denominator, fast), forces, atol=1e-12)
    np.testing.assert_allclose(forces[::new], expected[::old, 0], atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([1.0, 0.3], [1.0, 0.35]),
        ([0.0, 5.0, -8.0, 3.5], [1.0, 0.1, -0.2, 0.05]),
        ([1.0, 0.3, 0.2], [1.0, -0.5]),
    ],
)
def test_models_without_a_continuous_counterpart_run_in_phases(numerator, denominator):
    """For any positions, and whichever new sample the old clock begins at; against dlsim."""
    model = LinearModel(tuple(numerator), tuple(denominator), name="HO")
    faster = resample_model(model, 0.01, 0.001)
    assert faster.phases == 10
    positions = np.random.default_rng(5).standard_normal(500)
    forces = faster.response(positions)
    whole = faster.transfer_function
    np.testing.assert_allclose(lfilter(whole.numerator, whole.denominator, positions), forces, atol=1e-10)
    # scipy's polynomials are of z, the model's of 1/z: both need the same length.
    longest = max(len(numerator), len(denominator))
    system = [[*part, *[0.0] * (longest - len(part))] for part in (numerator, denominator)]
    for begin in (0, 3, 9):
        _, expected = dlsim((*system, 0.01), positions[begin::10])
        np.testing.assert_allclose(forces[begin::10], expected[:, 0], atol=1e-12)
    assert faster.largest_pole == pytest.approx(model.largest_pole**0.1)


@pytest.mark.parametrize(
    ("numerator", "denominator", "wanted", "message"),
    [
        ([1.0, 0.3], [1.0, 0.35], 0.003, r"KB: .*-0\.35.*runtime\.rate_Hz.*100 Hz"),
        ([1.9, -1.2], [1.0, -0.45], 0.02, r"KB: runtime\.rate_Hz 50\b.*100 Hz"),
    ],
)
def test_impossible_rates_are_rejected(numerator, denominator, wanted, message):
    model = LinearModel(tuple(numerator), tuple(denominator), name="KB")
    with pytest.raises(NumericalError, match=message):
        resample_model(model, 0.01, wanted)


def test_fmu_has_the_rate_of_the_settings():
    content = models_json(entry("KB", [1.9, -1.2], [1.0, -0.45]), entry("IL", [-0.125], [1.0]))
    kb, gain = selected(content, changed(SETTINGS, models=["KB", "IL"], rate_Hz=1000, moving_average_ms=3.0))
    assert kb.sampling_time == gain.sampling_time == 0.001
    assert kb.dynamics.largest_pole == pytest.approx(0.45**0.1)
    assert gain.dynamics.numerator == (-0.125,)
    assert sum(kb.dynamics.numerator) / sum(kb.dynamics.denominator) == pytest.approx(0.7 / 0.55)
