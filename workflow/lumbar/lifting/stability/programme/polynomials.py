"""V̇/ρ as polynomials in normal coordinates z (`exact_funnel`), for the methods that certify polynomials.

A polynomial is the vector of its coefficients over `monomials`, by rising total degree; the sine is its Taylor polynomial.

Under limits (`saturation`) the torque is one of three affine laws, u = −U, u = w or u = U with w = u0 − K·x̄, each where w
lies on its side of ±U. For each law V̇ is affine in m/m_true, so that it is largest for one of the two extreme masses.
Every such case is the nominal polynomial of V̇/ρ plus

    2·√(s22/ρ)·z2·Δω̇(z),   Δω̇ affine in z,

on the arc of the circle where an affine function of z, its `side`, is not negative. Certificates for all cases
are one for the loop with limits.
"""

from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.saturation import Saturation, SaturationReference
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, NormalForm, normal_axes


def monomials(degree: int) -> list[tuple[int, int]]:
    """Exponents of all monomials in two variables up to a degree."""
    return [(total - second, second) for total in range(degree + 1) for second in range(total + 1)]


def growth_polynomial(form: NormalForm, level: np.ndarray, degree: int) -> np.ndarray:
    """Coefficients of V̇/ρ in z with the Taylor polynomial of sin(θ0 + e) in e, shape (..., monomials of degree + 1).

    `level` is ρ, of the same shape (...) as the entries of `form`.
    """
    index = {exponents: position for position, exponents in enumerate(monomials(degree + 1))}
    coefficients = np.zeros((*np.shape(level), len(index)))
    coefficients[..., index[2, 0]] = -form.alpha
    coefficients[..., index[1, 1]] = -2 * form.beta
    coefficients[..., index[0, 2]] = -form.gamma
    semi_axis, kappa = form.amplitude * np.sqrt(level), form.coupling / np.sqrt(level)
    sine, cosine = np.sin(form.angle), np.cos(form.angle)
    derivatives = (sine, cosine, -sine, -cosine)
    for power in range(2, degree + 1):
        taylor = derivatives[power % 4] / factorial(power)
        coefficients[..., index[power, 1]] = -kappa * taylor * semi_axis**power
    return coefficients


TAYLOR_ERROR = 0.05
"""Error of the sine's Taylor polynomial up to which a method that uses it is in its range."""


def require_taylor_range(pendulums: Pendulums, cost: np.ndarray, level: np.ndarray, degree: int) -> None:
    """Refuse funnels that reach further than the Taylor polynomial of the sine does.

    Its remainder is at most |e|^(d + 1)/(d + 1)!; where that exceeds `TAYLOR_ERROR` on the ellipse, certificates
    of the polynomial say nothing of the pendulum.

    `cost` has shape (knots, pendulums, 3), `level` (knots, pendulums). Pendulums without gravity have no sine and no
    limit.
    """
    reach = (TAYLOR_ERROR * factorial(degree + 1)) ** (1 / (degree + 1))
    semi_axis = (np.sqrt(level) * normal_axes(cost)[0]).max(axis=0)
    semi_axis = np.where(pendulums.gravity_torque == 0, 0.0, semi_axis)
    if (semi_axis > reach).any():
        index = int(semi_axis.argmax())
        raise NumericalError(
            f"{pendulums.labels[index]}: the basin reaches {semi_axis[index]:.3g} rad from its trajectory, beyond the "
            f"range of the sine's Taylor polynomial of degree {degree} ({reach:.3g} rad); raise the degree or use "
            "the exact method"
        )


@cache
def harmonics_of_monomials(degree: int) -> np.ndarray:
    """Matrix from coefficients of monomials up to `degree` to harmonics 1, cos φ, sin φ, cos 2φ, ….

    Its entries are dyadic rationals and exact.
    """
    samples = 4 * (degree + 1)
    angle = 2 * np.pi * np.arange(samples) / samples
    values = np.stack([np.cos(angle) ** i * np.sin(angle) ** j for i, j in monomials(degree)], axis=1)
    projection = harmonics(degree, angle) * (2 / samples)
    projection[0] /= 2
    unit = 2.0**degree
    return np.round(projection @ values * unit) / unit


