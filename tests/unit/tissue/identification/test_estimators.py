"""Estimators of the identification against normal equations, statsmodels, a scan of the poles and the truth."""

import dataclasses

import numpy as np
import pytest
import statsmodels.api as sm
from periodic_records import record
from viscoelastic import discretise, kelvin_boltzmann

from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.identification.arx_search import IdentificationData, ReducedRegression, search, select
from lumbar.tissue.identification.identify_tissue import (
    fit_output_error,
    relaxation_starts,
    simulation_sensitivities,
    stabilise,
)
from lumbar.tissue.identification.metrics import block_bootstrap
from lumbar.tissue.models.tissue_models import KB, MAXWELL, MW, higher_order_structures
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction

TRUTH = {"k1": 0.4, "k2": 3.2, "b": 0.126}


def test_unstable_model_has_no_free_run():
    """An output that grows by itself: every ridge solution of MW keeps its pole outside the unit circle."""
    rng = np.random.default_rng(0)
    inputs = rng.standard_normal(400)
    outputs = np.zeros(400)
    for k in range(1, 400):
        outputs[k] = 1.04 * outputs[k - 1] + 0.1 * inputs[k - 1]
    data = IdentificationData.from_record(record(inputs, outputs, "growing"), 0.5)
    data = dataclasses.replace(data, outputs=outputs)
    regression = ReducedRegression(inputs, outputs, 2)
    candidates = search("MW", [ArxStructure(1, (1,))], np.array([0.0, 0.01]), regression, data, [data])
    chosen, remark = select(candidates, "training", None)
    assert not chosen.stable
    assert chosen.training is None
    assert chosen.test_vaf_percent is None
    assert "unstable" in remark


STRUCTURES = [MW.structure, MAXWELL.structure, KB.structure, *higher_order_structures(4)]


def regressor_matrix(structure, inputs, outputs, lag):
    """Write out A and b of Eq. 3.6 row by row."""
    rows = []
    for k in range(lag, len(inputs)):
        row = [outputs[k - i] for i in range(1, structure.order + 1)]
        if structure.zero_static_gain:
            row.append(inputs[k] - inputs[k - 1])
        else:
            row += [inputs[k - j] for j in structure.input_lags]
        rows.append(row)
    return np.array(rows), outputs[lag:]


@pytest.fixture(scope="module")
def one_record():
    rng = np.random.default_rng(5)
    inputs = np.convolve(rng.standard_normal(420), np.ones(9) / 3)[:400]
    outputs = TransferFunction((1.9, -1.5), (1.0, -0.7)).simulate(inputs) + 0.3 * rng.standard_normal(400)
    return inputs - inputs.mean(), outputs - outputs.mean()


@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
def test_ridge_solutions_equal_direct_solves(one_record, structure):
    path = ReducedRegression(*one_record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *one_record, lag=4)
    column_scale, target_scale = np.sqrt(np.mean(regressors**2, axis=0)), np.sqrt(np.mean(target**2))
    scaled, scaled_target = regressors / column_scale, target / target_scale
    np.testing.assert_allclose(path.singular_values, np.linalg.svd(scaled, compute_uv=False), rtol=1e-8)
    assert path.condition_number == pytest.approx(np.linalg.cond(scaled), rel=1e-7)
    for alpha in (0.0, 0.05, 3.0, 100.0):
        expected = np.linalg.solve(
            scaled.T @ scaled + alpha**2 * np.eye(scaled.shape[1]), scaled.T @ scaled_target
        )
        np.testing.assert_allclose(path.standardised_solution(alpha), expected, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            path.solution(alpha), expected * target_scale / column_scale, rtol=1e-6, atol=1e-9
        )
        residual = scaled_target - scaled @ expected
        assert path.residual_sum_of_squares(alpha) == pytest.approx(residual @ residual, rel=1e-9)


@pytest.mark.parametrize("structure", [MW.structure, KB.structure, ArxStructure(3, (0, 1, 2))], ids=str)
def test_parameter_covariance_is_that_of_ordinary_least_squares(one_record, structure):
    path = ReducedRegression(*one_record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *one_record, lag=4)
    reference = sm.OLS(target, regressors).fit()
    np.testing.assert_allclose(path.solution(0.0), reference.params, rtol=1e-8)
    deviations = path.standard_deviations(0.0) * path.target_scale / path.column_scale
    np.testing.assert_allclose(deviations, reference.bse, rtol=1e-8)


T = 0.01


def experiment(seed, samples=2000, noise=0.4):
    """Demeaned band-limited motion and the force of a KB tissue with white noise, σ = noise·σ_force."""
    rng = np.random.default_rng([7, seed])
    inputs = np.convolve(rng.standard_normal(samples + 20), np.hanning(15))[20 : samples + 20]
    force = discretise(kelvin_boltzmann(**TRUTH), T).simulate(inputs - inputs.mean())
    outputs = force + noise * force.std() * rng.standard_normal(samples)
    return inputs - inputs.mean(), outputs - outputs.mean()


