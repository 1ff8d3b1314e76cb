"""The sum-of-squares method against the exact method, cvxpy and closed forms."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from lifting_cases import WEIGHTS, minimum_jerk, pendulums_of

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.model.eq_4_2_regulator import regulate
from lumbar.lifting.stability.programme.certified_funnel import certified_funnels
from lumbar.lifting.stability.programme.eqs_4_5_to_4_7_in_cvxpy import (
    AGREEMENT,
    RateProgramme,
    rate_differences,
)
from lumbar.lifting.stability.programme.polynomials import (
    circle_maximum,
    monomials,
)
from lumbar.lifting.stability.programme.sum_of_squares import CircleProgramme

OPTIONS = {"margin": 2e-5}


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
        assert programme.rate(row, "test") == pytest.approx(values.max(), abs=2e-7)
        assert circle_maximum(row, degree + 1) == pytest.approx(values.max(), abs=1e-7)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_rates_are_those_of_eq_4_6_from_the_equation_of_motion_in_cvxpy(loops, degree):
    level = np.linspace(2.0, 0.5, loops.knots)[:, None] * np.ones(2)
    knots = [0, loops.knots // 3, loops.knots - 1]
    assert rate_differences(loops, level, degree, knots).max() < AGREEMENT
    # It is able to fail: the feedback of another control weight is another loop.
    other = replace(loops, weights=replace(loops.weights, control=2 * loops.weights.control))
    assert rate_differences(other, level, degree, knots).min() > 10 * AGREEMENT


def test_a_solver_that_gives_up_is_told_with_the_basin(loops, monkeypatch):
    def give_up(problem, **options):
        raise cp.SolverError("Solver 'CLARABEL' failed")

    monkeypatch.setattr(cp.Problem, "solve", give_up)
    said = r"expert 23 kg, abdomen, .*: Eq. 4.6 in cvxpy: Solver 'CLARABEL' failed"
    with pytest.raises(NumericalError, match=said):
        RateProgramme(3).solve(loops, 0, 0, level=1.0)


def test_areas_and_margins(loops):
    """Certified area at least 0.9999 of the exact one; rates agree with exact maxima to 1e-6."""
    exact = exact_funnels(loops)
    certified, agreement = certified_funnels(loops, 1.0, degree=5, knots=201, **OPTIONS)
    ratio = certified.mean_area / exact.mean_area
    assert (ratio > 0.9999).all() and (ratio < 1.001).all()
    assert agreement.margin_difference.max() < 1e-6
    assert monte_carlo_check(loops, certified, 500, [3]).exits.sum() == 0


def test_taylor_degree_decides_what_the_certificate_covers():
    """A large basin: degree 3 misjudges the sine, degree 7 hardly, and the method says by how much."""
    wide = regulate(pendulums_of([minimum_jerk(start=0.9)], "hanging", knots=101), WEIGHTS)
    differences = [certified_funnels(wide, 8.0, degree, 11, margin=1e-4)[1] for degree in (3, 5, 7)]
    values = [float(item.taylor_difference[0]) for item in differences]
    assert values[0] > 5 * values[1] > 25 * values[2]


def test_funnels_beyond_the_taylor_range_are_no_result():
    """A range of 5 %: (0.05·24)^(1/4) = 1.05 rad at degree 3; what is refused there passes at degree 7."""
    wide = regulate(pendulums_of([minimum_jerk(start=0.9)], "hanging", knots=101), WEIGHTS)
    options = {"knots": 11, "margin": 1e-4}
    message = (
        r"expert 23 kg, abdomen, .*beyond the range of the sine's Taylor polynomial of degree 3 \(1\.05 rad\)"
    )
    with pytest.raises(NumericalError, match=message):
        certified_funnels(wide, 150.0, 3, **options)
    certified_funnels(wide, 150.0, 7, **options)
