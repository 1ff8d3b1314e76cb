"""Extrapolated centre, capture and viability against simulated pendulums that are pushed a little too little or too much."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lumbar.lifting.measures.back_load import trunk_extension_strength
from lumbar.lifting.measures.balance import (
    MEAN_ANKLE_TORQUES,
    AnkleTorques,
    BaseOfSupport,
    braking_speed,
    capture_margin,
    pendulum_rate,
    pressure_limits,
    smallest_impulse,
    viability_margin,
)

G, MASS, LENGTH = 9.81, 80.0, 0.98
OMEGA = float(pendulum_rate(LENGTH, G))
FOOT = np.array([[[-0.15, -0.06], [0.15, -0.06], [0.15, 0.19], [-0.15, 0.19]]])
BASE = BaseOfSupport(FOOT, np.ones((1, 4), bool))


def best_braking(point, velocity, duration=4.0):
    """Linear pendulum with the centre of pressure as near below the extrapolated centre, and beyond it, as the foot allows."""
    low, high = FOOT[0].min(axis=0), FOOT[0].max(axis=0)

    def motion(_, state):
        x, v = state[:2], state[2:]
        pressure = np.clip(x + v / OMEGA + 0.5 * (x + v / OMEGA), low, high)
        return np.concatenate([v, OMEGA**2 * (x - pressure)])

    return solve_ivp(motion, (0, duration), [*point, *velocity], rtol=1e-9, atol=1e-12).y[:2, -1]


@pytest.mark.parametrize("velocity", [(0.0, 0.1), (0.12, -0.05), (-0.2, 0.05)])
def test_smallest_impulse_makes_the_linear_pendulum_fall(velocity):
    point, velocity = np.array([0.01, 0.04]), np.array(velocity)
    margin, direction = BASE.margin((point + velocity / OMEGA)[None])
    push = smallest_impulse(MASS, OMEGA, margin)[0] * direction[0]
    less, more = (best_braking(point, velocity + share * push / MASS) for share in (0.98, 1.02))
    assert np.linalg.norm(less) < 0.3
    assert np.linalg.norm(more) > 1.0


def fall(angle, velocity, reach):
    """Nonlinear pendulum under full braking: how it ends, at rest (True) or fallen forward (False)."""

    def motion(_, state):
        return [state[1], G / LENGTH * (np.sin(state[0]) - reach / LENGTH)]

    def rest(_, state):
        return state[1]

    def fallen(_, state):
        return state[0] - 1.4

    rest.terminal = fallen.terminal = True
    rest.direction, fallen.direction = -1, 1
    actual = solve_ivp(motion, (0, 20), [angle, velocity], events=(rest, fallen), rtol=1e-10, atol=1e-12)
    return bool(actual.t_events[0].size)


@pytest.mark.parametrize(("angle", "reach"), [(0.0, 0.15), (-0.3, 0.15), (0.1, 0.2), (-0.1, 0.05)])
def test_nonlinear_pendulum_stops_below_the_separatrix_only(angle, reach):
    speed = braking_speed(np.array([angle]), LENGTH, reach, G)[0]
    assert fall(angle, 0.999 * speed, reach)
    assert not fall(angle, 1.001 * speed, reach)


def test_beyond_the_saddle_only_a_fast_pendulum_returns():
    reach, angle = 0.1, 0.3
    speed = braking_speed(np.array([angle]), LENGTH, reach, G)[0]
    assert speed < 0
    for share, returns in ((1.01, True), (0.99, False)):
        course = solve_ivp(
            lambda _, state: [state[1], G / LENGTH * (np.sin(state[0]) - reach / LENGTH)],
            (0, 3),
            [angle, share * speed],
            rtol=1e-10,
            atol=1e-12,
        ).y[0]
        assert (course.min() < np.arcsin(reach / LENGTH) - 0.01) is np.bool_(returns)


def test_near_upright_viability_is_the_capture_margin_times_m_omega():
    offset, velocity = np.array([0.01, -0.012]), np.array([0.02, 0.01])
    limits = np.array([0.05, 0.04]), np.array([0.03, 0.05])
    height = np.full(2, LENGTH)
    capture = capture_margin(offset, velocity, height, limits, G)
    viable = viability_margin(offset / LENGTH, velocity / LENGTH, height, MASS, limits, G)
    assert viable == pytest.approx(MASS * OMEGA * capture, rel=2e-3)


def test_weak_ankles_or_short_feet_limit_the_centre_of_pressure():
    weight = np.array([MASS * G])
    ankles = np.array([[[-0.1, 0.0], [0.1, 0.0]]])
    right = np.array([[1.0, 0.0]])
    both, left = np.array([[True, True]]), np.array([[True, False]])
    strong, weak = AnkleTorques(500, 500, 500, 500), AnkleTorques(40.0, 15.0, 12.0, 9.0)
    limits = pressure_limits(BASE, ankles, both, right, weight, strong)
    assert np.concatenate(limits["flexion_extension"]) == pytest.approx([0.19, 0.06])
    assert np.concatenate(limits["lateral_bending"]) == pytest.approx([0.15, 0.15])
    limits = pressure_limits(BASE, ankles, both, right, weight, weak)
    assert np.concatenate(limits["flexion_extension"]) == pytest.approx([80 / weight[0], 30 / weight[0]])
    assert np.concatenate(limits["lateral_bending"]) == pytest.approx([0.1 + 12 / weight[0]] * 2)
    limits = pressure_limits(
        BASE, ankles, left, right, weight, weak
    )  # inward to the right, outward to the left
    assert np.concatenate(limits["flexion_extension"]) == pytest.approx([40 / weight[0], 15 / weight[0]])
    assert np.concatenate(limits["lateral_bending"]) == pytest.approx([9 / weight[0], 12 / weight[0]])


def test_strength_of_unknown_sex_is_the_mean_of_published_ones():
    assert MEAN_ANKLE_TORQUES.plantar_flexion == pytest.approx((158.1 + 100.4) / 2)
    assert trunk_extension_strength(np.array([0.0, 20.0, 50.0, 90.0]), "male") == pytest.approx(
        [288, 288, (232 + 171) / 2, 171]
    )
    assert trunk_extension_strength(40.0, "female") == pytest.approx(0.65 * 232)
