"""The three-link body against Lagrange's equations derived symbolically, and momentum."""

import numpy as np
import pytest
import sympy as sp

from lumbar.lifting.pushes.body import (
    GRAVITY,
    bodies_of_links,
    centre_of_mass,
    centre_of_pressure,
    centrifugal,
    ground_force,
    inverse_dynamics,
    mass_matrix,
    push_torque,
    solve,
    weight_torque,
)

MASSES, CENTRES = np.array([[22.0], [45.0], [30.0]]), np.array([[0.5], [0.2], [0.4]])
LENGTHS, INERTIAS = np.array([[0.86], [0.5], [0.55]]), np.array([[1.4], [2.2], [0.9]])
ANGLE, RATE = np.array([[0.1], [0.5], [2.4]]), np.array([[0.7], [-1.1], [1.9]])
ACCELERATION = np.array([[2.0], [-3.0], [1.0]])


@pytest.fixture(scope="module")
def bodies():
    return bodies_of_links(MASSES, CENTRES, LENGTHS, INERTIAS, [0.07])


@pytest.fixture(scope="module")
def lagrangian():
    """Generalised forces Q(θ, θ̇, θ̈), and those of a force on the trunk, from kinetic and potential energy."""
    t = sp.symbols("t")
    q = [sp.Function(f"q{i}")(t) for i in range(3)]
    joint, points = sp.zeros(2, 1), []
    for i, angle in enumerate(q):
        along = sp.Matrix([sp.sin(angle), sp.cos(angle)])
        points.append(joint + CENTRES[i, 0] * along)
        if i == 1:
            pushed = joint + 0.75 * LENGTHS[1, 0] * along
        joint = joint + LENGTHS[i, 0] * along
    kinetic = sum(
        MASSES[i, 0] * point.diff(t).dot(point.diff(t)) / 2 + INERTIAS[i, 0] * q[i].diff(t) ** 2 / 2
        for i, point in enumerate(points)
    )
    potential = sum(GRAVITY * MASSES[i, 0] * point[1] for i, point in enumerate(points))
    equations = [
        (kinetic.diff(x.diff(t)).diff(t) - kinetic.diff(x) + potential.diff(x)).doit() for x in q
    ] + [pushed[0].diff(x) for x in q]
    values = {}
    for i, x in enumerate(q):
        values |= {x.diff(t, 2): ACCELERATION[i, 0], x.diff(t): RATE[i, 0], x: ANGLE[i, 0]}
    ordered = sorted(values.items(), key=lambda item: -len(item[0].args))
    numbers = [float(equation.subs(ordered).evalf()) for equation in equations]
    return np.array(numbers[:3]), np.array(numbers[3:])


def test_equations_of_motion_are_lagranges(bodies, lagrangian):
    forces = (
        np.einsum("ijn,jn->in", mass_matrix(bodies, ANGLE), ACCELERATION)
        + centrifugal(bodies, ANGLE, RATE)
        - weight_torque(bodies, ANGLE)
    )
    assert forces[:, 0] == pytest.approx(lagrangian[0], rel=1e-12)
    assert push_torque(bodies, ANGLE, np.array([1.0]), 0.75)[:, 0] == pytest.approx(lagrangian[1], rel=1e-12)


def test_joint_torques_drive_the_motion_that_they_were_computed_from(bodies):
    ankle, hip, shoulder = inverse_dynamics(bodies, ANGLE, RATE, ACCELERATION)
    driven = np.stack([ankle - hip, hip - shoulder, shoulder])
    right = driven + weight_torque(bodies, ANGLE) - centrifugal(bodies, ANGLE, RATE)
    (found,) = solve(mass_matrix(bodies, ANGLE), right)
    assert found == pytest.approx(ACCELERATION, rel=1e-10)
    assert found[:, 0] == pytest.approx(np.linalg.solve(mass_matrix(bodies, ANGLE)[:, :, 0], right[:, 0]))


def test_pressure_under_the_feet_balances_momentum(bodies):
    """Force and moment about the ground below the ankle, from momenta of the links a moment before and after."""
    push, height = np.array([120.0]), 0.75

    def momenta(time):
        angle = ANGLE + RATE * time + ACCELERATION * time**2 / 2
        rate = RATE + ACCELERATION * time
        joint, speed, linear, angular = np.array([0.0, 0.07]), np.zeros(2), np.zeros(2), 0.0
        for i in range(3):
            s, c = np.sin(angle[i, 0]), np.cos(angle[i, 0])
            place = joint + CENTRES[i, 0] * np.array([s, c])
            velocity = speed + CENTRES[i, 0] * rate[i, 0] * np.array([c, -s])
            linear = linear + MASSES[i, 0] * velocity
            angular += MASSES[i, 0] * (place[1] * velocity[0] - place[0] * velocity[1])
            angular += INERTIAS[i, 0] * rate[i, 0]
            joint = joint + LENGTHS[i, 0] * np.array([s, c])
            speed = speed + LENGTHS[i, 0] * rate[i, 0] * np.array([c, -s])
        return *linear, angular

    (x1, z1, h1), (x0, z0, h0) = momenta(1e-5), momenta(-1e-5)
    weight = GRAVITY * MASSES.sum()
    fx, fz = (x1 - x0) / 2e-5 - push[0], (z1 - z0) / 2e-5 + weight
    high = 0.07 + LENGTHS[0, 0] * np.cos(ANGLE[0, 0]) + height * LENGTHS[1, 0] * np.cos(ANGLE[1, 0])
    centre = centre_of_mass(bodies, ANGLE, RATE)[0][0]
    # dH/dt = moment of weight, push and ground's force, clockwise positive: −c·F_z of the last.
    pressure = (weight * centre + push[0] * high - (h1 - h0) / 2e-5) / fz
    found = ground_force(bodies, ANGLE, RATE, ACCELERATION, push)
    assert [item[0] for item in found] == pytest.approx([fx, fz], rel=1e-6)
    driven = inverse_dynamics(bodies, ANGLE, RATE, ACCELERATION)[0] - push_torque(
        bodies, ANGLE, push, height
    ).sum(axis=0)
    assert centre_of_pressure(bodies, driven, *found)[0] == pytest.approx(pressure, rel=1e-5)
