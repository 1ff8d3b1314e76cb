"""The body model's linear algebra against dense matrices: solution, draws, and information of correlated residuals."""

import numpy as np
import pytest

from lumbar.base.errors import NumericalError
from lumbar.lifting.body_model.information import Information, Noise, factorise

N, SIZE, CONSTANTS = 8, 3, 2


def dense(information: Information) -> np.ndarray:
    """The whole matrix of the normal equations."""
    n, size = information.states.shape
    matrix = np.zeros((n * size + CONSTANTS, n * size + CONSTANTS))
    blocks = matrix[: n * size, : n * size].reshape(n, size, n, size)
    for t in range(n):
        blocks[t, :, t] = information.same[t]
        if t + 1 < n:
            blocks[t + 1, :, t], blocks[t, :, t + 1] = information.next[t], information.next[t].T
        if t + 2 < n:
            blocks[t + 2, :, t] = blocks[t, :, t + 2] = np.diag(information.second[t])
    border = information.border.reshape(n * size, -1)
    matrix[: n * size, n * size :], matrix[n * size :, : n * size] = border, border.T
    matrix[n * size :, n * size :] = information.corner
    return matrix


@pytest.fixture
def gathered():
    """Return information of a measurement with a gap, correlated in time, and its independent counterpart."""
    rng = np.random.default_rng(3)
    slope, fixed, residual = rng.normal(size=(N, 2, 2)), rng.normal(size=(N, 2, 1)), rng.normal(size=(N, 2))
    weight = np.array([1.0, 1, 1, 0, 0, 1, 1, 1])
    information = Information(N, SIZE, CONSTANTS)
    information.add(residual, [(slice(1, 3), slope)], [(slice(1, 2), fixed)], Noise(0.5, 0.8), weight)
    whole = np.zeros((N, 2, N * SIZE + CONSTANTS))
    for t in range(N):
        whole[t, :, t * SIZE + 1 : t * SIZE + 3], whole[t, :, N * SIZE + 1] = slope[t], fixed[t, :, 0]
    matrix, right = 0.0, 0.0
    for stretch in (slice(0, 3), slice(5, 8)):
        lag = np.abs(np.subtract.outer(np.arange(3), np.arange(3)))
        inverse = np.linalg.inv(0.25 * 0.8**lag)
        for axis in range(2):
            part = whole[stretch, axis]
            matrix = matrix + part.T @ inverse @ part
            right = right + part.T @ inverse @ residual[stretch, axis]
    return information, matrix, right


def test_a_gauss_markov_residual_has_the_information_of_its_covariance_matrix(gathered):
    information, matrix, right = gathered
    np.testing.assert_allclose(dense(information), matrix, atol=1e-10)
    found = np.concatenate([information.states.ravel(), information.constants])
    np.testing.assert_allclose(found, right, atol=1e-10)


@pytest.fixture
def definite(gathered):
    """Return information that tells all unknowns."""
    information = gathered[0]
    bend = np.random.default_rng(4).normal(size=(N - 2, SIZE))
    information.add_smoothness(slice(0, SIZE), bend, 2.0)
    information.same += 0.3 * np.eye(SIZE)
    information.add_prior(np.arange(CONSTANTS), np.array([[1.0, 0.4], [0.0, 0.7]]), np.array([0.3, -0.2]))
    return information


def test_smoothness_is_that_of_second_differences():
    information = Information(N, SIZE, CONSTANTS)
    bend = np.random.default_rng(5).normal(size=(N - 2, SIZE))
    information.add_smoothness(slice(0, SIZE), bend, 2.0)
    difference = np.diff(np.eye(N), 2, axis=0)
    expected = np.kron(2.0 * difference.T @ difference, np.eye(SIZE))
    np.testing.assert_allclose(dense(information)[: N * SIZE, : N * SIZE], expected, atol=1e-12)
    np.testing.assert_allclose(information.states, -2.0 * difference.T @ bend, atol=1e-12)


def test_the_factor_solves_and_draws_as_the_dense_matrix(definite):
    matrix = dense(definite)
    states, constants = definite.factor().solve(definite.states.ravel(), definite.constants)
    right = np.concatenate([definite.states.ravel(), definite.constants])
    np.testing.assert_allclose(np.concatenate([states, constants]), np.linalg.solve(matrix, right), atol=1e-9)
    drawn = np.concatenate(definite.factor().draws(40000, np.random.default_rng(1)))
    covariance = np.linalg.inv(matrix)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    # The standard error of a correlation from 40,000 draws is at most 0.007.
    np.testing.assert_allclose(np.cov(drawn) / scale, covariance / scale, atol=0.035)


def test_what_nothing_tells_is_an_error():
    empty = np.zeros((1, 2, 2))
    with pytest.raises(NumericalError, match="not positive definite"):
        factorise(empty, np.zeros((0, 2, 2)), np.zeros((2, 1)), np.eye(1))
