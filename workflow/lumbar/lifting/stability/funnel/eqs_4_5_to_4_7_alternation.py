"""The thesis's own method (Eqs 4.5–4.7), for comparison: bilinear alternation with ρ̇ frozen.

At every knot by itself, −V̇ + ρ̇ + L·(V − ρ) is to be a sum of squares, with the sine's cubic Taylor polynomial. An alternation

1. fixes ρ and looks for a multiplier L; where there is none, ρ is decreased as a geometric progression
until there is,
2. fixes L and ρ̇ (differences of ρ from step 1) and maximises ρ.

Because ρ̇ belongs to the ρ before the maximisation, the result is no certificate: `violation_share` says
at how many knots the final ρ breaks the condition it was meant to meet. The Riccati equation is
integrated by Euler's method, as in the thesis. ρ(T) is free too, as Eq. 4.6 has it: the goal set is
a result here and not a requirement.

**What needs a solver.** Whether step 1 has a multiplier does not: on the circle V = ρ every non-negative trigonometric
polynomial is a sum of squares (Fejér, Riesz), so there is one where ρ̇ is not below the largest V̇. Nor does step 2: a
polynomial of degree 4 in two variables is a sum of squares where it is nowhere negative (Hilbert 1888), so the largest ρ is
the least of a quotient of polynomials (`level_factors`). The solver returns L alone.

**Digits.** Eq. 4.5 does not determine L: with L every L − c·(1 − |z|²), c ≥ 0, is a multiplier too, for c·(1 − |z|²)²
is a square. The dual programme therefore has no interior point, and the L that an interior-point solver returns hangs
on where it stops; step 2 turns it into an area. Hence the fixed, moderate `ACCURACY` and the areas' `RESOLUTION`.

**From the second alternation on.** The first maximises ρ beyond what any multiplier proves; in the second nearly all knots have
none and keep their ρ. With as few knots as ten, none has. With as many as the thesis's 1000, ρ̇ of a few neighbouring knots,
most near t = 0, is large enough, and there alone ρ is maximised once more: it jumps (`Alternation.jumps`), and with it the
average area of that one basin by some percent. Which knots these are hangs on the number of knots and on the solver, not on the
lifter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial.polynomial import polyvander

from lumbar.lifting.stability.funnel.exact_funnel import Funnels, boundary_growth
from lumbar.lifting.stability.funnel.sum_of_squares import (
    Certificate,
    circle_map,
    circle_maximum,
    growth_polynomial,
    harmonics,
    harmonics_of_monomials,
    monomials,
)
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    ClosedLoops,
    NormalForm,
    cost_to_go_euler,
    determinant,
    with_cost,
)

DEGREE = 3
"""Taylor degree of the sine: the least that knows that it is no line. The thesis names none."""

ACCURACY = 1e-6
"""At which the solver stops. Rounding (relative changes of 1e-13 in the polynomials) moves the areas of the default study
by 3e-6 at most then; at the solver's own 1e-8 the last steps are made of rounding, which moves them by 2e-3."""

RESOLUTION = {"mean_area": 0.01, "initial_area": 0.02, "minimum_area": 0.01, "final_area": 0.01}
"""Relative: how far the areas of the default study move, at most, when the solver stops at 1e-4 to 1e-8 (no choice is
better founded than another). Digits beyond it mean nothing and are not published."""

MOST_DECREASES = 10
"""Geometric decreases after which a knot is infeasible and keeps its ρ."""


def level_factors(growth: np.ndarray, rate: np.ndarray, multiplier: np.ndarray) -> np.ndarray:
    """Return the largest s = ρ/ρ_before of step 2: −v + ρ̇/ρ_before + L·(|z|² − s) is a sum of squares.

    NaN where there is none, or no largest.

    Parameters
    ----------
    growth : numpy.ndarray, shape (programmes, 15)
        v = V̇/ρ_before as a polynomial of degree 4 in normal coordinates z, in 1/s.
    rate : numpy.ndarray, shape (programmes,)
        ρ̇/ρ_before in 1/s.
    multiplier : numpy.ndarray, shape (programmes, 6)
        L, of degree 2.
    """
    padded = np.zeros_like(growth)
    padded[:, : multiplier.shape[1]] = multiplier
    # L·|z|² = L − L·(1 − |z|²). Nowhere negative: s is at most the quotient where L > 0, at least that where L < 0.
    above = padded - multiplier @ circle_map(DEGREE).T - growth
    above[:, 0] += rate
    largest, least = _least_quotient(above, padded), -_least_quotient(above, -padded)
    return np.where(np.isfinite(largest) & (largest > 0) & (least <= largest), largest, np.nan)


