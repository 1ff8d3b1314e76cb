"""Pendulum states against rigid rods, closed forms and the twin's noise-free movement."""

import numpy as np
import pytest

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.movement.joint_centres import trunk_points
from lumbar.lifting.movement.pendulum_states import pendulum_states, pivot_trajectory
from lumbar.records.markers import MarkerRecording

TIME = np.arange(0, 4, 0.01)
START, STOP, POINTS = 1.0, 3.0, 1000


def rod(angle, length, plane):
    """Bob of a rod of this length at this angle from straight up, in one plane."""
    horizontal = length * np.sin(angle)
    zero = np.zeros_like(horizontal)
    columns = (horizontal, zero) if plane == "lateral_bending" else (zero, horizontal)
    return np.stack([*columns, length * np.cos(angle)], axis=1)


@pytest.mark.parametrize("plane", ["lateral_bending", "flexion_extension"])
def test_a_rigid_rod(plane):
    omega, amplitude = 2 * np.pi * 0.8, 0.4
    bob = rod(amplitude * np.sin(omega * TIME), 1.1, plane)
    states = pendulum_states(TIME, bob, START, STOP, POINTS)[plane]
    grid = np.linspace(START, STOP, POINTS)
    assert np.array_equal(states.time, grid)
    assert states.angle == pytest.approx(amplitude * np.sin(omega * grid), abs=1e-6)
    assert states.angular_velocity == pytest.approx(amplitude * omega * np.cos(omega * grid), abs=1e-4)
    acceleration = -amplitude * omega**2 * np.sin(omega * grid)
    assert states.angular_acceleration == pytest.approx(acceleration, abs=2e-2)
    assert states.length == pytest.approx(1.1, abs=1e-6)
    assert states.length_rate == pytest.approx(0.0, abs=1e-4)


def test_a_rod_that_changes_its_length():
    angle, length = 0.3 * TIME - 0.5, 0.8 + 0.1 * TIME
    states = pendulum_states(TIME, rod(angle, length, "lateral_bending"), START, STOP, POINTS)
    grid = np.linspace(START, STOP, POINTS)
    lateral, expected = states["lateral_bending"], 0.8 + 0.1 * grid
    assert lateral.length == pytest.approx(expected, abs=1e-6)
    assert lateral.length_rate == pytest.approx(0.1, abs=1e-5)
    assert lateral.angular_velocity == pytest.approx(0.3, abs=1e-5)
    assert lateral.angular_acceleration == pytest.approx(0.0, abs=1e-3)
    # The other plane sees the height alone.
    seen = expected * np.cos(0.3 * grid - 0.5)
    assert states["flexion_extension"].length == pytest.approx(seen, abs=1e-6)


def test_the_spline_does_not_end_where_the_deposit_ends():
    # Off-grid limits: the same instants of a longer deposit have the same states.
    bob = rod(0.3 * np.sin(5 * TIME), 1.0, "lateral_bending")
    short = pendulum_states(TIME, bob, 1.503, 2.507, 11)["lateral_bending"]
    assert short.angular_velocity == pytest.approx(1.5 * np.cos(5 * short.time), abs=1e-4)


def test_missing_samples_are_rejected_only_within_the_deposit():
    bob = rod(0.2 * np.sin(3 * TIME), 1.0, "lateral_bending")
    bob[20:60] = np.nan
    bob[350:360] = np.nan
    states = pendulum_states(TIME, bob, START, STOP, 50)["lateral_bending"]
    assert states.angle == pytest.approx(0.2 * np.sin(3 * states.time), abs=1e-6)
    bob[150:155] = np.nan
    with pytest.raises(InputError, match=r"^5 .*1\.50 s"):
        pendulum_states(TIME, bob, START, STOP, 50)


def test_deposit_of_three_samples_is_rejected():
    with pytest.raises(InputError, match=r"\b1 .*1\.004 s .*\b3 .*\b4\b"):
        pendulum_states(TIME, rod(0 * TIME, 1.0, "lateral_bending"), 1.0, 1.004, 50)


def test_a_bob_at_the_pivot_has_no_angle():
    with pytest.raises(NumericalError, match=r"5\.0 mm.*lifting\.pivot"):
        pendulum_states(TIME, rod(0 * TIME, 0.005, "lateral_bending"), START, STOP, 50)


def test_missing_markers_are_rejected_with_possible_pivots():
    recording = MarkerRecording("x", np.arange(5) / 100, 100.0, {"L5": np.ones((5, 3))}, source="x.c3d")
    points = trunk_points(recording, "inner", "harrington", "male")
    with pytest.raises(
        InputError, match=r"x\.c3d: .*\n.*L_ANKLE: .*lifting\.pivot mid_ankle.*: L5\n.*R_ANKLE: .*: L5$"
    ):
        pivot_trajectory(recording, points, "mid_ankle")
