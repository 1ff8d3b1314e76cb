"""Riccati equation of the pendulum: against closed forms, scipy's algebraic solver, matrix exponentials."""

import numpy as np
import pytest
from lifting_cases import GRAVITY, WEIGHTS, full, minimum_jerk, pendulums_of
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm, solve_continuous_are

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.stability.model.eq_4_1_pendulum import feedforward_torque, remainder
from lumbar.lifting.stability.model.eq_4_2_regulator import (
    check_weights,
    cost_to_go,
    cost_to_go_euler,
    determinant,
)


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
    found = full(cost_to_go(pendulums, WEIGHTS)[0, 0])
    assert found == pytest.approx(expected, rel=1e-3)


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
    with pytest.raises(NumericalError, match=r"expert 23 kg, abdomen, flexion_ext.*not positive definite"):
        cost_to_go_euler(pendulums, WEIGHTS)


@pytest.mark.parametrize(
    ("state", "control", "terminal", "message"),
    [
        ([[-1, 0], [0, 1]], 1, [[1, 0], [0, 1]], "state_weight: smallest eigenvalue -1"),
        ([[1, 0], [0, 1]], 0, [[1, 0], [0, 1]], "control_weight: 0; it must be positive"),
        ([[1, 0], [0, 1]], float("nan"), [[1, 0], [0, 1]], "control_weight: nan"),
        ([[1, 0], [0, 1]], 1, [[1, 0], [0, 0]], "terminal_weight: smallest eigenvalue 0"),
        ([[1, 2], [0, 1]], 1, [[1, 0], [0, 1]], "state_weight.*symmetric"),
    ],
)
def test_inadmissible_weights_are_named(state, control, terminal, message):
    with pytest.raises(InputError, match=message):
        check_weights(state, control, terminal)


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


def test_remainder_is_what_linearisation_leaves_out():
    angle, error = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-4, 4, 17))
    expected = np.sin(angle + error) - np.sin(angle) - error * np.cos(angle)
    assert remainder(angle, error) == pytest.approx(expected, abs=1e-14)
    # Small errors keep their leading term, which the naive difference loses.
    assert remainder(np.array(0.7), np.array(1e-7)) == pytest.approx(-np.sin(0.7) * 0.5e-14, rel=1e-6)
