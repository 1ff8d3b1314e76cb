"""The sum-of-squares engine and its rational certificates: against the exact engine, cvxpy and closed forms."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from stability_cases import WEIGHTS, minimum_jerk, pendulums_of

from lumbar.errors import NumericalError
from lumbar.stability.funnel.funnel import exact_funnels, regulate
from lumbar.stability.funnel.monte_carlo_check import attack
from lumbar.stability.funnel.polynomials import (
    circle_map,
    circle_maximum,
    growth_polynomial,
    harmonics,
    harmonics_of_monomials,
    monomials,
)
from lumbar.stability.programme.certified_funnel import certified_funnels
from lumbar.stability.programme.circle_certificate import CircleProgramme, multiplier
from lumbar.stability.programme.cvxpy_reference import certified_rate
from lumbar.stability.programme.rational_certificate import (
    gram_harmonics,
    holds,
    is_positive_definite,
    rational_certificate,
)

OPTIONS = {"alternations": 2, "margin": 2e-5, "rational": True}


@pytest.fixture(scope="module", params=["hanging", "inverted"])
def loops(request):
    items = [minimum_jerk(), minimum_jerk(start=0.1, end=-0.1, mass=45.0, length=1.2)]
    return regulate(pendulums_of(items, request.param), WEIGHTS)


def random_polynomials(degree, count, seed):
    return np.random.default_rng(seed).normal(size=(count, len(monomials(degree + 1))))


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_rate_is_the_maximum_on_a_dense_grid(degree):
    programme = CircleProgramme(degree)
    angle = np.linspace(0, 2 * np.pi, 40_001)
    for row in random_polynomials(degree, 4, 11):
        values = sum(
            c * np.cos(angle) ** i * np.sin(angle) ** j
            for c, (i, j) in zip(row, monomials(degree + 1), strict=True)
        )
        found = programme.solve(row, "test")
        assert found.rate == pytest.approx(values.max(), abs=2e-7)
        assert circle_maximum(row, degree + 1) == pytest.approx(values.max(), abs=1e-7)
        assert np.linalg.eigvalsh(found.gram)[0] > -1e-6


@pytest.mark.parametrize("degree", [3, 5])
def test_same_programme_with_its_multiplier_in_cvxpy(degree):
    for row in random_polynomials(degree, 3, 12):
        assert CircleProgramme(degree).solve(row, "test").rate == pytest.approx(
            certified_rate(row, degree), abs=1e-6
        )


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_multiplier_makes_the_identity_hold_off_the_circle(degree):
    row = random_polynomials(degree, 1, 13)[0]
    certificate = CircleProgramme(degree).solve(row, "test")
    found = multiplier(certificate, row, degree)
    assert len(found) == len(monomials(degree - 1))
    left = -row - circle_map(degree) @ found
    left[0] += certificate.rate
    for z1, z2 in np.random.default_rng(2).normal(size=(5, 2)):
        basis = [1.0]
        for k in range(1, (degree + 1) // 2 + 1):
            basis += [((z1 + 1j * z2) ** k).real, ((z1 + 1j * z2) ** k).imag]
        value = sum(c * z1**i * z2**j for c, (i, j) in zip(left, monomials(degree + 1), strict=True))
        assert value == pytest.approx(np.array(basis) @ certificate.gram @ np.array(basis), abs=1e-5)


def test_multiplier_of_another_polynomial_is_refused():
    row = random_polynomials(3, 1, 14)[0]
    certificate = CircleProgramme(3).solve(row, "test")
    with pytest.raises(NumericalError, match="no multiplier: remainder"):
        multiplier(certificate, row + np.eye(len(row))[1], 3)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_harmonics_of_monomials(degree):
    angle = np.linspace(0, 6, 9)
    values = harmonics_of_monomials(degree).T @ harmonics(degree, angle)
    expected = [np.cos(angle) ** i * np.sin(angle) ** j for i, j in monomials(degree)]
    assert values == pytest.approx(np.array(expected), abs=1e-14)


def test_areas_margins_and_rational_share(loops):
    """Certified area at least 0.9999 of the exact one; rates agree with exact maxima to 1e-6; all rational."""
    exact = exact_funnels(loops)
    certified, agreement = certified_funnels(loops, 1.0, degree=5, knots=201, **OPTIONS)
    ratio = certified.mean_area / exact.mean_area
    assert (ratio > 0.9999).all() and (ratio < 1.001).all()
    assert agreement.margin_difference.max() < 1e-6
    assert (agreement.rational_share == 1).all()
    assert agreement.alternations == 2
    assert attack(loops, certified, 500, [3]).exits.sum() == 0


def test_taylor_degree_decides_what_the_certificate_covers():
    """A large basin: degree 3 misjudges the sine, degree 7 hardly, and the engine says by how much."""
    wide = regulate(pendulums_of([minimum_jerk(start=0.9)], "hanging", knots=101), WEIGHTS)
    differences = [
        certified_funnels(wide, 8.0, degree, 11, alternations=2, margin=1e-4, rational=False)[1]
        for degree in (3, 5, 7)
    ]
    values = [float(item.taylor_difference[0]) for item in differences]
    assert values[0] > 5 * values[1] > 25 * values[2]
    assert all(item.rational_share is None for item in differences)


def test_funnels_beyond_the_taylor_range_are_no_result():
    """A range of 5 %: (0.05·24)^(1/4) = 1.05 rad at degree 3; what is refused there passes at degree 7."""
    wide = regulate(pendulums_of([minimum_jerk(start=0.9)], "hanging", knots=101), WEIGHTS)
    options = {"knots": 11, "alternations": 2, "margin": 1e-4, "rational": False}
    message = (
        r"expert 23 kg, abdomen, .*beyond the range of the sine's Taylor polynomial of degree 3 \(1\.05 rad\)"
    )
    with pytest.raises(NumericalError, match=message):
        certified_funnels(wide, 150.0, 3, **options)
    certified_funnels(wide, 150.0, 7, **options)


def test_linear_loop_has_the_eigenvalue_as_its_certified_rate():
    from scipy.linalg import eigvalsh, solve_continuous_are

    item = minimum_jerk(duration=2.0)
    pendulums = pendulums_of([item], "hanging", gravity=0.0)
    a, b = np.array([[0, 1], [0, -1 / pendulums.inertia[0]]]), np.array([[0], [1 / pendulums.inertia[0]]])
    state = np.diag([1.0, 0.1])
    cost = solve_continuous_are(a, b, state, [[float(WEIGHTS.control)]])
    steady = replace(WEIGHTS, terminal=np.array([cost[0, 0], cost[0, 1], cost[1, 1]]))
    found, _ = certified_funnels(regulate(pendulums, steady), 1.0, degree=3, knots=11, **OPTIONS)
    decay = eigvalsh(state + cost @ b @ b.T @ cost / float(WEIGHTS.control), cost)[0]
    expected = 2.0 * decay
    assert np.log(found.level[0, 0]) == pytest.approx(expected - 2.0 * OPTIONS["margin"], abs=1e-5)


def certificate_of(loops, degree=3):
    point = loops.knots - 41
    level = np.full(2, 1.2)
    row = growth_polynomial(loops.form(point), level, degree)[0]
    return CircleProgramme(degree).solve(row, "test"), row


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_rational_certificate_is_an_identity_checked_by_other_formulas(loops, degree):
    certificate, row = certificate_of(loops, degree)
    found = rational_certificate(certificate, row, certificate.rate + 1e-4, degree)
    assert holds(found)
    assert float(found.rate) == certificate.rate + 1e-4
    # It is able to fail: a changed entry breaks the identity, a lower rate leaves no certificate.
    broken = replace(found, target=[found.target[0] + Fraction(1, 10**12), *found.target[1:]])
    assert not holds(broken)
    assert rational_certificate(certificate, row, certificate.rate - 1e-4, degree) is None


def test_gram_harmonics_against_numbers():
    gram = np.random.default_rng(4).integers(-5, 6, size=(7, 7))
    gram = gram + gram.T
    exact = gram_harmonics([[Fraction(int(entry)) for entry in row] for row in gram])
    angle = np.linspace(0, 6, 20)
    basis = harmonics(3, angle)
    expected = np.einsum("ia,ij,ja->a", basis, gram, basis)
    assert np.array([float(value) for value in exact]) @ harmonics(6, angle) == pytest.approx(expected)


def test_exact_ldl_sees_what_floating_point_does_not():
    """[[1, 1], [1, 1 + 2⁻⁶⁰]] is positive definite, [[1, 1], [1, 1]] is not: to floats they are the same."""
    one = Fraction(1)
    assert is_positive_definite([[one, one], [one, one + Fraction(1, 2**60)]])
    assert not is_positive_definite([[one, one], [one, one]])
    for seed in range(6):
        matrix = np.random.default_rng(seed).integers(-8, 9, size=(5, 5))
        matrix = matrix @ matrix.T - 9 * np.eye(5, dtype=int)
        exact = is_positive_definite([[Fraction(int(entry)) for entry in row] for row in matrix])
        assert exact == (np.linalg.eigvalsh(matrix)[0] > 0)


def test_solver_without_an_optimum_is_no_result():
    with pytest.raises(NumericalError, match="somebody: the sum-of-squares programme ended as"):
        CircleProgramme(3).solve(np.full(len(monomials(4)), np.nan), "somebody")
