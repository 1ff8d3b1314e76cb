"""Certificates without rounding: the Gram matrix in rational numbers, positive definite by an exact LDLᵀ.

A solver's G satisfies r − v ≡ bᵀGb on the circle only up to its tolerance and may have slightly negative
eigenvalues. Between the certified rate and ρ̇/ρ there is a small margin; half of it is spent on making G
strictly positive (on the circle bᵀb is the number (d + 3)/2, so adding δ·1 to G costs exactly δ·(d + 3)/2 of
the rate), then G is rounded and the remaining residual is put into it. What comes out is the identity

    ρ̇/ρ − v(z) = c + b(z)ᵀG·b(z)   on |z| = 1,   c ≥ 0,  G ≻ 0,

in rational numbers, with the coefficients of v taken as the binary fractions that they are in the computer.
`holds` checks it by other formulas than those that made it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lumbar.stability.circle_certificate import CircleCertificate
from lumbar.stability.polynomials import harmonics_of_monomials

GRID = 2**44
"""Entries of G are rounded to this part of a unit of the polynomial's scale."""


@dataclass(frozen=True)
class RationalCertificate:
    """A proved bound.

    Attributes
    ----------
    rate : Fraction
        ρ̇/ρ in 1/s.
    slack : Fraction
        c ≥ 0 in 1/s.
    target : list of Fraction
        Harmonics of v: 1, cos φ, sin φ, cos 2φ, ….
    gram : list of list of Fraction
        G.
    """

    rate: Fraction
    slack: Fraction
    target: list[Fraction]
    gram: list[list[Fraction]]


def rational_certificate(
    certificate: CircleCertificate, coefficients: np.ndarray, rate: float, degree: int
) -> RationalCertificate | None:
    """Return the certificate in rational numbers, or None where the margin does not suffice.

    Parameters
    ----------
    certificate : CircleCertificate
        Of the programme at this level.
    coefficients : numpy.ndarray, shape (monomials of degree d + 1,)
        Of v in 1/s.
    rate : float
        ρ̇/ρ in 1/s.
    degree : int
    """
    target = _exact_harmonics(coefficients, degree)
    size = degree + 2
    shift = max(0.0, 0.5 * (rate - certificate.rate) / (0.5 * (degree + 3)))
    unit = 2.0 ** np.ceil(np.log2(max(np.abs(certificate.gram).max(), 1e-300))) / GRID
    rounded = np.round((certificate.gram + shift * np.eye(size)) / unit).astype(object)
    exact_unit = Fraction(unit)
    gram = [[Fraction(int(entry)) * exact_unit for entry in row] for row in rounded]
    wanted = [-value for value in target]
    wanted[0] += Fraction(rate)
    slack = _absorb(gram, wanted)
    found = RationalCertificate(Fraction(rate), slack, target, gram)
    return found if slack >= 0 and is_positive_definite(gram) else None


def _exact_harmonics(coefficients: np.ndarray, degree: int) -> list[Fraction]:
    """Harmonics of v without rounding: the map is dyadic and so are the coefficients."""
    rows = harmonics_of_monomials(degree + 1)
    values = [Fraction(float(value)) for value in coefficients]
    return [
        sum((Fraction(float(row[column])) * values[column] for column in np.flatnonzero(row)), Fraction(0))
        for row in rows
    ]


def _absorb(gram: list[list[Fraction]], wanted: list[Fraction]) -> Fraction:
    """Put what is missing of every harmonic but the constant into G; return what is left of the constant."""
    residual = [value - found for value, found in zip(wanted, gram_harmonics(gram), strict=True)]
    order = len(gram) // 2
    for multiple in range(1, 2 * order + 1):
        cosine, sine = residual[2 * multiple - 1], residual[2 * multiple]
        if multiple <= order:
            # 2·G[1, cos kφ]·cos kφ
            _add(gram, 0, 2 * multiple - 1, cosine / 2)
            _add(gram, 0, 2 * multiple, sine / 2)
            continue
        # cos nφ·cos kφ − sin nφ·sin kφ = cos (n + k)φ;  sin nφ·cos kφ + cos nφ·sin kφ = sin (n + k)φ
        first, second = order, multiple - order
        share = Fraction(1) if first == second else Fraction(1, 2)
        _add(gram, 2 * first - 1, 2 * second - 1, share * cosine)
        _add(gram, 2 * first, 2 * second, -share * cosine)
        if first == second:
            _add(gram, 2 * first - 1, 2 * first, sine)
        else:
            _add(gram, 2 * first, 2 * second - 1, sine / 2)
            _add(gram, 2 * first - 1, 2 * second, sine / 2)
    left = [value - found for value, found in zip(wanted, gram_harmonics(gram), strict=True)]
    if any(left[1:]):
        raise AssertionError("the residual of a Gram matrix was not absorbed")
    return left[0]


