"""The thesis's own method (Eqs 4.5–4.7), for comparison: bilinear alternation with ρ̇ frozen.

At every knot by itself, −V̇ + ρ̇ + L·(V − ρ) is to be a sum of squares. An alternation

1. fixes ρ and looks for a multiplier L; where there is none, ρ is decreased as a geometric progression
until there is,
2. fixes L and ρ̇ (differences of ρ from step 1) and maximises ρ.

Because ρ̇ belongs to the ρ before the maximisation, the result is no certificate: `violation_share` says
at how many knots the final ρ breaks the condition it was meant to meet. The Riccati equation is
integrated by Euler's method, as in the thesis. ρ(T) is free too, as Eq. 4.6 has it: the goal set is
a result here and not a requirement.

**Digits.** Eq. 4.5 does not determine L: with L every L − c·(1 − |z|²), c ≥ 0, is a multiplier too, for c·(1 − |z|²)²
is a square. The dual programme therefore has no interior point, and the L that an interior-point solver returns hangs
on where it stops; step 2 turns it into an area. Hence the fixed, moderate `ACCURACY` and the areas' `RESOLUTION`.

**The second alternation.** The first maximises ρ beyond what any multiplier proves; in the second hardly a knot of the
default study has one, so that it changes nothing there (`unsolved_share` 0.5: half of all programmes). The result is that of
one alternation, whatever number is asked for.

With torque limits or an uncertain mass, which the thesis leaves out, its condition is imposed on every case of
`saturation_cases`: a knot is feasible when all have a multiplier, and ρ is the smallest of their maxima.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lumbar.lifting.stability.funnel.exact_funnel import Funnels, boundary_growth, even_knots
from lumbar.lifting.stability.funnel.saturation import (
    UNSATURATED,
    Saturation,
    SaturationReference,
    reference_of,
    require_torque,
    saturated_growth,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import (
    ClosedLoops,
    cost_to_go_euler,
    determinant,
    with_cost,
)
from lumbar.lifting.stability.programme.polynomials import Case, circle_map, saturation_cases
from lumbar.lifting.stability.programme.sum_of_squares import Certificate, SumOfSquares, grams

ACCURACY = 1e-6
"""At which the solver stops. Rounding (relative changes of 1e-13 in the polynomials) moves the areas of the default study
by 3e-6 at most then; at the solver's own 1e-8 the last steps are made of rounding, which moves them by 2e-3."""

RESOLUTION = {"mean_area": 0.01, "initial_area": 0.02, "minimum_area": 0.01, "final_area": 0.01}
"""Relative: how far the areas of the default study move, at most, when the solver stops at 1e-4 to 1e-8 (no choice is
better founded than another). Digits beyond it mean nothing and are not published."""

MOST_DECREASES = 10
"""Geometric decreases after which a knot counts as infeasible and keeps its ρ."""


class LevelStep:
    """Step 2 at one knot: with L fixed, maximise s = ρ/ρ_before."""

    def __init__(self, degree: int, accuracy: float):
        self._degree, self._accuracy = degree, accuracy
        self._ring = circle_map(degree)

    def solve(self, case: Case, rate: float, multiplier: np.ndarray) -> float | None:
        """Return ρ/ρ_before, or None where there is no maximum (infeasible or unbounded).

        `case` is V̇/ρ_before as a polynomial in z, and where it applies; `rate` is ρ̇/ρ_before in 1/s; `multiplier`
        holds the coefficients of L.
        """
        growth = case.coefficients
        scale = float(np.abs(growth).max())
        padded = np.zeros(len(growth))
        padded[: len(multiplier)] = multiplier
        # −v + ρ̇/ρ_before + L·(|z|² − s) is to be a sum of squares, with L·|z|² = L − L·(1 − |z|²).
        constant = padded - self._ring @ multiplier - growth
        constant[0] += rate
        free = padded[:, None] / scale
        programme = SumOfSquares(np.array([-1.0]), free, grams(self._degree, case.side), self._accuracy)
        found = programme.solve(constant / scale)
        return None if found is None or found[0] <= 0 else float(found[0])


