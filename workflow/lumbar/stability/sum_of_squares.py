"""Sum-of-squares certificates at knots of the funnel: semidefinite programmes solved by Clarabel.

At one knot, in the normal coordinates of `invariance`, with h expanded to a Taylor polynomial v(z) of V̇/ρ:

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²)  is a sum of squares,   L free of degree d − 1

(equations 4.5 and 4.6 with ρ̇/ρ = r as a variable). r is the smallest certified rate of ρ; against the
largest V̇/ρ on the circle it leaves a margin that is zero for a tight certificate. Coordinates scaled by
√ρ·S^(−1/2), division by ρ and by the largest coefficient keep the programmes well conditioned; a status
other than "optimal" is never a result.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.funnel import ClosedLoops, Funnels
from lumbar.stability.invariance import NormalForm, boundary_growth, normal_form
from lumbar.stability.pendulum import Pendulums


def monomials(degree: int) -> list[tuple[int, int]]:
    """Exponents of all monomials in two variables up to a degree."""
    return [(total - second, second) for total in range(degree + 1) for second in range(total + 1)]


def growth_polynomial(form: NormalForm, level: np.ndarray, degree: int) -> np.ndarray:
    """Coefficients of V̇/ρ in z with the sine's Taylor polynomial of a degree.

    Parameters
    ----------
    form : NormalForm
        Entries of shape (...,).
    level : numpy.ndarray, shape (...)
        ρ.
    degree : int
        Of the Taylor polynomial of sin(θ0 + e) in e.

    Returns
    -------
    numpy.ndarray, shape (..., monomials of degree + 1)
    """
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    coefficients = np.zeros((*np.shape(level), len(index)))
    coefficients[..., index[2, 0]] = -form.alpha
    coefficients[..., index[1, 1]] = -2 * form.beta
    coefficients[..., index[0, 2]] = -form.gamma
    swing, kappa = form.amplitude * np.sqrt(level), form.coupling / np.sqrt(level)
    sine, cosine = np.sin(form.angle), np.cos(form.angle)
    derivatives = (sine, cosine, -sine, -cosine)
    for power in range(2, degree + 1):
        taylor = derivatives[power % 4] / factorial(power)
        coefficients[..., index[power, 1]] = -kappa * taylor * swing**power
    return coefficients


@cache
def _monomials_on_circle(degree: int, samples: int) -> np.ndarray:
    circle = np.linspace(0.0, 2 * np.pi, samples, endpoint=False)
    return np.stack([np.cos(circle) ** i * np.sin(circle) ** j for i, j in monomials(degree)])


def circle_maximum(coefficients: np.ndarray, degree: int, samples: int = 4096) -> np.ndarray:
    """Return the largest value on the unit circle, by a dense grid and a parabola at its best point."""
    values = coefficients @ _monomials_on_circle(degree, samples)
    best = values.argmax(axis=-1)[..., None]
    left, middle, right = (
        np.take_along_axis(values, (best + shift) % samples, -1)[..., 0] for shift in (-1, 0, 1)
    )
    curvature = np.maximum(2 * middle - left - right, np.finfo(float).tiny)
    return middle + np.where(right == left, 0.0, (right - left) ** 2 / (8 * curvature))


class GramProgramme:
    """Maximise one number so that a polynomial, affine in free coefficients, is a sum of squares.

    In normal form: minimise cᵀy subject to F·y + Γ·g = target, where g holds the upper triangle of a
    positive semidefinite Gram matrix G (off-diagonal entries times √2) and Γ·g the coefficients of bᵀGb
    (equation 2.13).
    """

    def __init__(self, degree: int):
        import clarabel
        from scipy import sparse

        self._clarabel, self._sparse = clarabel, sparse
        self._gram = gram_map(degree)
        coefficients, entries = self._gram.shape
        size = len(monomials((degree + 1) // 2))
        self._cones = [clarabel.ZeroConeT(coefficients), clarabel.PSDTriangleConeT(size)]
        self._cone_rows = -np.eye(entries)
        self._settings = clarabel.DefaultSettings()
        self._settings.verbose = False

    def constraints(self, free: np.ndarray):
        """Return the constraints for F of shape (monomials, free coefficients), ready for `solve`."""
        entries = self._gram.shape[1]
        below = np.zeros((entries, free.shape[1]))
        return self._sparse.csc_matrix(np.block([[free, self._gram], [below, self._cone_rows]]))

    def solve(self, cost: np.ndarray, constraints, target: np.ndarray) -> np.ndarray | None:
        """Return y, or None where the solver does not say "solved" (almost solved is not solved).

        Parameters
        ----------
        cost : numpy.ndarray, shape (free coefficients,)
            c.
        constraints : scipy.sparse.csc_matrix
            Of `constraints`.
        target : numpy.ndarray, shape (monomials,)
        """
        variables, entries = constraints.shape[1], self._gram.shape[1]
        solver = self._clarabel.DefaultSolver(
            self._sparse.csc_matrix((variables, variables)),
            np.concatenate([cost, np.zeros(entries)]),
            constraints,
            np.concatenate([target, np.zeros(entries)]),
            self._cones,
            self._settings,
        )
        solution = solver.solve()
        self.status = str(solution.status)
        if solution.status != self._clarabel.SolverStatus.Solved:
            return None
        return np.array(solution.x[: len(cost)])


class Certificate:
    """The programme of one Taylor degree, for many knots."""

    def __init__(self, degree: int):
        self.degree = degree
        self._programme = GramProgramme(degree)
        constant = np.eye(len(monomials(degree + 1)))[:, :1]
        # r − v − L·(1 − |z|²) = bᵀGb
        free = np.hstack([-constant, circle_map(degree)])
        self._constraints = self._programme.constraints(free)
        self._cost = np.eye(free.shape[1])[0]

    def solve(self, coefficients: np.ndarray, label: str) -> tuple[float, np.ndarray]:
        """Return the smallest certified rate r in 1/s and the coefficients of L.

        Raises
        ------
        NumericalError
            The solver did not reach an optimum.
        """
        scale = float(np.abs(coefficients).max())
        found = self._programme.solve(self._cost, self._constraints, -coefficients / scale)
        if found is None:
            raise NumericalError(f"{label}: the sum-of-squares programme ended as {self._programme.status}")
        return float(found[0]) * scale, found[1:] * scale


def gram_map(degree: int) -> np.ndarray:
    """Matrix that takes the scaled upper triangle of G, column by column, to the coefficients of bᵀGb."""
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    basis = monomials((degree + 1) // 2)
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    matrix = np.zeros((len(index), len(triangle)))
    for entry, (row, column) in enumerate(triangle):
        exponents = (basis[row][0] + basis[column][0], basis[row][1] + basis[column][1])
        matrix[index[exponents], entry] = 1.0 if row == column else np.sqrt(2.0)
    return matrix


def circle_map(degree: int) -> np.ndarray:
    """Matrix that takes the coefficients of L to those of L·(1 − |z|²)."""
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    matrix = np.zeros((len(index), len(monomials(degree - 1))))
    for column, (i, j) in enumerate(monomials(degree - 1)):
        matrix[index[i, j], column] += 1.0
        matrix[index[i + 2, j], column] -= 1.0
        matrix[index[i, j + 2], column] -= 1.0
    return matrix


@dataclass(frozen=True)
class Agreement:
    """How certificates and exact maxima compare, per pendulum, in 1/s.

    Attributes
    ----------
    margin_difference : numpy.ndarray, shape (pendulums,)
        Largest |certified rate − largest V̇/ρ of the same Taylor polynomial|: the error of the programme.
    taylor_difference : numpy.ndarray, shape (pendulums,)
        Largest |certified rate − largest V̇/ρ with the true sine|: what the Taylor polynomial changes.
    """

    margin_difference: np.ndarray
    taylor_difference: np.ndarray


def certified_funnels(
    loops: ClosedLoops, exact: Funnels, degree: int, knots: int
) -> tuple[Funnels, Agreement]:
    """Solve for the funnel with certified rates in place of exact ones.

    What is integrated, backward by the trapezoidal rule with an Euler predictor, is the small difference
    y = ln ρ − ln ρ_exact, dy/dt = r_certified(ρ) − r_exact(ρ_exact), so that few knots are enough.

    Parameters
    ----------
    loops : ClosedLoops
    exact : Funnels
        Of the same loops.
    degree : {3, 5}
        Taylor degree of the sine.
    knots : int
        Knots of certificates; the nearest number that divides those of `exact` evenly is taken.

    Returns
    -------
    Funnels, Agreement

    Raises
    ------
    NumericalError
        A programme was not solved to optimality.
    """
    certificate = Certificate(degree)
    chosen = even_knots(loops.knots, knots)
    step = loops.step * (chosen[1] - chosen[0])
    count = len(loops.pendulums.labels)
    excess = np.zeros((len(chosen), count))
    margins = np.zeros((2, len(chosen), count))
    slope = np.zeros(count)
    for position in range(len(chosen) - 1, -1, -1):
        knot, point = chosen[position], 2 * chosen[position]
        form = normal_form(loops.pendulums, loops.weights, loops.pendulums.angle[point], loops.cost[point])
        at_goal = position == len(chosen) - 1
        before = 0.0 if at_goal else excess[position + 1]
        level = exact.level[knot] * np.exp(before if at_goal else before - step * slope)
        coefficients = growth_polynomial(form, level, degree)
        certified = _solve_all(certificate, coefficients, loops.pendulums)
        now = certified - boundary_growth(form, exact.level[knot])
        if not at_goal:
            excess[position] = before - 0.5 * step * (slope + now)
        slope = now
        margins[0, position] = np.abs(certified - circle_maximum(coefficients, degree + 1))
        margins[1, position] = np.abs(certified - boundary_growth(form, level))
    funnels = Funnels(
        "sum_of_squares", exact.duration, exact.cost[chosen], exact.level[chosen] * np.exp(excess)
    )
    return funnels, Agreement(*margins.max(axis=1))


def _solve_all(certificate: Certificate, coefficients: np.ndarray, pendulums: Pendulums) -> np.ndarray:
    return np.array(
        [certificate.solve(row, label)[0] for row, label in zip(coefficients, pendulums.labels, strict=True)]
    )


def even_knots(available: int, wanted: int) -> np.ndarray:
    """Return evenly spaced knots, first and last included, as near to `wanted` as the spacing allows."""
    intervals = available - 1
    divisors = [number for number in range(1, intervals + 1) if intervals % number == 0]
    nearest = min(divisors, key=lambda number: abs(number - (wanted - 1)))
    return np.arange(0, available, intervals // nearest)
