"""Ridge ARX against normal equations, numpy, statsmodels and exact recovery."""

import numpy as np
import pytest
import statsmodels.api as sm

from lumbar.tissue.identification.metrics import (
    condition_number,
    fit_ratio,
    mean_residual,
    normalized_mean_squared_error,
    variance_accounted_for,
)
from lumbar.tissue.identification.ridge import ReducedRegression, RidgePath, ridge_grid
from lumbar.tissue.models.arx_structure import ArxStructure
from lumbar.tissue.models.tissue_models import KB, MAXWELL, MW, higher_order_structures
from lumbar.tissue.models.transfer_function import TransferFunction

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
def record():
    rng = np.random.default_rng(5)
    inputs = np.convolve(rng.standard_normal(420), np.ones(9) / 3)[:400]
    outputs = TransferFunction((1.9, -1.5), (1.0, -0.7)).simulate(inputs) + 0.3 * rng.standard_normal(400)
    return inputs - inputs.mean(), outputs - outputs.mean()


@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
def test_one_factorisation_gives_every_ridge_solution(record, structure):
    path = ReducedRegression(*record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *record, lag=4)
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
def test_parameter_covariance_is_that_of_ordinary_least_squares(record, structure):
    path = ReducedRegression(*record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *record, lag=4)
    reference = sm.OLS(target, regressors).fit()
    np.testing.assert_allclose(path.solution(0.0), reference.params, rtol=1e-8)
    deviations = path.standard_deviations(0.0) * path.target_scale / path.column_scale
    np.testing.assert_allclose(deviations, reference.bse, rtol=1e-8)


@pytest.mark.parametrize(
    ("structure", "truth"),
    [
        (KB.structure, TransferFunction((1.9, -1.5), (1.0, -0.7))),
        (ArxStructure(2, (0, 1, 2)), TransferFunction((1.0, -0.4, 0.2), (1.0, -1.1, 0.5))),
        (ArxStructure(4, (1, 2)), TransferFunction((0.0, 0.4, 0.2), (1.0, -0.5, 0.2, -0.1, 0.3))),
    ],
)
def test_noise_free_coefficients_are_recovered(structure, truth):
    inputs = np.random.default_rng(2).standard_normal(300)
    outputs = truth.simulate(inputs)
    found = structure.transfer_function(ReducedRegression(inputs, outputs, 5).path(structure).solution(0.0))
    np.testing.assert_allclose(found.numerator, truth.numerator, atol=1e-10)
    np.testing.assert_allclose(found.denominator, truth.denominator, atol=1e-10)
    np.testing.assert_allclose(structure.coefficients(found), structure.coefficients(truth), atol=1e-9)


@pytest.mark.parametrize(("correlation", "published"), [(0.5835, 1.95), (0.573, 1.92), (0.418, 1.56)])
def test_condition_number_of_two_standardised_columns(correlation, published):
    """√((1+ρ)/(1−ρ)): the thesis's MW condition numbers belong to moderate correlations of u and y."""
    rng = np.random.default_rng(0)
    first, second = np.linalg.qr(rng.standard_normal((500, 2)))[0].T
    columns = np.column_stack([first, correlation * first + np.sqrt(1 - correlation**2) * second]) * [
        1e3,
        1e-3,
    ]
    path = RidgePath.factorise(columns, rng.standard_normal(500), 500)
    assert path.condition_number == pytest.approx(np.sqrt((1 + correlation) / (1 - correlation)), rel=1e-9)
    assert path.condition_number == pytest.approx(published, abs=0.01)


def test_a_single_sine_is_reported_as_rank_deficient():
    time = np.arange(600) * 0.01
    inputs = np.sin(2 * np.pi * time)
    outputs = TransferFunction((1.9, -1.5), (1.0, -0.7)).simulate(inputs)[200:]
    path = ReducedRegression(inputs[200:], outputs, 4).path(ArxStructure(3, (0, 1, 2, 3)))
    assert path.rank == 2
    assert path.condition_number is None
    assert path.standard_deviations(0.0) is None
    assert np.isfinite(path.solution(0.0)).all()
    assert path.residual_sum_of_squares(0.0) < 1e-15 * path.rows


def test_units_change_neither_condition_nor_standardised_solution(record):
    inputs, outputs = record
    path = ReducedRegression(inputs, outputs, 3).path(KB.structure)
    other = ReducedRegression(inputs * 1e-3, outputs * 4.448, 3).path(KB.structure)
    assert other.condition_number == pytest.approx(path.condition_number, rel=1e-9)
    np.testing.assert_allclose(other.standardised_solution(2.0), path.standardised_solution(2.0), rtol=1e-8)


def test_ridge_grid_starts_at_zero_and_ends_at_the_maximum():
    grid = ridge_grid(1e-3, 100.0, 26)
    assert grid[0] == 0.0
    assert grid[-1] == pytest.approx(100.0)
    np.testing.assert_allclose(np.diff(np.log(grid[1:])), np.log(1e5) / 25)


@pytest.mark.parametrize(
    ("vaf", "fit"),
    [
        (12.24, 6.32),
        (81.16, 56.59),
        (82.64, 58.33),
        (2.09, 1.05),
        (66.16, 41.83),
        (67.44, 42.94),
        (6.92, 3.52),
        (70.21, 45.42),
        (72.55, 47.61),
    ],
)
def test_metrics_reproduce_every_published_pair_of_vaf_and_fit(vaf, fit):
    """Table 3.1 of the thesis: an error of zero mean with this VAF has this FIT."""
    rng = np.random.default_rng(0)
    measured, error = rng.standard_normal((2, 5000))
    error -= error.mean()
    error *= np.sqrt(1 - vaf / 100) * measured.std() / error.std()
    assert variance_accounted_for(measured, measured + error) == pytest.approx(vaf, abs=1e-9)
    assert fit_ratio(measured, measured + error) == pytest.approx(fit, abs=0.006)


def test_metrics_of_numbers_worked_by_hand():
    measured, modelled = np.array([1.0, 2.0, 3.0, 6.0]), np.array([1.0, 1.0, 4.0, 6.0])
    assert mean_residual(measured, modelled) == 0.5
    assert variance_accounted_for(measured, modelled) == pytest.approx(100 * (1 - 0.5 / 3.5))
    assert fit_ratio(measured, modelled) == pytest.approx(100 * (1 - np.sqrt(0.5 / 3.5)))
    assert normalized_mean_squared_error(measured, modelled) == pytest.approx(2 / 50)
    assert condition_number(np.array([4.0, 0.5]), 10) == 8.0
    assert condition_number(np.array([4.0, 1e-16]), 10) is None
