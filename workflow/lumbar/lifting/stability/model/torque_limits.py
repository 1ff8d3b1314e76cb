"""Torque limits of a pendulum by foot or hips, and whether its regulator exceeds them, for the page of a lift."""

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops, Pendulums
from lumbar.lifting.stability.model.pendulum_trajectories import Trajectory
from lumbar.settings.lifting import StabilitySettings


def torque_range(item: Trajectory, settings: StabilitySettings) -> tuple[float, float]:
    """Return the smallest and the largest torque u in N·m that foot or hips allow a pendulum.

    About the ankles the centre of pressure of the pendulum's weight must stay under the feet; about the hips (or L5) the limit
    is the strength, in full for each pendulum. Positive torques act forward or to the right.

    Parameters
    ----------
    item : Trajectory
        Trajectory of the pendulum.
    settings : StabilitySettings
        Settings of the study.
    """
    limits, weight = settings.limits, item.mass_kg * settings.pendulum.gravity_m_s2
    if item.plane == "lateral_bending":
        side = weight * limits.feet_half_width_m if item.pivot == "mid_ankle" else limits.hip_abduction_N_m
        return -side, side
    if item.pivot == "mid_ankle":
        return -weight * limits.foot_ahead_m, weight * limits.foot_behind_m
    return -limits.hip_extension_N_m, limits.hip_flexion_N_m


@dataclass(frozen=True)
class Reference:
    """Feedforward torque and motion on the grid of the pendulums; arrays of shape (points, pendulums)."""

    torque: np.ndarray
    """Feedforward torque u0 in N·m."""
    velocity: np.ndarray
    """Angular velocity θ̇0 in rad/s."""


def reference_of(pendulums: Pendulums) -> Reference:
    """Return u0 and θ̇0 of the cubic spline through the knots of θ0 (Eq. 4.1 solved for u).

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums on their grid.
    """
    from scipy.interpolate import CubicSpline

    phase = np.linspace(0.0, 1.0, len(pendulums.angle))
    spline = CubicSpline(phase[::2], pendulums.angle[::2])
    velocity = spline(phase, 1) / pendulums.duration
    acceleration = spline(phase, 2) / pendulums.duration**2
    torque = (
        pendulums.inertia * acceleration
        + pendulums.damping * velocity
        + pendulums.gravity_torque * np.sin(spline(phase))
    )
    return Reference(torque, velocity)


def exceeds(
    loops: ClosedLoops, level: np.ndarray, reference: Reference, lowest: float, highest: float
) -> np.ndarray:
    """Return whether u0 − K·x̄ leaves a range of torques anywhere in a funnel, shape (pendulums,).

    On V = ρ, |K·x̄| is at most √(ρ·K·S⁻¹·Kᵀ).

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    level : numpy.ndarray, shape (knots, pendulums)
        ρ, dimensionless.
    reference : Reference
        Feedforward torque of the same pendulums.
    lowest, highest : float
        Smallest torque of the range in N·m; largest torque of the range in N·m.
    """
    points = slice(None, None, 2)
    s11, s12, s22 = np.moveaxis(loops.cost[points], -1, 0)
    k1, k2 = np.moveaxis(loops.gains[points], -1, 0)
    feedback = (s22 * k1**2 - 2 * s12 * k1 * k2 + s11 * k2**2) / (s11 * s22 - s12**2)
    beyond = np.abs(reference.torque[points] - (highest + lowest) / 2) + np.sqrt(level * feedback)
    return (beyond > (highest - lowest) / 2).any(axis=0)
