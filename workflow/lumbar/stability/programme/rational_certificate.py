"""Certificates without rounding: the Gram matrix in rational numbers, positive definite by an exact LDLᵀ.

A solver's G satisfies r − v ≡ bᵀGb on the circle only up to its tolerance and may have slightly negative
eigenvalues. Between the certified rate and ρ̇/ρ there is a small margin; half of it is spent on making G
strictly positive (on the circle bᵀb is the number (d + 3)/2, so adding δ·1 to G costs exactly δ·(d + 3)/2 of
the rate), then G is rounded and the remaining residual is put into it. What comes out is the identity

    ρ̇/ρ − v(z) = c + b(z)ᵀG·b(z) + g(z)·c(z)ᵀH·c(z)   on |z| = 1,   c ≥ 0,  G ≻ 0,  H ≻ 0,

in rational numbers, with the coefficients of v and g taken as the binary fractions that they are in the computer
(the last term only for bounds on the arc g ≥ 0).
`holds` checks it by other formulas than those that made it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lumbar.stability.funnel.polynomials import harmonics_of_monomials
from lumbar.stability.programme.circle_certificate import CircleCertificate

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
    side : list of Fraction
        g over 1, z1, z2; empty where the bound holds all round the circle.
    side_gram : list of list of Fraction
        H, or empty.
    """

    rate: Fraction
    slack: Fraction
    target: list[Fraction]
    gram: list[list[Fraction]]
    side: list[Fraction]
    side_gram: list[list[Fraction]]


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
    spare = max(0.0, rate - certificate.rate)
    # bᵀb = (d + 3)/2; cᵀc = (d + 1)/2 and |g| ≤ |g|₁.
    gram = _rounded(certificate.gram, 0.5 * spare / (0.5 * (degree + 3)))
    wanted = [-value for value in target]
    wanted[0] += Fraction(rate)
    side, side_gram = [], []
    if certificate.side is not None:
        side = [Fraction(float(value)) for value in certificate.side]
        reach = float(np.abs(certificate.side).sum())
        side_gram = _rounded(certificate.side_gram, 0.25 * spare / (0.5 * (degree + 1) * reach))
        product = side_harmonics(side, side_gram)
        wanted = [value - found for value, found in zip(wanted, product, strict=True)]
    slack = _absorb(gram, wanted)
    found = RationalCertificate(Fraction(rate), slack, target, gram, side, side_gram)
    positive = is_positive_definite(gram) and is_positive_definite(side_gram)
    return found if slack >= 0 and positive else None


def _rounded(gram: np.ndarray, shift: float) -> list[list[Fraction]]:
    """Return a matrix plus `shift` times the identity in binary fractions."""
    unit = 2.0 ** np.ceil(np.log2(max(np.abs(gram).max(), 1e-300))) / GRID
    rounded = np.round((gram + shift * np.eye(len(gram))) / unit).astype(object)
    exact_unit = Fraction(unit)
    return [[Fraction(int(entry)) * exact_unit for entry in row] for row in rounded]


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
    waves = [
        (0, False),
        *((2 * multiple, sine) for multiple in range(1, order + 1) for sine in (False, True)),
    ]
    return _product_harmonics(gram, waves, 2 * order)


def side_harmonics(side: list[Fraction], gram: list[list[Fraction]]) -> list[Fraction]:
    """Return the harmonics of g·cᵀHc exactly."""
    size = len(gram)
    waves = [(odd, sine) for odd in range(1, size, 2) for sine in (False, True)]
    result = [Fraction(0)] * (2 * size + 1)
    for index, value in enumerate(_product_harmonics(gram, waves, size - 1)):
        multiple, sine = (index + 1) // 2, index > 0 and index % 2 == 0
        result[index] += side[0] * value
        for factor, factor_sine in ((side[1], False), (side[2], True)):
            _add_product(result, (2, factor_sine), (2 * multiple, sine), factor * value)
    return result


def _product_harmonics(gram: list, waves: list[tuple[int, bool]], order: int) -> list[Fraction]:
    """Harmonics up to `order` of the quadratic form of waves, each (twice its multiple, whether it is a sine)."""
    result = [Fraction(0)] * (2 * order + 1)
    for row, first in zip(gram, waves, strict=True):
        for entry, second in zip(row, waves, strict=True):
            _add_product(result, first, second, entry)
    return result


def _add_product(result: list[Fraction], first: tuple, second: tuple, value: Fraction) -> None:
    """Add value·first·second to harmonics; a wave is (twice its multiple, whether it is a sine)."""
    (n, first_sine), (k, second_sine) = first, second
    half = value / 2

    def add(multiple: int, sine: bool, part: Fraction) -> None:
        if multiple or not sine:
            sign = -1 if sine and multiple < 0 else 1
            result[2 * abs(multiple) - (0 if sine or not multiple else 1)] += sign * part

    total, difference = (n + k) // 2, (n - k) // 2
    if first_sine and second_sine:
        add(difference, False, half)
        add(total, False, -half)
    elif not first_sine and not second_sine:
        add(difference, False, half)
        add(total, False, half)
    else:
        # sin a·cos b = (sin (a + b) + sin (a − b))/2
        add(total, True, half)
        add(difference if first_sine else -difference, True, half)


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
    """Check a certificate anew: the identity at enough rational points of the circle, G ≻ 0 and H ≻ 0.

    Two trigonometric polynomials of order n that agree at 2n + 1 points are equal. At the points with
    (cos φ/2, sin φ/2) = ((1 − t²)/(1 + t²), 2t/(1 + t²)), t rational, all harmonics are rational, those of half
    the odd orders too.
    """
    for number in range(2 * len(certificate.target) + 1):
        t = Fraction(2 * number + 1, 7)
        half = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
        waves = [(Fraction(1), Fraction(0))]
        while len(waves) <= len(certificate.target):
            c, s = waves[-1]
            waves.append((c * half[0] - s * half[1], s * half[0] + c * half[1]))
        whole = [Fraction(1), *(value for wave in waves[2::2] for value in wave)]
        odd = [value for wave in waves[1::2] for value in wave]
        left = certificate.rate - _dot(certificate.target, whole)
        right = certificate.slack + _quadratic(certificate.gram, whole)
        if certificate.side:
            right += _dot(certificate.side, whole) * _quadratic(certificate.side_gram, odd)
        if left != right:
            return False
    positive = is_positive_definite(certificate.gram) and is_positive_definite(certificate.side_gram)
    return certificate.slack >= 0 and positive


def _dot(first: list[Fraction], second: list[Fraction]) -> Fraction:
    return sum((value * other for value, other in zip(first, second, strict=False)), Fraction(0))


def _quadratic(matrix: list[list[Fraction]], vector: list[Fraction]) -> Fraction:
    return _dot([_dot(row, vector) for row in matrix], vector)
