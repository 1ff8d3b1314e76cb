"""The thesis's method (Eqs 4.5–4.7), for comparison: bilinear alternation with ρ̇ frozen.

At every knot separately, −V̇ + ρ̇ + L·(V − ρ) is to be a sum of squares, with the sine's cubic Taylor polynomial. An alternation

1. fixes ρ and searches a multiplier L; without one, ρ is decreased as a geometric progression until there is one,
2. fixes L and ρ̇ (differences of ρ from step 1) and maximises ρ.

Because ρ̇ belongs to the ρ before the maximisation, the result certifies nothing: `violation_share` is the share of knots at
which the final ρ breaks its own condition. The Riccati equation is integrated by Euler's method, as in the thesis. ρ(T) is free
too, as in Eq. 4.6: the goal set is a result here and not a requirement.

**Solver.** It returns L only. Step 1 has a multiplier if ρ̇ is not below the largest V̇: on the circle V = ρ every non-negative
trigonometric polynomial is a sum of squares (Fejér, Riesz). In step 2 the largest ρ is the least of a quotient of polynomials
(`level_factors`): a non-negative polynomial of degree 4 in two variables is a sum of squares (Hilbert 1888).

**Digits.** Eq. 4.5 does not determine L: L − c·(1 − |z|²), c ≥ 0, is a multiplier too, for c·(1 − |z|²)² is a square. The L of
an interior-point solver therefore depends on its last iteration, and so does the area from step 2. Therefore `ACCURACY` is
fixed and moderate, and the areas have a `RESOLUTION`.

**Second and later alternations.** The first maximises ρ beyond any proof; in the second nearly all knots have no multiplier and
keep their ρ. With the thesis's 1000 knots, ρ̇ of a few neighbouring knots, most near t = 0, is large enough, and only there ρ is
maximised again: it jumps (`Alternation.jumps`), and the average area of that basin changes by some percent. These knots depend
on the number of knots and the solver, not on the lifter.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial.polynomial import polyvander

from lumbar.lifting.stability.funnel import sum_of_squares
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, boundary_growth
from lumbar.lifting.stability.funnel.sum_of_squares import Certificate, growth_polynomial, monomials
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    ClosedLoops,
    NormalForm,
    close_with_cost,
    cost_to_go_euler,
    determinant,
)

DEGREE = 3
"""Taylor degree of the sine: the smallest nonlinear degree. The thesis does not state its degree."""

ACCURACY = 1e-6
"""Tolerance of the solver: rounding changes the areas of the default study by at most 3e-6 (by 2e-3 at a tolerance of 1e-8)."""

RESOLUTION = {"mean_area": 0.01, "initial_area": 0.02, "minimum_area": 0.01, "final_area": 0.01}
"""Largest relative change of the areas of the default study for tolerances of 1e-4 to 1e-8: further digits are not published."""

MOST_DECREASES = 10
"""Number of geometric decreases after which a knot is infeasible and keeps its ρ."""


def level_factors(growth: np.ndarray, rate: np.ndarray, multiplier: np.ndarray) -> np.ndarray:
    """Return the largest s = ρ/ρ_before of step 2 for which −v + ρ̇/ρ_before + L·(|z|² − s) is a sum of squares.

    The shape is (programmes,); NaN if no s is possible or s is unbounded.

    Parameters
    ----------
    growth : numpy.ndarray, shape (programmes, 15)
        v = V̇/ρ_before as a polynomial of degree 4 in normal coordinates z, in 1/s.
    rate : numpy.ndarray, shape (programmes,)
        ρ̇/ρ_before in 1/s.
    multiplier : numpy.ndarray, shape (programmes, 6)
        L, of degree 2, in 1/s.
    """
    padded = np.zeros_like(growth)
    padded[:, : multiplier.shape[1]] = multiplier
    # L·|z|² = L − L·(1 − |z|²). Nowhere negative: s is at most the quotient where L > 0, at least that where L < 0.
    above = padded - multiplier @ sum_of_squares.circle_map(DEGREE).T - growth
    above[:, 0] += rate
    largest, least = _least_quotient(above, padded), -_least_quotient(above, -padded)
    return np.where(np.isfinite(largest) & (largest > 0) & (least <= largest), largest, np.nan)


_ON_CIRCLE = sum_of_squares.harmonics_of_monomials(DEGREE + 1).T @ sum_of_squares.harmonics(
    DEGREE + 1, np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
)
"""Matrix from coefficients to values at points of the circle."""

RADII = np.geomspace(0.1, 20.0, 32)
ANGLES = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
"""Directions in rad of the grid from which Newton's starts are chosen, the best point of each sector; `RADII` in semi-axes."""
SECTORS = 8
NEWTON_STEPS = 6


