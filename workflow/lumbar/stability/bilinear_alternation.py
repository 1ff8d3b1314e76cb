"""The thesis's own engine (equations 4.5 to 4.7), for comparison: bilinear alternation with ρ̇ frozen.

At every knot by itself, −V̇ + ρ̇ + L·(V − ρ) is to be a sum of squares. An alternation

1. fixes ρ and looks for a multiplier L; where there is none, ρ is decreased as a geometric progression
until there is,
2. fixes L and ρ̇ (differences of ρ from step 1) and maximises ρ.

Because ρ̇ belongs to the ρ before the maximisation, the result is no certificate: `violation_share` says
at how many knots the final ρ breaks the condition it was meant to meet. The Riccati equation is
integrated by Euler's method, as in the thesis. ρ(T) is free too, as equation 4.6 has it: the goal set is
a result here and not a requirement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.stability.funnel import ClosedLoops, Funnels, even_knots
from lumbar.stability.invariance import NormalForm, boundary_growth, normal_form
from lumbar.stability.polynomials import circle_map, growth_polynomial
from lumbar.stability.riccati import cost_to_go_euler, decay_matrix, determinant
from lumbar.stability.sum_of_squares import Certificate, GramProgramme

MOST_DECREASES = 10
"""Geometric decreases after which a knot counts as infeasible and keeps its ρ."""


class LevelStep:
    """Step 2 at one knot: with L fixed, maximise s = ρ/ρ_before."""

    def __init__(self, degree: int):
        self._programme = GramProgramme(degree)
        self._ring = circle_map(degree)

    def solve(self, growth: np.ndarray, rate: float, multiplier: np.ndarray) -> float | None:
        """Return ρ/ρ_before, or None where there is no maximum (infeasible or unbounded).

        Parameters
        ----------
        growth : numpy.ndarray, shape (monomials,)
            Polynomial of V̇/ρ_before in z.
        rate : float
            ρ̇/ρ_before in 1/s.
        multiplier : numpy.ndarray
            Coefficients of L.
        """
        scale = float(np.abs(growth).max())
        padded = np.zeros(len(growth))
        padded[: len(multiplier)] = multiplier
        # −v + ρ̇/ρ_before + L·(|z|² − s) is to be a sum of squares, with L·|z|² = L − L·(1 − |z|²).
        constant = padded - self._ring @ multiplier - growth
        constant[0] += rate
        constraints = self._programme.constraints(padded[:, None] / scale)
        found = self._programme.solve(np.array([-1.0]), constraints, constant / scale)
        return None if found is None or found[0] <= 0 else float(found[0])


@dataclass(frozen=True)
class Alternation:
    """Result of the thesis's engine.

    Attributes
    ----------
    funnels : Funnels
    violation_share : numpy.ndarray, shape (pendulums,)
        Share of the knots before the last at which the final ρ̇ (forward difference) is below the largest
        V̇ on V = ρ with the true sine: there states leave.
    unsolved_share : numpy.ndarray, shape (pendulums,)
        Share of the knots and alternations without multiplier or without maximum (infeasible, unbounded):
        they kept ρ.
    euler_error : numpy.ndarray, shape (pendulums,)
        Relative error of the ellipse V = 1 at t = 0 that Euler's method makes in its area.
    """

    funnels: Funnels
    violation_share: np.ndarray
    unsolved_share: np.ndarray
    euler_error: np.ndarray


def alternate(
    loops: ClosedLoops,
    degree: int,
    knots: int,
    initial_level: float,
    ratio: float,
    alternations: int,
) -> Alternation:
    """Run the thesis's bilinear alternation.

    Parameters
    ----------
    loops : ClosedLoops
        Their accurate cost-to-go is replaced by Euler's.
    degree : {3, 5}
        Taylor degree of the sine.
    knots : int
        Knots at which ρ is sought; the nearest number that divides those of `loops` evenly is taken.
    initial_level : float
        First guess of ρ at every knot.
    ratio : float
        Of the geometric progression, between 0 and 1.
    alternations : int
        The thesis: 2.

    Returns
    -------
    Alternation

    Raises
    ------
    NumericalError
        A programme of step 1 ended without an optimum.
    """
    certificate, level_step = Certificate(degree), LevelStep(degree)
    chosen = even_knots(loops.knots, knots)
    pendulums = loops.pendulums
    cost = cost_to_go_euler(pendulums, loops.weights)[chosen]
    decay = decay_matrix(pendulums, loops.weights, cost)
    form = normal_form(pendulums, pendulums.angle[2 * chosen], cost, decay)
    step = loops.step * (chosen[1] - chosen[0])
    level = np.full((len(chosen), len(pendulums.labels)), initial_level)
    unsolved = np.zeros(level.shape[1])
    for _ in range(alternations):
        level, multipliers = _multiplier_step(certificate, form, level, step, ratio, pendulums.labels)
        frozen = _difference(level, step)
        growth = growth_polynomial(form, level, degree)
        for knot, index in np.ndindex(level.shape):
            multiplier = multipliers.get((knot, index))
            rate = frozen[knot, index] / level[knot, index]
            factor = None if multiplier is None else level_step.solve(growth[knot, index], rate, multiplier)
            if factor is None:
                unsolved[index] += 1
            else:
                level[knot, index] *= factor
    required = boundary_growth(form, level)
    violated = (_difference(level, step) / level < required)[:-1]
    funnels = Funnels("thesis", pendulums.duration, cost, level)
    return Alternation(
        funnels=funnels,
        violation_share=violated.mean(axis=0),
        unsolved_share=unsolved / (alternations * len(chosen)),
        euler_error=np.sqrt(determinant(loops.cost[0]) / determinant(cost[0])) - 1,
    )


def _difference(level: np.ndarray, step: np.ndarray) -> np.ndarray:
    """ρ̇ at every knot: forward differences, at the last knot the one before."""
    rate = np.diff(level, axis=0) / step
    return np.concatenate([rate, rate[-1:]])


def _multiplier_step(
    certificate: Certificate,
    form: NormalForm,
    level: np.ndarray,
    step: np.ndarray,
    ratio: float,
    labels: tuple[str, ...],
) -> tuple[np.ndarray, dict[tuple[int, int], np.ndarray]]:
    """Step 1: decrease ρ where needed; return it with the multipliers of the feasible knots."""
    frozen = _difference(level, step)
    result, multipliers = level.copy(), {}
    for knot, index in np.ndindex(level.shape):
        local = NormalForm(**{name: entry[knot, index] for name, entry in vars(form).items()})
        trial = level[knot, index]
        for _ in range(MOST_DECREASES):
            growth = growth_polynomial(local, trial, certificate.degree)
            rate, multiplier = certificate.solve(growth, labels[index])
            if rate <= frozen[knot, index] / trial:
                result[knot, index], multipliers[knot, index] = trial, multiplier
                break
            trial *= ratio
    return result, multipliers
