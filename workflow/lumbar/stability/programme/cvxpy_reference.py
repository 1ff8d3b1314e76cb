"""The sum-of-squares programme of one knot as one would write it on paper, through cvxpy: a readable reference.

Slow (it is built anew for every knot) and used by tests and the benchmark only.
"""

from __future__ import annotations

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.funnel.polynomials import monomials


def certified_rate(coefficients: np.ndarray, degree: int) -> float:
    """Return the smallest r with r − v − L·(1 − |z|²) a sum of squares, L free of degree d − 1.

    Parameters
    ----------
    coefficients : numpy.ndarray, shape (monomials of degree d + 1,)
        Of v.
    degree : int
        Taylor degree d.

    Raises
    ------
    NumericalError
        The status is not "optimal".
    """
    import cvxpy as cp

    basis = monomials((degree + 1) // 2)
    rate = cp.Variable()
    multiplier = {exponents: cp.Variable() for exponents in monomials(degree - 1)}
    gram = cp.Variable((len(basis), len(basis)), PSD=True)
    scale = float(np.abs(coefficients).max())
    left = {
        exponents: -value / scale
        for exponents, value in zip(monomials(degree + 1), coefficients, strict=True)
    }
    left[0, 0] += rate
    for (i, j), variable in multiplier.items():
        left[i, j] -= variable
        left[i + 2, j] += variable
        left[i, j + 2] += variable
    right = dict.fromkeys(monomials(degree + 1), 0)
    for row, (i, j) in enumerate(basis):
        for column, (k, m) in enumerate(basis):
            right[i + k, j + m] += gram[row, column]
    problem = cp.Problem(cp.Minimize(rate), [left[exponents] == right[exponents] for exponents in right])
    problem.solve(solver=cp.CLARABEL)
    if problem.status != cp.OPTIMAL:
        raise NumericalError(f"the sum-of-squares programme ended as {problem.status}")
    return float(rate.value) * scale
