"""Eqs 4.5–4.7 formulated directly in cvxpy, and the check of the alternation's programme against them.

The formulation is in the error x̄ = (e, ω), from the equation of motion, and uses neither the normal coordinates nor the
hand-assembled programme of the thesis's alternation (`sum_of_squares`).
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_alternation import ACCURACY, DEGREE
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.funnel.sum_of_squares import Certificate, growth_polynomial, monomials
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops, close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import THESIS, Failure, Trajectory, compute_together

if TYPE_CHECKING:
    from cvxpy.constraints.constraint import Constraint

    from lumbar.settings.lifting import StabilitySettings

TOLERANCES = (1e-8, 1e-7, 1e-6)
"""Tolerances of gaps and residuals, tried until the solver's status is "optimal" (not "optimal_inaccurate"), for a polynomial in
units of the ellipse. The first is Clarabel's default, the last is far below `AGREEMENT`."""
AGREEMENT = 1e-4
"""Largest difference in 1/s between two certified rates that the tolerances of both solvers explain."""


class Polynomial(dict):
    """Polynomial in two variables: coefficients (numbers or expressions of cvxpy) by exponents."""

    def __add__(self, other: Polynomial) -> Polynomial:
        total = Polynomial(self)
        for exponents, value in other.items():
            total[exponents] = total[exponents] + value if exponents in total else value
        return total

    def __mul__(self, other) -> Polynomial:
        if not isinstance(other, Polynomial):
            return Polynomial({exponents: other * value for exponents, value in self.items()})
        product = Polynomial()
        for (i, j), value in self.items():
            product += Polynomial({(i + k, j + m): value * factor for (k, m), factor in other.items()})
        return product

    def __truediv__(self, divisor) -> Polynomial:
        return self * (1 / divisor)

    def __neg__(self) -> Polynomial:
        return self * -1.0

    def __sub__(self, other: Polynomial) -> Polynomial:
        return self + -other


def constant(value) -> Polynomial:
    """Return a polynomial of degree 0.

    Parameters
    ----------
    value : float or cvxpy.Expression
        Value of the polynomial.
    """
    return Polynomial({(0, 0): value})


def unknown(exponents: list[tuple[int, int]], kind: type) -> Polynomial:
    """Return a polynomial with variables (a multiplier L of Eq. 4.5) or parameters of cvxpy as coefficients.

    Parameters
    ----------
    exponents : list of (int, int)
        Exponents of the polynomial's monomials.
    kind : type
        ``cvxpy.Variable`` or ``cvxpy.Parameter``.
    """
    return Polynomial({item: kind() for item in exponents})


