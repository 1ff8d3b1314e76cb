"""Moment at the pivot of a swinging body, by Newton's law for its masses: independent of any pendulum equation.

Every mass is a point that moves in a vertical plane; its acceleration is a difference of its positions. Inertia, Coriolis
and pivot terms follow from the motion and are written down nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81
"""m/s², unless a swing says otherwise."""
STEP = 1e-3
"""Seconds between the positions that accelerations are differences of (error of the fourth order)."""

Signal = Callable[[np.ndarray], np.ndarray]


def constant(value: float) -> Signal:
    """Signal that does not change."""
    return lambda time: np.full(np.shape(time), float(value))


def rate(signal: Signal, time: np.ndarray) -> np.ndarray:
    """First derivative, by a central difference of the fourth order."""
    ahead = signal(time + STEP) - signal(time - STEP)
    return (8 * ahead - signal(time + 2 * STEP) + signal(time - 2 * STEP)) / (12 * STEP)


def acceleration(signal: Signal, time: np.ndarray) -> np.ndarray:
    """Second derivative, by a central difference of the fourth order."""
    near = signal(time + STEP) + signal(time - STEP)
    far = signal(time + 2 * STEP) + signal(time - 2 * STEP)
    return (16 * near - far - 30 * signal(time)) / (12 * STEP**2)


ALWAYS = constant(1.0)
AT_REST = constant(0.0)


@dataclass(frozen=True)
class Mass:
    """A point mass on the line through the pivot."""

    kg: float
    distance: Signal
    """From the pivot in metres, over time."""
    carried: Signal = ALWAYS
    """Share of its weight and inertia that the pendulum carries, over time."""


@dataclass(frozen=True)
class Swing:
    """A swinging body."""

    angle: Signal
    """From the vertical in rad, over time."""
    masses: tuple[Mass, ...]
    central_inertia: float = 0.0
    """Of the body about its own centre of mass, kg·m²."""
    hanging: bool = True
    """Whether the angle counts from straight down; else from straight up."""
    pivot_x: Signal = AT_REST
    pivot_z: Signal = AT_REST
    """`pivot_x`, `pivot_z`: callable: place of the pivot in metres: x horizontal, towards where a growing angle moves the
    mass; z up."""
    gravity: float = GRAVITY
    """m/s²."""

    def moment(self, time: np.ndarray) -> np.ndarray:
        """Moment that moves the body so, N·m, positive with the angle; shape (samples,)."""
        up = -1.0 if self.hanging else 1.0
        total = self.central_inertia * acceleration(self.angle, time)
        for mass in self.masses:

            def x(instant, mass=mass):
                return self.pivot_x(instant) + mass.distance(instant) * np.sin(self.angle(instant))

            def z(instant, mass=mass):
                return self.pivot_z(instant) + up * mass.distance(instant) * np.cos(self.angle(instant))

            force_x = mass.kg * acceleration(x, time)
            force_z = mass.kg * (acceleration(z, time) + self.gravity)
            arm_x, arm_z = x(time) - self.pivot_x(time), z(time) - self.pivot_z(time)
            total = total + mass.carried(time) * -up * (arm_x * force_z - arm_z * force_x)
        return total
