"""Basins with limited torque and uncertain mass: the exact method for the loop as it really is.

The torque is u = clip(u0 + ū, −U, U) with ū = −K·x̄, the mass anywhere in an interval about the nominal m for
which u0 and K were computed. With r = m/m_true the error obeys the nominal equation plus

    Δω̇ = (r·(u − b·(θ̇0 + ω)) − (u0 + ū − b·(θ̇0 + ω)))/I

(gravity and ℓ²: g/ℓ does not depend on the mass). It is affine in r, so that the largest V̇ over all masses is
that of the lightest or the heaviest. With a wrong mass the reference itself is no solution, Δω̇ ≠ 0 at x̄ = 0:
where the goal set is too small for that, there is no basin.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import (
    FunnelVariants,
    distinct_variants,
    integrate_backward,
    variants_of,
)
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, remainder
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, NormalForm, normal_axes

SAMPLES = 96
POSITION = np.linspace(0.0, 2 * np.pi, SAMPLES, endpoint=False)
SECTORS = 8
ZOOMS = 4
OFFSETS = np.linspace(-1.0, 1.0, 9)
LEAST_LEVEL = 1e-6
"""Share of ρ(T) below which the basin counts as lost."""


@dataclass(frozen=True)
class Saturation:
    """What the real loop adds to the nominal one."""

    torque: float | np.ndarray = np.inf
    """U in N·m, one for all pendulums or shape (pendulums,); infinite for none."""
    mass_share: float = 0.0
    """The true mass lies within m·(1 ± this share)."""
    bias: float | np.ndarray = 0.0
    """Middle of the torques allowed in N·m: |u − bias| ≤ U; likewise. Only with a mass that is known."""

    def __post_init__(self):
        if np.any(self.bias) and self.mass_share:
            raise InputError(
                "torques that are not limited alike to both sides, and an uncertain mass: one at a time"
            )
        if not np.all(np.greater(self.torque, 0)):
            raise InputError(f"torque limit: {np.min(self.torque):g} N·m; it must be positive")
        if not 0 <= self.mass_share < 1:
            raise InputError(f"uncertain mass: share {self.mass_share:g}; it must lie in [0, 1)")

    def __str__(self) -> str:
        parts = []
        if np.isfinite(self.torque):
            low, high = self.bias - self.torque, self.bias + self.torque
            parts = [f"{low:.4g} ≤ u ≤ {high:.4g} N·m" if self.bias else f"|u| ≤ {self.torque:g} N·m"]
        parts += [f"mass ±{100 * self.mass_share:g} %"] if self.mass_share else []
        return ", ".join(parts) or "no limits"

    def of(self, index: int) -> Saturation:
        """Return that of one pendulum."""
        torque, bias = (np.ravel(value)[index if np.ndim(value) else 0] for value in (self.torque, self.bias))
        return Saturation(float(torque), self.mass_share, float(bias))

    @property
    def active(self) -> bool:
        """Whether there are any."""
        return bool(np.isfinite(self.torque).any() or self.mass_share)

    @property
    def ratios(self) -> tuple[float, float]:
        """m/m_true of the heaviest and the lightest mass."""
        return 1 / (1 + self.mass_share), 1 / (1 - self.mass_share)


UNSATURATED = Saturation()


@dataclass(frozen=True)
class SaturationReference:
    """Feedforward less bias, and motion, on the grid of a pendulum; arrays of shape (points, pendulums).

    With a known mass only torques less the bias matter: clip(u, −a, b) = c + clip(u − c, −U, U), U = (a + b)/2, c = (b − a)/2.
    """

    torque: np.ndarray
    velocity: np.ndarray


def reference_of(pendulums: Pendulums, bias: float | np.ndarray = 0.0) -> SaturationReference:
    """Return u0 less the bias and θ̇0 of the cubic spline through the knots of θ0 (Eq. 4.1 solved for u).

    The spline is the interpolant about which `interval_proof` proves: its second derivative, and with it the
    saturated torque, is that of no finer one.
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
    return SaturationReference(torque - bias, velocity)


def saturated_funnels(
    loops: ClosedLoops,
    terminal_level: float,
    saturation: Saturation,
    negative_control: float = 0.0,
) -> FunnelVariants:
    """Compute the largest invariant funnels of V under limits, with the true sine.

    `terminal_level` is ρ(T), `negative_control` as for `funnel_variants`.

    Raises
    ------
    NumericalError
        The feedforward alone leaves the limits, no basin is left, or one reaches too far; names the pendulum.
    """
    reference = reference_of(loops.pendulums, saturation.bias)
    require_torque(loops.pendulums, reference, saturation)
    floor = np.log(terminal_level * LEAST_LEVEL)
    changes, which = distinct_variants(0.0, negative_control)

    def slope(point, log_level):
        # Below the floor the basin is lost; the rate there must only stay finite.
        level = np.exp(np.clip(log_level, floor, None))
        growth = saturated_growth(loops, point, level, saturation, reference)
        rate = growth - changes[:, 1:] * np.abs(growth)
        return np.where(log_level > floor, np.minimum(rate, 1e3), 0.0)

    goal = np.full((len(changes), len(loops.pendulums.labels)), np.log(terminal_level))
    level = np.exp(integrate_backward(loops, goal, slope)[:, which])
    require_basin(loops, level[:, 0], terminal_level, saturation)
    return variants_of(loops, level, 0.0)


