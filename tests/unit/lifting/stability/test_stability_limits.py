"""Torque limits, uncertain masses, better V: closed forms, brute force, simulation, methods against one another."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, minimum_jerk, pendulums_of
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.population.contrast import Interval
from lumbar.lifting.stability.comparison.table_4_1_controls import verdict
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels, reachable_area
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.funnel.saturation import (
    Saturation,
    disturbance_of,
    reference_of,
    saturated_funnels,
    saturated_growth,
)
from lumbar.lifting.stability.model.eq_4_1_pendulum import feedforward_torque
from lumbar.lifting.stability.model.eq_4_2_regulator import check_weights, regulate
from lumbar.lifting.stability.programme.certified_funnel import certified_funnels
from lumbar.lifting.stability.programme.polynomials import Case, case_maximum, monomials, saturation_cases
from lumbar.lifting.stability.programme.sum_of_squares import CircleProgramme

SIGNS = ("hanging", "inverted")


def loops_of(items, sign, **keywords):
    return regulate(pendulums_of(items, sign, **{"knots": 201, **keywords}), WEIGHTS)


def test_reference_torque_is_inverse_dynamics():
    item = minimum_jerk()
    found = reference_of(pendulums_of([item], "inverted", knots=401)).torque[:, 0]
    expected = np.interp(
        np.linspace(0, item.duration, 801), item.time, feedforward_torque(item, "inverted", 1.0, GRAVITY)
    )
    assert found[20:-20] == pytest.approx(expected[20:-20], abs=0.02)


def test_limits_that_are_none_are_refused():
    assert Saturation(mass_share=0.25).ratios == pytest.approx((0.8, 4 / 3))
    with pytest.raises(InputError, match="must be positive"):
        Saturation(torque=0.0)
    with pytest.raises(InputError, match=r"\[0, 1\)"):
        Saturation(mass_share=1.0)


def torque_limited_pendulum(limit):
    """Swing-up pendulum of the LQR-trees literature about the top: m 1 kg, ℓ 0.5 m, b 0.1, Q diag(10, 1), R 15.

    Tedrake, Manchester, Tobenkin & Roberts, International Journal of Robotics Research 29 (2010) 1038-1052.
    """
    inertia, weight, damping = 0.25, 9.8 * 0.5, 0.1
    a, b = np.array([[0, 1], [weight / inertia, -damping / inertia]]), np.array([[0], [1 / inertia]])
    cost = solve_continuous_are(a, b, np.diag([10.0, 1.0]), [[15.0]])
    weights = check_weights([[10, 0], [0, 1]], 15.0, [[1, 0], [0, 1]])
    weights = replace(weights, terminal=np.array([cost[0, 0], cost[0, 1], cost[1, 1]]))
    still = minimum_jerk(start=0.0, end=0.0, duration=6.0, mass=1.0, length=0.5)
    loops = regulate(pendulums_of([still], "inverted", damping=damping, gravity=9.8, knots=301), weights)
    gain = cost[1] / (inertia * 15.0)

    def growth(level):
        """V̇ on V = level, written down anew, with saturated torque."""
        circle = np.linspace(0, 2 * np.pi, 2001)
        x = np.linalg.inv(np.linalg.cholesky(cost)).T @ np.stack([np.cos(circle), np.sin(circle)])
        x = x * np.sqrt(level)
        torque = np.clip(-gain @ x, -limit, limit)
        acceleration = (torque - damping * x[1] + weight * np.sin(x[0])) / inertia
        return 2 * np.sum((cost @ x) * np.stack([x[1], acceleration]), axis=0).max()

    return loops, growth


@pytest.mark.parametrize("limit", [0.5, 1.0, np.inf])
def test_torque_limited_pendulum_of_the_literature(limit):
    """Backward in time the funnel grows to the region of attraction {V < ρ*}, ρ* the first zero of max V̇."""
    loops, growth = torque_limited_pendulum(limit)
    levels = np.geomspace(1e-2, 1e4, 120)
    first = int(np.argmax([growth(level) > 0 for level in levels]))
    expected = brentq(growth, levels[first - 1], levels[first])
    found = saturated_funnels(loops, 0.2 * expected, Saturation(torque=limit))
    assert found.exact.level[0, 0] == pytest.approx(expected, rel=2e-3)
    assert (found.exact.level[:, 0] < expected * (1 + 1e-6)).all()
    unlimited = saturated_funnels(loops, 0.2 * expected, Saturation()).exact.level[0, 0]
    assert np.isinf(limit) or found.exact.level[0, 0] < 0.7 * unlimited


def test_best_v_of_a_linear_loop_reaches_liouvilles_area():
    """Without gravity λ = 0 maps the goal set back exactly: no set can be larger."""
    loops = loops_of([minimum_jerk()], "hanging", gravity=0.0)
    best = best_of_family(loops, 1.0, [0.0, 0.5, 1.0])
    assert best.share[0] == 0
    assert best.exact.initial_area == pytest.approx(reachable_area(loops), rel=1e-5)


def test_verdicts():
    changed = {"Q divided": 9.0, "the other sign of gravity": 11.0}
    unknown = Interval(remark="no interval: 1 person (expert), at least 3 are needed")
    assert verdict(10.0, 0.9, changed, unknown).startswith("survives parts")
    assert verdict(10.0, 0.9, changed, unknown).endswith(
        "(no interval: 1 person (expert), at least 3 are needed)"
    )
    assert "90 % of it come from duration" in verdict(10.0, 0.1, changed, unknown)
    assert "sign turns with Q divided" in verdict(10.0, 0.9, {**changed, "Q divided": -1.0}, unknown)
    assert "contains 0" in verdict(10.0, 0.9, changed, Interval(-2.0, 20.0))
    assert "[+5.00, +20.00]" in verdict(10.0, 0.9, changed, Interval(5.0, 20.0))
    assert verdict(None, None, {}, unknown) == "not testable in this study"


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
