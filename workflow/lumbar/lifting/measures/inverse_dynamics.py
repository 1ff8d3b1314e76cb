"""Net moment about a joint of all that moves above it, top-down from movement and inertia (Winter 2009, section 5).

M = Σ (c − p) × m·(a + g·ẑ) + dH/dt, over segments with centre c, mass m, acceleration a and angular momentum H about the
centre; p is the joint. It is the moment that muscles and ligaments bring up; what the weight does to the joint is opposite.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.movement.joint_centres import unit

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Link:
    """One segment, or a load, as it moves."""

    mass_kg: np.ndarray | float
    """Ndarray, shape (n,), or float: over time for what is carried for a while."""
    centre: np.ndarray
    """Shape (n, 3): centre of mass, metres."""
    axis: np.ndarray | None = None
    """Shape (n, 3), or None: along the segment, any length; None for a point mass."""
    gyration_m: float = 0.0
    """Radius of gyration across the axis about the centre, metres."""


def spin_moment(axis: np.ndarray, rate: float) -> np.ndarray:
    """Rate of change of u × u̇ of a slender body's axis, u × ü, shape (n, 3) in 1/s²; m·k² times it is dH/dt.

    A slender body has no moment of inertia along its axis, so that its angular momentum is m·k²·(u × u̇) with the unit vector u.
    """
    direction = unit(axis)
    return np.cross(direction, derivative(direction, rate, 2))


def net_moment(joint: np.ndarray, links: Iterable[Link], rate: float, gravity: float) -> np.ndarray:
    """Moment that acts at a joint upon all links above it, shape (n, 3) in N·m.

    Parameters
    ----------
    joint : ndarray, shape (n, 3)
        Metres; it may move.
    links : iterable of Link
        All that the joint carries, z up.
    rate : float
        Frames per second; accelerations are central differences of filtered positions.
    gravity : float
        m/s².
    """
    total = np.zeros_like(joint)
    for link in links:
        mass = np.reshape(link.mass_kg, (-1, 1))
        force = mass * (derivative(link.centre, rate, 2) + gravity * UP)
        total = total + np.where(mass > 0, np.cross(link.centre - joint, force), 0.0)
        if link.axis is not None and link.gyration_m:
            total = total + mass * link.gyration_m**2 * spin_moment(link.axis, rate)
    return total
