"""The sum-of-squares programme of one knot (Eqs 4.5 and 4.6, ρ̇ a variable), for Clarabel.

In normal coordinates (`exact_funnel`), with v(z) the polynomial of V̇/ρ and d the sine's Taylor degree,

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

says that V̇/ρ ≤ r on V = ρ. The thesis's alternation needs L; a status other than "solved" is never a result.
"""

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.programme.polynomials import circle_map, gram_map, monomials


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
            raise NumericalError(
                f"{label}: the sum-of-squares programme ended as {self._programme.status}", label
            )
        return float(found[0]) * scale, found[1:] * scale
