"""Basins with limited torque and uncertain mass: the exact engine for the loop as it really is.

The torque is u = clip(u0 + ū, −U, U) with ū = −K·x̄, the mass anywhere in an interval about the nominal m for
which u0 and K were computed. With r = m/m_true the error obeys the nominal equation plus

    Δω̇ = (r·(u − b·(θ̇0 + ω)) − (u0 + ū − b·(θ̇0 + ω)))/I

(gravity and ℓ²: g/ℓ does not depend on the mass). It is affine in r, so that the largest V̇ over all masses is
that of the lightest or the heaviest. With a wrong mass the reference itself is no solution, Δω̇ ≠ 0 at x̄ = 0:
where the goal set is too small for that, there is no basin, and `LimitedFunnels.held` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.errors import InputError
from lumbar.stability.funnel import ClosedLoops, Funnels, integrate_backward
from lumbar.stability.invariance import normal_axes
from lumbar.stability.pendulum import Pendulums, remainder

SAMPLES = 96
SECTORS = 8
ZOOMS = 4
LEAST_LEVEL = 1e-6
"""Share of ρ(T) below which the basin counts as lost."""


@dataclass(frozen=True)
class Limits:
    """What the real loop adds to the nominal one.

    Attributes
    ----------
    torque : float
        U in N·m; infinite for none.
    mass_share : float
        The true mass lies within m·(1 ± this share).
    """

    torque: float = np.inf
    mass_share: float = 0.0

    def __post_init__(self):
        if not self.torque > 0:
            raise InputError(f"torque limit: {self.torque:g} N·m; it must be positive")
        if not 0 <= self.mass_share < 1:
            raise InputError(f"uncertain mass: share {self.mass_share:g}; it must lie in [0, 1)")

    @property
    def ratios(self) -> tuple[float, float]:
        """m/m_true of the heaviest and the lightest mass."""
        return 1 / (1 + self.mass_share), 1 / (1 - self.mass_share)


@dataclass(frozen=True)
class Reference:
    """Feedforward and motion on the grid of a pendulum; arrays of shape (points, pendulums)."""

    torque: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True)
class LimitedFunnels:
    """Largest funnels under `Limits`.

    Attributes
    ----------
    funnels : Funnels
        Meaningful where `held`.
    held : numpy.ndarray of bool, shape (pendulums,)
        Whether there is a basin: the feedforward lies within the limit and ρ stays above `LEAST_LEVEL`.
    """

    funnels: Funnels
    held: np.ndarray


def reference_of(pendulums: Pendulums) -> Reference:
    """Return u0 and θ̇0 of the cubic spline through the grid of θ0 (equation 4.1 solved for u)."""
    from scipy.interpolate import CubicSpline

    phase = np.linspace(0.0, 1.0, len(pendulums.angle))
    spline = CubicSpline(phase, pendulums.angle)
    velocity = spline(phase, 1) / pendulums.duration
    acceleration = spline(phase, 2) / pendulums.duration**2
    torque = (
        pendulums.inertia * acceleration
        + pendulums.damping * velocity
        + pendulums.gravity_torque * np.sin(pendulums.angle)
    )
    return Reference(torque, velocity)


def limited_funnels(loops: ClosedLoops, goal_level: float, limits: Limits) -> LimitedFunnels:
    """Compute the largest invariant funnels of V under limits, with the true sine.

    Parameters
    ----------
    loops : ClosedLoops
    goal_level : float
        ρ(T).
    limits : Limits
    """
    reference = reference_of(loops.pendulums)
    floor = np.log(goal_level * LEAST_LEVEL)

    def slope(point, log_level):
        # Below the floor the basin is lost; the rate there must only stay finite.
        level = np.exp(np.clip(log_level, floor, None))
        rate = limited_growth(loops, point, level, limits, reference)
        return np.where(log_level > floor, np.minimum(rate, 1e3), 0.0)

    log_level = integrate_backward(loops, np.full(len(loops.pendulums.labels), np.log(goal_level)), slope)
    within = np.abs(reference.torque).max(axis=0) <= limits.torque
    funnels = Funnels("limited", loops.pendulums.duration, loops.cost[::2], np.exp(log_level))
    return LimitedFunnels(funnels, within & (log_level > floor).all(axis=0))


def limited_growth(
    loops: ClosedLoops, point: int, level: np.ndarray, limits: Limits, reference: Reference
) -> np.ndarray:
    """Return the largest V̇/ρ on V = ρ over all masses, shape (pendulums,)."""
    position = np.linspace(0.0, 2 * np.pi, SAMPLES, endpoint=False)
    values = _growth(loops, point, level, limits, reference, position)
    best = values.reshape(len(level), SECTORS, -1).argmax(axis=-1) + np.arange(SECTORS) * (SAMPLES // SECTORS)
    centre, width = position[best], 2 * np.pi / SAMPLES
    result = values.max(axis=-1)
    offsets = np.linspace(-1.0, 1.0, 9)
    for _ in range(ZOOMS):
        nearby = centre[..., None] + width * offsets
        values = _growth(loops, point, level, limits, reference, nearby.reshape(len(level), -1))
        values = values.reshape(nearby.shape)
        centre = np.take_along_axis(nearby, values.argmax(axis=-1)[..., None], -1)[..., 0]
        result = np.maximum(result, values.max(axis=(-1, -2)))
        width /= 4
    return result


def _growth(loops, point, level, limits, reference, position) -> np.ndarray:
    """V̇/ρ at angles φ of the boundary, the largest of both extreme masses, shape (pendulums, angles)."""
    form = loops.form(point)
    c, s = np.cos(position), np.sin(position)
    root = np.sqrt(level)[:, None]
    a, p, q = (axis[:, None] for axis in normal_axes(loops.cost[point]))
    state = np.stack(np.broadcast_arrays(root * a * c, root * (p * c + q * s)))
    sine = remainder(form.angle[:, None], state[0])
    nominal = (
        -(form.alpha[:, None] * c**2 + 2 * form.beta[:, None] * c * s + form.gamma[:, None] * s**2)
        - form.coupling[:, None] / root * s * sine
    )
    weight = 2 * np.sqrt(loops.cost[point][:, 2])[:, None] / root * s
    changes = [
        extra_acceleration(loops, reference, limits.torque, ratio, point, state) for ratio in limits.ratios
    ]
    return nominal + np.maximum(weight * changes[0], weight * changes[1])


def extra_acceleration(
    loops: ClosedLoops, reference: Reference, torque: float, ratio, point: int, state: np.ndarray
) -> np.ndarray:
    """Return Δω̇ in rad/s² for m/m_true = `ratio`, shape (pendulums, states)."""
    pendulums = loops.pendulums
    k1, k2 = (loops.gains[point][:, entry, None] for entry in (0, 1))
    wanted = reference.torque[point][:, None] - k1 * state[0] - k2 * state[1]
    drag = pendulums.damping[:, None] * (reference.velocity[point][:, None] + state[1])
    applied = np.clip(wanted, -torque, torque)
    return (ratio * (applied - drag) - (wanted - drag)) / pendulums.inertia[:, None]


def disturbance_of(loops: ClosedLoops, limits: Limits, starts: int, seed: list[int]):
    """Return the disturbance for `simulation.attack`: a mass for every start, half of them an extreme one."""
    reference = reference_of(loops.pendulums)
    generator = np.random.default_rng(seed)
    low, high = limits.ratios
    ratio = 1 / generator.uniform(1 / high, 1 / low, starts)
    ratio[::4], ratio[1::4] = low, high

    def disturbance(point, state):
        return extra_acceleration(loops, reference, limits.torque, ratio, point, state)

    return disturbance
