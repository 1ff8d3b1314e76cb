"""V̇/ρ under limits as polynomials, for the methods that certify polynomials: cases and where each applies.

The saturated torque is one of three affine laws, u = −U, u = w or u = U with w = u0 − K·x̄, each where w lies on
its side of ±U. For each law V̇ is affine in m/m_true (`saturation`), so that it is largest for one of the two extreme
masses. In the normal coordinates z of `invariance` every case is the nominal polynomial of V̇/ρ plus

    2·√(s22/ρ)·z2·Δω̇(z),   Δω̇ affine in z,

on the arc of the circle where an affine function of z, its `side`, is not negative. Certificates for all cases
are one for the loop with limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.stability.funnel.invariance import NormalForm, normal_axes
from lumbar.lifting.stability.funnel.polynomials import growth_polynomial, harmonics_of_monomials, monomials
from lumbar.lifting.stability.funnel.saturation import Saturation
from lumbar.lifting.stability.model.pendulum_loop import Pendulums

ARC_OVERLAP = 1e-9
"""By which two arcs of one law are longer at each end than they must be, in rad, so that rounding leaves no gap."""

LEAST_HALF_ARC = 0.02
"""Half of the shortest arc in rad: a shorter one is widened (the law is then certified on more than its arc), as its
multipliers would be too large for the solver."""


@dataclass(frozen=True)
class Case:
    """One law and one mass of one pendulum at one moment."""

    coefficients: np.ndarray
    """Shape (monomials of degree d + 1,): V̇/ρ in 1/s with the sine's Taylor polynomial of degree d."""
    side: np.ndarray | None = None
    """Shape (3,), or None: over 1, z1, z2: the law applies where this is ≥ 0, an arc of the circle. None: all round it.
    """


def saturation_cases(
    pendulums: Pendulums,
    form: NormalForm,
    cost: np.ndarray,
    gains: np.ndarray,
    level: np.ndarray,
    reference: tuple[np.ndarray, np.ndarray],
    saturation: Saturation,
    degree: int,
) -> list[list[Case]]:
    """Return the cases of every pendulum at one moment.

    Parameters
    ----------
    cost, gains : numpy.ndarray, shapes (pendulums, 3) and (pendulums, 2)
        S and K.
    level : numpy.ndarray, shape (pendulums,)
        ρ.
    reference : tuple of numpy.ndarray, shape (pendulums,)
        u0 and θ̇0.
    degree : int
        Of the sine's Taylor polynomial.
    """
    nominal = growth_polynomial(form, level, degree)
    if not saturation.active:
        return [[Case(row)] for row in nominal]
    torque, velocity = reference
    a, p, q = (np.sqrt(level) * axis for axis in normal_axes(cost))
    b = pendulums.damping
    wanted = np.stack([torque, -(gains[:, 0] * a + gains[:, 1] * p), -gains[:, 1] * q], axis=-1)
    drag = b[:, None] * np.stack([velocity, p, q], axis=-1)
    index = [monomials(degree + 1).index(exponents) for exponents in ((0, 1), (1, 1), (0, 2))]
    weight = 2 * np.sqrt(cost[:, 2] / level) / pendulums.inertia
    result: list[list[Case]] = [[] for _ in range(len(nominal))]
    for law, sides in _laws(wanted, saturation.torque):
        changes = []
        for ratio in sorted(set(saturation.ratios)):
            changed = nominal.copy()
            changed[:, index] += weight[:, None] * (ratio * (law - drag) - (wanted - drag))
            changes.append(changed)
        for number, cases in enumerate(result):
            arcs = _arcs([side[number] for side in sides])
            cases += [Case(changed[number], arc) for changed in changes for arc in arcs]
    return result


def _laws(wanted: np.ndarray, torque: float):
    """Yield each law of the saturation and the functions that are not negative where it applies."""
    if not np.isfinite(torque):
        yield wanted, ()
        return
    limit = np.broadcast_to([torque, 0.0, 0.0], wanted.shape)
    yield wanted, (limit - wanted, limit + wanted)
    yield limit, (wanted - limit,)
    yield -limit, (-limit - wanted,)


def _arcs(sides: list[np.ndarray]) -> list[np.ndarray | None]:
    """Return one function per arc on which all sides are ≥ 0; None stands for the whole circle."""
    amplitudes = [np.hypot(side[1], side[2]) for side in sides]
    if any(side[0] + amplitude < 0 for side, amplitude in zip(sides, amplitudes, strict=True)):
        return []
    cutting = [side for side, amplitude in zip(sides, amplitudes, strict=True) if side[0] - amplitude < 0]
    if not cutting:
        return [None]
    if len(cutting) == 1:
        constant, *slope = cutting[0]
        least = -np.hypot(*slope) * np.cos(LEAST_HALF_ARC)
        side = np.array([max(constant, least), *slope])
        # A power of two keeps the zeros, digit for digit.
        return [side / 2.0 ** np.ceil(np.log2(np.abs(side).max()))]
    # |w| ≤ U between two parallel chords: one arc on either side, each cut off by a chord of its own.
    upper, lower = cutting
    middle = np.arctan2(lower[2], lower[1])
    start, end = (
        np.arccos(side[0] / amplitude)
        for side, amplitude in ((upper, amplitudes[0]), (-lower, amplitudes[0]))
    )
    half = max(0.5 * (end - start) + ARC_OVERLAP, LEAST_HALF_ARC)
    centres = [middle + turn * 0.5 * (start + end) for turn in (1, -1)]
    return [np.array([-np.cos(half), np.cos(centre), np.sin(centre)]) for centre in centres]


def case_maximum(case: Case, degree: int) -> float:
    """Return the largest value of a case on its arc.

    Candidates are all critical angles, roots of the derivative as a polynomial in exp(iφ), and the ends of
    the arc: no sampling and no search.
    """
    amplitudes = harmonics_of_monomials(degree + 1) @ case.coefficients
    cosines, sines = amplitudes[1::2], amplitudes[2::2]
    order = np.arange(1, degree + 2)
    # d/dφ Σ a·cos kφ + b·sin kφ = Re Σ k·(b + ia)·exp(ikφ); times exp(inφ) a polynomial of degree 2n.
    upper = 0.5 * order * (sines + 1j * cosines)
    roots = np.roots(np.concatenate([upper[::-1], [0.0], np.conj(upper)]))
    angle = np.angle(roots)
    within = np.ones(len(angle), dtype=bool)
    if case.side is not None:
        constant, first, second = case.side
        middle, half = (
            np.arctan2(second, first),
            np.arccos(np.clip(-constant / np.hypot(first, second), -1, 1)),
        )
        within = constant + first * np.cos(angle) + second * np.sin(angle) >= 0
        angle, within = np.append(angle, [middle - half, middle + half]), np.append(within, [True, True])
    values = amplitudes[0] + cosines @ np.cos(np.outer(order, angle)) + sines @ np.sin(np.outer(order, angle))
    return float(values[within].max())
