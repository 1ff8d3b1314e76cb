"""Definitions of the tissue models against mechanics, scipy and python-control."""

import numpy as np
import pytest
from scipy import signal
from viscoelastic import discretise, dynamic_stiffness, kelvin_boltzmann, maxwell, polynomials

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.tissue import BASE_NAMES, system_of
from lumbar.tissue.models import tissue_models as models
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA
from lumbar.tissue.models.transfer_function import FirstOrder, TransferFunction, filtered

KB_ELEMENTS = {"k1": 0.4, "k2": 3.2, "b": 0.13}
T = 0.01


@pytest.mark.parametrize(
    ("model", "system", "elements"),
    [
        (models.KB, kelvin_boltzmann(**KB_ELEMENTS), KB_ELEMENTS),
        (models.MAXWELL, maxwell(3.2, 0.13), {"k": 3.2, "b": 0.13}),
    ],
)
def test_equation_of_table_2_1_matches_mechanical_analogue(model, system, elements):
    s = 1j * np.geomspace(1e-2, 1e4, 50)
    numerator, denominator = polynomials(system)
    expected = np.polyval(numerator, s) / np.polyval(denominator, s)
    np.testing.assert_allclose(dynamic_stiffness(model.network, elements, s), expected, rtol=1e-12)
    base = FirstOrder.from_base(system.k, system.nu / system.gamma - system.k, system.gamma)
    assert (base.k, base.nu, base.gamma) == pytest.approx((system.k, system.nu, system.gamma))


def test_filter_matches_scipy():
    draws = np.random.default_rng(0)
    for _ in range(300):
        numerator = draws.normal(size=draws.integers(1, 9))
        denominator = np.poly(draws.uniform(-1, 1, draws.integers(0, 9))) * draws.uniform(0.5, 2)
        inputs = draws.normal(size=draws.integers(1, 200))
        expected = signal.lfilter(numerator, denominator, inputs)
        result = filtered(numerator, np.atleast_1d(denominator), inputs)
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    turning = [1.0, -np.exp(-0.1 + 0.3j)]
    np.testing.assert_allclose(filtered([1.0], turning, inputs), signal.lfilter([1.0], turning, inputs))
    away = filtered((1.0,), (1.0, -1e200), np.ones(9))
    np.testing.assert_array_equal(away, signal.lfilter((1.0,), (1.0, -1e200), np.ones(9)))


def test_kelvin_voigt_is_improper_and_not_identified():
    s = np.array([1e6j])
    assert dynamic_stiffness(models.KV.network, {"k": 1.0, "b": 0.1}, s) == pytest.approx(1.0 + 0.1 * s)
    assert models.KV.element_values({"spring_stiffness": 1.0, "viscosity": 0.1}) == {"k": 1.0, "b": 0.1}
    with pytest.raises(NumericalError, match="improper"):
        models.KV.physical_parameters(TransferFunction((1.0,)), T)


@pytest.mark.parametrize("ratio", [1e-5, 1e-3, 0.3, 3.0, 20.0])
def test_physical_parameters_are_recovered(ratio):
    gamma = T / ratio
    k1, k2 = 0.4, 3.2
    discrete = discretise(kelvin_boltzmann(k1, k2, gamma * (k1 + k2)), T)
    result = models.KB.physical_parameters(discrete, T)
    k = k1 * k2 / (k1 + k2)
    base = {"spring_stiffness": k, "branch_stiffness": k2 - k, "relaxation_time": gamma}
    elements = {"k": k, "nu": gamma * k2, "gamma": gamma, "k1": k1, "k2": k2, "b": gamma * (k1 + k2)}
    assert result == pytest.approx({**base, **elements}, rel=1e-5)
    discrete = discretise(maxwell(3.2, 3.2 * gamma), T)
    expected = {"branch_stiffness": 3.2, "relaxation_time": gamma, "k": 3.2, "b": 3.2 * gamma, "alpha": gamma}
    assert models.MAXWELL.physical_parameters(discrete, T) == pytest.approx(expected, rel=1e-5)


def test_maxwell_has_no_static_force_and_eq_3_3_has_one():
    assert discretise(maxwell(3.2, 0.13), T).static_gain == pytest.approx(0.0, abs=1e-12)
    coefficients = np.array([0.9, 0.2])
    assert models.MAXWELL.structure.transfer_function(coefficients).static_gain == 0.0
    assert models.MW.structure.transfer_function(coefficients).static_gain == pytest.approx(2.0)
    with pytest.raises(NumericalError, match=r"MW: Eq\. 3\.3 .*\bMaxwell\b"):
        models.MW.physical_parameters(models.MW.structure.transfer_function(coefficients), T)


@pytest.mark.parametrize(
    ("model", "transfer_function", "reason"),
    [
        (models.KB, TransferFunction((3.0, -2.5), (1.0, 0.3)), r"pole .*-0\.3\b.*\(0, 1\)"),
        (models.KB, TransferFunction((3.0, -2.5), (1.0, -1.1)), r"pole .*\b1\.1\b.*\(0, 1\)"),
        (models.KB, TransferFunction((0.5, 0.5), (1.0, -0.5)), r"KB: branch_stiffness .*-2\.079\b.*\b0\b"),
        (models.KB, TransferFunction((3.0, -3.2), (1.0, -0.5)), r"KB: spring_stiffness .*-0\.4\b"),
        (
            models.MAXWELL,
            TransferFunction((-3.0, 3.0), (1.0, -0.5)),
            r"Maxwell: branch_stiffness .*-4\.159\b",
        ),
        (models.LE, TransferFunction((-1.0,)), r"LE: spring_stiffness .*-1\b"),
        (models.HO, TransferFunction((1.0, 0.2, 0.3), (1.0, 0.1, 0.1)), r"^HO: "),
    ],
)
def test_models_without_mechanical_counterpart_are_rejected(model, transfer_function, reason):
    with pytest.raises(NumericalError, match=reason):
        model.physical_parameters(transfer_function, T)


@pytest.mark.parametrize("denominator", [(1.0, -1.0), (1.0, -1.04), (1.0, 0.0, 1.2), (1.0, float("nan"))])
def test_unstable_model_is_not_simulated(denominator):
    model = TransferFunction((1.0, 0.5), denominator)
    assert not model.stable
    with pytest.raises(NumericalError, match="unstable"):
        model.simulate(np.ones(10))


def test_higher_order_structures_are_proper_and_complete():
    structures = models.higher_order_structures(5)
    assert len(structures) == len(set(structures)) == sum(2 * order + 1 for order in range(2, 6))
    assert all(0 <= item.input_lags[0] <= item.input_lags[-1] <= item.order for item in structures)
    assert min(item.order for item in structures) == 2


def test_inverted_linear_opposes_the_other_models():
    model = models.inverted_linear(5.0, 40.0)
    assert model.simulate(np.array([0.0, 20.0, 40.0])).tolist() == [0.0, -2.5, -5.0]
    with pytest.raises(InputError, match=r"tissue\.inverted_linear: .*force_max 5\b.*travel 0\b"):
        models.inverted_linear(5.0, 0.0)


def test_settings_and_models_have_equal_base_names():
    assert (CHOSEN_BY_DATA, *BASES) == BASE_NAMES
    assert {name: system_of(name) for name in BASES} == {name: base.system for name, base in BASES.items()}
