"""Sum-of-squares certificates against exact maxima, cvxpy and known polynomials; interval arithmetic, the proof between knots."""

from dataclasses import replace
from fractions import Fraction

import cvxpy as cp
import numpy as np
import pytest
from lifting_cases import WEIGHTS, minimum_jerk, pendulums_of

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_alternation import RESOLUTION, alternate, level_factors
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_in_cvxpy import (
    AGREEMENT,
    RateProgramme,
    rate_differences,
)
from lumbar.lifting.stability.funnel.exact_funnel import funnel_variants
from lumbar.lifting.stability.funnel.interval_proof import (
    Interval,
    _coefficient_rates,
    _coefficients,
    _derivatives,
    _slopes_of_g,
    interpolants,
    proved_share,
)
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.funnel.sum_of_squares import (
    Certificate,
    SumOfSquares,
    circle_map,
    circle_maximum,
    gram_map,
    growth_polynomial,
    monomials,
)
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import regulate


@pytest.fixture(scope="module", params=["hanging", "inverted"])
def loops(request):
    items = [minimum_jerk(), minimum_jerk(start=0.1, end=-0.1, mass=45.0, length=1.2)]
    return regulate(pendulums_of(items, request.param), WEIGHTS)


def random_polynomials(degree, count, seed):
    return np.random.default_rng(seed).normal(size=(count, len(monomials(degree + 1))))


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_rate_is_the_maximum_on_a_dense_grid(degree):
    programme = Certificate(degree)
    angle = np.linspace(0, 2 * np.pi, 40_001)
    for row in random_polynomials(degree, 4, 11):
        values = sum(
            c * np.cos(angle) ** i * np.sin(angle) ** j
            for c, (i, j) in zip(row, monomials(degree + 1), strict=True)
        )
        assert programme.solve(row, "test")[0] == pytest.approx(values.max(), abs=1e-6)
        assert circle_maximum(row, degree + 1) == pytest.approx(values.max(), abs=1e-7)


