"""A simulated person beyond the posture: strength, reach of the feet, delay and gains of the controller.

The controller is a linear-quadratic regulator of the body about the mean posture of its lift, for commands that are held
between instants and arrive after a whole number of them. For such a delay the optimum is the regulator without delay of
the state predicted from the commands on their way (certainty equivalence): with x⁺ = A·x + B·u_{k−D},

    u_k = −K·(A^D·x_k + Σ_{j=1..D} A^(j−1)·B·u_{k−j})
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.pushes.body import GRAVITY, JOINT_ANGLES, Bodies, mass_matrix
from lumbar.lifting.pushes.motion import DepositMotion, bodies_of
from lumbar.lifting.pushes.reference import toppling_stiffness

if TYPE_CHECKING:
    from lumbar.settings.pushes import BodySettings, ControllerSettings, PersonalSpreadSettings

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
    """Draw what no measure is told: once per person, the same in all of the person's lifts.

    Parameters
    ----------
    subjects : list of str
        One per motion.
    """
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
