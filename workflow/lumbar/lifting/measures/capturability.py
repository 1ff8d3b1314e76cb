"""Capturability: whether a person can come to rest without a step, with feet of finite size and ankles of finite strength.

Two models, both exact. The *linear* inverted pendulum comes to rest without a step if and only if its instantaneous capture
point x + v·√(z/g) lies within the places where its centre of pressure can be (Koolen et al., Int. J. Robotics Research 31
(2012) 1094-1113, the model with a finite foot). The *nonlinear* pendulum with a limited torque,
m l² θ̈ = m g l sin θ − τ, |τ| within the limits, comes to rest if and only if full braking stops it before the angle θ* at
which gravity wins, sin θ* = τ/(m g l): energy gives the largest speed at every angle in closed form.
"""

from __future__ import annotations

import numpy as np

from lumbar.lifting.measures.base_of_support import BaseOfSupport
from lumbar.lifting.measures.extrapolated_centre import pendulum_rate
from lumbar.lifting.measures.strength import AnkleTorques


def capture_margin(
    offset: np.ndarray,
    velocity: np.ndarray,
    height: np.ndarray,
    ahead: np.ndarray,
    behind: np.ndarray,
    gravity: float,
) -> np.ndarray:
    """Distance of the instantaneous capture point to the nearer end of where the centre of pressure can be, metres.

    Parameters
    ----------
    offset, velocity : ndarray, shape (n,)
        Of the centre of mass from the pivot along one horizontal axis, m and m/s.
    height : ndarray, shape (n,)
        Of the centre of mass above the pivot, metres.
    ahead, behind : ndarray, shape (n,)
        How far the centre of pressure can go from the pivot along the axis and against it, metres.
    gravity : float
        m/s².

    Returns
    -------
    ndarray, shape (n,)
        Positive: 0-step capturable.
    """
    point = offset + velocity / pendulum_rate(height, gravity)
    return np.minimum(ahead - point, behind + point)


def braking_speed(angle: np.ndarray, length: np.ndarray, reach: np.ndarray, gravity: float) -> np.ndarray:
    """Largest angular velocity in rad/s towards positive angles at which full braking still stops the pendulum.

    The stable manifold of the saddle θ* = asin(r/l) of θ̈ = (g/l)·(sin θ − r/l): with the potential
    V(θ) = cos θ + (r/l)·θ, θ̇ = sign(θ* − θ)·√(2(g/l)(V(θ*) − V(θ))). Beyond θ* it is negative: the pendulum must swing back.

    Parameters
    ----------
    angle : ndarray, shape (n,)
        Radians from straight up.
    length : ndarray, shape (n,)
        Metres.
    reach : ndarray, shape (n,)
        Largest braking torque over the weight, metres: how far the centre of pressure can go ahead of the pivot.
    gravity : float
        m/s².
    """
    share = np.clip(reach / length, -1.0, 1.0)
    saddle = np.arcsin(share)
    height = np.cos(saddle) + share * saddle - np.cos(angle) - share * angle
    return np.sign(saddle - angle) * np.sqrt(2 * gravity / length * np.maximum(height, 0.0))


def viability_margin(
    angle: np.ndarray,
    angular_velocity: np.ndarray,
    length: np.ndarray,
    mass: np.ndarray | float,
    ahead: np.ndarray,
    behind: np.ndarray,
    gravity: float,
) -> np.ndarray:
    """Impulse across the pendulum in N·s that just takes it beyond what its torque can stop, towards the nearer side.

    m·l·(θ̇_braking − θ̇); for small angles m·ω0 times the `capture_margin`. Parameters as of `capture_margin` and
    `braking_speed`; `mass` in kilograms.

    Returns
    -------
    ndarray, shape (n,)
        Positive: viable without a step.
    """
    forward = braking_speed(angle, length, ahead, gravity) - angular_velocity
    backward = braking_speed(-angle, length, behind, gravity) + angular_velocity
    return mass * length * np.minimum(forward, backward)


def pressure_limits(
    base: BaseOfSupport,
    ankles: np.ndarray,
    standing: np.ndarray,
    right: np.ndarray,
    weight: np.ndarray | float,
    torques: AnkleTorques,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """How far the centre of pressure can go from the middle of the ankles that stand, by foot size and ankle torque.

    Fore and aft the torques of all standing ankles add up over the weight. Sideways the weight shifts from foot to foot, and
    beyond the outer ankle only that ankle's torque counts (outward inversion, inward eversion where it stands alone).

    Parameters
    ----------
    base : BaseOfSupport
        Of n instants: the whole of what is on the ground.
    ankles : ndarray, shape (n, 2, 2)
        Left and right ankle, horizontal coordinates in metres.
    standing : ndarray of bool, shape (n, 2)
        Which of them stand.
    right : ndarray, shape (n, 2)
        Unit vector to the person's right; forward is to its left by a quarter turn.
    weight : ndarray, shape (n,), or float
        m·g of body and load, newtons.

    Returns
    -------
    dict of str to tuple of ndarray
        By plane (`lumbar.lifting.movement.pendulum_states.PLANES`): along the axis (right, forward) and against it, metres.
    """
    forward = np.stack([-right[:, 1], right[:, 0]], axis=1)
    pivot = middle_of_standing(ankles, standing)
    feet = standing.sum(axis=1)
    across = np.einsum("nfj,nj->nf", ankles - pivot[:, None, :], right)
    outer = np.where(standing, across, -np.inf).max(axis=1), np.where(standing, -across, -np.inf).max(axis=1)
    outer = tuple(np.where(feet > 0, values, np.nan) for values in outer)
    sides = (
        standing[:, 1],
        standing[:, 0],
    )  # to the right of a standing right foot is outward, of a lone left foot inward
    lateral = [
        np.minimum(
            base.reach(pivot, sign * right),
            ankle + np.where(outward, torques.inversion, torques.eversion) / weight,
        )
        for sign, ankle, outward in zip((1, -1), outer, sides, strict=True)
    ]
    sagittal = [
        np.minimum(base.reach(pivot, sign * forward), feet * torque / weight)
        for sign, torque in ((1, torques.plantar_flexion), (-1, torques.dorsiflexion))
    ]
    return {"lateral_bending": (lateral[0], lateral[1]), "flexion_extension": (sagittal[0], sagittal[1])}


def middle_of_standing(ankles: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """Middle of the ankles that stand, shape (n, d): the pivot; NaN where none does.

    Parameters
    ----------
    ankles : ndarray, shape (n, 2, d)
    standing : ndarray of bool, shape (n, 2)
    """
    weight = standing[..., None].astype(float)
    with np.errstate(invalid="ignore"):
        return (np.nan_to_num(ankles) * weight).sum(axis=1) / weight.sum(axis=1)
