"""Sum-of-squares programmes on the unit circle, assembled by hand for Clarabel, and recovery of multipliers.

The certificate of one knot (equations 4.5 and 4.6 with ρ̇ as a variable, in the coordinates of `invariance`)

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

says that V̇/ρ ≤ r on V = ρ; with ρ̇/ρ given it is the margin form, γ = ρ̇/ρ − r is maximised. As L is free,
only what both sides are *on the circle* matters: the programme is solved in the quotient ring of polynomials
modulo 1 − |z|², whose basis are the circular harmonics 1, cos kφ, sin kφ. That leaves d + 2 times fewer
unknowns and, the harmonics being orthogonal, well-conditioned programmes. L follows by exact division
(`multiplier`), so nothing is lost: a non-negative trigonometric polynomial is a sum of squares (Fejér, Riesz).

Where a law holds only on the arc on which an affine function g(z) is not negative (`saturation_cases`), the identity

    r − v(z) = b(z)ᵀG·b(z) + g(z)·c(z)ᵀH·c(z)   on |z| = 1,   G, H ⪰ 0

is the S-procedure; c holds the harmonics of half the odd orders, cos φ/2, sin φ/2, cos 3φ/2, …, whose products have
whole ones. Nothing is lost here either (Dumitrescu, Positive Trigonometric Polynomials, 2017, section 1.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.funnel.polynomials import circle_map, harmonics, harmonics_of_monomials, monomials

TOLERANCES = (1e-10, 1e-9, 1e-8)
"""Of gaps and residuals, on polynomials scaled to a largest harmonic of one; tried in turn until the status is
"solved". The last is Clarabel's own."""


@cache
def _gram_rows(degree: int) -> np.ndarray:
    """Matrix from the scaled upper triangle of G, column by column, to the harmonics of bᵀGb."""
    order = (degree + 1) // 2
    samples = 4 * (degree + 1)
    angle = 2 * np.pi * np.arange(samples) / samples
    basis = harmonics(order, angle)
    projection = harmonics(2 * order, angle) * (2 / samples)
    projection[0] /= 2
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    products = np.stack([basis[row] * basis[column] for row, column in triangle], axis=1)
    exact = np.round(projection @ products * 4) / 4
    return exact * [1.0 if row == column else np.sqrt(2.0) for row, column in triangle]


