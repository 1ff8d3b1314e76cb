"""Interval arithmetic and the proof between knots: true enclosures, and a proof that is able to fail."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from lifting_cases import WEIGHTS, minimum_jerk, pendulums_of

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import funnel_variants
from lumbar.lifting.stability.funnel.interval import Interval
from lumbar.lifting.stability.funnel.interval_proof import (
    _coefficient_rates,
    _coefficients,
    _derivatives,
    _g,
    _g_arc,
    _g_time,
    interpolants,
    proved_share,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import regulate


@pytest.fixture(scope="module", params=["hanging", "inverted"])
def case(request):
    items = [minimum_jerk(), minimum_jerk(start=0.1, end=-0.1, mass=18.0, length=0.95)]
    loops = regulate(pendulums_of(items, request.param), WEIGHTS)
    found = funnel_variants(loops, 1.0, margin=0.02, negative_control=0.3)
    return loops, found.exact, found.with_margin, found.negative_control


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
    found, expected = {
        "add": lambda: (first + second, x + y),
        "sub": lambda: (first - second, x - y),
        "mul": lambda: (first * second, x * y),
        "truediv": lambda: (first / second, x / y),
        "square": lambda: (first.square(), x**2),
        "sin": lambda: (first.sin(), np.sin(x)),
        "cos": lambda: (first.cos(), np.cos(x)),
    }[name]()
    assert ((found.low <= expected) & (expected <= found.high)).all()
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


def test_division_by_zero_is_refused():
    with pytest.raises(ZeroDivisionError, match="contains zero"):
        Interval(np.array([1.0])) / Interval(np.array([-1.0]), np.array([1.0]))


def pieces_at(curves, interval, offset):
    """Coefficients of g at one moment of every pendulum, as thin intervals, with their rates."""
    local = {name: values[:, interval] for name, values in curves.pieces.items()}
    gravity = Interval(curves.gravity)
    zero = Interval(np.zeros_like(curves.step))
    derivatives = _derivatives(local, Interval(offset * curves.step), zero)
    found = _coefficients(derivatives, gravity)
    return found, _coefficient_rates(derivatives, found, gravity)


def value_of(coefficients, angle):
    thin = Interval(np.full(2, angle))
    return _g(coefficients, thin.cos(), thin.sin()).low


def test_derivatives_of_g_against_differences(case):
    loops, exact, *_ = case
    curves = interpolants(loops, exact)
    width = 1e-4
    for angle in (0.3, 2.0, 4.4):
        thin = Interval(np.full(2, angle))
        over, rates = pieces_at(curves, 150, 0.5)
        arc = (value_of(over, angle + width) - value_of(over, angle - width)) / (2 * width)
        assert _g_arc(over, thin.cos(), thin.sin()).low == pytest.approx(arc, abs=1e-5)
        later, _ = pieces_at(curves, 150, 0.5 + width)
        earlier, _ = pieces_at(curves, 150, 0.5 - width)
        slope = (value_of(later, angle) - value_of(earlier, angle)) / (2 * width * curves.step)
        assert _g_time(over, rates, thin.cos(), thin.sin()).low == pytest.approx(slope, abs=1e-4)


def test_a_margin_is_proved_at_all_times_and_too_large_funnels_are_not(case):
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
    with pytest.raises(NumericalError, match="7 knots do not lie evenly among 401"):
        interpolants(loops, replace(exact, level=exact.level[:7], cost=exact.cost[:7]))
