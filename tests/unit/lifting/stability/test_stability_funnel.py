"""Riccati equation and exact funnels: against closed forms, scipy, matrix exponentials, simulation, Liouville's theorem."""

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, full, minimum_jerk, pendulums_of
from pydantic import ValidationError
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import eigvalsh, expm, solve_continuous_are
from statsmodels.stats.proportion import proportion_confint

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import boundary_growth, exact_funnels, reachable_area
from lumbar.lifting.stability.funnel.monte_carlo_check import MonteCarloCheck, quadratic_form, simulate
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    Weights,
    cost_to_go,
    cost_to_go_euler,
    determinant,
    feedforward_torque,
    gain,
    normal_axes,
    regulate,
    remainder,
    riccati_rate,
)
from lumbar.settings.lifting import RegulatorSettings


def matrices(pendulums, angle):
    a21, a22, b2 = (float(item[0]) for item in pendulums.linearisation(np.array([angle])))
    return np.array([[0.0, 1.0], [a21, a22]]), np.array([[0.0], [b2]])


def test_small_inertia_is_integrated_implicitly():
    """A grain of 0.1 g: the loop is 10⁵ times as fast as its movement, and S that of the algebraic equation."""
    still = minimum_jerk(start=0.0, end=0.0, mass=1e-4)
    pendulums = pendulums_of([still], "inverted", knots=101)
    a, b = matrices(pendulums, 0.0)
    expected = solve_continuous_are(a, b, full(WEIGHTS.state), [[float(WEIGHTS.control)]])
    # After 1.5 s the slow mode has nearly settled; the fast one has at once.
    actual = full(cost_to_go(pendulums, WEIGHTS)[0, 0])
    assert actual == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("sign", ["hanging", "inverted"])
def test_transient_is_the_hamiltonian_flow(sign):
    pendulums = pendulums_of([minimum_jerk(start=0.3, end=0.3)], sign, knots=101)
    a, b = matrices(pendulums, 0.3)
    hamiltonian = np.block([[a, -b @ b.T / WEIGHTS.control], [-full(WEIGHTS.state), -a.T]])
    cost = cost_to_go(pendulums, WEIGHTS)
    for point in (0, 77, 150):
        remaining = (1 - point / 200) * pendulums.duration[0]
        flow = expm(-hamiltonian * remaining) @ np.vstack([np.eye(2), full(WEIGHTS.terminal)])
        assert full(cost[point, 0]) == pytest.approx(flow[2:] @ np.linalg.inv(flow[:2]), rel=1e-8)


def test_euler_converges_with_order_one():
    errors = []
    for knots in (500, 1000, 2000):
        pendulums = pendulums_of([minimum_jerk()], "hanging", knots=knots)
        exact, euler = cost_to_go(pendulums, WEIGHTS)[0], cost_to_go_euler(pendulums, WEIGHTS)[0]
        errors.append(abs(np.sqrt(determinant(exact) / determinant(euler)) - 1)[0])
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2, rel=0.1)


def test_euler_blows_up_where_the_accurate_solution_does_not():
    light = minimum_jerk(mass=2.0, length=0.12, duration=2.0)
    pendulums = pendulums_of([light], "hanging", knots=60)
    assert (determinant(cost_to_go(pendulums, WEIGHTS)) > 0).all()
    with pytest.raises(NumericalError, match=r"expert 23 kg, abdomen, flexion_extension .*Riccati"):
        cost_to_go_euler(pendulums, WEIGHTS)


@pytest.mark.parametrize(
    "weights",
    [
        {"state_weight": [[-1, 0], [0, 1]]},
        {"state_weight": [[1, 2], [0, 1]]},
        {"control_weight": 0},
        {"control_weight": float("nan")},
        {"terminal_weight": [[1, 0], [0, 0]]},
    ],
)
def test_inadmissible_weights_are_named(weights):
    with pytest.raises(ValidationError) as rejected:
        RegulatorSettings(**weights)
    assert [error["loc"] for error in rejected.value.errors()] == [tuple(weights)]
    semidefinite = ((1, 1), (1, 1))
    assert RegulatorSettings(state_weight=semidefinite).state_weight == semidefinite


@pytest.mark.parametrize("sign", ["hanging", "inverted"])
def test_feedforward_keeps_the_reference(sign):
    """Driven by u0 alone, the pendulum of Eq. 4.1 stays on the reference it was computed from."""
    item = minimum_jerk(duration=0.6)
    torque = CubicSpline(item.time, feedforward_torque(item, sign, 2.0, GRAVITY))
    direction = {"hanging": 1, "inverted": -1}[sign]
    inertia = item.mass_kg * item.length_m**2

    def rate(time, state):
        weight = direction * item.mass_kg * GRAVITY * item.length_m * np.sin(state[0])
        return [state[1], (torque(time) - 2.0 * state[1] - weight) / inertia]

    end = solve_ivp(rate, (0, item.duration), [item.angle[0], 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert end == pytest.approx([item.angle[-1], 0.0], abs=1e-7)


def test_remainder_is_the_error_of_linearisation():
    angle, error = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-4, 4, 17))
    expected = np.sin(angle + error) - np.sin(angle) - error * np.cos(angle)
    assert remainder(angle, error) == pytest.approx(expected, abs=1e-14)
    # Small errors keep their leading term, which the naive difference loses.
    assert remainder(np.array(0.7), np.array(1e-7)) == pytest.approx(-np.sin(0.7) * 0.5e-14, rel=1e-6)


SIGNS = ("hanging", "inverted")


def loops_of(items, sign, **keywords):
    return regulate(pendulums_of(items, sign, **keywords), WEIGHTS)


def growth_by_brute_force(loops, knot, index, level):
    """Return the largest V̇/ρ from the error dynamics themselves, written down again, on a fine grid."""
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
    actual = boundary_growth(loops.form(2 * knot), level)
    expected = [growth_by_brute_force(loops, knot, index, level[index]) for index in range(40)]
    assert actual == pytest.approx(np.array(expected), rel=1e-5, abs=1e-5)


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
    assert funnels.area[0, 0] < reachable_area(loops)[0]


def test_basin_of_many_turns_is_rejected():
    strong = Weights(WEIGHTS.state * 50, WEIGHTS.control / 1000, WEIGHTS.terminal)
    loops = regulate(pendulums_of([minimum_jerk(duration=8.0)], "hanging"), strong)
    with pytest.raises(
        NumericalError,
        match=r"expert 23 kg, abdomen, .*\bbasin .*32 rad",
    ):
        exact_funnels(loops)


def test_goal_set_beyond_every_funnel_is_named():
    loops = loops_of([minimum_jerk()], "hanging")
    with pytest.raises(NumericalError, match=r"expert 23 kg, abdomen, .*\bgoal set .*3\.1[0-9] rad"):
        exact_funnels(loops, (np.pi + 1e-6) ** 2 * 100)


def test_knots_too_far_apart_for_the_loop_are_named():
    strong = Weights(WEIGHTS.state, WEIGHTS.control / 1000, WEIGHTS.terminal)
    loops = regulate(pendulums_of([minimum_jerk(mass=3.0, length=0.3)], "hanging", knots=51), strong)
    message = r"expert 23 kg, abdomen, .*0\.03 s "
    with pytest.raises(NumericalError, match=message):
        list(simulate(loops, np.zeros((2, 1, 1))))


def test_upper_share_is_clopper_pearson():
    exits = np.array([0, 3, 250, 499, 500])
    expected = proportion_confint(exits, 500, method="beta")[1]
    assert MonteCarloCheck(exits, 500).share_high == pytest.approx(expected)
