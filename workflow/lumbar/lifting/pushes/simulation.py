"""Pushed bodies followed for a while, many at once: Runge–Kutta of order 4 between two commands of the controller.

The torque of a joint is the lift's own, the controller's command and what stiffness and damping add, within the joint's
strength; the ankle's is limited by the feet too. The forces on the ground are affine in the ankle's torque, so that the
torque at which the centre of pressure reaches heel or toe is known exactly at every instant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.pushes.body import (
    GRAVITY,
    Bodies,
    centre_of_mass,
    centrifugal,
    ground_force,
    mass_matrix,
    push_torque,
    solve,
    weight_torque,
)
from lumbar.lifting.pushes.person import Persons
from lumbar.lifting.pushes.reference import References, joint, target

if TYPE_CHECKING:
    from lumbar.settings.pushes import ControllerSettings, OutcomeSettings, PushSettings

STANDS, LEANS, UNBALANCED = "stands", "leans", "unbalanced"
"""Outcomes: back within the feet at the end; a leg leant too far; not within the feet at the end. The last two step."""


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

    outcome: np.ndarray
    """Shape (pushes,)."""
    angle: np.ndarray
    rate: np.ndarray
    """`angle`, `rate`: shape (3, pushes): at the end, or when the body fell."""

    @property
    def steps(self) -> np.ndarray:
        """Who must step, shape (pushes,)."""
        return self.outcome != STANDS


def simulate(scene: Scene, pushes: Pushes, watch: Callable | None = None) -> Ends:
    """Push bodies and follow them to the horizon.

    Parameters
    ----------
    watch : callable, optional
        Called with (seconds, angle, rate, command) at every command.
    """
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
    x, z, vx, _ = centre_of_mass(bodies, angle, rate)
    extrapolated = x + vx * np.sqrt(np.maximum(z, 0.1) / GRAVITY)
    balanced = (extrapolated > persons.heel) & (extrapolated < persons.toe)
    return Ends(np.where(fallen, LEANS, np.where(balanced, STANDS, UNBALANCED)), angle, rate)


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

    Parameters
    ----------
    wanted : tuple
        Angle, rate and torque of the lift.
    command : numpy.ndarray, shape (3, bodies)
        The controller's torque in N·m.
    force : numpy.ndarray, shape (bodies,)
        Push in N.
    height : float
        Where it acts, as a share of the trunk.
    angle, rate : numpy.ndarray, shape (3, bodies)
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