def test_rates_agree_with_eq_4_6_in_cvxpy(loops):
    level = np.linspace(2.0, 0.5, loops.knots)[:, None] * np.ones(2)
    knots = [0, loops.knots // 3, loops.knots - 1]
    assert rate_differences(loops, level, knots).max() < AGREEMENT
    # It is able to fail: the feedback of another control weight is another loop.
    other = replace(loops, weights=replace(loops.weights, control=2 * loops.weights.control))
    assert rate_differences(other, level, knots).min() > 10 * AGREEMENT


def test_solver_failure_names_the_basin(loops, monkeypatch):
    def give_up(problem, **options):
        raise cp.SolverError("Solver 'CLARABEL' failed")

    monkeypatch.setattr(cp.Problem, "solve", give_up)
    message = r"expert 23 kg, abdomen, .*: Eq\. 4\.6 .*'CLARABEL'"
    with pytest.raises(NumericalError, match=message):
        RateProgramme(3).solve(loops, 0, 0, level=1.0)


def test_status_other_than_solved_is_an_error():
    with pytest.raises(NumericalError, match=r"a pendulum: .*\bNumericalError\b"):
        Certificate(3).solve(np.full(len(monomials(4)), np.nan), "a pendulum")


SETTINGS = {"knots": 9, "initial_level": 1.0, "ratio": 0.8, "alternations": 2}


def test_alternation_is_no_certificate(loops):
    """The thesis's method overstates the basin: its condition is violated and simulated starts leave."""
    result = alternate(loops, **SETTINGS)
    assert (result.violation_share > 0).any()
    assert monte_carlo_check(loops, result.funnels, 500, [4]).exits.sum() > 0
    assert (result.euler_error > 0).all() and (result.euler_error < 0.05).all()
    # And it depends on its guess.
    other = alternate(loops, **{**SETTINGS, "initial_level": 5.0})
    assert np.abs(other.funnels.mean_area / result.funnels.mean_area - 1).max() > 0.05


def largest_level(coefficients, rate, multiplier):
    """Step 2 as a semidefinite programme: the largest s with −v + rate + L·(|z|² − s) a sum of squares."""
    padded = np.zeros(len(coefficients))
    padded[: len(multiplier)] = multiplier
    constant = padded - circle_map(3) @ multiplier - coefficients
    constant[0] += rate
    programme = SumOfSquares(np.array([-1.0]), padded[:, None], [gram_map(3)])
    actual = programme.solve(constant)
    return np.nan if actual is None else actual[0]


@pytest.mark.parametrize("slack", [0.0003, 0.03, 3.0])
def test_level_step_is_its_semidefinite_programme(loops, slack):
    level = np.geomspace(0.3, 3.0, 7)[:, None] * np.ones(2)
    growth = growth_polynomial(loops.form(slice(0, 14, 2)), level, 3).reshape(14, -1)
    rates, multipliers = zip(*(Certificate(3, 1e-6).solve(row, "test") for row in growth), strict=True)
    rate = np.array(rates) + slack
    actual = level_factors(growth, rate, np.stack(multipliers))
    expected = [largest_level(*row) for row in zip(growth, rate, multipliers, strict=True)]
    assert actual == pytest.approx(np.array(expected), rel=1e-5)


def test_level_step_by_hand():
    """L = −1 + |z|², no growth: ρ̇ + L·(|z|² − s) is nowhere negative as long as (s − 1)² ≤ 4·ρ̇; with L = −1 no s is too large."""
    ring = np.array([[-1.0, 0, 0, 1, 0, 1]])
    assert level_factors(np.zeros((1, 15)), np.array([0.25]), ring) == pytest.approx([2.0])
    downward = np.array([[-1.0, 0, 0, 0, 0, 0]])
    assert np.isnan(level_factors(np.zeros((1, 15)), np.array([0.25]), downward)).all()
    # ρ̇ so small that nothing is left: none, and not a number near zero.
    assert np.isnan(level_factors(np.zeros((1, 15)), np.array([-0.25]), ring)).all()


def test_areas_of_one_alternation_have_their_published_digits(loops):
    """Rounding moves nothing that is printed; a solver that stops elsewhere moves no more than `RESOLUTION` says."""

    def areas(loops, **options):
        funnels = alternate(loops, **SETTINGS, **options).after[0]
        parts = funnels.mean_area, funnels.area[0], funnels.area.min(axis=0)
        return dict(zip(("mean_area", "initial_area", "minimum_area"), parts, strict=True))

    actual = areas(loops)
    moved = replace(loops.pendulums, angle=loops.pendulums.angle * (1 + 1e-13))
    others = [(areas(regulate(moved, WEIGHTS)), dict.fromkeys(actual, 1e-5))]
    others += [(areas(loops, certificate=Certificate(3, size)), RESOLUTION) for size in (1e-4, 1e-5, 1e-7)]
    for other, tolerance in others:
        for name, values in actual.items():
            np.testing.assert_allclose(other[name], values, rtol=tolerance[name])


def test_half_a_milliradian_decides_where_the_level_jumps():
    """Six times the same pendulum, wiggles of other phases on its path: at one knot of two of them ρ grows 2.5-fold and more."""
    pendulums = pendulums_of(6 * [minimum_jerk(duration=1.0, mass=8.6, length=1.0)], "hanging", knots=101)
    phase = np.linspace(0.0, 1.0, len(pendulums.angle))[:, None]
    path = 0.014 * phase + 0.0005 * np.sin(5 * phase + np.arange(6))
    loops = regulate(replace(pendulums, angle=path), replace(WEIGHTS, control=np.array(3e-3)))
    actual = alternate(loops, **{**SETTINGS, "knots": 101})
    assert (actual.jumps != 1).sum(axis=0).tolist() == [0, 0, 0, 0, 1, 1]
    assert (actual.jumps.max(axis=0)[4:] > 2.5).all()
    assert np.isnan(actual.jump_range[:, :4]).all() and (actual.jump_range[:, 4:] < 0.2).all()
    first, second = (item.mean_area for item in (actual.after[0], actual.funnels))
    assert np.ptp(first) < 0.002 * first.min()
    assert (second[4:] > 1.01 * first[4:]).all()
    np.testing.assert_array_equal(second[:4], first[:4])


@pytest.fixture(scope="module", params=["hanging", "inverted"])
def case(request):
    items = [minimum_jerk(), minimum_jerk(start=0.1, end=-0.1, mass=18.0, length=0.95)]
    loops = regulate(pendulums_of(items, request.param), WEIGHTS)
    actual = funnel_variants(loops, 1.0, margin=0.02, negative_control=0.3)
    return loops, actual.exact, actual.with_margin, actual.negative_control


def random_intervals(count, seed):
    generator = np.random.default_rng(seed)
    low = generator.uniform(-4, 4, count)
    return Interval(low, low + generator.exponential(0.7, count)), generator


@pytest.mark.parametrize("name", ["add", "sub", "mul", "square", "sin", "cos", "truediv"])
def test_results_contain_every_point(name):
    first, generator = random_intervals(4000, 1)
    second, _ = random_intervals(4000, 2)
    if name == "truediv":
        second = Interval(np.abs(second.low) + 0.1, np.abs(second.low) + 0.1 + second.high - second.low)
    x = first.low + generator.uniform(size=4000) * (first.high - first.low)
    y = second.low + generator.uniform(size=4000) * (second.high - second.low)
    actual, expected = {
        "add": lambda: (first + second, x + y),
        "sub": lambda: (first - second, x - y),
        "mul": lambda: (first * second, x * y),
        "truediv": lambda: (first / second, x / y),
        "square": lambda: (first.square(), x**2),
        "sin": lambda: (first.sin(), np.sin(x)),
        "cos": lambda: (first.cos(), np.cos(x)),
    }[name]()
    assert ((actual.low <= expected) & (expected <= actual.high)).all()
    # And they are tight: single numbers stay nearly single.
    point = Interval(x)
    tight = {"square": point.square, "sin": point.sin, "cos": point.cos}.get(name)
    if tight:
        assert (tight().high - tight().low).max() < 1e-13


def test_rounding_is_outward():
    third = Interval(np.array([1.0])) / Interval(np.array([3.0]))
    assert Fraction(third.low[0]) < Fraction(1, 3) < Fraction(third.high[0])
    total = Interval(np.array([0.1])) + Interval(np.array([0.2]))
    assert Fraction(total.low[0]) <= Fraction(0.1) + Fraction(0.2) <= Fraction(total.high[0])


def test_division_by_zero_is_rejected():
    with pytest.raises(ZeroDivisionError, match="zero"):
        Interval(np.array([1.0])) / Interval(np.array([-1.0]), np.array([1.0]))


def pieces_at(curves, interval, offset):
    """Coefficients of g at one moment of every pendulum, as thin intervals, with their rates."""
    local = {name: values[:, interval] for name, values in curves.pieces.items()}
    gravity = Interval(curves.gravity)
    zero = Interval(np.zeros_like(curves.step))
    derivatives = _derivatives(local, Interval(offset * curves.step), zero)
    actual = _coefficients(derivatives, gravity)
    return actual, _coefficient_rates(derivatives, actual, gravity)


def value_of(coefficients, angle):
    at, c, s = {name: values.low for name, values in coefficients.items()}, np.cos(angle), np.sin(angle)
    gravity = np.sin(at["angle"] + at["A"] * c) - np.sin(at["angle"])
    return at["q11"] * c**2 + at["q12"] * c * s + at["q22"] * s**2 - at["weight"] * s * gravity


def test_derivatives_of_g_against_differences(case):
    loops, exact, *_ = case
    curves = interpolants(loops, exact)
    width = 1e-4
    for angle in (0.3, 2.0, 4.4):
        thin = Interval(np.full(2, angle))
        over, rates = pieces_at(curves, 150, 0.5)
        arc = (value_of(over, angle + width) - value_of(over, angle - width)) / (2 * width)
        by_time, by_arc = _slopes_of_g(over, rates, *[(thin.cos(), thin.sin())] * 2)
        assert by_arc.low == pytest.approx(arc, abs=1e-5)
        later, _ = pieces_at(curves, 150, 0.5 + width)
        earlier, _ = pieces_at(curves, 150, 0.5 - width)
        slope = (value_of(later, angle) - value_of(earlier, angle)) / (2 * width * curves.step)
        assert by_time.low == pytest.approx(slope, abs=1e-4)


def test_proof_succeeds_with_a_margin_and_fails_for_large_funnels(case):
    loops, exact, smaller, negative_control = case
    assert (proved_share(loops, smaller) == 1).all()
    assert (smaller.mean_area / exact.mean_area > 0.97).all()
    assert (proved_share(loops, negative_control) < 0.05).all()
    swollen = replace(exact, level=exact.level * np.linspace(1.3, 1.0, len(exact.level))[:, None])
    assert (proved_share(loops, swollen) < 1).all()


def test_one_bad_second_is_found(case):
    """A bump of ρ at one knot is invisible to areas but not to the proof."""
    loops, _, smaller, _ = case
    level = smaller.level.copy()
    level[200] *= 1.001
    share = proved_share(loops, replace(smaller, level=level))
    assert (share < 1).all() and (share > 0.9).all()


def test_knots_that_do_not_fit_are_named(case):
    loops, exact, *_ = case
    with pytest.raises(NumericalError, match=r"\b7 knots .*\b401\b"):
        interpolants(loops, replace(exact, level=exact.level[:7], cost=exact.cost[:7]))
