"""Torque limits, uncertain masses, better V, perturbed trials, exponents: closed forms, brute force, simulation."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, minimum_jerk, pendulums_of
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

from lumbar.base.errors import InputError
from lumbar.lifting.population.contrast import Interval
from lumbar.lifting.stability.comparison.lyapunov_exponent import maximum_exponent
from lumbar.lifting.stability.comparison.table_4_1_controls import verdict
from lumbar.lifting.stability.funnel.exact_funnel import reachable_area
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.saturation import (
    Saturation,
    reference_of,
    saturated_funnels,
)
from lumbar.lifting.stability.model.eq_4_1_pendulum import feedforward_torque
from lumbar.lifting.stability.model.eq_4_2_regulator import check_weights, regulate

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
    assert verdict(10.0, 1.0, changed, unknown).startswith("survives null control")
    assert verdict(10.0, 1.0, changed, unknown).endswith(
        "(no interval: 1 person (expert), at least 3 are needed)"
    )
    assert "null control shows +9.00 % of the +10.00 %" in verdict(10.0, 9.0, changed, unknown)
    assert "sign turns with Q divided" in verdict(10.0, 1.0, {**changed, "Q divided": -1.0}, unknown)
    assert "contains 0" in verdict(10.0, 1.0, changed, Interval(-2.0, 20.0))
    assert "[+5.00, +20.00]" in verdict(10.0, 1.0, changed, Interval(5.0, 20.0))
    assert verdict(None, None, {}, unknown) == "not testable in this study"


def test_exponent_of_the_lorenz_system():
    """Its largest exponent is 0.906 1/s (Sprott, Chaos and Time-Series Analysis, 2003)."""

    def lorenz(_, x):
        return [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]]

    trials, state = [], [1.0, 1.0, 20.0]
    for _ in range(12):
        times = np.arange(0, 30, 0.05)
        solution = solve_ivp(lorenz, (0, 30), state, "DOP853", times, rtol=1e-8, atol=1e-8)
        state = solution.y[:, -1]
        trials.append(solution.y.T[100:])
    found = maximum_exponent(trials, 0.05, horizon=2.5, fewest=10)
    assert found.value == pytest.approx(0.906, rel=0.15)
    assert found.remark == "estimated from 12 trials"


def test_exponent_without_enough_trials_is_not_estimated():
    found = maximum_exponent([np.zeros((100, 2))] * 5, 0.01, 0.1)
    assert found.value is None and found.remark.startswith("insufficient data: 5 trials")
    with pytest.raises(InputError, match="twice the horizon"):
        maximum_exponent([np.ones((10, 2))] * 30, 0.01, 0.1)