def arx(structure, inputs, outputs):
    return structure.transfer_function(
        ReducedRegression(inputs, outputs, structure.largest_lag).path(structure).solution(0)
    )


@pytest.mark.parametrize("structure", [KB.structure, MAXWELL.structure, ArxStructure(3, (1, 2))], ids=str)
def test_sensitivities_are_derivatives_of_the_free_run(structure):
    inputs, _ = experiment(0, samples=200)
    coefficients = np.linspace(0.4, -0.2, structure.parameter_count)
    slopes = simulation_sensitivities(structure, coefficients, inputs + 0.7)
    for column in range(structure.parameter_count):
        step = np.zeros(structure.parameter_count)
        step[column] = 1e-6
        ahead = structure.transfer_function(coefficients + step).simulate(inputs + 0.7)
        behind = structure.transfer_function(coefficients - step).simulate(inputs + 0.7)
        np.testing.assert_allclose(slopes[:, column], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("model", [MW, MAXWELL, KB], ids=lambda model: model.name)
def test_starts_over_all_poles_find_the_lowest_minimum(model):
    """Against a fine scan of the pole with the best numerator for each."""
    inputs, outputs = experiment(5)
    structure = model.structure
    starts = relaxation_starts(structure, inputs, outputs)
    fit = fit_output_error(structure, inputs, outputs, starts, 50)
    scan = relaxation_starts(structure, inputs, outputs, tuple(np.linspace(-0.995, 0.995, 400)))
    lowest = min(np.sum((item.simulate(inputs) - outputs)[50:] ** 2) for item in scan)
    assert np.sum(fit.residuals**2) <= lowest
    assert np.sum(fit.residuals**2) >= 0.98 * lowest


def test_bootstrap_intervals_of_output_error_only_cover_the_truth():
    """A 95 % interval misses each parameter in one of 20 experiments on average; ARX is biased."""
    covered, arx_covered = np.zeros(3), 0
    truth = KB.structure.coefficients(discretise(kelvin_boltzmann(**TRUTH), T))
    for seed in range(20):
        inputs, outputs = experiment(100 + seed)
        start = arx(KB.structure, inputs, outputs)
        fit = fit_output_error(KB.structure, inputs, outputs, [start], 50)
        rng = np.random.default_rng(seed)
        draws = fit.coefficients + block_bootstrap(fit.sensitivities, fit.residuals, 50, 400, rng)
        low, high = np.quantile(draws, [0.025, 0.975], axis=0)
        covered += (low <= truth) & (truth <= high)
        regressors = np.column_stack([outputs[:-1], inputs[1:], inputs[:-1]])
        draws = block_bootstrap(regressors, outputs[1:], 50, 400, rng)
        assert np.median(draws[:, 0]) == pytest.approx(-start.denominator[1], abs=0.05)
        low, high = np.quantile(draws[:, 0], [0.025, 0.975])
        arx_covered += low <= truth[0] <= high
    assert (covered >= 15).all(), covered
    assert arx_covered == 0


def test_bootstrap_of_a_ridge_solution_is_centred_on_it():
    rng = np.random.default_rng(6)
    regressors = rng.standard_normal((1000, 2))
    target = regressors @ [1.0, -2.0] + 0.1 * rng.standard_normal(1000)
    ridge = np.linalg.solve(regressors.T @ regressors + 30.0**2 * np.eye(2), regressors.T @ target)
    draws = block_bootstrap(regressors, target, 10, 1000, rng, alpha=30.0)
    np.testing.assert_allclose(draws.mean(axis=0), ridge, atol=0.02)


def test_bootstrap_of_few_blocks_is_rejected():
    with pytest.raises(InputError, match=r"\b40\b.*\b4\b.*\b10\b.*tissue\.bootstrap\.block_s"):
        block_bootstrap(np.ones((40, 1)), np.ones(40), 10, 100, np.random.default_rng(0))


def test_unstable_start_is_reflected_and_reaches_the_minimum():
    inputs, outputs = experiment(3)
    unstable = TransferFunction((3.0, -2.9), (1.0, -1.04))
    assert not unstable.stable
    assert stabilise(unstable).stable
    good = fit_output_error(KB.structure, inputs, outputs, [arx(KB.structure, inputs, outputs)], 50)
    fit = fit_output_error(KB.structure, inputs, outputs, [unstable], 50)
    assert np.sum(fit.residuals**2) == pytest.approx(np.sum(good.residuals**2), rel=1e-6)


def test_fit_without_starts_is_an_error():
    inputs, outputs = experiment(3)
    with pytest.raises(NumericalError, match=r"output-error.*\bstable"):
        fit_output_error(KB.structure, inputs, outputs, [], 50)
