"""The sum-of-squares programme of one knot (Eqs 4.5 and 4.6, ρ̇ a variable), in two equivalent forms for Clarabel.

In normal coordinates (`exact_funnel`), with v(z) the polynomial of V̇/ρ and d the sine's Taylor degree,

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

says that V̇/ρ ≤ r on V = ρ; with ρ̇/ρ given it is the margin form, γ = ρ̇/ρ − r is maximised. The thesis's alternation
needs L: `Certificate` has it written out. `certified_funnel` needs r alone, and only what both sides are *on the circle*
matters then: `CircleProgramme` works in the quotient ring of polynomials modulo 1 − |z|², whose basis are the circular
harmonics 1, cos kφ, sin kφ. That leaves d + 2 times fewer unknowns and, the harmonics being orthogonal, well-conditioned
programmes; a non-negative trigonometric polynomial is a sum of squares (Fejér, Riesz), so nothing is lost.

Where a law holds only on the arc on which an affine function g(z) is not negative (`polynomials.Case`), the S-procedure
subtracts g(z)·σ(z), σ a sum of squares of degree d − 1; on the circle

    r − v(z) = b(z)ᵀG·b(z) + g(z)·c(z)ᵀH·c(z)   on |z| = 1,   G, H ⪰ 0

with the harmonics of half the odd orders in c, cos φ/2, sin φ/2, cos 3φ/2, …, whose products have whole ones. Nothing is
lost here either (Dumitrescu, Positive Trigonometric Polynomials, 2017, section 1.4). A status other than "solved" is never
a result.
"""

from functools import cache

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.programme.polynomials import (
    circle_map,
    gram_map,
    harmonics,
    harmonics_of_monomials,
    monomials,
)


class SumOfSquares:
    """Minimise cᵀy so that polynomials, affine in y, are sums of squares: set up once, solved for many targets.

    In normal form: minimise cᵀy subject to F·y + Σ Γ·g = target, where each g holds the upper triangle, column by
    column, of a positive semidefinite Gram matrix G (off-diagonal entries times √2) and Γ·g the coefficients of bᵀGb
    (Eq. 2.13) in any basis of polynomials.

    Parameters
    ----------
    cost : numpy.ndarray, shape (free,)
        c.
    free : numpy.ndarray, shape (coefficients, free)
        F.
    grams : list of numpy.ndarray, shape (coefficients, triangle)
        Γ of each Gram matrix.
    tolerance : float
        Of gaps and residuals.
    """

    def __init__(self, cost: np.ndarray, free: np.ndarray, grams: list[np.ndarray], tolerance: float = 1e-8):
        import clarabel
        from scipy import sparse

        rows = np.hstack([free, *grams])
        self._equations, variables = rows.shape
        self._free = len(cost)
        entries = variables - self._free
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # otherwise the target cannot be exchanged
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        # n(n + 1)/2 entries stand for a matrix of size n.
        sizes = [int(np.sqrt(2 * gram.shape[1])) for gram in grams]
        self._target = np.zeros(self._equations + entries)
        self._solved = clarabel.SolverStatus.Solved
        self._solver = clarabel.DefaultSolver(
            sparse.csc_matrix((variables, variables)),
            np.concatenate([cost, np.zeros(entries)]),
            sparse.csc_matrix(np.vstack([rows, np.eye(variables)[self._free :] * -1.0])),
            self._target,
            [clarabel.ZeroConeT(self._equations), *map(clarabel.PSDTriangleConeT, sizes)],
            settings,
        )
        self.status = ""

    def solve(self, target: np.ndarray) -> np.ndarray | None:
        """Return y, or None where the solver does not say "solved" (almost solved is not solved)."""
        self._target[: self._equations] = target
        self._solver.update(b=self._target)
        solution = self._solver.solve()
        self.status = str(solution.status)
        return np.array(solution.x[: self._free]) if solution.status == self._solved else None