def _least_quotient(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """Return the least p/q over points with q > 0, for p and q of degree 4, shape (programmes,); ∞ if there is no such point."""
    # The best point of the grid in every sector.
    grid = np.stack([np.outer(np.cos(ANGLES), RADII), np.outer(np.sin(ANGLES), RADII)]).reshape(2, -1)
    powers = _powers(grid)
    quotient = _quotient(over @ powers.T, under @ powers.T).reshape(len(over), SECTORS, -1)
    start = quotient.argmin(axis=-1) + np.arange(SECTORS) * quotient.shape[-1]
    z, least = grid[:, start], quotient.min(axis=-1)
    parts = [(over @ matrix, under @ matrix) for matrix in _derivatives()]
    for _ in range(NEWTON_STEPS):
        # At a stationary point of f = p/q also p − f·q is stationary: a Newton step, kept if it is lower.
        f, powers = np.where(np.isfinite(least), least, 0.0), _powers(z)
        g1, g2, h11, h12, h22 = (_dot(powers, p) - f * _dot(powers, q) for p, q in parts[1:])
        # −H⁻¹g, no longer than a fifth of the radius; zero unless H is positive definite.
        volume = h11 * h22 - h12**2
        step = np.stack([h12 * g2 - h22 * g1, h12 * g1 - h11 * g2])
        step = np.divide(step, volume, out=np.zeros_like(step), where=(volume > 0) & (h11 > 0))
        length, longest = np.hypot(*step), 0.2 * np.hypot(*z)
        trial = z + step * np.divide(longest, length, out=np.ones_like(length), where=length > longest)
        powers = _powers(trial)
        values = _quotient(*(_dot(powers, part) for part in parts[0]))
        is_lower = values < least
        z, least = np.where(is_lower, trial, z), np.where(is_lower, values, least)
    return least.min(axis=-1)


def _dot(powers: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    return np.matmul(powers, coefficients[:, :, None])[..., 0]


def _quotient(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    return np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0)


def _powers(z: np.ndarray) -> np.ndarray:
    """Return the monomials up to degree 4 of points, shape (2, ...), along a new last axis."""
    first, second = polyvander(z, DEGREE + 1)
    return np.stack([first[..., i] * second[..., j] for i, j in monomials(DEGREE + 1)], axis=-1)


@cache
def _derivatives() -> list[np.ndarray]:
    """Return the matrices from coefficients of p, as rows, to the coefficients of p, ∂₁p, ∂₂p, ∂₁₁p, ∂₁₂p, ∂₂₂p."""
    index = {exponents: position for position, exponents in enumerate(monomials(DEGREE + 1))}
    first, second = np.zeros((2, len(index), len(index)))
    for (i, j), row in index.items():
        if i:
            first[row, index[i - 1, j]] = i
        if j:
            second[row, index[i, j - 1]] = j
    return [np.eye(len(index)), first, second, first @ first, first @ second, second @ second]


EVIDENCE = (1, 4)
"""Alternations after which the mean area is also stored: it would hardly change if the method converged."""


@dataclass(frozen=True)
class Alternation:
    """Result of the thesis's method."""

    after: tuple[Funnels, ...]
    """Funnels after each alternation from the first on, also after the required number (see `EVIDENCE`)."""
    funnels: Funnels
    """Funnels after the required number of alternations."""
    violation_share: np.ndarray
    """Shape (pendulums,): share of the knots before the last at which the final ρ̇ (forward difference) is below the
    largest V̇ on V = ρ with the true sine: states leave the funnel there."""
    unsolved_share: np.ndarray
    """Shape (pendulums,): share of knots and alternations that kept ρ, infeasible (no multiplier) or unbounded."""
    euler_error: np.ndarray
    """Shape (pendulums,): relative error of the ellipse V = 1 at t = 0 that Euler's method makes in its area."""

    @property
    def jumps(self) -> np.ndarray:
        """ρ divided by ρ after the first alternation, shape (knots, pendulums): 1 if no later alternation was solved."""
        return self.funnels.level / self.after[0].level

    @property
    def jump_range(self) -> np.ndarray:
        """First and last t/T of the knots that jump, shape (2, pendulums); NaN if none jumps."""
        jumps, phase = self.jumps != 1, np.linspace(0.0, 1.0, len(self.jumps))
        ends = [jumps.argmax(axis=0), len(phase) - 1 - jumps[::-1].argmax(axis=0)]
        return np.where(jumps.any(axis=0), phase[np.array(ends)], np.nan)


def alternate(
    loops: ClosedLoops,
    knots: int,
    initial_level: float,
    ratio: float,
    alternations: int,
    certificate: Certificate | None = None,
) -> Alternation:
    """Run the thesis's bilinear alternation of Eq. 4.6.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator; Euler's method replaces their accurate cost-to-go.
    knots : int
        Number of knots at which ρ is searched; rounded to the nearest number that divides the knots of `loops` evenly.
    initial_level, ratio : float
        First guess of ρ at every knot, dimensionless; ratio of the geometric progression, between 0 and 1.
    alternations : int
        Number of alternations; the thesis: 2.
    certificate : Certificate, optional
        Solver of step 1; default: Clarabel at `ACCURACY`.

    Raises
    ------
    NumericalError
        If the solver ends without a multiplier although one exists.
    """
    certificate = certificate or Certificate(DEGREE, ACCURACY)
    # Evenly spaced knots, first and last included, as near to the wanted number as the spacing allows.
    intervals = loops.knots - 1
    divisors = [number for number in range(1, intervals + 1) if intervals % number == 0]
    chosen = np.arange(
        0, loops.knots, intervals // min(divisors, key=lambda number: abs(number - (knots - 1)))
    )
    # The loops at these knots with Euler's cost-to-go.
    pendulums, weights = loops.pendulums, loops.weights
    cost = cost_to_go_euler(pendulums, weights)[chosen]
    form = close_with_cost(replace(pendulums, angle=pendulums.angle[2 * chosen]), weights, cost).form(
        slice(None)
    )
    step = loops.step * (chosen[1] - chosen[0])
    levels = [np.full(cost.shape[:2], initial_level)]
    unsolved = []
    for _ in range(max(alternations, *EVIDENCE)):
        # Step 1: decrease ρ until there is a multiplier.
        level, feasible = _decrease_level(form, levels[-1], _level_rate(levels[-1], step), ratio)
        # Step 2: maximise ρ with this multiplier and the frozen ρ̇.
        growth, frozen = growth_polynomial(form, level, DEGREE), _level_rate(level, step)
        factors = np.full_like(level, np.nan)
        for index, label in enumerate(pendulums.labels):
            rows = feasible[:, index]
            if rows.any():
                multipliers = [certificate.solve(row, label)[1] for row in growth[rows, index]]
                rate = frozen[rows, index] / level[rows, index]
                factors[rows, index] = level_factors(growth[rows, index], rate, np.stack(multipliers))
        unsolved.append(np.isnan(factors).mean(axis=0))
        levels.append(level * np.where(np.isnan(factors), 1.0, factors))
    # Knots at which the final ρ breaks the condition that it should meet.
    level = levels[alternations]
    violated = (_level_rate(level, step) / level < boundary_growth(form, level))[:-1]
    after = tuple(Funnels("thesis", pendulums.duration, cost, level) for level in levels[1:])
    return Alternation(
        after=after,
        funnels=after[alternations - 1],
        violation_share=violated.mean(axis=0),
        unsolved_share=np.mean(unsolved[:alternations], axis=0),
        euler_error=np.sqrt(determinant(loops.cost[0]) / determinant(cost[0])) - 1,
    )


def _level_rate(level: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return ρ̇ at every knot by forward differences; the last knot takes the difference before it."""
    rate = np.diff(level, axis=0) / step
    return np.concatenate([rate, rate[-1:]])


def _decrease_level(
    form: NormalForm, level: np.ndarray, frozen: np.ndarray, ratio: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return ρ and the knots with a multiplier; ρ is decreased until there is a multiplier, and unchanged if there is none."""
    result, trial, feasible = level.copy(), level.copy(), np.zeros(level.shape, dtype=bool)
    for _ in range(MOST_DECREASES):
        growth, allowed = growth_polynomial(form, trial, DEGREE), frozen / trial
        # A few values exclude nearly all knots without a multiplier.
        new = ~feasible & (growth @ _ON_CIRCLE <= allowed[..., None]).all(axis=-1)
        if new.any():
            new[new] = sum_of_squares.circle_maximum(growth[new], DEGREE + 1) <= allowed[new]
        result[new], feasible[new] = trial[new], True
        if feasible.all():
            break
        trial = ratio * trial
    return result, feasible
