"""Simulated pushes against an adaptive solver, the controller against the regulator of the whole delay line."""

from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import deposit, scene_of
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

from lumbar.lifting.pushes import simulation as person
from lumbar.lifting.pushes.body import (
    GRAVITY,
    JOINT_ANGLES,
    centre_of_mass,
    centre_of_pressure,
    ground_force,
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
