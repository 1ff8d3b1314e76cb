"""Torque limits and uncertain masses in every method, against each other and simulation."""

import numpy as np
import pytest
from lifting_cases import WEIGHTS, minimum_jerk, pendulums_of

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.funnel.saturation import (
    Saturation,
    disturbance_of,
    reference_of,
    saturated_funnels,
    saturated_growth,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import regulate
from lumbar.lifting.stability.programme.certified_funnel import certified_funnels
from lumbar.lifting.stability.programme.polynomials import Case, case_maximum, monomials, saturation_cases
from lumbar.lifting.stability.programme.sum_of_squares import CircleProgramme

SIGNS = ("hanging", "inverted")
KINDS = ("torque", "mass", "both")
GOAL = 3.0


def limited(sign, kind, box=True, knots=161):
    """Loops of one movement, carried with or without a box, and limits that bind."""
    mass = 33.0 if box else 18.0
    loops = regulate(pendulums_of([minimum_jerk(start=0.2, end=0.0, mass=mass)], sign, knots=knots), WEIGHTS)
    peak = float(np.abs(reference_of(loops.pendulums).torque).max())
    torque = {"torque": 1.05 * peak, "mass": np.inf, "both": 1.1 * peak}[kind]
    return loops, Saturation(torque, 0.0 if kind == "torque" else 0.05)


def certify(loops, saturation, degree=5, knots=37):
    return certified_funnels(loops, GOAL, degree, knots, 2e-5, saturation)


def cases_at(loops, point, level, saturation, degree):
    return saturation_cases(loops, point, level, saturation, reference_of(loops.pendulums), degree)[0]


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("kind", KINDS)
def test_largest_case_is_the_growth_with_the_true_sine(sign, kind):
    """The methods' polynomials (degree 7) against the clipped torque and the sine, which know nothing of cases."""
    loops, saturation = limited(sign, kind)
    reference = reference_of(loops.pendulums)
    funnel = saturated_funnels(loops, GOAL, saturation).exact
    for point in (0, 100, 320):
        level = funnel.level[point // 2]
        cases = cases_at(loops, point, level, saturation, 7)
        expected = saturated_growth(loops, point, level, saturation, reference)[0]
        assert max(case_maximum(case, 7) for case in cases) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_arc_certificates_lose_nothing(degree):
    """Random polynomials on random arcs: the programme's bound is the maximum, by roots of the derivative."""
    generator, programme = np.random.default_rng(degree), CircleProgramme(degree)
    for _ in range(40):
        coefficients = generator.normal(size=len(monomials(degree + 1)))
        half, middle = generator.uniform(0.02, 3.1), generator.uniform(0, 7)
        side = np.array([-np.cos(half), np.cos(middle), np.sin(middle)])
        found = programme.rate(coefficients, "random", side)
        assert found == pytest.approx(case_maximum(Case(coefficients, side), degree), abs=1e-6)
        assert found <= programme.rate(coefficients, "random") + 1e-6


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize(("kind", "box"), [("torque", True), ("mass", False), ("both", True)])
def test_certified_area_is_the_exact_one(kind, sign, box):
    """Two methods that share only the equation of motion: areas at 37 knots, and limits that cost area."""
    loops, saturation = limited(sign, kind, box, knots=331)
    exact = saturated_funnels(loops, GOAL, saturation, negative_control=5.0)
    funnels, agreement = certify(loops, saturation)
    assert funnels.mean_area == pytest.approx(exact.exact.mean_area, rel=1e-2)
    assert agreement.margin_difference.max() < 1e-6
    assert funnels.mean_area[0] < 0.9999 * exact_funnels(loops, GOAL).mean_area[0]
    disturbance = disturbance_of(loops, saturation, 500, [2])
    assert monte_carlo_check(loops, exact.exact, 500, [1], disturbance).exits[0] == 0
    assert monte_carlo_check(loops, exact.negative_control, 500, [1], disturbance).exits[0] > 0


def test_limits_of_their_own_in_one_batch_are_those_of_each_by_itself():
    """Areas and certificates of three pendulums at once, and of each alone; the last one's limit never binds."""
    items = [minimum_jerk(start=start, end=0.0, mass=33.0) for start in (0.2, 0.25, 0.1)]
    loops = regulate(pendulums_of(items, "inverted", knots=161), WEIGHTS)
    peak = np.abs(reference_of(loops.pendulums).torque).max(axis=0)
    saturation = Saturation(peak * [1.3, 1.5, 50.0], bias=np.array([2.0, -3.0, 0.0]))
    assert str(saturation.of(1)) == str(Saturation(1.5 * peak[1], bias=-3.0))
    found = saturated_funnels(loops, GOAL, saturation)
    certified = certify(loops, saturation)[0]
    for index in range(3):
        own, limit = loops.select(np.array([index])), saturation.of(index)
        alone = saturated_funnels(own, GOAL, limit)
        assert found.exact.mean_area[index] == pytest.approx(alone.exact.mean_area[0], rel=1e-9)
        assert certified.mean_area[index] == pytest.approx(certify(own, limit)[0].mean_area[0], rel=1e-3)
    with pytest.raises(NumericalError, match=f"limit is {0.9 * peak[1]:g}"):
        saturated_funnels(loops, GOAL, Saturation(peak * [1.3, 0.9, 50.0]))


def test_limits_that_differ_between_the_sides_hold_in_every_engine():
    """More torque backward than forward: exact, certified and simulated agree; the nominal funnel is too large."""
    loops, _ = limited("inverted", "torque")
    wanted = reference_of(loops.pendulums).torque
    low, high = 1.05 * float(wanted.min()), max(1.05 * float(wanted.max()), 20.0)
    assert low < -1.2 * high
    saturation = Saturation(torque=(high - low) / 2, bias=(high + low) / 2)
    found = saturated_funnels(loops, GOAL, saturation)
    nominal = exact_funnels(loops, GOAL)
    assert found.exact.mean_area[0] < 0.999 * nominal.mean_area[0]
    disturbance = disturbance_of(loops, saturation, 2000, [5])
    assert monte_carlo_check(loops, found.exact, 2000, [4], disturbance).exits[0] == 0
    assert monte_carlo_check(loops, nominal, 2000, [4], disturbance).exits[0] > 0
    error, velocity = np.full((1, 1), 0.05), np.zeros((1, 1))
    wanted = reference_of(loops.pendulums).torque[40] - loops.gains[40][:, 0] * 0.05
    added = np.clip(wanted, low, high) - wanted
    assert disturbance(40, np.stack([error, velocity]))[0, 0] == pytest.approx(
        (added / loops.pendulums.inertia)[0]
    )
    assert certify(loops, saturation)[0].mean_area[0] == pytest.approx(found.exact.mean_area[0], rel=0.02)
    with pytest.raises(InputError, match="one at a time"):
        Saturation(10.0, 0.05, 1.0)
