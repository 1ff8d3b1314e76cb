"""Simulated pushes: the three-link body against Lagrange's equations, the solver against an adaptive one, the controller."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from lifting_cases import deposit, scene_of
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

from lumbar.lifting.pushes import simulation as person
from lumbar.lifting.pushes.body import (
    GRAVITY,
    JOINT_ANGLES,
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
from lumbar.lifting.pushes.motion import return_motion, target
from lumbar.lifting.pushes.simulation import Pushes, accelerations, simulate
from lumbar.settings.pushes import PushesSettings

SETTINGS = PushesSettings()


@pytest.fixture(scope="module")
def scene():
    return scene_of([deposit()])


def push(scene, *impulses, share=0.3):
    count = len(impulses)
    instant = int(share * scene.references.last[0])
    return Pushes(np.zeros(count, dtype=int), np.full(count, instant), np.array(impulses, dtype=float))


def test_gains_are_those_of_the_regulator_that_knows_all_commands_on_their_way(scene):
    motions, controller = [deposit()], SETTINGS.controller
    persons, bodies, delay = scene.persons, scene.bodies, int(scene.persons.delay[0])
    posture = motions[0].angle.mean(axis=1)[:, None]
    a, b = person._linear(bodies, posture, persons.stiffness, persons.damping, 0)
    steps = solve_ivp(
        lambda _, y: (np.block([[a, b], [np.zeros((3, 9))]]) @ y.reshape(9, 9)).ravel(),
        (0, controller.step_s),
        np.eye(9).ravel(),
        rtol=1e-11,
        atol=1e-12,
    ).y[:, -1]
    held = steps.reshape(9, 9)
    size = 6 + 3 * delay
    line, entry = np.zeros((size, size)), np.zeros((size, 3))
    line[:6, :6], line[:6, -3:] = held[:6, :6], held[:6, 6:]
    line[9:, 6:-3] = np.eye(3 * (delay - 1))
    entry[6:9] = np.eye(3)
    joints = np.kron(np.diag([1 / controller.angle_rad, 1 / controller.rate_rad_s]), JOINT_ANGLES)
    weight = np.zeros((size, size))
    weight[:6, :6] = joints.T @ joints
    tolerated = controller.torque_share * np.minimum(-persons.lowest, persons.highest)[:, 0]
    effort = np.diag(1 / tolerated**2)
    cost = solve_discrete_are(line, entry, weight, effort)
    gain = np.linalg.solve(effort + entry.T @ cost @ entry, entry.T @ cost @ line)
    assert persons.state_gain[:, :, 0] == pytest.approx(gain[:, :6], rel=1e-5, abs=1e-3)
    queue = np.hstack([persons.queue_gain[ago, :, :, 0] for ago in range(delay)])
    assert queue == pytest.approx(gain[:, 6:], rel=1e-5, abs=1e-5)


def followed(scene, pushes):
    """The same push by an adaptive solver, with the commands that the simulation gave."""
    seen = []
    short = replace(scene, outcome=replace(scene.outcome, horizon_s=0.8))
    ends = simulate(short, pushes, lambda *state: seen.append(state))
    bodies, persons = scene.bodies.take(pushes.lift), scene.persons.take(pushes.lift)
    state = np.concatenate(seen[0][1:3])[:, 0]
    grid = scene.references.step

    def slope(time, y, command):
        # Between the points of the grid the target's columns are taken at both sides.
        sides = [
            target(
                bodies,
                scene.references,
                pushes.lift,
                pushes.instant,
                halves,
                scene.controller.delay_s,
                scene.outcome.return_s,
            )
            for halves in (int(time / grid), int(time / grid) + 1)
        ]
        share = time / grid - int(time / grid)
        wanted = [(1 - share) * low + share * high for low, high in zip(*sides, strict=True)]
        force = pushes.impulse / scene.push.duration_s * (time < scene.push.duration_s)
        found, _ = accelerations(
            bodies, persons, wanted, command, force, scene.push.height_share, y[:3, None], y[3:, None]
        )
        return np.concatenate([y[3:], found[:, 0]])

    for start, _, _, command in seen:
        until = start + scene.controller.step_s
        state = solve_ivp(
            slope, (start + 1e-9, until - 1e-9), state, args=(command,), rtol=1e-6, atol=1e-8, max_step=0.01
        ).y[:, -1]
    return np.concatenate([ends.angle, ends.rate])[:, 0], state


def test_integration_agrees_with_an_adaptive_solver(scene):
    found, expected = followed(scene, push(scene, -15.0))
    assert np.abs(found[:3]).max() > 0.02
    assert found == pytest.approx(expected, abs=3e-4)


def test_without_a_push_the_body_takes_the_box_back_and_presses_within_its_feet(scene):
    pushes, pressure = push(scene, 0.0), []

    def watch(seconds, angle, rate, command):
        bodies, persons = scene.bodies.take(pushes.lift), scene.persons.take(pushes.lift)
        wanted = target(
            bodies,
            scene.references,
            pushes.lift,
            pushes.instant,
            round(seconds / scene.references.step),
            scene.controller.delay_s,
            scene.outcome.return_s,
        )
        found, torque = accelerations(bodies, persons, wanted, command, np.zeros(1), 0.75, angle, rate)
        pressure.append(centre_of_pressure(bodies, torque[0], *ground_force(bodies, angle, rate, found))[0])

    ends = simulate(scene, pushes, watch)
    assert ends.falls.tolist() == [False]
    assert ends.angle[:, 0] == pytest.approx(deposit().angle[:, 0], abs=0.02)
    assert min(pressure) >= -0.95 * 0.065 - 1e-9 and max(pressure) <= 0.95 * 0.2 + 1e-9


def test_hard_pushes_make_everyone_step_and_the_toes_end_what_the_foot_can_hold():
    scene = scene_of([deposit(foot=0.17), deposit(foot=0.24)])
    sizes = np.r_[np.arange(0.0, 40.0, 2.0), 90.0, -120.0]
    lift = np.repeat([0, 1], len(sizes))
    instant = scene.references.first[lift] + int(0.3 * scene.references.last[0])
    steps = simulate(scene, Pushes(lift, instant, np.tile(sizes, 2))).falls.reshape(2, -1)
    assert steps[:, -2:].all()
    # Who holds a push holds a smaller one.
    assert (np.diff(steps[:, :-2].astype(int), axis=1) >= 0).all()
    short, long = ((~steps[:, :-2]).sum(axis=1) - 1) * 2.0
    assert long > short + 4


def test_whoever_has_not_fallen_at_the_end_stands_for_good(scene):
    """With the feet's rule, the extrapolated centre of mass within them, nobody is told otherwise, though it decides nothing."""
    pushes = push(scene, *np.arange(-70.0, 25.0, 2.5))
    ends, later = (
        simulate(replace(scene, outcome=replace(scene.outcome, horizon_s=seconds)), pushes)
        for seconds in (4.0, 8.0)
    )
    assert ends.falls.tolist() == later.falls.tolist() and 0 < ends.falls.mean() < 1
    x, z, speed, _ = centre_of_mass(scene.bodies.take(pushes.lift), ends.angle, ends.rate)
    extrapolated = x + speed * np.sqrt(np.maximum(z, 0.1) / GRAVITY)
    persons = scene.persons
    assert ((extrapolated > persons.heel) & (extrapolated < persons.toe)).tolist() == (~ends.falls).tolist()


def test_the_way_back_joins_the_motion_smoothly():
    time = np.linspace(0, 1.2, 4001)
    angle, rate, acceleration = 0.3 * np.sin(time), 0.3 * np.cos(time), -0.3 * np.sin(time)
    path = np.array(
        [
            np.concatenate(
                return_motion(
                    t / 1.2,
                    (a * np.ones((3, 1)), v * np.ones((3, 1)), c * np.ones((3, 1))),
                    np.ones((3, 1)),
                    1.2,
                )
            )[[0, 3, 6], 0]
            for t, a, v, c in zip(time, angle, rate, acceleration, strict=True)
        ]
    )
    assert np.gradient(path[:, 0], time)[1:-1] == pytest.approx(path[1:-1, 1], abs=1e-5)
    assert np.gradient(path[:, 1], time)[1:-1] == pytest.approx(path[1:-1, 2], abs=1e-4)
    assert path[[0, -1], 0] == pytest.approx([0.0, 1.0])
    assert path[-1, 1:] == pytest.approx([0.0, 0.0])


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
