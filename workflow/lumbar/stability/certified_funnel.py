"""The sum-of-squares engine: funnels whose every rate ρ̇/ρ carries a certificate, backward from ρ(T).

Between two knots ρ̇/ρ is one number r, ln ρ is linear, and the condition −V̇ + ρ̇ + L·(V − ρ) ∈ SOS is imposed
at the middle of the interval (an error of second order in the spacing). ρ̇ is a variable and ρ(T) is fixed, so
that going backward each interval is a small bilinear problem in (r, L, ρ) of its own, solved by alternation:

1. ρ at the middle fixed: the programme of `circle_certificate` finds L and the smallest certified r, which is
   the margin form, γ = ρ̇/ρ − r being maximised;
2. L and r fixed: ρ follows from r, ρ(t) = ρ(t + Δt)·exp(−r·Δt).

The first guess of r is extrapolated from the later intervals. As ρ depends on r only through Δt/2, two
alternations suffice; the last programme is solved at the very ρ that is returned and its margin γ must not be
negative: what is returned is certified, however it was found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.errors import NumericalError
from lumbar.stability.circle_certificate import CircleCertificate, CircleProgramme
from lumbar.stability.funnel import ClosedLoops, Funnels, even_knots
from lumbar.stability.invariance import boundary_growth
from lumbar.stability.polynomials import circle_maximum, growth_polynomial, require_taylor_range
from lumbar.stability.rational_certificate import rational_certificate

MOST_ALTERNATIONS = 8
"""Alternations after which a margin that is still negative is an error."""
SAFETY = 0.05
"""Share of the last change of r by which the next r is enlarged: covers what the change of ρ does to it."""


@dataclass(frozen=True)
class Agreement:
    """How certificates and exact maxima compare, per pendulum.

    Attributes
    ----------
    margin_difference : numpy.ndarray, shape (pendulums,)
        Largest |certified rate − largest V̇/ρ of the same Taylor polynomial| in 1/s: the programme's error.
    taylor_difference : numpy.ndarray, shape (pendulums,)
        Largest |certified rate − largest V̇/ρ with the true sine| in 1/s: what the polynomial changes.
    taylor_optimism : numpy.ndarray, shape (pendulums,)
        Largest (largest V̇/ρ with the true sine − ρ̇/ρ of the funnel) in 1/s: where positive, the Taylor
        polynomial was optimistic and the certificate does not hold for the true sine.
    rational_share : numpy.ndarray, shape (pendulums,), or None
        Share of the intervals whose certificate was proved in rational arithmetic, if asked for.
    alternations : int
        Most alternations that an interval took.
    """

    margin_difference: np.ndarray
    taylor_difference: np.ndarray
    taylor_optimism: np.ndarray
    rational_share: np.ndarray | None
    alternations: int


def certified_funnels(
    loops: ClosedLoops,
    goal_level: float,
    degree: int,
    knots: int,
    alternations: int,
    margin: float,
    rational: bool,
) -> tuple[Funnels, Agreement]:
    """Compute funnels by sum-of-squares programmes.

    Parameters
    ----------
    loops : ClosedLoops
    goal_level : float
        ρ(T).
    degree : {3, 5, 7}
        Taylor degree of the sine.
    knots : int
        Knots of ρ; the nearest number that divides those of `loops` evenly is taken.
    alternations : int
        Programmes per interval, at least 2 (more are taken where the margin is still negative).
    margin : float
        In 1/s; γ that is left so that certificates can be made rational.
    rational : bool
        Whether every certificate is proved in rational arithmetic.

    Raises
    ------
    NumericalError
        A programme was not solved, or an interval has no certificate after `MOST_ALTERNATIONS`.
    """
    programme = CircleProgramme(degree)
    chosen = even_knots(loops.knots, knots)
    step = loops.step * (chosen[1] - chosen[0])
    count = len(loops.pendulums.labels)
    log_level = np.empty((len(chosen), count))
    log_level[-1] = np.log(goal_level)
    differences, rational_knots, most = np.zeros((3, count)), np.zeros(count), 0
    differences[2] = -np.inf
    rates: list[np.ndarray] = []
    for interval in range(len(chosen) - 2, -1, -1):
        form = loops.form(chosen[interval] + chosen[interval + 1])
        guess = _extrapolate(rates, form, log_level[interval + 1])
        for alternation in range(1, MOST_ALTERNATIONS + 1):
            level = np.exp(log_level[interval + 1] - 0.5 * step * guess)
            coefficients = growth_polynomial(form, level, degree)
            certificates = [
                programme.solve(row, label)
                for row, label in zip(coefficients, loops.pendulums.labels, strict=True)
            ]
            certified = np.array([item.rate for item in certificates])
            if alternation >= alternations and (guess - certified >= 0.5 * margin).all():
                break
            guess = certified + margin + SAFETY * np.abs(certified - guess)
        else:
            index = int((guess - certified).argmin())
            raise NumericalError(
                f"{loops.pendulums.labels[index]}: no certificate {loops.pendulums.duration[index]:.3g} s long "
                f"after {MOST_ALTERNATIONS} alternations (margin {guess[index] - certified[index]:.3g} 1/s)"
            )
        most = max(most, alternation)
        log_level[interval] = log_level[interval + 1] - step * guess
        rates = [guess, *rates[:2]]
        true_growth = boundary_growth(form, level)
        taylor_growth = circle_maximum(coefficients, degree + 1)
        found = [np.abs(certified - taylor_growth), np.abs(certified - true_growth), true_growth - guess]
        differences = np.maximum(differences, found)
        if rational:
            rational_knots += _rational(certificates, coefficients, guess, degree)
    require_taylor_range(loops.pendulums, loops.cost[2 * chosen], np.exp(log_level), degree)
    share = rational_knots / (len(chosen) - 1) if rational else None
    funnels = Funnels("sum_of_squares", loops.pendulums.duration, loops.cost[2 * chosen], np.exp(log_level))
    return funnels, Agreement(*differences, share, most)


def _extrapolate(rates: list[np.ndarray], form, log_level: np.ndarray) -> np.ndarray:
    """Return the first guess of r: a polynomial through the last three, at first the exact maximum."""
    if not rates:
        return boundary_growth(form, np.exp(log_level))
    if len(rates) < 3:
        return rates[0]
    return 3 * rates[0] - 3 * rates[1] + rates[2]


def _rational(
    certificates: list[CircleCertificate], coefficients: np.ndarray, rate: np.ndarray, degree: int
) -> np.ndarray:
    return np.array(
        [
            rational_certificate(item, row, bound, degree) is not None
            for item, row, bound in zip(certificates, coefficients, rate, strict=True)
        ]
    )
