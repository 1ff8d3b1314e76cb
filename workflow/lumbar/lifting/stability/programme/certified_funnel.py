"""The sum-of-squares method: funnels whose every rate ρ̇/ρ carries a certificate, backward from ρ(T).

Between two knots ρ̇/ρ is one number r, ln ρ is linear, and the condition −V̇ + ρ̇ + L·(V − ρ) ∈ SOS is imposed
at the middle of the interval (an error of second order in the spacing). ρ̇ is a variable and ρ(T) is fixed, so
that going backward each interval is a small bilinear problem in (r, L, ρ) of its own, solved by alternation:

1. ρ at the middle fixed: the smallest r that has a certificate is the largest V̇/ρ of the polynomial on the circle (or on the
   arcs of its cases), which needs no solver;
2. r fixed: ρ follows, ρ(t) = ρ(t + Δt)·exp(−r·Δt).

The first guess of r is extrapolated from the later intervals. When r is above that maximum by the margin, the programme of
`sum_of_squares` is solved at the very ρ that is returned and must certify r: what is returned is certified, however it was found.

With torque limits or an uncertain mass (`saturation`) r is certified for every extreme mass and every part of the
saturation (`saturation_cases`), each on its arc of the circle.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, boundary_growth, even_knots
from lumbar.lifting.stability.funnel.saturation import (
    UNSATURATED,
    Saturation,
    reference_of,
    require_basin,
    require_torque,
    saturated_growth,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops
from lumbar.lifting.stability.programme.polynomials import (
    Case,
    case_maximum,
    circle_maximum,
    require_taylor_range,
    saturation_cases,
)
from lumbar.lifting.stability.programme.sum_of_squares import CircleProgramme

LEAST_ALTERNATIONS, MOST_ALTERNATIONS = 2, 8
"""Alternations from which on a margin is enough, and after which one that is still negative is an error."""
LONGER_ARCS = (0.0, 0.01, 0.05)
"""By how much in rad an arc is made longer at each end where its programme is not solved; then the whole circle."""
SAFETY = 0.05
"""Share of the last change of r by which the next r is enlarged: covers what the change of ρ does to it."""


@dataclass(frozen=True)
class Agreement:
    """How certificates and exact maxima compare, per pendulum."""

    margin_difference: np.ndarray
    """Shape (pendulums,): largest |certified rate − largest V̇/ρ of the same Taylor polynomial| in 1/s: the programme's
    error."""
    taylor_difference: np.ndarray
    """Shape (pendulums,): largest |certified rate − largest V̇/ρ with the true sine| in 1/s: what the polynomial changes.
    """
    taylor_optimism: np.ndarray
    """Shape (pendulums,): largest (largest V̇/ρ with the true sine − ρ̇/ρ of the funnel) in 1/s: where positive, the
    Taylor polynomial was optimistic and the certificate does not hold for the true sine."""


def certified_funnels(
    loops: ClosedLoops,
    terminal_level: float,
    degree: int,
    knots: int,
    margin: float,
    saturation: Saturation = UNSATURATED,
) -> tuple[Funnels, Agreement]:
    """Compute funnels by sum-of-squares programmes.

    Parameters
    ----------
    terminal_level : float
        ρ(T).
    degree : {3, 5, 7}
        Taylor degree of the sine.
    knots : int
        Knots of ρ; the nearest number that divides those of `loops` evenly is taken.
    margin : float
        In 1/s; γ that is left, above the solver's tolerance.
    saturation : Saturation
        Of the loop.

    Raises
    ------
    NumericalError
        A programme was not solved, an interval has no certificate after `MOST_ALTERNATIONS`, or no basin is left
        under the limits.
    """
    programme = CircleProgramme(degree)
    chosen = even_knots(loops.knots, knots)
    step = loops.step * (chosen[1] - chosen[0])
    count = len(loops.pendulums.labels)
    log_level = np.empty((len(chosen), count))
    log_level[-1] = np.log(terminal_level)
    reference = reference_of(loops.pendulums, saturation.bias)
    require_torque(loops.pendulums, reference, saturation)
    differences = np.zeros((3, count))
    differences[2] = -np.inf
    rates: list[np.ndarray] = []
    for interval in range(len(chosen) - 2, -1, -1):
        point = chosen[interval] + chosen[interval + 1]
        form = loops.form(point)

        def largest(level, point=point, form=form):
            if not saturation.active:
                return boundary_growth(form, level)
            return saturated_growth(loops, point, level, saturation, reference)

        def cases_of(rate, point=point, after=log_level[interval + 1]):
            level = np.exp(after - 0.5 * step * rate)
            require_basin(loops, level, terminal_level, saturation)
            return level, saturation_cases(loops, point, level, saturation, reference, degree)

        guess = _extrapolate(rates, largest, log_level[interval + 1])
        rate, taylor_growth = _smallest_rate(loops, cases_of, guess, margin, degree)
        level, cases = cases_of(rate)
        certified = np.array(
            [
                max(_certified_rate(programme, case, label) for case in own)
                for own, label in zip(cases, loops.pendulums.labels, strict=True)
            ]
        )
        _require_certified(loops, rate - certified)
        log_level[interval] = log_level[interval + 1] - step * rate
        rates = [rate, *rates[:2]]
        true_growth = largest(level)
        found = [np.abs(certified - taylor_growth), np.abs(certified - true_growth), true_growth - rate]
        differences = np.maximum(differences, found)
    require_taylor_range(loops.pendulums, loops.cost[2 * chosen], np.exp(log_level), degree)
    funnels = Funnels("sum_of_squares", loops.pendulums.duration, loops.cost[2 * chosen], np.exp(log_level))
    return funnels, Agreement(*differences)


def _smallest_rate(
    loops: ClosedLoops, cases_of: Callable, guess: np.ndarray, margin: float, degree: int
) -> tuple[np.ndarray, np.ndarray]:
    """Alternate until r is above the largest V̇/ρ of the polynomial at the ρ that follows from it; return both."""
    before = None
    for alternation in range(1, MOST_ALTERNATIONS + 1):
        largest = _polynomial_maxima(cases_of(guess)[1], degree)
        left = guess - largest
        if alternation >= LEAST_ALTERNATIONS and (left >= 0.5 * margin).all():
            break
        guess, before = _next_rate(guess, largest, margin, before), (guess, largest)
    else:
        _require_certified(loops, np.where(left >= 0.5 * margin, 0.0, -np.abs(left)))
    return guess, largest


def _polynomial_maxima(cases: list[list[Case]], degree: int) -> np.ndarray:
    """Return the largest V̇/ρ of every pendulum over its cases, shape (pendulums,)."""
    if all(len(own) == 1 and own[0].side is None for own in cases):
        return circle_maximum(np.stack([case.coefficients for (case,) in cases]), degree + 1)
    return np.array([max(case_maximum(case, degree) for case in own) for own in cases])


def _require_certified(loops: ClosedLoops, margin: np.ndarray) -> None:
    if (margin < 0).any():
        index = int(margin.argmin())
        raise NumericalError(
            f"{loops.pendulums.labels[index]}: an interval between two knots has no certificate (margin "
            f"{margin[index]:.3g} 1/s); raise stability.sum_of_squares.knots"
        )


def _extrapolate(rates: list[np.ndarray], largest: Callable, log_level: np.ndarray) -> np.ndarray:
    """Return the first guess of r: a polynomial through the last three, at first the exact maximum."""
    if not rates:
        return largest(np.exp(log_level))
    if len(rates) < 3:
        return rates[0]
    return 3 * rates[0] - 3 * rates[1] + rates[2]


def _certified_rate(programme: CircleProgramme, case: Case, label: str) -> float:
    """Solve one programme; where an arc is no solvable problem, that of a longer one: it covers the arc too."""
    for longer in LONGER_ARCS if case.side is not None else ():
        constant, *slope = case.side
        amplitude = np.hypot(*slope)
        half = np.arccos(np.clip(-constant / amplitude, -1.0, 1.0)) + longer
        if half >= np.pi:
            break
        side = case.side if not longer else np.array([-amplitude * np.cos(half), *slope])
        try:
            return programme.rate(case.coefficients, label, side)
        except NumericalError:
            continue
    return programme.rate(case.coefficients, label)


def _next_rate(guess: np.ndarray, largest: np.ndarray, margin: float, before: tuple | None) -> np.ndarray:
    """Return the next r: the largest V̇/ρ, or where the interval is long for the loop a step of the secant method.

    A larger r makes ρ at the middle smaller and with it the largest V̇/ρ; where that falls faster than r rises,
    taking it for the next r would oscillate ever wider.
    """
    change = largest + margin - guess
    if before is not None:
        earlier = before[1] + margin - before[0]
        run, rise = guess - before[0], earlier - change
        steep = rise * run > 0
        change = np.where(steep, change * np.divide(run, rise, where=steep, out=np.ones_like(run)), change)
    return guess + change + SAFETY * np.abs(change)
