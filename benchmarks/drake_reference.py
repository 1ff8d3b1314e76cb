"""The sum-of-squares programme of one knot in pydrake with its Clarabel, for comparison (an extra of the tests)."""

from __future__ import annotations

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.symbolic import Polynomial, Variables

from lumbar.lifting.stability.programme.polynomials import monomials


def drake_rate(coefficients: np.ndarray) -> float:
    """Return the smallest r with r − v − L·(1 − |z|²) a sum of squares at Taylor degree 3."""
    program = MathematicalProgram()
    z = program.NewIndeterminates(2)
    rate = program.NewContinuousVariables(1)[0]
    multiplier = program.NewFreePolynomial(Variables(z), 2)
    scale = float(np.abs(coefficients).max())
    growth = sum(
        float(value) / scale * z[0] ** i * z[1] ** j
        for value, (i, j) in zip(coefficients, monomials(4), strict=True)
        if value
    )
    constant = Polynomial(rate - growth, Variables(z))
    ring = Polynomial(1 - z[0] ** 2 - z[1] ** 2, Variables(z))
    program.AddSosConstraint(constant - multiplier * ring)
    program.AddLinearCost(rate)
    result = ClarabelSolver().Solve(program)
    if not result.is_success():
        raise RuntimeError(f"pydrake: {result.get_solution_result()}")
    return float(result.GetSolution(rate)) * scale