def _add(gram: list[list[Fraction]], row: int, column: int, value: Fraction) -> None:
    gram[row][column] += value
    if row != column:
        gram[column][row] += value


def gram_harmonics(gram: list[list[Fraction]]) -> list[Fraction]:
    """Return the harmonics of bᵀGb exactly, by the product formulas of sine and cosine."""
    order = len(gram) // 2
    result = [Fraction(0)] * (4 * order + 1)

    def add(multiple: int, sine: bool, value: Fraction) -> None:
        if multiple == 0:
            if not sine:
                result[0] += value
            return
        sign = -1 if sine and multiple < 0 else 1
        result[2 * abs(multiple) - (0 if sine else 1)] += sign * value

    for row in range(len(gram)):
        for column in range(len(gram)):
            n, k = (row + 1) // 2, (column + 1) // 2
            half = gram[row][column] / 2
            row_sine, column_sine = row > 0 and row % 2 == 0, column > 0 and column % 2 == 0
            if row_sine and column_sine:
                add(n - k, False, half)
                add(n + k, False, -half)
            elif not row_sine and not column_sine:
                add(n - k, False, half)
                add(n + k, False, half)
            else:
                # sin a·cos b = (sin (a + b) + sin (a − b))/2
                a, b = (n, k) if row_sine else (k, n)
                add(a + b, True, half)
                add(a - b, True, half)
    return result


def is_positive_definite(matrix: list[list[Fraction]]) -> bool:
    """Whether all pivots of the exact LDLᵀ factorisation are positive."""
    common = 1
    for row in matrix:
        for entry in row:
            common = max(common, entry.denominator)
    # All denominators are powers of two, so the largest is common; integers make elimination fast.
    work = [[int(entry * common) for entry in row] for row in matrix]
    previous = 1
    for pivot in range(len(work)):
        # Bareiss: after this step the pivot is the leading minor, and D's entry the quotient of two of them.
        if work[pivot][pivot] <= 0:
            return False
        for row in range(pivot + 1, len(work)):
            for column in range(pivot + 1, len(work)):
                value = work[row][column] * work[pivot][pivot] - work[row][pivot] * work[pivot][column]
                work[row][column] = value // previous
        previous = work[pivot][pivot]
    return True


def holds(certificate: RationalCertificate) -> bool:
    """Check a certificate anew: the identity at enough rational points of the circle, and G ≻ 0.

    Two trigonometric polynomials of order n that agree at 2n + 1 points are equal. Points are
    ((1 − t²)/(1 + t²), 2t/(1 + t²)) with rational t, where every harmonic is rational.
    """
    size = len(certificate.gram)
    for number in range(2 * len(certificate.target) + 1):
        t = Fraction(2 * number + 1, 7)
        cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
        values = [Fraction(1)]
        c, s = Fraction(1), Fraction(0)
        while len(values) < len(certificate.target):
            c, s = c * cosine - s * sine, s * cosine + c * sine
            values += [c, s]
        left = certificate.rate - sum(
            (value * entry for value, entry in zip(values, certificate.target, strict=True)), Fraction(0)
        )
        right = certificate.slack + sum(
            values[row] * certificate.gram[row][column] * values[column]
            for row in range(size)
            for column in range(size)
        )
        if left != right:
            return False
    return certificate.slack >= 0 and is_positive_definite(certificate.gram)
