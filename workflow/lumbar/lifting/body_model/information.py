"""Information of all measurements about states and constants: normal equations, gathered measurement by measurement.

A residual may be correlated in time as skin that stays displaced: a first-order Gauss-Markov process, whose
innovations e(t) - φ e(t-1) are independent, so that each frame is coupled to the one before alone. The matrix is
[[A, B], [Bᵀ, C]]: A, block-tridiagonal, couples each instant to its neighbours, C the constants to each other, B constants to
all instants. A = L Lᵀ is factored block by block; the Schur complement S = C - Bᵀ A⁻¹ B is the information left for the
constants (Golub and Van Loan, Matrix Computations, 4th ed., section 4.5).
"""

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
        forward = _forward(self.diagonal, self.below, states[:, None])
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

    def _backward(self, right: np.ndarray) -> np.ndarray:
        size = self.diagonal.shape[1]
        blocks = right.reshape(len(self.diagonal), size, -1).copy()
        for index in range(len(blocks) - 1, -1, -1):
            if index + 1 < len(blocks):
                blocks[index] -= self.below[index].T @ blocks[index + 1]
            blocks[index] = dtrtrs(self.diagonal[index], blocks[index], lower=1, trans=1)[0]
        return blocks.reshape(right.shape)


def factorise(diagonal: np.ndarray, below: np.ndarray, border: np.ndarray, corner: np.ndarray) -> ArrowFactor:
    """Factor a positive-definite matrix; its parts have the shapes of `ArrowFactor`, a block below is in row i + 1 and column i.

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


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a residual per axis, metres, and its correlation from one instant to the next."""

    sd: float
    phi: float = 0.0

    def whitening(self, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors of e(t), shape (n,), and of e(t - 1), shape (n - 1,), that make innovations of unit variance.

        After a frame without a measurement the process starts anew with all its variance.
        """
        seen = weight > 0
        chained = np.concatenate([[False], seen[1:] & seen[:-1]]) & (self.phi > 0)
        scale = np.sqrt(weight) / (self.sd * np.where(chained, np.sqrt(1 - self.phi**2), 1.0))
        return scale, (self.phi * scale * chained)[1:]


def _stack_slopes(slopes: list[tuple[slice, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Columns, shape (k,), and derivatives by them, shape (n, m, k), in one."""
    columns = np.concatenate([np.arange(where.start, where.stop) for where, _ in slopes])
    return columns, np.concatenate([values for _, values in slopes], axis=2)


class Information:
    """Normal equations of states, shape (n, size), and constants."""

    def __init__(self, n: int, size: int, constants: int):
        self.same = np.zeros((n, size, size))
        self.next = np.zeros((n - 1, size, size))
        self.second = np.zeros((n - 2, size))
        self.border = np.zeros((n, size, constants))
        self.corner = np.zeros((constants, constants))
        self.states, self.constants = np.zeros((n, size)), np.zeros(constants)

    def add(
        self,
        residual: np.ndarray,
        states: list[tuple[slice, np.ndarray]],
        constants: list[tuple[slice, np.ndarray]],
        noise: Noise,
        weight: np.ndarray,
    ) -> None:
        """Add a measurement made at every instant.

        Parameters
        ----------
        residual : ndarray, shape (n, m)
            Measured less predicted; any number where the weight is zero.
        states, constants : list of (slice, ndarray)
            Derivatives of the prediction, as of `lumbar.lifting.body_model.structure.Position`.
        weight : ndarray, shape (n,)
            0 where there is no measurement; between 0 and 1 where it counts less.
        """
        columns, slope = _stack_slopes(states)
        scale, back = noise.whitening(weight)
        clean = np.where(weight[:, None] > 0, residual, 0.0)
        white = scale[:, None] * clean
        white[1:] -= back[:, None] * clean[:-1]
        own, earlier = scale[:, None, None] * slope, -back[:, None, None] * slope[:-1]
        rows, across = columns[:, None], columns[None]
        square = np.einsum("nmi,nmj->nij", own, own)
        square[:-1] += np.einsum("nmi,nmj->nij", earlier, earlier)
        self.same[:, rows, across] += square
        self.next[:, rows, across] += np.einsum("nmi,nmj->nij", own[1:], earlier)
        self.states[:, columns] += np.einsum("nmi,nm->ni", own, white)
        self.states[:-1, columns] += np.einsum("nmi,nm->ni", earlier, white[1:])
        if constants:
            there, fixed = _stack_slopes(constants)
            shared = scale[:, None, None] * fixed
            shared[1:] -= back[:, None, None] * fixed[:-1]
            cross = np.einsum("nmi,nmj->nij", own, shared)
            cross[:-1] += np.einsum("nmi,nmj->nij", earlier, shared[1:])
            self.border[:, rows, there[None]] += cross
            self.corner[np.ix_(there, there)] += np.einsum("nmi,nmj->ij", shared, shared)
            self.constants[there] += np.einsum("nmi,nm->i", shared, white)

    def add_smoothness(self, columns: slice, bend: np.ndarray, precision: float) -> None:
        """Add that second differences, at present `bend`, shape (n - 2, k), are small: integrated white acceleration.

        `precision` is one over the variance of a second difference.
        """
        coefficient = (1.0, -2.0, 1.0)
        where = np.arange(columns.start, columns.stop)
        n = len(self.states)
        for first in range(3):
            self.states[first : n - 2 + first, columns] -= precision * coefficient[first] * bend
            self.same[first : n - 2 + first, where, where] += precision * coefficient[first] ** 2
        self.next[:-1, where, where] += precision * coefficient[0] * coefficient[1]
        self.next[1:, where, where] += precision * coefficient[1] * coefficient[2]
        self.second[:, columns] += precision

    def add_prior(self, columns: np.ndarray, root: np.ndarray, residual: np.ndarray) -> None:
        """Add what is known of constants: `root` @ (true - present) = `residual`, with unit variance."""
        self.corner[np.ix_(columns, columns)] += root.T @ root
        self.constants[columns] += root.T @ residual

    def factor(self) -> ArrowFactor:
        """Factor it, two instants to a block."""
        n, size, _ = self.same.shape
        half, block = n // 2, 2 * size
        diagonal = np.zeros((half, block, block))
        below = np.zeros((half - 1, block, block))
        axis = np.arange(size)
        diagonal[:, :size, :size], diagonal[:, size:, size:] = self.same[0::2], self.same[1::2]
        diagonal[:, size:, :size] = self.next[0::2]
        diagonal[:, :size, size:] = np.swapaxes(self.next[0::2], 1, 2)
        below[:, :size, size:] = self.next[1::2]
        below[:, axis, axis] = self.second[0::2]
        below[:, size + axis, size + axis] = self.second[1::2]
        return factorise(diagonal, below, self.border.reshape(n * size, -1), self.corner)
