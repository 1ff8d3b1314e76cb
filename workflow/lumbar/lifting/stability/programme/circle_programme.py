"""The sum-of-squares programme of one knot (Eqs 4.5 and 4.6, ρ̇ a variable) on the unit circle: small and fast.

In the coordinates of `invariance`

    minimise r  subject to  r − v(z) − L(z)·(1 − |z|²) = b(z)ᵀG·b(z),   G ⪰ 0,   L free of degree d − 1

says that V̇/ρ ≤ r on V = ρ; with ρ̇/ρ given it is the margin form, γ = ρ̇/ρ − r is maximised. As L is free,
only what both sides are *on the circle* matters: the programme is solved in the quotient ring of polynomials
modulo 1 − |z|², whose basis are the circular harmonics 1, cos kφ, sin kφ. That leaves d + 2 times fewer
unknowns and, the harmonics being orthogonal, well-conditioned programmes. L follows by exact division, so nothing is
lost: a non-negative trigonometric polynomial is a sum of squares (Fejér, Riesz).

Where a law holds only on the arc on which an affine function g(z) is not negative (`saturation_cases`), the identity

    r − v(z) = b(z)ᵀG·b(z) + g(z)·c(z)ᵀH·c(z)   on |z| = 1,   G, H ⪰ 0

is the S-procedure; c holds the harmonics of half the odd orders, cos φ/2, sin φ/2, cos 3φ/2, …, whose products have
whole ones. Nothing is lost here either (Dumitrescu, Positive Trigonometric Polynomials, 2017, section 1.4).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.polynomials import harmonics, harmonics_of_monomials
from lumbar.lifting.stability.programme.sum_of_squares import SumOfSquares

TOLERANCES = (1e-10, 1e-9, 1e-8)
"""Of gaps and residuals, on polynomials scaled to a largest harmonic of one; tried in turn until the status is
"solved". The last is Clarabel's own."""


def _products(basis: np.ndarray, factors: np.ndarray, angle: np.ndarray, order: int, unit: int) -> np.ndarray:
    """Matrices from the scaled upper triangle of a Gram matrix to the harmonics of each factor times bᵀGb.

    Their entries are multiples of 1/`unit` and exact.
    """
    projection = harmonics(order, angle) * (2 / len(angle))
    projection[0] /= 2
    triangle = [(row, column) for column in range(len(basis)) for row in range(column + 1)]
    products = np.stack([basis[row] * basis[column] for row, column in triangle], axis=1)
    exact = np.round(projection @ (factors[:, :, None] * products) * unit) / unit
    return exact * [1.0 if row == column else np.sqrt(2.0) for row, column in triangle]


@cache
def _gram_rows(degree: int) -> np.ndarray:
    """Matrix from the scaled upper triangle of G to the harmonics of bᵀGb."""
    angle = np.linspace(0.0, 2 * np.pi, 4 * (degree + 1), endpoint=False)
    basis = harmonics((degree + 1) // 2, angle)
    return _products(basis, np.ones((1, len(angle))), angle, degree + 1, 4)[0]


@cache
def _side_rows(degree: int) -> np.ndarray:
    """Matrices from the scaled upper triangle of H to the harmonics of cᵀHc, of cos φ and of sin φ times it."""
    angle = np.linspace(0.0, 2 * np.pi, 4 * (degree + 2), endpoint=False)
    half = np.outer(np.repeat(np.arange(1, (degree + 1) // 2 + 1) - 0.5, 2), angle)
    basis = np.where(np.arange(len(half))[:, None] % 2, np.sin(half), np.cos(half))
    return _products(basis, harmonics(1, angle), angle, degree + 1, 8)


class CircleProgramme:
    """The programme of one Taylor degree d (odd), set up once and solved for many knots."""

    def __init__(self, degree: int):
        self._gram = _gram_rows(degree)
        self._side = _side_rows(degree)
        self._harmonics = harmonics_of_monomials(degree + 1)
        self._programmes = [self._programme([self._gram], tolerance) for tolerance in TOLERANCES]

    def _programme(self, grams: list[np.ndarray], tolerance: float) -> SumOfSquares:
        constant = np.eye(len(self._gram))[:, :1]
        return SumOfSquares(np.ones(1), -constant, grams, tolerance)

    def rate(self, coefficients: np.ndarray, label: str, side: np.ndarray | None = None) -> float:
        """Return the smallest certified bound of a polynomial on the circle, or on an arc of it, in 1/s.

        Parameters
        ----------
        coefficients : numpy.ndarray, shape (monomials of degree d + 1,)
            Of v in 1/s.
        label : str
            For messages.
        side : numpy.ndarray, shape (3,), optional
            g over 1, z1, z2: the bound is to hold where g ≥ 0.

        Raises
        ------
        NumericalError
            The solver's status is not "solved" ("almost solved" is not solved).
        """
        target = self._harmonics @ coefficients
        scale = float(np.abs(target).max()) or 1.0
        programmes = self._programmes
        if side is not None:
            grams = [self._gram, np.tensordot(side, self._side, 1)]
            programmes = (self._programme(grams, tolerance) for tolerance in TOLERANCES)
        for programme in programmes:
            found = programme.solve(-target / scale)
            if found is not None:
                return float(found[0]) * scale
        raise NumericalError(f"{label}: the sum-of-squares programme ended as {programme.status}")