def is_sum_of_squares(polynomial: Polynomial) -> list[Constraint]:
    """Return the constraints p = bᵀQb, Q ≽ 0 (Eqs 2.13–2.15), b all monomials (Eq. 2.14).

    Parameters
    ----------
    polynomial : Polynomial
        p, with expressions of cvxpy as coefficients.
    """
    import cvxpy as cp

    degree = max(map(sum, polynomial))
    basis = [Polynomial({exponents: 1.0}) for exponents in monomials((degree + 1) // 2)]
    gram = cp.Variable((len(basis), len(basis)), PSD=True)
    squares = Polynomial()
    for row, first in enumerate(basis):
        for column, second in enumerate(basis):
            squares += first * second * gram[row, column]
    return [polynomial.get(exponents, 0.0) == value for exponents, value in squares.items()]


def s_procedure(positive: Polynomial, zero: Polynomial, multiplier: Polynomial) -> list[Constraint]:
    """Return the constraints that p − L·g is a sum of squares, so that p ≥ 0 if g = 0 (Eq. 4.5, one equality).

    Parameters
    ----------
    positive, zero, multiplier : Polynomial
        p; g; L, with variables of cvxpy as coefficients.
    """
    return is_sum_of_squares(positive - multiplier * zero)


def lyapunov_function(cost: np.ndarray, state: tuple[Polynomial, Polynomial]) -> Polynomial:
    """Return V = x̄ᵀSx̄ (Eq. 4.7), or its partial derivative ∂V/∂t if Ṡ is given for S.

    Parameters
    ----------
    cost : numpy.ndarray, shape (2, 2)
        S, symmetric.
    state : tuple of two Polynomial
        Error x̄ = (e, ω) in rad and rad/s.
    """
    e, w = state
    return e * e * cost[0, 0] + e * w * (2 * cost[0, 1]) + w * w * cost[1, 1]


def lyapunov_rate(
    loops: ClosedLoops, point: int, pendulum: int, state: tuple[Polynomial, Polynomial], degree: int
) -> Polynomial:
    """Return V̇ = ∂V/∂t + ∂V/∂x̄·f (Eq. 2.17) with a Taylor polynomial of the sine about θ0.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    point, pendulum : int
        Point of the grid of `loops`; index of the pendulum.
    state : tuple of two Polynomial
        Error x̄ = (e, ω) in rad and rad/s.
    degree : int
        Degree of the Taylor polynomial.
    """
    pendulums = loops.pendulums
    inertia, damping, gravity = (
        np.broadcast_to(values, len(pendulums.labels))[pendulum]
        for values in (pendulums.inertia, pendulums.damping, pendulums.gravity_torque)
    )
    angle = pendulums.angle[point, pendulum]
    s, q, r = _matrix(loops.cost[point, pendulum]), _matrix(loops.weights.state), loops.weights.control
    # Eqs 4.3, 4.4 and 4.2: linearisation, feedback, Riccati equation.
    a = np.array([[0.0, 1.0], [-gravity * np.cos(angle) / inertia, -damping / inertia]])
    b = np.array([[0.0], [1 / inertia]])
    k = (b.T @ s / r)[0]
    s_rate = -(q - s @ b @ b.T @ s / r + s @ a + a.T @ s)
    # Eq. 4.1 less the reference: I·ω̇ = −b·ω − mgℓ·(sin(θ0 + e) − sin θ0) − K·x̄.
    e, w = state
    derivatives = (np.sin(angle), np.cos(angle), -np.sin(angle), -np.cos(angle))
    sine, power = Polynomial(), constant(1.0)
    for order in range(1, degree + 1):
        power = power * e
        sine += power * derivatives[order % 4] / factorial(order)
    acceleration = -(w * damping + sine * gravity + e * k[0] + w * k[1]) / inertia
    slope = (e * s[0, 0] + w * s[0, 1]) * 2.0, (e * s[0, 1] + w * s[1, 1]) * 2.0
    return lyapunov_function(s_rate, state) + slope[0] * w + slope[1] * acceleration


class RateProgramme:
    """Eq. 4.6 at one instant, divided by ρ: minimise ρ̇/ρ so that −V̇ + ρ̇ + L·(V − ρ) is a sum of squares.

    Parameters
    ----------
    degree : int
        Degree of the sine's Taylor polynomial.
    """

    def __init__(self, degree: int):
        import cvxpy as cp

        self.degree = degree
        self._rate = cp.Variable()
        # V/ρ and V̇/ρ are set for every moment: the programme is compiled once.
        self._v = unknown([(2, 0), (1, 1), (0, 2)], cp.Parameter)
        self._v_rate = unknown(monomials(degree + 1), cp.Parameter)
        multiplier = unknown(monomials(degree - 1), cp.Variable)
        constraints = s_procedure(constant(self._rate) - self._v_rate, constant(1.0) - self._v, multiplier)
        self._problem = cp.Problem(cp.Minimize(self._rate), constraints)

    def solve(self, loops: ClosedLoops, point: int, pendulum: int, level: float) -> float:
        """Return the smallest ρ̇/ρ in 1/s of one pendulum at one instant.

        Parameters
        ----------
        loops : ClosedLoops
            Pendulums under their regulator.
        point, pendulum : int
            Point of the grid of `loops`; index of the pendulum.
        level : float
            ρ > 0 at this point, dimensionless.

        Raises
        ------
        NumericalError
            If the solver fails or its status is not "optimal".
        """
        import cvxpy as cp

        cost = _matrix(loops.cost[point, pendulum])
        # The ellipse's semi-axes in e and ω as units: polynomials of degree six stay well conditioned.
        units = np.sqrt(level * np.diag(np.linalg.inv(cost)))
        state = Polynomial({(1, 0): units[0]}), Polynomial({(0, 1): units[1]})
        values = lyapunov_function(cost, state) / level
        rates = lyapunov_rate(loops, point, pendulum, state, self.degree) / level
        for parameters, polynomial in ((self._v, values), (self._v_rate, rates)):
            for exponents, parameter in parameters.items():
                parameter.value = polynomial.get(exponents, 0.0)
        label = loops.pendulums.labels[pendulum]
        for tolerance in TOLERANCES:
            limits = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
            try:
                self._problem.solve(solver=cp.CLARABEL, **limits)
            except cp.SolverError as error:
                raise NumericalError(f"{label}: Eq. 4.6 in cvxpy: {error}", label) from error
            if self._problem.status == cp.OPTIMAL:
                return float(self._rate.value)
        raise NumericalError(f"{label}: Eq. 4.6 in cvxpy ended as {self._problem.status}", label)


def rate_differences(loops: ClosedLoops, level: np.ndarray, knots: list[int]) -> np.ndarray:
    """Return the largest difference in 1/s, shape (pendulums,), between the rates by the alternation and by Eq. 4.6 in cvxpy.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    level : numpy.ndarray, shape (knots, pendulums)
        ρ at all knots of `loops`, dimensionless.
    knots : list of int
        Knots at which the rates are compared.
    """
    own, written, labels = Certificate(DEGREE, ACCURACY), RateProgramme(DEGREE), loops.pendulums.labels
    differences = np.zeros((len(knots), len(labels)))
    for row, knot in enumerate(knots):
        polynomials = growth_polynomial(loops.form(2 * knot), level[knot], DEGREE)
        for column, (coefficients, label) in enumerate(zip(polynomials, labels, strict=True)):
            expected = written.solve(loops, 2 * knot, column, level[knot, column])
            differences[row, column] = abs(own.solve(coefficients, label)[0] - expected)
    return differences.max(axis=0)


def _matrix(entries: np.ndarray) -> np.ndarray:
    """Return the symmetric matrix with the entries 11, 12, 22."""
    return np.array([[entries[0], entries[1]], [entries[1], entries[2]]])


CHECK = "thesis, Eq. 4.6 in cvxpy"


def cross_check(
    boa: pd.DataFrame, trajectories: list[Trajectory], settings: StabilitySettings
) -> tuple[pd.DataFrame, list[Failure]]:
    """Fill the column ``sos_cvxpy_difference`` for the method ``thesis``, by comparison of the programmes on the exact funnels.

    The column is in 1/s. The failures are basins for which the two formulations disagree or one formulation has no optimum.

    Parameters
    ----------
    boa : pandas.DataFrame
        Rows of ``boa.csv`` of all lifts.
    trajectories : list of Trajectory
        Valid trajectories of all lifts in the thesis's convention.
    settings : StabilitySettings
        Settings of the study.
    """
    rows = boa["method"] == "thesis"
    if "cvxpy" not in settings.checks or not rows.any():
        return boa, []
    differences: dict[str, float] = {}
    failures: list[Failure] = []
    fewer = settings.model_copy(update={"knots": settings.fewer_knots})

    def compute(items: list[Trajectory]) -> np.ndarray:
        loops = close_loops(items, THESIS.sign, fewer)
        level = exact_funnels(loops, settings.goal_level).level
        return rate_differences(loops, level, [0, loops.knots // 2])

    for items, values in compute_together(compute, trajectories, CHECK, failures):
        differences |= {item.label: value for item, value in zip(items, values, strict=True)}
    for item in trajectories:
        if differences.get(item.label, 0.0) > AGREEMENT:
            reason = f"certified rates differ by {differences[item.label]:.3g} 1/s; at most {AGREEMENT:g} 1/s is rounding"
            failures.append(Failure.from_trajectory(item, CHECK, reason))
    labels = boa.apply(
        lambda row: f"{row['subject']} {row['box_mass_kg']:g} kg, {row['com']}, {row['plane']}", axis=1
    )
    return boa.assign(sos_cvxpy_difference=labels.map(differences).where(rows)), failures
