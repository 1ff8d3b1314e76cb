"""What the controller follows: the deposit until the push is answered, then the way back to the deposit's start.

Who is pushed does not put the box down in that moment: after the reaction time the posture turns, with least jerk, into the
one from which the deposit began, the box still in the hands, and stays there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.pushes.body import GRAVITY, Bodies, inverse_dynamics
from lumbar.lifting.pushes.motion import DepositMotion


@dataclass(frozen=True)
class References:
    """Motions of several lifts on one grid, one after the other."""

    step: float
    """s between instants."""
    first: np.ndarray
    last: np.ndarray
    """`first`, `last`: shape (lifts,): column of each lift's first and last instant."""
    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    """`angle`, `rate`, `acceleration`: shape (3, columns): of the links, rad, rad/s and rad/s²; at rest in each lift's
    last column."""

    def moment(self, lift: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, ...]:
        """Angle, rate and acceleration at some columns, the last of a lift from its end on; shape (3, n) each."""
        at = np.minimum(column, self.last[lift])
        return self.angle[:, at], self.rate[:, at], self.acceleration[:, at]


def references_of(motions: list[DepositMotion], step: float) -> References:
    """Put motions on a grid of `step` seconds."""
    from scipy.interpolate import CubicHermiteSpline

    parts = []
    for motion in motions:
        time = np.arange(motion.time[0], motion.time[-1], step)
        place = CubicHermiteSpline(motion.time, motion.angle, motion.rate, axis=1)
        speed = CubicHermiteSpline(motion.time, motion.rate, motion.acceleration, axis=1)
        moving = place(time), speed(time), speed(time, 1)
        parts.append([np.hstack([item, item[:, -1:] * (kind == 0)]) for kind, item in enumerate(moving)])
    sizes = np.array([part[0].shape[1] for part in parts])
    last = np.cumsum(sizes) - 1
    return References(
        step, last - sizes + 1, last, *(np.hstack(columns) for columns in zip(*parts, strict=True))
    )


def returning(phase: float, moving: tuple, start: np.ndarray, duration: float) -> tuple[np.ndarray, ...]:
    """Angle, rate and acceleration on the way from a moving posture to one at rest.

    Parameters
    ----------
    phase : float
        From 0, where the way back begins, to 1, where it ends; beyond them it stays.
    moving : tuple of numpy.ndarray, shape (3, n)
        Angle, rate and acceleration of the deposit at that time.
    start : numpy.ndarray, shape (3, n)
        Angles to go back to.
    duration : float
        s of the way back.
    """
    s = min(max(phase, 0.0), 1.0)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    speed = 30 * s**2 * (1 - s) ** 2 / duration
    growth = 60 * s * (1 - s) * (1 - 2 * s) / duration**2
    angle, rate, acceleration = moving
    away = start - angle
    return (
        angle + share * away,
        (1 - share) * rate + speed * away,
        (1 - share) * acceleration - 2 * speed * rate + growth * away,
    )


def target(
    bodies: Bodies, references: References, lift, instant, halves: int, reaction: float, duration: float
) -> tuple:
    """Angle, rate and joint torques that the controller follows `halves` grid steps after the push, shape (3, n) each."""
    moving = references.moment(lift, instant + halves)
    start = references.angle[:, references.first[lift]]
    phase = (halves * references.step - reaction) / duration
    wanted = returning(phase, moving, start, duration) if phase > 0 else moving
    return wanted[0], wanted[1], inverse_dynamics(bodies, *wanted)


def toppling_stiffness(bodies: Bodies) -> np.ndarray:
    """Return the stiffness in N·m/rad that just keeps all above a joint upright, shape (3, bodies): Σ m·g·height."""
    return GRAVITY * np.cumsum(bodies.first_moment[::-1], axis=0)[::-1]


def joint(values: np.ndarray) -> np.ndarray:
    """Return joint angles (or rates) of links' angles, shape (3, ...)."""
    return np.concatenate([values[:1], values[1:] - values[:-1]])