@dataclass(frozen=True)
class Alternation:
    """Result of the thesis's method."""

    funnels: Funnels
    violation_share: np.ndarray
    """Shape (pendulums,): share of the knots before the last at which the final ρ̇ (forward difference) is below the
    largest V̇ on V = ρ with the true sine: there states leave."""
    unsolved_share: np.ndarray
    """Shape (pendulums,): share of the knots and alternations without multiplier or without maximum (infeasible,
    unbounded): they kept ρ."""
    euler_error: np.ndarray
    """Shape (pendulums,): relative error of the ellipse V = 1 at t = 0 that Euler's method makes in its area."""


def alternate(
    loops: ClosedLoops,
    degree: int,
    knots: int,
    initial_level: float,
    ratio: float,
    alternations: int,
    saturation: Saturation = UNSATURATED,
    accuracy: float = ACCURACY,
) -> Alternation:
    """Run the thesis's bilinear alternation of Eq. 4.6.

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
    saturation : Saturation
        Of the loop; the thesis has none.
    accuracy : float
        At which the solver stops.

    Raises
    ------
    NumericalError
        A programme of step 1 ended without an optimum, or the feedforward lies beyond the torque limit.
    """
    certificate, level_step = Certificate(degree, accuracy), LevelStep(degree, accuracy)
    chosen = even_knots(loops.knots, knots)
    pendulums, reference = loops.pendulums, reference_of(loops.pendulums, saturation.bias)
    require_torque(pendulums, reference, saturation)
    reference = SaturationReference(reference.torque[2 * chosen], reference.velocity[2 * chosen])
    cost = cost_to_go_euler(pendulums, loops.weights)[chosen]
    at_knots = with_cost(replace(pendulums, angle=pendulums.angle[2 * chosen]), loops.weights, cost)
    step = loops.step * (chosen[1] - chosen[0])
    level = np.full((len(chosen), len(pendulums.labels)), initial_level)
    unsolved = np.zeros(level.shape[1])
    for _ in range(alternations):
        frozen = _difference(level, step)
        level, multipliers = _multiplier_step(
            certificate, at_knots, level, frozen, ratio, reference, saturation
        )
        frozen = _difference(level, step)
        for knot, index in np.ndindex(level.shape):
            rate = frozen[knot, index] / level[knot, index]
            factors = [
                level_step.solve(case, rate, multiplier)
                for case, multiplier in multipliers.get((knot, index), ())
            ]
            if factors and None not in factors:
                level[knot, index] *= min(factors)
            else:
                unsolved[index] += 1
    if saturation.active:
        required = [
            saturated_growth(at_knots, knot, level[knot], saturation, reference)
            for knot in range(len(chosen))
        ]
    else:
        required = boundary_growth(at_knots.form(slice(None)), level)
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
    at_knots: ClosedLoops,
    level: np.ndarray,
    frozen: np.ndarray,
    ratio: float,
    reference: SaturationReference,
    saturation: Saturation,
) -> tuple[np.ndarray, dict[tuple[int, int], list[tuple[Case, np.ndarray]]]]:
    """Step 1: decrease ρ where needed; return it with the cases and multipliers of the feasible knots."""
    result, multipliers = level.copy(), {}
    labels = at_knots.pendulums.labels
    for knot in range(len(level)):
        trial, wanted = level[knot].copy(), set(range(len(labels)))
        for _ in range(MOST_DECREASES):
            cases = saturation_cases(at_knots, knot, trial, saturation, reference, certificate.degree)
            for index in sorted(wanted):
                solved = [
                    certificate.solve(case.coefficients, labels[index], case.side) for case in cases[index]
                ]
                if max(rate for rate, _ in solved) <= frozen[knot, index] / trial[index]:
                    result[knot, index] = trial[index]
                    found = zip(cases[index], (multiplier for _, multiplier in solved), strict=True)
                    multipliers[knot, index] = list(found)
                    wanted.remove(index)
                else:
                    trial[index] *= ratio
            if not wanted:
                break
    return result, multipliers