def require_basin(
    loops: ClosedLoops, level: np.ndarray, terminal_level: float, saturation: Saturation
) -> None:
    """Refuse funnels whose ρ, shape (..., pendulums), has fallen to nothing."""
    lost = ~(level > LEAST_LEVEL * terminal_level).reshape(-1, level.shape[-1]).all(axis=0)
    if lost.any():
        index = int(lost.argmax())
        raise NumericalError(
            f"{loops.pendulums.labels[index]}: {saturation.of(index)}: no basin of the goal set is left (ρ falls below "
            f"{LEAST_LEVEL:g} of its value there)"
        )


def require_torque(pendulums: Pendulums, reference: SaturationReference, saturation: Saturation) -> None:
    """Refuse references whose feedforward itself lies beyond the torque limit."""
    peak = np.abs(reference.torque).max(axis=0)
    if (peak > saturation.torque).any():
        index = int((peak - saturation.torque).argmax())
        limit = saturation.of(index)
        reason = f"reaches {peak[index]:.4g} N·m; the limit is {limit.torque:g} N·m"
        if limit.bias:
            reason = f"leaves its limits, {limit}, by {peak[index] - limit.torque:.4g} N·m"
        raise NumericalError(f"{pendulums.labels[index]}: the feedforward torque {reason}")


def saturated_growth(
    loops: ClosedLoops, point: int, level: np.ndarray, saturation: Saturation, reference: SaturationReference
) -> np.ndarray:
    """Return the largest V̇/ρ on V = ρ over all masses, shape as `level`: (..., pendulums)."""
    boundary = _Boundary(loops, point, level, saturation, reference)
    values = boundary.growth(POSITION)
    best = values.reshape(*level.shape, SECTORS, -1).argmax(axis=-1)
    best += np.arange(SECTORS) * (SAMPLES // SECTORS)
    centre, width = POSITION[best], 2 * np.pi / SAMPLES
    result = values.max(axis=-1)
    for _ in range(ZOOMS):
        nearby = centre[..., None] + width * OFFSETS
        values = boundary.growth(nearby.reshape(*level.shape, -1)).reshape(nearby.shape)
        centre = np.take_along_axis(nearby, values.argmax(axis=-1)[..., None], -1)[..., 0]
        result = np.maximum(result, values.max(axis=(-1, -2)))
        width /= 4
    return result


class _Boundary:
    """V̇/ρ on V = ρ at one point of the grid; entries have shape (..., pendulums, 1)."""

    def __init__(self, loops, point, level, saturation, reference):
        self._form = NormalForm(*(part[:, None] for part in vars(loops.form(point)).values()))
        root = np.sqrt(level)[..., None]
        self._axes = [root * axis[:, None] for axis in normal_axes(loops.cost[point])]
        self._kappa = self._form.coupling / root
        self._weight = 2 * np.sqrt(loops.cost[point][:, 2])[:, None] / root
        ratios = sorted(set(saturation.ratios))
        self._changes = [
            partial(extra_acceleration, loops, reference, saturation.torque, ratio, point) for ratio in ratios
        ]

    def growth(self, position: np.ndarray) -> np.ndarray:
        """Return it at angles φ, the largest of both extreme masses, shape (..., pendulums, angles)."""
        form, (a, p, q) = self._form, self._axes
        c, s = np.cos(position), np.sin(position)
        error = a * c
        state = error, p * c + q * s
        quadratic = (form.alpha * c + 2 * form.beta * s) * c + form.gamma * s**2
        nominal = -quadratic - self._kappa * s * remainder(form.angle, error)
        first, *others = (self._weight * s * change(state) for change in self._changes)
        return nominal + reduce(np.maximum, others, first)


def extra_acceleration(
    loops: ClosedLoops, reference: SaturationReference, torque, ratio, point: int, state
) -> np.ndarray:
    """Return Δω̇ in rad/s² for m/m_true = `ratio`; each of the two states has shape (..., pendulums, states).

    `torque` is U, a number or of shape (pendulums,).
    """
    pendulums = loops.pendulums
    k1, k2 = (loops.gains[point][:, entry, None] for entry in (0, 1))
    wanted = reference.torque[point][:, None] - k1 * state[0] - k2 * state[1]
    torque = np.asarray(torque)[..., None]
    applied = np.minimum(np.maximum(wanted, -torque), torque)
    if np.ndim(ratio) == 0 and ratio == 1:
        return (applied - wanted) / pendulums.inertia[:, None]
    drag = pendulums.damping[:, None] * (reference.velocity[point][:, None] + state[1])
    return (ratio * (applied - drag) - (wanted - drag)) / pendulums.inertia[:, None]


def disturbance_of(loops: ClosedLoops, saturation: Saturation, starts: int, seed: list[int]):
    """Return the disturbance for `monte_carlo_check`: a mass for every start, half of them an extreme one."""
    reference = reference_of(loops.pendulums, saturation.bias)
    generator = np.random.default_rng(seed)
    low, high = saturation.ratios
    ratio = 1 / generator.uniform(1 / high, 1 / low, starts)
    ratio[::4], ratio[1::4] = low, high
    ratio = ratio if saturation.mass_share else 1.0

    def disturbance(point, state):
        return extra_acceleration(loops, reference, saturation.torque, ratio, point, state)

    return disturbance
