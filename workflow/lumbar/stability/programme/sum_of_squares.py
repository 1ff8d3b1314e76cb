"""Sum-of-squares programmes with their multiplier written out, as equations 4.5 and 4.6 have them.

At one knot, in the normal coordinates of `invariance`, with h expanded to a Taylor polynomial v(z) of V̇/ρ:

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²)  is a sum of squares,   L free of degree d − 1

The thesis's alternation needs L and uses these; `certified_funnel` uses the smaller, equivalent programmes of
`circle_certificate`. Where a law holds only on one side g(z) ≥ 0 of a line (`saturation_cases`), the S-procedure
subtracts g(z)·σ(z), σ a sum of squares of degree d − 1. A status other than "solved" is never a result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.funnel.polynomials import circle_map, gram_map, monomials, side_map


class Constraints(NamedTuple):
    """Constraint matrix (scipy.sparse.csc_matrix) and cones of a programme."""

    matrix: object
    cones: list


class GramProgramme:
    """Maximise one number so that a polynomial, affine in free coefficients, is a sum of squares.

    In normal form: minimise cᵀy subject to F·y + Γ·g = target, where g holds the upper triangle of a
    positive semidefinite Gram matrix G (off-diagonal entries times √2) and Γ·g the coefficients of bᵀGb
    (equation 2.13).

    Parameters
    ----------
    degree : int
        Of the sine's Taylor polynomial.
    accuracy : float
        Duality gap and residuals, relative, at which the solver stops.
    """

    def __init__(self, degree: int, accuracy: float = 1e-8):
        import clarabel
        from scipy import sparse

        self._clarabel, self._sparse = clarabel, sparse
        self._degree = degree
        self._gram = gram_map(degree)
        self._sizes = [len(monomials(order)) for order in ((degree + 1) // 2, (degree - 1) // 2)]
        self._settings = clarabel.DefaultSettings()
        self._settings.verbose = False
        self._settings.tol_gap_abs = self._settings.tol_gap_rel = self._settings.tol_feas = accuracy

    def constraints(self, free: np.ndarray, side: np.ndarray | None = None) -> Constraints:
        """Return the constraints for F of shape (monomials, free coefficients), ready for `solve`.

        With `side`, g over 1, z1, z2, they hold where g ≥ 0: g·σ is added to bᵀGb.
        """
        grams = [self._gram] if side is None else [self._gram, side_map(side, self._degree)]
        gram = np.hstack(grams)
        coefficients, entries = gram.shape
        below = np.zeros((entries, free.shape[1]))
        matrix = self._sparse.csc_matrix(np.block([[free, gram], [below, -np.eye(entries)]]))
        sizes = self._sizes[: len(grams)]
        cones = [self._clarabel.ZeroConeT(coefficients), *map(self._clarabel.PSDTriangleConeT, sizes)]
        return Constraints(matrix, cones)

    def solve(self, cost: np.ndarray, constraints: Constraints, target: np.ndarray) -> np.ndarray | None:
        """Return y, or None where the solver does not say "solved" (almost solved is not solved).

        Parameters
        ----------
        cost : numpy.ndarray, shape (free coefficients,)
            c.
        constraints : Constraints
        target : numpy.ndarray, shape (monomials,)
        """
        variables = constraints.matrix.shape[1]
        entries = variables - len(cost)
        solver = self._clarabel.DefaultSolver(
            self._sparse.csc_matrix((variables, variables)),
            np.concatenate([cost, np.zeros(entries)]),
            constraints.matrix,
            np.concatenate([target, np.zeros(entries)]),
            constraints.cones,
            self._settings,
        )
        solution = solver.solve()
        self.status = str(solution.status)
        if solution.status != self._clarabel.SolverStatus.Solved:
            return None
        return np.array(solution.x[: len(cost)])


class Certificate:
    """The programme of one Taylor degree, for many knots."""

    def __init__(self, degree: int, accuracy: float = 1e-8):
        self.degree = degree
        self._programme = GramProgramme(degree, accuracy)
        constant = np.eye(len(monomials(degree + 1)))[:, :1]
        # r − v − L·(1 − |z|²) = bᵀGb
        self._free = np.hstack([-constant, circle_map(degree)])
        self._constraints = self._programme.constraints(self._free)
        self._cost = np.eye(self._free.shape[1])[0]

    def solve(
        self, coefficients: np.ndarray, label: str, side: np.ndarray | None = None
    ) -> tuple[float, np.ndarray]:
        """Return the smallest certified rate r in 1/s, where `side` is ≥ 0, and the coefficients of L.

        Raises
        ------
        NumericalError
            The solver did not reach an optimum.
        """
        scale = float(np.abs(coefficients).max())
        constraints = self._constraints if side is None else self._programme.constraints(self._free, side)
        found = self._programme.solve(self._cost, constraints, -coefficients / scale)
        if found is None:
            raise NumericalError(f"{label}: the sum-of-squares programme ended as {self._programme.status}")
        return float(found[0]) * scale, found[1:] * scale