@cache
def _side_rows(degree: int) -> np.ndarray:
    """Matrices from the scaled upper triangle of H to the harmonics of cᵀHc, of cos φ and of sin φ times it."""
    samples = 4 * (degree + 2)
    angle = 2 * np.pi * np.arange(samples) / samples
    half = np.repeat(np.arange(1, (degree + 1) // 2 + 1) - 0.5, 2)
    basis = np.where(
        np.arange(len(half))[:, None] % 2, np.sin(np.outer(half, angle)), np.cos(np.outer(half, angle))
    )
    projection = harmonics(degree + 1, angle) * (2 / samples)
    projection[0] /= 2
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    products = np.stack([basis[row] * basis[column] for row, column in triangle], axis=1)
    factors = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    exact = np.round(projection @ (factors[:, :, None] * products) * 8) / 8
    return exact * [1.0 if row == column else np.sqrt(2.0) for row, column in triangle]


@dataclass(frozen=True)
class CircleCertificate:
    """Certified bound of a polynomial on the unit circle, or on a part of it.

    Attributes
    ----------
    rate : float
        r in 1/s: the polynomial is at most r on |z| = 1, where `side` is ≥ 0.
    gram : numpy.ndarray, shape (d + 2, d + 2)
        G over the harmonics 1, cos φ, sin φ, …, of order (d + 1)/2; G ≽ 0 up to the solver's tolerance.
    side : numpy.ndarray, shape (3,), or None
        g over 1, z1, z2; None where the bound holds all round the circle.
    side_gram : numpy.ndarray, shape (d + 1, d + 1), or None
        H over the harmonics cos φ/2, sin φ/2, ….
    """

    rate: float
    gram: np.ndarray
    side: np.ndarray | None = None
    side_gram: np.ndarray | None = None


class CircleProgramme:
    """The programme of one Taylor degree d (odd), set up once and solved for many knots."""

    def __init__(self, degree: int):
        import clarabel
        from scipy import sparse

        self.degree = degree
        self._clarabel, self._sparse = clarabel, sparse
        self._solved = clarabel.SolverStatus.Solved
        gram = _gram_rows(degree)
        equations, entries = gram.shape
        self._size = degree + 2
        self._rows = np.hstack([-np.eye(equations)[:, :1], gram])
        self._target = np.zeros(equations + entries)
        self._equations = equations
        self._solvers = [self._solver(self._rows, [self._size], tolerance) for tolerance in TOLERANCES]

    def _solver(self, rows: np.ndarray, sizes: list[int], tolerance: float):
        """Return a solver for rows·(r, triangles) = target with positive semidefinite matrices of these sizes."""
        settings = self._clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # otherwise the data cannot be exchanged
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        equations, variables = rows.shape
        cones = np.hstack([np.zeros((variables - 1, 1)), -np.eye(variables - 1)])
        return self._clarabel.DefaultSolver(
            self._sparse.csc_matrix((variables, variables)),
            np.eye(variables)[0],
            self._sparse.csc_matrix(np.vstack([rows, cones])),
            np.zeros(equations + variables - 1),
            [self._clarabel.ZeroConeT(equations), *map(self._clarabel.PSDTriangleConeT, sizes)],
            settings,
        )

    def solve(
        self, coefficients: np.ndarray, label: str, side: np.ndarray | None = None
    ) -> CircleCertificate:
        """Bound a polynomial on the circle, or on an arc of it.

        Parameters
        ----------
        coefficients : numpy.ndarray, shape (monomials of degree d + 1,)
            Of v in 1/s.
        label : str
            For messages.
        side : numpy.ndarray, shape (3,), optional
            g over 1, z1, z2: the bound is to hold where g ≥ 0.

        Raises
        ------
        NumericalError
            The solver's status is not "solved" ("almost solved" is not solved).
        """
        target = harmonics_of_monomials(self.degree + 1) @ coefficients
        scale = float(np.abs(target).max()) or 1.0
        sizes, solvers, padded = [self._size], self._solvers, self._target
        if side is not None:
            sizes.append(self.degree + 1)
            rows = np.hstack([self._rows, np.tensordot(side, _side_rows(self.degree), 1)])
            solvers = (self._solver(rows, sizes, tolerance) for tolerance in TOLERANCES)
            padded = np.zeros(self._equations + rows.shape[1] - 1)
        padded[: self._equations] = -target / scale
        for solver in solvers:
            solver.update(b=padded)
            solution = solver.solve()
            if solution.status == self._solved:
                break
        else:
            raise NumericalError(f"{label}: the sum-of-squares programme ended as {solution.status}")
        found = np.array(solution.x)
        ends = np.cumsum([1, *(size * (size + 1) // 2 for size in sizes)])
        grams = [
            _symmetric(found[start:end] * scale, size)
            for start, end, size in zip(ends[:-1], ends[1:], sizes, strict=True)
        ]
        return CircleCertificate(float(found[0]) * scale, grams[0], side, *grams[1:])


def _symmetric(triangle: np.ndarray, size: int) -> np.ndarray:
    """Return the matrix of a scaled upper triangle, column by column."""
    columns, rows = np.tril_indices(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = triangle * np.where(rows == columns, 1.0, 1 / np.sqrt(2.0))
    return matrix + np.triu(matrix, 1).T


def multiplier(certificate: CircleCertificate, coefficients: np.ndarray, degree: int) -> np.ndarray:
    """Return the coefficients of L of degree d − 1 in r − v − L·(1 − |z|²) = bᵀGb.

    The harmonics of b stand for the polynomials Re(z1 + i·z2)ᵏ and Im(z1 + i·z2)ᵏ.

    Raises
    ------
    NumericalError
        The remainder of the division is not zero: G and r do not belong to this polynomial.
    """
    difference = -np.asarray(coefficients, dtype=float)
    difference[0] += certificate.rate
    difference -= _gram_polynomial(certificate.gram, degree)
    ring = circle_map(degree)
    found, *_ = np.linalg.lstsq(ring, difference, rcond=None)
    error = np.abs(ring @ found - difference).max()
    if error > 1e-6 * max(np.abs(coefficients).max(), 1e-300):
        raise NumericalError(f"no multiplier: remainder {error:.3g}")
    return found


def _gram_polynomial(gram: np.ndarray, degree: int) -> np.ndarray:
    """Coefficients of bᵀGb as a polynomial in z."""
    from scipy.signal import convolve2d

    order = (degree + 1) // 2
    powers = [np.ones((1, 1), dtype=complex)]
    for _ in range(order):
        powers.append(convolve2d(powers[-1], np.array([[0, 1j], [1, 0]])))
    basis = [powers[0].real]
    for power in powers[1:]:
        basis += [power.real, power.imag]
    total = np.zeros((2 * order + 1, 2 * order + 1))
    for row, first in enumerate(basis):
        for column, second in enumerate(basis):
            product = convolve2d(first, second)
            total[: product.shape[0], : product.shape[1]] += gram[row, column] * product
    return np.array([total[i, j] for i, j in monomials(degree + 1)])
