"""Exact funnels: against eigenvalues of the linear loop, brute force, simulation and Liouville's theorem."""

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, full, minimum_jerk, pendulums_of
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import eigvalsh
from statsmodels.stats.proportion import proportion_confint

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import (
    boundary_growth,
    exact_funnels,
    reachable_area,
)
from lumbar.lifting.stability.funnel.monte_carlo_check import (
    quadratic_form,
    simulate,
    upper_share,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import (
    Weights,
    gain,
    normal_axes,
    regulate,
    riccati_rate,
)

SIGNS = ("hanging", "inverted")


def loops_of(items, sign, **keywords):
    return regulate(pendulums_of(items, sign, **keywords), WEIGHTS)


def growth_by_brute_force(loops, knot, index, level):
    """Return the largest V̇/ρ from the error dynamics themselves, written down anew, on a fine grid."""
    pendulums, point = loops.pendulums, 2 * knot
    cost = full(loops.cost[point, index])
    rate = -full(riccati_rate(pendulums, loops.weights, pendulums.angle[point], loops.cost[point])[index])
    factor = np.linalg.inv(np.linalg.cholesky(cost)).T
    angle, inertia = pendulums.angle[point, index], pendulums.inertia[index]

    def growth(circle):
        error, velocity = np.sqrt(level) * factor @ np.stack([np.cos(circle), np.sin(circle)])
        feedback = (cost[1, 0] * error + cost[1, 1] * velocity) / (inertia * float(loops.weights.control))
        gravity = pendulums.gravity_torque[index] * (np.sin(angle + error) - np.sin(angle))
        acceleration = (-feedback - pendulums.damping[index] * velocity - gravity) / inertia
        state, flow = np.stack([error, velocity]), np.stack([velocity, acceleration])
        return (np.sum(state * (rate @ state), axis=0) + 2 * np.sum(state * (cost @ flow), axis=0)) / level

    circle = np.linspace(0, 2 * np.pi, 20001)
    for width in (1e-3, 1e-6):
        best = circle[growth(circle).argmax()]
        circle = np.linspace(best - width, best + width, 2001)
    return growth(circle).max()


@pytest.mark.parametrize(("sign", "knot"), [("hanging", 137), ("inverted", 0)])
def test_boundary_growth_finds_the_global_maximum_of_random_forms(sign, knot):
    generator = np.random.default_rng(5)
    loops = loops_of([minimum_jerk(start=start) for start in generator.uniform(-2.5, 2.5, 40)], sign)
    level = 10 ** generator.uniform(-4, 3, 40)
    found = boundary_growth(loops.form(2 * knot), level)
    expected = [growth_by_brute_force(loops, knot, index, level[index]) for index in range(40)]
    assert found == pytest.approx(np.array(expected), rel=1e-5, abs=1e-5)


def test_without_gravity_the_rate_is_an_eigenvalue():
    """A linear loop has V̇ = −x̄ᵀ(Q + KᵀRK)x̄, so d ln ρ/dt is a generalised eigenvalue whatever ρ."""
    loops = loops_of([minimum_jerk()], "hanging", gravity=0.0)
    control = WEIGHTS.control * loops.pendulums.inertia[0] ** 2
    rates = []
    for entries in loops.cost[:, 0]:
        column = full(entries)[:, 1:]
        decay = full(WEIGHTS.state) + column @ column.T / control
        rates.append(-eigvalsh(decay, full(entries))[0])
    half_step = loops.step[0] / 2
    integral = cumulative_simpson(np.array(rates), dx=half_step, initial=0.0)
    expected = np.exp(integral - integral[-1])[::2]
    assert exact_funnels(loops).level[:, 0] == pytest.approx(expected, rel=1e-6)


def test_simulation_is_the_true_dynamics():
    """Against solve_ivp on Eq. 4.1 itself with feedforward and feedback, not on error coordinates."""
    item = minimum_jerk()
    loops = loops_of([item], "inverted")
    inertia, weight = item.mass_kg * item.length_m**2, -item.mass_kg * GRAVITY * item.length_m
    time = np.linspace(0, item.duration, len(loops.cost))
    gains = CubicSpline(time, np.stack(gain(loops.pendulums, WEIGHTS.control, loops.cost), axis=-1)[:, 0])
    reference = CubicSpline(item.time, np.stack([item.angle, item.angular_velocity], axis=-1))
    acceleration = CubicSpline(item.time, item.angular_acceleration)

    def rate(now, state):
        angle, velocity = reference(now)
        forward = inertia * acceleration(now) + 1.0 * velocity + weight * np.sin(angle)
        torque = forward - gains(now) @ (state - reference(now))
        return [state[1], (torque - 1.0 * state[1] - weight * np.sin(state[0])) / inertia]

    start = np.array([0.5, -0.8])
    end = solve_ivp(rate, (0, item.duration), reference(0.0) + start, rtol=1e-9, atol=1e-11).y[:, -1]
    *_, (_, state) = simulate(loops, start[:, None, None])
    assert state[:, 0, 0] == pytest.approx(end - reference(item.duration), abs=1e-6)


@pytest.mark.parametrize("sign", SIGNS)
def test_reachable_area_is_that_of_the_simulated_boundary(sign):
    """The edge of the goal set simulated backward encloses the area that Liouville's theorem gives."""
    loops = loops_of([minimum_jerk(duration=0.5)], sign)
    pendulums, inertia = loops.pendulums, loops.pendulums.inertia[0]
    phase = np.linspace(0, 1, len(loops.cost))
    gains = CubicSpline(phase, np.stack(gain(pendulums, WEIGHTS.control, loops.cost), axis=-1)[:, 0])
    angle = CubicSpline(phase, pendulums.angle[:, 0])
    a, p, q = (float(axis[0]) for axis in normal_axes(loops.cost[-1]))
    circle = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    edge = np.stack([a * np.cos(circle), p * np.cos(circle) + q * np.sin(circle)])

    def rate(now, flat):
        error, velocity = flat.reshape(2, -1)
        first, second = gains(now / 0.5)
        theta = angle(now / 0.5)
        gravity = pendulums.gravity_torque[0] * (np.sin(theta + error) - np.sin(theta))
        return np.concatenate([velocity, -(first * error + (second + 1.0) * velocity + gravity) / inertia])

    x, y = solve_ivp(rate, (0.5, 0), edge.ravel(), rtol=1e-8, atol=1e-10).y[:, -1].reshape(2, -1)
    polygon = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    assert reachable_area(loops)[0] == pytest.approx(polygon, rel=1e-4)
    # The funnel lies inside: every point of the simulated boundary has V ≥ ρ at t = 0.
    funnels = exact_funnels(loops)
    outside = quadratic_form(funnels.cost[0], np.stack([x, y])[:, None, :])
    assert outside.min() >= funnels.level[0, 0] * (1 - 1e-6)
    assert funnels.initial_area[0] < reachable_area(loops)[0]


def test_basin_of_many_turns_is_no_result():
    strong = Weights(WEIGHTS.state * 50, WEIGHTS.control / 1000, WEIGHTS.terminal)
    loops = regulate(pendulums_of([minimum_jerk(duration=8.0)], "hanging"), strong)
    with pytest.raises(NumericalError, match=r"expert 23 kg, abdomen, .*the basin reaches"):
        exact_funnels(loops)


def test_goal_set_beyond_every_funnel_is_named():
    loops = loops_of([minimum_jerk()], "hanging")
    with pytest.raises(NumericalError, match=r"expert 23 kg, abdomen, .*the goal set reaches 3\.1[0-9] rad"):
        exact_funnels(loops, (np.pi + 1e-6) ** 2 * 100)


def test_knots_too_far_apart_for_the_loop_are_named():
    strong = Weights(WEIGHTS.state, WEIGHTS.control / 1000, WEIGHTS.terminal)
    loops = regulate(pendulums_of([minimum_jerk(mass=3.0, length=0.3)], "hanging", knots=51), strong)
    said = r"raise stability\.regulator\.control_weight .*, or stability\.knots"
    with pytest.raises(NumericalError, match=said):
        list(simulate(loops, np.zeros((2, 1, 1))))


def test_upper_share_is_clopper_pearson():
    for exits in (0, 3, 250, 499, 500):
        expected = proportion_confint(exits, 500, method="beta")[1]
        assert upper_share(np.array(exits), 500) == pytest.approx(expected)
