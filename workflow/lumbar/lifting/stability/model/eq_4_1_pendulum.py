"""The damped pendulum of Eq. 4.1 about a reference trajectory, for many pendulums at once.

    I·θ̈ + b·θ̇ + σ·m·g·ℓ·sin θ = u,      I = m·ℓ²

σ = +1 is the equation as it is published: a hanging pendulum, although the thesis calls it inverted. σ =
−1 is the inverted one. With u = u0(t) − K(t)·x̄ the error x̄ = (e, ω) about the reference obeys

    ė = ω,   ω̇ = a21·e + a22·ω − K·x̄/I − (σ·m·g·ℓ/I)·h(e),   h(e) = sin(θ0 + e) − sin θ0 − e·cos θ0

in which h holds everything that the linearisation (Eq. 4.3) leaves out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.lifting.stability.model.trajectories import Trajectory

SIGNS = {"hanging": 1.0, "inverted": -1.0}
"""Sign σ of the gravity term."""


@dataclass(frozen=True)
class Pendulums:
    """Pendulums that are computed together."""

    labels: tuple[str, ...]
    """One per pendulum, for messages."""
    inertia: np.ndarray
    """Shape (pendulums,): m·ℓ² in kg·m²."""
    damping: np.ndarray
    """Shape (pendulums,): b in N·m·s/rad."""
    gravity_torque: np.ndarray
    """Shape (pendulums,): σ·m·g·ℓ in N·m, with its sign."""
    duration: np.ndarray
    """Shape (pendulums,): length T of each trajectory in seconds."""
    angle: np.ndarray
    """Shape (points, pendulums): θ0 in rad on an even grid from t = 0 to T: the knots and the points halfway between them.
    """

    def linearisation(self, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a21, a22 and b2 of A = [[0, 1], [a21, a22]] and B = [0, b2] (Eq. 4.3)."""
        return (
            -self.gravity_torque * np.cos(angle) / self.inertia,
            -self.damping / self.inertia,
            1 / self.inertia,
        )


def pendulum_label(trajectory: Trajectory, sign: str) -> str:
    """Return what messages and `lumbar.base.errors.NumericalError.label` call the pendulum of a trajectory."""
    return f"{trajectory.label} ({sign})"


def gather(
    trajectories: Sequence[Trajectory],
    sign: str | Sequence[str],
    damping: float | np.ndarray,
    gravity: float,
    knots: int,
) -> Pendulums:
    """Put trajectories on one grid, scaled to their length.

    Parameters
    ----------
    sign : {"hanging", "inverted"} or sequence of them
        Of all trajectories, or one per trajectory; `damping` likewise.
    damping : float or numpy.ndarray
        b in N·m·s/rad.
    gravity : float
        Gravitational acceleration in m/s².
    knots : int
        Points in time at which the basin is computed (the thesis: 1000).
    """
    from scipy.interpolate import CubicSpline

    signs = [sign] * len(trajectories) if isinstance(sign, str) else sign
    phase = np.linspace(0.0, 1.0, 2 * knots - 1)
    mass, length = (
        np.array([getattr(item, name) for item in trajectories]) for name in ("mass_kg", "length_m")
    )
    angle = [
        CubicSpline((item.time - item.time[0]) / item.duration, item.angle)(phase) for item in trajectories
    ]
    return Pendulums(
        labels=tuple(pendulum_label(item, sign) for item, sign in zip(trajectories, signs, strict=True)),
        inertia=mass * length**2,
        damping=np.full(len(trajectories), damping, dtype=float),
        gravity_torque=np.array([SIGNS[sign] for sign in signs]) * mass * gravity * length,
        duration=np.array([item.duration for item in trajectories]),
        angle=np.stack(angle, axis=1),
    )


def feedforward_torque(trajectory: Trajectory, sign: str, damping: float, gravity: float) -> np.ndarray:
    """Return u0(t) in N·m by inverse dynamics of the reference states (Eq. 4.1)."""
    inertia = trajectory.mass_kg * trajectory.length_m**2
    gravity_torque = SIGNS[sign] * trajectory.mass_kg * gravity * trajectory.length_m
    return (
        inertia * trajectory.angular_acceleration
        + damping * trajectory.angular_velocity
        + gravity_torque * np.sin(trajectory.angle)
    )


def remainder(angle: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return h(e) = sin(θ0 + e) − sin θ0 − e·cos θ0, without cancellation for small e."""
    return np.cos(angle) * (np.sin(error) - error) - 2 * np.sin(angle) * np.sin(error / 2) ** 2
