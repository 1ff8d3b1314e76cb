"""Simulated persons who are pushed, many at once: strength, feet, delayed controller, and how each push ends.

The controller is a linear-quadratic regulator of the body about the mean posture of its lift, for commands that are held
between instants and arrive after a whole number of them. For such a delay the optimum is the regulator without delay of
the state predicted from the commands on their way (certainty equivalence): with x⁺ = A·x + B·u_{k−D},

    u_k = −K·(A^D·x_k + Σ_{j=1..D} A^(j−1)·B·u_{k−j})

The torque of a joint is the lift's own, the controller's command and what stiffness and damping add, within the joint's
strength; the ankle's is limited by the feet too. The forces on the ground are affine in the ankle's torque, so that the
torque at which the centre of pressure reaches heel or toe is known exactly at every instant. Between two commands
Runge-Kutta of order 4 integrates the equations of motion.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.pushes.body import (
    GRAVITY,
    JOINT_ANGLES,
    Bodies,
    centrifugal,
    ground_force,
    mass_matrix,
    push_torque,
    solve,
    weight_torque,
)
from lumbar.lifting.pushes.motion import (
    DepositMotion,
    References,
    bodies_of,
    joint,
    target,
    toppling_stiffness,
)
from lumbar.settings.pushes import (
    BodySettings,
    ControllerSettings,
    OutcomeSettings,
    PersonalSpreadSettings,
    PushSettings,
)

_STREAMS = {"traits": 1, "pushes": 2}


@dataclass(frozen=True)
class Persons:
    """What bodies can do; the last axis counts bodies."""

    lowest: np.ndarray
    highest: np.ndarray
    """`lowest`, `highest`: shape (3, bodies): torque of ankle, hip and shoulder in N·m; forward (flexion of the hip, toes
    up) is positive."""
    stiffness: np.ndarray
    damping: np.ndarray
    """`stiffness`, `damping`: shape (3, bodies): of the joints without delay, in N·m/rad and N·m·s/rad."""
    heel: np.ndarray
    toe: np.ndarray
    """`heel`, `toe`: shape (bodies,): how far behind (negative) and ahead of the ankles the centre of pressure can go, m.
    """
    delay: np.ndarray
    """Shape (bodies,): in commands."""
    state_gain: np.ndarray
    """Shape (3, 6, bodies): K·A^D: N·m/rad and N·m·s/rad on the deviation of the links' angles and rates."""
    queue_gain: np.ndarray
    """Shape (longest delay, 3, 3, bodies): K·A^(j−1)·B of the command j instants ago; zero beyond the body's delay."""

    def take(self, index: np.ndarray) -> Persons:
        """Return some of the persons, or one of them several times."""
        return Persons(*(getattr(self, name)[..., index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Traits:
    """How persons differ from the settings, as factors; arrays of shape (motions,), the delay in s."""

    strength: np.ndarray
    foot: np.ndarray
    effort: np.ndarray
    delay: np.ndarray


def generator(seed: int, stream: str, name: str) -> np.random.Generator:
    """Random numbers of one person or lift, whoever else there is; `stream` is one of ``traits`` and ``pushes``."""
    return np.random.default_rng([seed, _STREAMS[stream], zlib.crc32(name.encode())])


def draw_traits(
    subjects: list[str], controller: ControllerSettings, spread: PersonalSpreadSettings, seed: int
) -> Traits:
    """Draw what no measure is told: once per person, the same in all of the person's lifts; one subject per motion."""
    normal = np.stack([generator(seed, "traits", name).normal(size=4) for name in subjects], axis=1)
    normal = np.clip(normal, -2, 2)  # no one without strength or delay
    return Traits(
        1 + spread.strength * normal[0],
        1 + spread.foot * normal[1],
        np.exp(spread.gain * normal[2]),
        np.maximum(controller.step_s, controller.delay_s + spread.delay_s * normal[3]),
    )


def persons_of(
    motions: list[DepositMotion], body: BodySettings, controller: ControllerSettings, traits: Traits
) -> Persons:
    """Return the persons of some motions, each with a controller about the mean posture of its motion."""
    bodies = bodies_of(motions)
    moment = np.array([item.mass_kg * item.height_m for item in motions]) * GRAVITY * traits.strength
    weak = -2 * np.outer([body.plantarflexion_share, body.hip_extension_share, body.shoulder_share], moment)
    strong = 2 * np.outer([body.dorsiflexion_share, body.hip_flexion_share, body.shoulder_share], moment)
    toppling = np.abs(toppling_stiffness(bodies))
    stiffness, damping = body.stiffness_share * toppling, body.damping_s * toppling
    posture = np.stack([item.angle.mean(axis=1) for item in motions], axis=1)
    delay = np.maximum(1, np.rint(traits.delay / controller.step_s).astype(int))
    torque = np.sqrt(traits.effort) * controller.torque_share * np.minimum(-weak, strong)
    gains = [
        _gains(
            *_linear(bodies, posture, stiffness, damping, index),
            torque[:, index],
            steps,
            delay.max(),
            controller,
        )
        for index, steps in enumerate(delay)
    ]
    state_gain, queue_gain = (np.stack(item, axis=-1) for item in zip(*gains, strict=True))
    return Persons(
        weak,
        strong,
        stiffness,
        damping,
        -body.heel_share * traits.foot * np.array([item.heel_m for item in motions]),
        body.toe_share * traits.foot * np.array([item.toe_m for item in motions]),
        delay,
        state_gain,
        queue_gain,
    )


def _linear(bodies: Bodies, posture, stiffness, damping, index: int) -> tuple[np.ndarray, np.ndarray]:
    """A (6×6) and B (6×3) of one body about a posture at rest, with its stiffness and damping."""
    mass = mass_matrix(bodies, posture)[:, :, index]
    gravity = np.diag(GRAVITY * bodies.first_moment[:, index] * np.cos(posture[:, index]))
    spring, damper = (
        JOINT_ANGLES.T @ np.diag(item[:, index]) @ JOINT_ANGLES for item in (stiffness, damping)
    )
    inverse = np.linalg.inv(mass)
    upper = np.hstack([np.zeros((3, 3)), np.eye(3)])
    lower = inverse @ np.hstack([gravity - spring, -damper])
    return np.vstack([upper, lower]), np.vstack([np.zeros((3, 3)), inverse @ JOINT_ANGLES.T])


def _gains(matrix, torques, tolerated, delay: int, longest: int, controller: ControllerSettings):
    """State and queue gains of one body; `tolerated` is the torque that costs as much as the tolerated deviation."""
    from scipy.linalg import expm, solve_discrete_are

    step = controller.step_s
    held = expm(step * np.block([[matrix, torques], [np.zeros((3, 9))]]))
    a, b = held[:6, :6], held[:6, 6:]
    joints = np.kron(np.diag([1 / controller.angle_rad, 1 / controller.rate_rad_s]), JOINT_ANGLES)
    weight, effort = joints.T @ joints, np.diag(1 / tolerated**2)
    cost = solve_discrete_are(a, b, weight, effort)
    gain = np.linalg.solve(effort + b.T @ cost @ b, b.T @ cost @ a)
    queue = np.zeros((longest, 3, 3))
    power = np.eye(6)
    for ago in range(delay):
        queue[ago] = gain @ power @ b
        power = power @ a
    return gain @ power, queue


@dataclass(frozen=True)
class Pushes:
    """Pushes; arrays of shape (pushes,)."""

    lift: np.ndarray
    """Index of the motion."""
    instant: np.ndarray
    """Column of its reference at which the push begins."""
    impulse: np.ndarray
    """N·s, forward positive."""


@dataclass(frozen=True)
class Scene:
    """Everything a simulation needs beside the pushes."""

    bodies: Bodies
    persons: Persons
    references: References
    controller: ControllerSettings
    push: PushSettings
    outcome: OutcomeSettings


@dataclass(frozen=True)
class Ends:
    """How pushes ended."""

    falls: np.ndarray
    """Shape (pushes,): who has leant too far to come back without a step."""
    angle: np.ndarray
    rate: np.ndarray
    """`angle`, `rate`: shape (3, pushes): at the end, or when the body fell."""


def simulate(scene: Scene, pushes: Pushes, watch: Callable | None = None) -> Ends:
    """Push bodies and follow them to the horizon; `watch` is called with (seconds, angle, rate, command) at every command."""
    controller, outcome, references = scene.controller, scene.outcome, scene.references
    bodies, persons = scene.bodies.take(pushes.lift), scene.persons.take(pushes.lift)
    step = 2 * references.step
    inner = round(controller.step_s / step)
    angle, rate = references.angle[:, pushes.instant], references.rate[:, pushes.instant]
    queue = np.zeros((scene.persons.queue_gain.shape[0], *angle.shape))
    arriving = persons.delay - 1, slice(None), np.arange(len(pushes.lift))
    fallen = np.zeros(len(pushes.lift), dtype=bool)
    force = pushes.impulse / scene.push.duration_s

    def follow(halves: int) -> tuple[np.ndarray, ...]:
        return target(
            bodies, references, pushes.lift, pushes.instant, halves, controller.delay_s, outcome.return_s
        )

    wanted = follow(0)
    for number in range(round(outcome.horizon_s / controller.step_s)):
        seconds = number * controller.step_s
        command = queue[arriving].T
        if watch is not None:
            watch(seconds, angle, rate, command)
        new = _command(bodies, persons, wanted, angle, rate, queue)
        queue = np.concatenate([new[None], queue[:-1]])
        for part in range(inner):
            halves = 2 * (inner * number + part)
            # A push that ends within a step loses the rest of it: its duration is a whole number of steps.
            pushing = force if (halves / 2 + 0.5) * step < scene.push.duration_s else 0 * force
            targets = wanted, follow(halves + 1), follow(halves + 2)
            new = _runge_kutta(
                bodies, persons, targets, command, pushing, scene.push.height_share, angle, rate, step
            )
            angle, rate = (np.where(fallen, old, item) for old, item in zip((angle, rate), new, strict=True))
            wanted = targets[2]
        fallen |= np.abs(angle[0] - wanted[0][0]) > np.deg2rad(outcome.lean_deg)
    return Ends(fallen, angle, rate)


def _command(bodies: Bodies, persons: Persons, wanted, angle, rate, queue) -> np.ndarray:
    """Command for after the delay; `queue` holds the earlier ones, the latest first.

    The controller knows its strength and, standing still, its feet: it asks for no torque that they cannot give.
    """
    deviation = np.concatenate([angle - wanted[0], rate - wanted[1]])
    command = -np.einsum("ijn,jn->in", persons.state_gain, deviation)
    command -= np.einsum("kijn,kjn->in", persons.queue_gain, queue)
    weight = bodies.mass * GRAVITY
    lowest, highest = persons.lowest.copy(), persons.highest.copy()
    lowest[0] = np.maximum(lowest[0], -persons.toe * weight)
    highest[0] = np.minimum(highest[0], -persons.heel * weight)
    return np.clip(wanted[2] + command, lowest, highest) - wanted[2]


def _runge_kutta(bodies, persons, targets, command, force, height, angle, rate, step: float):
    """One step of order 4; `targets` are those at its start, middle and end."""

    def slope(wanted, a, r):
        return accelerations(bodies, persons, wanted, command, force, height, a, r)[0]

    first = slope(targets[0], angle, rate)
    rate2 = rate + 0.5 * step * first
    second = slope(targets[1], angle + 0.5 * step * rate, rate2)
    rate3 = rate + 0.5 * step * second
    third = slope(targets[1], angle + 0.5 * step * rate2, rate3)
    rate4 = rate + step * third
    fourth = slope(targets[2], angle + step * rate3, rate4)
    return (
        angle + step / 6 * (rate + 2 * rate2 + 2 * rate3 + rate4),
        rate + step / 6 * (first + 2 * second + 2 * third + fourth),
    )


def accelerations(bodies: Bodies, persons: Persons, wanted, command, force, height: float, angle, rate):
    """Return the links' angular accelerations in rad/s² and the joints' torques in N·m, each of shape (3, bodies).

    `wanted` are angle, rate and torque of the lift, `command` is the controller's torque; the push in N acts at a height that
    is a share of the trunk.
    """
    elastic = persons.stiffness * joint(angle - wanted[0]) + persons.damping * joint(rate - wanted[1])
    torque = np.clip(wanted[2] + command - elastic, persons.lowest, persons.highest)
    upper = np.stack([-torque[1], torque[1] - torque[2], torque[2]])
    free = (
        weight_torque(bodies, angle)
        - centrifugal(bodies, angle, rate)
        + push_torque(bodies, angle, force, height)
    )
    unit = np.zeros_like(angle)
    unit[0] = 1
    without, per_torque = solve(mass_matrix(bodies, angle), free + upper, unit)
    torque[0] = _within_feet(bodies, persons, angle, rate, without, per_torque, force, torque[0])
    return without + per_torque * torque[0], torque


def _within_feet(bodies, persons, angle, rate, without, per_torque, force, torque) -> np.ndarray:
    """Ankle torque for which the centre of pressure stays between heel and toe."""
    base = ground_force(bodies, angle, rate, without, force)
    with_torque = ground_force(bodies, angle, rate, without + per_torque, force)
    limits = []
    for reach in (persons.toe, persons.heel):
        # −(τ + h·F_x)/F_z = reach, with F = base + slope·τ.
        moment = bodies.ankle_height * base[0] + reach * base[1]
        slope = bodies.ankle_height * (with_torque[0] - base[0]) + reach * (with_torque[1] - base[1])
        limits.append(-moment / (1 + slope))
    return np.clip(torque, *limits)