def harmonics(order: int, angle: np.ndarray) -> np.ndarray:
    """Values of 1, cos φ, sin φ, …, cos nφ, sin nφ, shape (2n + 1, angles)."""
    rows = [np.ones_like(angle)]
    for multiple in range(1, order + 1):
        rows += [np.cos(multiple * angle), np.sin(multiple * angle)]
    return np.stack(rows)


NEGLIGIBLE = 1e-8
"""Last step in rad towards a maximum: what is left of the height goes with its square."""


def circle_maximum(coefficients: np.ndarray, degree: int) -> np.ndarray:
    """Return the largest value on the unit circle: samples, then Newton's method from the best of each part.

    `coefficients` have shape (..., monomials).
    """
    amplitudes = coefficients @ harmonics_of_monomials(degree).T
    samples, parts = 16 * (degree + 1), 2 * (degree + 1)
    angle, waves = _sampled_circle(degree, samples)
    values = amplitudes @ waves
    within = values.reshape(*values.shape[:-1], parts, -1).argmax(axis=-1)
    position = angle[within + np.arange(parts) * (samples // parts)]
    # The sum of aₖ cos kφ + bₖ sin kφ is the real part of the sum of cₖzᵏ with cₖ = aₖ − ibₖ and z = exp iφ.
    complex_amplitudes = amplitudes[..., 1::2] - 1j * amplitudes[..., 2::2]
    multiple = np.arange(1, degree + 1)
    first, second = 1j * multiple * complex_amplitudes, -(multiple**2) * complex_amplitudes
    for _ in range(5):
        powers = _powers(position, degree)
        slope, bend = (np.matmul(powers, part[..., None])[..., 0].real for part in (first, second))
        step = np.where(bend < 0, -slope / np.where(bend < 0, bend, -1.0), 0.0)
        position = position + np.clip(step, -angle[1], angle[1])
        if np.abs(step).max(initial=0.0) < NEGLIGIBLE:
            break
    waves = np.matmul(_powers(position, degree), complex_amplitudes[..., None])[..., 0].real
    return np.maximum(amplitudes[..., 0] + waves.max(axis=-1), values.max(axis=-1))


@cache
def _sampled_circle(degree: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return even angles and the harmonics there."""
    angle = 2 * np.pi * np.arange(samples) / samples
    return angle, harmonics(degree, angle)


def _powers(angle: np.ndarray, degree: int) -> np.ndarray:
    """Return z, z², …, zⁿ of z = exp iφ, shape (angles, n)."""
    return np.multiply.accumulate(np.repeat(np.exp(1j * angle)[..., None], degree, axis=-1), axis=-1)


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
    loops: ClosedLoops,
    point: int,
    level: np.ndarray,
    saturation: Saturation,
    reference: SaturationReference,
    degree: int,
) -> list[list[Case]]:
    """Return the cases of every pendulum at one point of the grid, with the sine's Taylor polynomial of a degree.

    `level` is ρ, shape (pendulums,).
    """
    form, cost, gains = loops.form(point), loops.cost[point], loops.gains[point]
    nominal = growth_polynomial(form, level, degree)
    if not saturation.active:
        return [[Case(row)] for row in nominal]
    torque, velocity = reference.torque[point], reference.velocity[point]
    a, p, q = (np.sqrt(level) * axis for axis in normal_axes(cost))
    b = loops.pendulums.damping
    wanted = np.stack([torque, -(gains[:, 0] * a + gains[:, 1] * p), -gains[:, 1] * q], axis=-1)
    drag = b[:, None] * np.stack([velocity, p, q], axis=-1)
    index = [monomials(degree + 1).index(exponents) for exponents in ((0, 1), (1, 1), (0, 2))]
    weight = 2 * np.sqrt(cost[:, 2] / level) / loops.pendulums.inertia
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


def _laws(wanted: np.ndarray, torque: float | np.ndarray):
    """Yield each law of the saturation and the functions that are not negative where it applies."""
    if np.isinf(torque).all():
        yield wanted, ()
        return
    limit = np.zeros_like(wanted)
    limit[:, 0] = torque
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
