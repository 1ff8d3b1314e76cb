"""Sum-of-squares programmes on the unit circle, assembled by hand for Clarabel, and recovery of multipliers.

The certificate of one knot (equations 4.5 and 4.6 with ρ̇ as a variable, in the coordinates of `invariance`)

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

says that V̇/ρ ≤ r on V = ρ; with ρ̇/ρ given it is the margin form, γ = ρ̇/ρ − r is maximised. As L is free,
only what both sides are *on the circle* matters: the programme is solved in the quotient ring of polynomials
modulo 1 − |z|², whose basis are the circular harmonics 1, cos kφ, sin kφ. That leaves d + 2 times fewer
unknowns and, the harmonics being orthogonal, well-conditioned programmes. L follows by exact division
(`multiplier`), so nothing is lost: a non-negative trigonometric polynomial is a sum of squares (Fejér, Riesz).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.polynomials import circle_map, harmonics, harmonics_of_monomials, monomials

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


@dataclass(frozen=True)
class CircleCertificate:
    """Certified bound of a polynomial on the unit circle.

    Attributes
    ----------
    rate : float
        r in 1/s: the polynomial is at most r on |z| = 1.
    gram : numpy.ndarray, shape (d + 2, d + 2)
        G over the harmonics 1, cos φ, sin φ, …, of order (d + 1)/2; G ≽ 0 up to the solver's tolerance.
    """

    rate: float
    gram: np.ndarray


class CircleProgramme:
    """The programme of one Taylor degree d (odd), set up once and solved for many knots."""

    def __init__(self, degree: int):
        import clarabel
        from scipy import sparse

        self.degree = degree
        self._solved = clarabel.SolverStatus.Solved
        gram = _gram_rows(degree)
        equations, entries = gram.shape
        self._size = degree + 2
        self._triangle = tuple(
            np.array([(row, column) for column in range(self._size) for row in range(column + 1)]).T
        )
        constant = -np.eye(equations)[:, :1]
        matrix = np.block([[constant, gram], [np.zeros((entries, 1)), -np.eye(entries)]])
        self._target = np.zeros(equations + entries)
        self._equations = equations

        def solver(tolerance):
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.presolve_enable = False  # otherwise the data cannot be exchanged
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
            return clarabel.DefaultSolver(
                sparse.csc_matrix((entries + 1, entries + 1)),
                np.eye(entries + 1)[0],
                sparse.csc_matrix(matrix),
                self._target,
                [clarabel.ZeroConeT(equations), clarabel.PSDTriangleConeT(self._size)],
                settings,
            )

        self._solvers = [solver(tolerance) for tolerance in TOLERANCES]

    def solve(self, coefficients: np.ndarray, label: str) -> CircleCertificate:
        """Bound a polynomial on the circle.

        Parameters
        ----------
        coefficients : numpy.ndarray, shape (monomials of degree d + 1,)
            Of v in 1/s.
        label : str
            For messages.

        Raises
        ------
        NumericalError
            The solver's status is not "solved" ("almost solved" is not solved).
        """
        target = harmonics_of_monomials(self.degree + 1) @ coefficients
        scale = float(np.abs(target).max()) or 1.0
        self._target[: self._equations] = -target / scale
        for solver in self._solvers:
            solver.update(b=self._target)
            solution = solver.solve()
            if solution.status == self._solved:
                break
        else:
            raise NumericalError(f"{label}: the sum-of-squares programme ended as {solution.status}")
        found = np.array(solution.x)
        gram = np.zeros((self._size, self._size))
        rows, columns = self._triangle
        gram[rows, columns] = found[1:] * np.where(rows == columns, scale, scale / np.sqrt(2.0))
        return CircleCertificate(float(found[0]) * scale, gram + np.triu(gram, 1).T)


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