_ON_CIRCLE = harmonics_of_monomials(DEGREE + 1).T @ harmonics(
    DEGREE + 1, np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
)
"""From coefficients to values at points of the circle."""

RADII = np.geomspace(0.1, 20.0, 32)
ANGLES = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
"""Points of the plane, in semi-axes of the ellipse, among which Newton's starts are chosen: the best of each of `SECTORS`."""
SECTORS = 8
NEWTON_STEPS = 6


def _least_quotient(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """Return the least p/q in the part of the plane with q > 0, p and q of degree 4, shape (programmes,); ∞ without one."""
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
        values = [_dot(powers, p) - f * _dot(powers, q) for p, q in parts[1:]]
        trial = z + _newton_step(*values, 0.2 * np.hypot(*z))
        powers = _powers(trial)
        there = _quotient(*(_dot(powers, part) for part in parts[0]))
        lower = there < least
        z, least = np.where(lower, trial, z), np.where(lower, there, least)
    return least.min(axis=-1)


def _dot(powers: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    return np.matmul(powers, coefficients[:, :, None])[..., 0]


def _newton_step(g1, g2, h11, h12, h22, longest: np.ndarray) -> np.ndarray:
    """Return −H⁻¹g in two variables, shape (2, ...), no longer than that; zero where H is not positive definite."""
    volume = h11 * h22 - h12**2
    downward = (volume > 0) & (h11 > 0)
    step = np.stack([h12 * g2 - h22 * g1, h12 * g1 - h11 * g2])
    step = np.divide(step, volume, out=np.zeros_like(step), where=downward)
    length = np.hypot(*step)
    return step * np.divide(longest, length, out=np.ones_like(length), where=length > longest)


def _quotient(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    return np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0)


def _powers(z: np.ndarray) -> np.ndarray:
    """Monomials up to degree 4 of points, shape (2, ...), along a new last axis."""
    first, second = polyvander(z, DEGREE + 1)
    return np.stack([first[..., i] * second[..., j] for i, j in monomials(DEGREE + 1)], axis=-1)


@cache
def _derivatives() -> list[np.ndarray]:
    """Matrices from coefficients, as rows, to those of p, ∂₁p, ∂₂p, ∂₁₁p, ∂₁₂p, ∂₂₂p."""
    index = {exponents: position for position, exponents in enumerate(monomials(DEGREE + 1))}
    first, second = np.zeros((2, len(index), len(index)))
    for (i, j), row in index.items():
        if i:
            first[row, index[i - 1, j]] = i
        if j:
            second[row, index[i, j - 1]] = j
    return [np.eye(len(index)), first, second, first @ first, first @ second, second @ second]


EVIDENCE = (1, 4)
"""Alternations after which the mean area is also kept: if the method had converged, it would hardly change."""


@dataclass(frozen=True)
class Alternation:
    """Result of the thesis's method."""

    after: tuple[Funnels, ...]
    """Funnels after each alternation, including the first and more than required (`EVIDENCE`)."""
    alternations: int
    """Number of required alternations."""
    violation_share: np.ndarray
    """Shape (pendulums,): share of the knots before the last at which the final ρ̇ (forward difference) is below the
    largest V̇ on V = ρ with the true sine: there states leave."""
    unsolved_share: np.ndarray
    """Shape (pendulums,): share of the knots and alternations without multiplier or without maximum (infeasible,
    unbounded): they kept ρ."""
    euler_error: np.ndarray
    """Shape (pendulums,): relative error of the ellipse V = 1 at t = 0 that Euler's method makes in its area."""

    @property
    def funnels(self) -> Funnels:
        """Funnels after the required alternations."""
        return self.after[self.alternations - 1]

    @property
    def jumps(self) -> np.ndarray:
        """ρ divided by that after the first alternation, shape (knots, pendulums): 1 where no further one was solved."""
        return self.funnels.level / self.after[0].level

    @property
    def jump_range(self) -> np.ndarray:
        """First and last of the knots that jump as t/T, shape (2, pendulums); NaN where none does."""
        there, phase = self.jumps != 1, np.linspace(0.0, 1.0, len(self.jumps))
        ends = [there.argmax(axis=0), len(phase) - 1 - there[::-1].argmax(axis=0)]
        return np.where(there.any(axis=0), phase[np.array(ends)], np.nan)


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
        Their accurate cost-to-go is replaced by Euler's.
    knots : int
        Knots at which ρ is sought; the nearest number that divides those of `loops` evenly is taken.
    initial_level : float
        First guess of ρ at every knot.
    ratio : float
        Of the geometric progression, between 0 and 1.
    alternations : int
        The thesis: 2.
    certificate : Certificate
        Solver of step 1; Clarabel at `ACCURACY` unless given.

    Raises
    ------
    NumericalError
        A programme that has a multiplier ended without one.
    """
    certificate = certificate or Certificate(DEGREE, ACCURACY)
    # Evenly spaced knots, first and last included, as near to the wanted number as the spacing allows.
    intervals = loops.knots - 1
    divisors = [number for number in range(1, intervals + 1) if intervals % number == 0]
    chosen = np.arange(
        0, loops.knots, intervals // min(divisors, key=lambda number: abs(number - (knots - 1)))
    )
    pendulums = loops.pendulums
    # The loops at these knots with Euler's cost-to-go.
    cost = cost_to_go_euler(pendulums, loops.weights)[chosen]
    at_knots = with_cost(replace(pendulums, angle=pendulums.angle[2 * chosen]), loops.weights, cost)
    form = at_knots.form(slice(None))
    step = loops.step * (chosen[1] - chosen[0])
    levels = [np.full(cost.shape[:2], initial_level)]
    unsolved = []
    for _ in range(max(alternations, *EVIDENCE)):
        # Step 1: decrease ρ until there is a multiplier; step 2: maximise ρ with this multiplier and the frozen ρ̇.
        level, feasible = _decreased(form, levels[-1], _difference(levels[-1], step), ratio)
        factors = _factors(form, level, _difference(level, step), feasible, certificate, pendulums.labels)
        unsolved.append(np.isnan(factors).mean(axis=0))
        levels.append(level * np.where(np.isnan(factors), 1.0, factors))
    # Knots at which the final ρ breaks the condition that it should meet.
    level = levels[alternations]
    violated = (_difference(level, step) / level < boundary_growth(form, level))[:-1]
    return Alternation(
        after=tuple(Funnels("thesis", pendulums.duration, cost, level) for level in levels[1:]),
        alternations=alternations,
        violation_share=violated.mean(axis=0),
        unsolved_share=np.mean(unsolved[:alternations], axis=0),
        euler_error=np.sqrt(determinant(loops.cost[0]) / determinant(cost[0])) - 1,
    )


def _factors(
    form: NormalForm,
    level: np.ndarray,
    frozen: np.ndarray,
    feasible: np.ndarray,
    certificate: Certificate,
    labels: Sequence[str],
) -> np.ndarray:
    """Step 2, with the multipliers of step 1: return what ρ is multiplied by, NaN where there is no multiplier or maximum."""
    growth, factors = growth_polynomial(form, level, DEGREE), np.full_like(level, np.nan)
    for index, label in enumerate(labels):
        there = feasible[:, index]
        if there.any():
            rows = growth[there, index]
            multipliers = np.stack([certificate.solve(row, label)[1] for row in rows])
            rate = frozen[there, index] / level[there, index]
            factors[there, index] = level_factors(rows, rate, multipliers)
    return factors


def _difference(level: np.ndarray, step: np.ndarray) -> np.ndarray:
    """ρ̇ at every knot: forward differences, at the last knot the one before."""
    rate = np.diff(level, axis=0) / step
    return np.concatenate([rate, rate[-1:]])


def _decreased(
    form: NormalForm, level: np.ndarray, frozen: np.ndarray, ratio: float
) -> tuple[np.ndarray, np.ndarray]:
    """Step 1: return ρ, decreased until there is a multiplier, and where there is one; elsewhere ρ is kept."""
    result, trial, feasible = level.copy(), level.copy(), np.zeros(level.shape, dtype=bool)
    for _ in range(MOST_DECREASES):
        growth, allowed = growth_polynomial(form, trial, DEGREE), frozen / trial
        # The largest of a few values is enough to say no, and nearly always does.
        new = ~feasible & (growth @ _ON_CIRCLE <= allowed[..., None]).all(axis=-1)
        if new.any():
            new[new] = circle_maximum(growth[new], DEGREE + 1) <= allowed[new]
        result[new], feasible[new] = trial[new], True
        if feasible.all():
            break
        trial = ratio * trial
    return result, feasible