class Certificate:
    """Eq. 4.6 with ρ given and ρ̇ a variable, at one Taylor degree and many knots."""

    def __init__(self, degree: int, accuracy: float = 1e-8):
        constant = np.eye(len(monomials(degree + 1)))[:, :1]
        # r − v − L·(1 − |z|²) = bᵀGb
        free = np.hstack([-constant, circle_map(degree)])
        self._programme = SumOfSquares(np.eye(free.shape[1])[0], free, [gram_map(degree)], accuracy)

    def solve(self, coefficients: np.ndarray, label: str) -> tuple[float, np.ndarray]:
        """Return the smallest certified rate r in 1/s and the coefficients of L.

        Raises
        ------
        NumericalError
            The solver did not reach an optimum.
        """
        scale = float(np.abs(coefficients).max())
        found = self._programme.solve(-coefficients / scale)
        if found is None:
            raise NumericalError(f"{label}: the sum-of-squares programme ended as {self._programme.status}")
        return float(found[0]) * scale, found[1:] * scale


TOLERANCES = (1e-8, 1e-7)
"""Of gaps and residuals, on polynomials scaled to a largest harmonic of one; tried in turn until the status is
"solved". The first is Clarabel's own."""


def _products(basis: np.ndarray, factors: np.ndarray, angle: np.ndarray, order: int, unit: int) -> np.ndarray:
    """Matrices from the scaled upper triangle of a Gram matrix to the harmonics of each factor times bᵀGb.

    Their entries are multiples of 1/`unit` and exact.
    """
    projection = harmonics(order, angle) * (2 / len(angle))
    projection[0] /= 2
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    products = np.stack([basis[row] * basis[column] for row, column in triangle], axis=1)
    exact = np.round(projection @ (factors[:, :, None] * products) * unit) / unit
    return exact * [1.0 if row == column else np.sqrt(2.0) for row, column in triangle]


@cache
def _gram_rows(degree: int) -> np.ndarray:
    """Matrix from the scaled upper triangle of G to the harmonics of bᵀGb."""
    angle = np.linspace(0.0, 2 * np.pi, 4 * (degree + 1), endpoint=False)
    basis = harmonics((degree + 1) // 2, angle)
    return _products(basis, np.ones((1, len(angle))), angle, degree + 1, 4)[0]


@cache
def _side_rows(degree: int) -> np.ndarray:
    """Matrices from the scaled upper triangle of H to the harmonics of cᵀHc, of cos φ and of sin φ times it."""
    angle = np.linspace(0.0, 2 * np.pi, 4 * (degree + 2), endpoint=False)
    half = np.outer(np.repeat(np.arange(1, (degree + 1) // 2 + 1) - 0.5, 2), angle)
    basis = np.where(np.arange(len(half))[:, None] % 2, np.sin(half), np.cos(half))
    return _products(basis, harmonics(1, angle), angle, degree + 1, 8)


class CircleProgramme:
    """The programme of one Taylor degree d (odd), set up once and solved for many knots."""

    def __init__(self, degree: int):
        self._gram = _gram_rows(degree)
        self._side = _side_rows(degree)
        self._harmonics = harmonics_of_monomials(degree + 1)
        self._programmes = [self._programme([self._gram], tolerance) for tolerance in TOLERANCES]

    def _programme(self, grams: list[np.ndarray], tolerance: float) -> SumOfSquares:
        constant = np.eye(len(self._gram))[:, :1]
        return SumOfSquares(np.ones(1), -constant, grams, tolerance)

    def rate(self, coefficients: np.ndarray, label: str, side: np.ndarray | None = None) -> float:
        """Return the smallest certified bound of a polynomial on the circle, or on an arc of it, in 1/s.

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
        target = self._harmonics @ coefficients
        scale = float(np.abs(target).max()) or 1.0
        programmes = self._programmes
        if side is not None:
            grams = [self._gram, np.tensordot(side, self._side, 1)]
            programmes = (self._programme(grams, tolerance) for tolerance in TOLERANCES)
        for programme in programmes:
            found = programme.solve(-target / scale)
            if found is not None:
                return float(found[0]) * scale
        raise NumericalError(f"{label}: the sum-of-squares programme ended as {programme.status}")
