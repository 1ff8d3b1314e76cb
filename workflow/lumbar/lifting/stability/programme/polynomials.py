"""V̇/ρ as polynomials in normal coordinates z (`exact_funnel`), for the methods that certify polynomials.

A polynomial is the vector of its coefficients over `monomials`, by rising total degree; the sine is its Taylor polynomial.
"""

from functools import cache
from math import factorial

import numpy as np

from lumbar.lifting.stability.model.eq_4_2_regulator import NormalForm


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
