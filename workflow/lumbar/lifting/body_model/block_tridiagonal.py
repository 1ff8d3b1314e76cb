"""Symmetric block-tridiagonal systems with a border: trajectories coupled to neighbours, constants coupled to all.

The matrix is [[A, B], [Bᵀ, C]]: A couples each instant to its neighbours, C the constants to each other. A = L Lᵀ is
factored block by block; the Schur complement S = C - Bᵀ A⁻¹ B is the information left for the constants (Golub and
Van Loan, Matrix Computations, 4th ed., section 4.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dtrtrs

from lumbar.base.errors import NumericalError


@dataclass(frozen=True)
class ArrowFactor:
    """Cholesky factor of a bordered block-tridiagonal matrix."""

    diagonal: np.ndarray
    """Shape (k, b, b): lower-triangular blocks of L."""
    below: np.ndarray
    """Shape (k - 1, b, b): blocks of L under them."""
    border: np.ndarray
    """Shape (k * b, c): L⁻¹ B."""
    corner: np.ndarray
    """Shape (c, c): lower-triangular factor of the Schur complement."""

    def solve(self, states: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solution for right-hand sides of shapes (k * b,) and (c,)."""
        forward = self._forward(states[:, None])
        rest = constants - (self.border.T @ forward)[:, 0]
        lower = solve_triangular(self.corner, rest, lower=True)
        constants = solve_triangular(self.corner, lower, lower=True, trans="T")
        states = self._backward(forward - self.border @ constants[:, None])[:, 0]
        return states, constants

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Normal deviates whose covariance is the matrix's inverse, shapes (k * b, count) and (c, count)."""
        constants = solve_triangular(
            self.corner, rng.standard_normal((len(self.corner), count)), lower=True, trans="T"
        )
        white = rng.standard_normal((len(self.border), count))
        return self._backward(white - self.border @ constants), constants

    def _forward(self, right: np.ndarray) -> np.ndarray:
        return _forward(self.diagonal, self.below, right)

    def _backward(self, right: np.ndarray) -> np.ndarray:
        size = self.diagonal.shape[1]
        blocks = right.reshape(len(self.diagonal), size, -1).copy()
        for index in range(len(blocks) - 1, -1, -1):
            if index + 1 < len(blocks):
                blocks[index] -= self.below[index].T @ blocks[index + 1]
            blocks[index] = dtrtrs(self.diagonal[index], blocks[index], lower=1, trans=1)[0]
        return blocks.reshape(right.shape)


def factored(diagonal: np.ndarray, below: np.ndarray, border: np.ndarray, corner: np.ndarray) -> ArrowFactor:
    """Factor a positive-definite matrix.

    Parameters
    ----------
    diagonal : ndarray, shape (k, b, b)
    below : ndarray, shape (k - 1, b, b)
        Block in row i + 1 and column i.
    border : ndarray, shape (k * b, c)
    corner : ndarray, shape (c, c)

    Raises
    ------
    NumericalError
        If it is not positive definite: something is neither seen nor has a prior.
    """
    lower, under = np.empty_like(diagonal), np.empty_like(below)
    try:
        for index, block in enumerate(diagonal):
            if index:
                under[index - 1] = dtrtrs(lower[index - 1], below[index - 1].T, lower=1)[0].T
                block = block - under[index - 1] @ under[index - 1].T
            lower[index] = cholesky(block, lower=True)
        reduced = _forward(lower, under, border)
        return ArrowFactor(lower, under, reduced, cholesky(corner - reduced.T @ reduced, lower=True))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NumericalError(
            f"the body model's information matrix is not positive definite: {error}"
        ) from error


def _forward(diagonal: np.ndarray, below: np.ndarray, right: np.ndarray) -> np.ndarray:
    size = diagonal.shape[1]
    blocks = right.reshape(len(diagonal), size, -1).copy()
    for index in range(len(blocks)):
        if index:
            blocks[index] -= below[index - 1] @ blocks[index - 1]
        blocks[index] = dtrtrs(diagonal[index], blocks[index], lower=1)[0]
    return blocks.reshape(right.shape)
