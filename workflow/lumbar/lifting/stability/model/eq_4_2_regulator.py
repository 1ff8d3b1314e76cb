"""Pendulums under their finite-horizon linear-quadratic regulator (Eqs 4.2 to 4.4), many at once.

The differential Riccati equation gives the cost-to-go S, S the feedback K = R⁻¹BᵀS; `ClosedLoops` holds both, and how V =
x̄ᵀSx̄ changes along the loop in the coordinates in which the ellipse V = ρ is a circle. A symmetric 2×2 matrix is held as
its three entries (s11, s12, s22) along the last axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, gather
from lumbar.lifting.stability.model.trajectories import Trajectory
from lumbar.settings.stability import RegulatorSettings, StabilitySettings

RELATIVE_TOLERANCE = 1e-10
STIFF = 3000.0
"""Fastest rate times duration from which the implicit method is quicker than the explicit one."""


@dataclass(frozen=True)
class Weights:
    """Weights of the regulator's cost ∫(x̄ᵀQx̄ + R·ū²)dt + x̄(T)ᵀ·Qf·x̄(T), made dimensionless."""

    state: np.ndarray
    """Shape (..., 3): Q, positive semidefinite; per second and per rad², rad²/s and rad²/s²."""
    control: np.ndarray
    """Shape (...): R > 0 in 1/(N²·m²·s)."""
    terminal: np.ndarray
    """Shape (..., 3): qf, positive definite; with ρ(T) it is the goal set x̄ᵀ·Qf·x̄ ≤ ρ(T)."""

    @classmethod
    def of(cls, settings: RegulatorSettings) -> Weights:
        """Return the weights of a configuration."""
        state, terminal = (
            np.array([matrix[0][0], matrix[0][1], matrix[1][1]])
            for matrix in (settings.state_weight, settings.terminal_weight)
        )
        return cls(state, np.asarray(settings.control_weight), terminal)


def determinant(matrix: np.ndarray) -> np.ndarray:
    """Return the determinant of symmetric 2×2 matrices of shape (..., 3)."""
    return matrix[..., 0] * matrix[..., 2] - matrix[..., 1] ** 2


def gain(pendulums: Pendulums, control_weight: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K1 (N·m/rad) and K2 (N·m·s/rad) of K = R⁻¹BᵀS (Eq. 4.4); `cost` has shape (..., 3)."""
    scale = 1 / (pendulums.inertia * control_weight)
    return scale * cost[..., 1], scale * cost[..., 2]


def decay_matrix(pendulums: Pendulums, weights: Weights, cost: np.ndarray) -> np.ndarray:
    """Return Q + SBR⁻¹BᵀS = Q + KᵀRK: how fast V falls along the linear loop, V̇ = −x̄ᵀ(Q + KᵀRK)x̄."""
    first, second = gain(pendulums, weights.control, cost)
    feedback = np.stack([first**2, first * second, second**2], axis=-1)
    return weights.state + np.asarray(weights.control)[..., None] * feedback


def riccati_rate(pendulums: Pendulums, weights: Weights, angle: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Return −Ṡ = Q − SBR⁻¹BᵀS + SA + AᵀS (Eq. 4.2), shape (pendulums, 3)."""
    a21, a22, b2 = pendulums.linearisation(angle)
    s11, s12, s22 = np.moveaxis(cost, -1, 0)
    control = b2**2 / weights.control
    rate = np.stack(
        [
            2 * s12 * a21 - control * s12**2,
            s11 + s12 * a22 + s22 * a21 - control * s12 * s22,
            2 * (s12 + s22 * a22) - control * s22**2,
        ],
        axis=-1,
    )
    return rate + weights.state


def cost_to_go(pendulums: Pendulums, weights: Weights) -> np.ndarray:
    """Integrate the Riccati equation backward from S(T) = Qf, adaptively.

    Dormand–Prince of order 8, or for small inertias, whose loop is stiff, Radau's implicit method of order 5.

    S has shape (points, pendulums, 3), on the grid of ``pendulums.angle``.

    Raises
    ------
    NumericalError
        The integration failed or S lost its definiteness; names the pendulum.
    """
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    points, count = pendulums.angle.shape
    phase = np.linspace(0.0, 1.0, points)
    reference = CubicSpline(phase, pendulums.angle)
    terminal = np.broadcast_to(weights.terminal, (count, 3))

    # Time runs backward from T and is scaled to each trajectory's length: remaining = 1 − t/T.
    def backward(remaining, flat):
        rate = riccati_rate(pendulums, weights, reference(1.0 - remaining), flat.reshape(count, 3))
        return (pendulums.duration[:, None] * rate).ravel()

    # A trial step too long for a small inertia may overflow; the solver rejects it and halves the step.
    with np.errstate(over="ignore", invalid="ignore"):
        solution = solve_ivp(
            backward,
            (0.0, 1.0),
            terminal.ravel(),
            method="Radau" if _stiffness(pendulums, weights) > STIFF else "DOP853",
            t_eval=phase,
            rtol=RELATIVE_TOLERANCE,
            atol=RELATIVE_TOLERANCE * float(np.abs(terminal).max()),
        )
    if not solution.success:
        raise NumericalError(
            f"Riccati equation of {pendulums.labels[0]} and {count - 1} more: {solution.message}"
        )
    cost = solution.y.T.reshape(points, count, 3)[::-1]
    _require_definite(pendulums, cost)
    return cost


def _stiffness(pendulums: Pendulums, weights: Weights) -> float:
    """Fastest rate of the steady closed loop, √(Q22/R)/I, times the duration: steps that an explicit method needs."""
    rate = np.sqrt(weights.state[..., 2] / weights.control) / pendulums.inertia
    return float((rate * pendulums.duration).max())


def cost_to_go_euler(pendulums: Pendulums, weights: Weights) -> np.ndarray:
    """Integrate the Riccati equation by Euler's method from knot to knot, as the thesis does.

    S has shape (knots, pendulums, 3), at the knots (every other point of ``pendulums.angle``).

    Raises
    ------
    NumericalError
        S lost its definiteness (a step too long for the pendulum's inertia).
    """
    angle = pendulums.angle[::2]
    cost = np.empty((*angle.shape, 3))
    cost[-1] = weights.terminal
    step = pendulums.duration[:, None] / (len(angle) - 1)
    with np.errstate(over="ignore", invalid="ignore"):
        for knot in range(len(angle) - 1, 0, -1):
            cost[knot - 1] = cost[knot] + step * riccati_rate(pendulums, weights, angle[knot], cost[knot])
    _require_definite(pendulums, cost)
    return cost


def _require_definite(pendulums: Pendulums, cost: np.ndarray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        definite = np.isfinite(cost).all(axis=-1) & (cost[..., 0] > 0) & (determinant(cost) > 0)
    if not definite.all():
        point, index = np.argwhere(~definite)[-1]
        remaining = (1 - point / (len(cost) - 1)) * pendulums.duration[index]
        raise NumericalError(
            f"{pendulums.labels[index]}: the solution of the Riccati equation is not positive definite "
            f"{remaining:.3g} s before the end; raise stability.regulator.control_weight or stability.knots",
            label=pendulums.labels[index],
        )


@dataclass(frozen=True)
class NormalForm:
    """V̇/ρ in normal coordinates, apart from the level ρ; every entry has shape (..., pendulums)."""

    angle: np.ndarray
    amplitude: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    gamma: np.ndarray
    coupling: np.ndarray
    """2·(σmgℓ/I)·√s22: κ is this divided by √ρ."""


def normal_form(pendulums: Pendulums, angle: np.ndarray, cost: np.ndarray, decay: np.ndarray) -> NormalForm:
    """Bring the closed loop into normal coordinates.

    Parameters
    ----------
    angle : numpy.ndarray, shape (..., pendulums)
        θ0 in rad.
    cost, decay : numpy.ndarray, shape (..., pendulums, 3)
        S of V = x̄ᵀSx̄ and M = −V̇ of the linear loop.
    """
    s22 = cost[..., 2]
    m11, m12, m22 = np.moveaxis(decay, -1, 0)
    a, p, q = normal_axes(cost)
    return NormalForm(
        angle=angle,
        amplitude=a,
        alpha=m11 * a**2 + 2 * m12 * a * p + m22 * p**2,
        beta=(m12 * a + m22 * p) * q,
        gamma=m22 * q**2,
        coupling=2 * pendulums.gravity_torque / pendulums.inertia * np.sqrt(s22),
    )


def normal_axes(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a, p, q of the ellipse x̄ᵀSx̄ = 1: e = a·z1, ω = p·z1 + q·z2 with z on the unit circle."""
    s12, s22 = cost[..., 1], cost[..., 2]
    amplitude = np.sqrt(s22 / determinant(cost))
    return amplitude, -amplitude * s12 / s22, 1 / np.sqrt(s22)


@dataclass(frozen=True)
class ClosedLoops:
    """Pendulums under their finite-horizon regulator."""

    pendulums: Pendulums
    weights: Weights
    cost: np.ndarray
    """Shape (points, pendulums, 3): S(t) of V = x̄ᵀSx̄ at the knots and halfway between them."""
    decay: np.ndarray
    """Shape (points, pendulums, 3): M(t) of V̇ = −x̄ᵀMx̄ along the linear loop."""
    gains: np.ndarray
    """Shape (points, pendulums, 2): K1 (N·m/rad) and K2 (N·m·s/rad) of the feedback."""

    @property
    def knots(self) -> int:
        """Number of knots: every other point of the grid."""
        return (len(self.cost) + 1) // 2

    @property
    def step(self) -> np.ndarray:
        """Seconds between knots, shape (pendulums,)."""
        return self.pendulums.duration / (self.knots - 1)

    def form(self, point) -> NormalForm:
        """Return V̇/ρ in normal coordinates at points of the grid (an index or a slice)."""
        return NormalForm(*(part[point] for part in self._parts))

    @cached_property
    def _parts(self) -> tuple[np.ndarray, ...]:
        form = normal_form(self.pendulums, self.pendulums.angle, self.cost, self.decay)
        return tuple(vars(form).values())

    def select(self, index: np.ndarray) -> ClosedLoops:
        """Return the loops of these pendulums, which may repeat."""
        given, weights = self.pendulums, self.weights
        arrays = ("inertia", "damping", "gravity_torque", "duration", "angle")
        pendulums = replace(
            given,
            labels=tuple(given.labels[number] for number in index),
            **{name: getattr(given, name)[..., index] for name in arrays},
        )
        own = Weights(
            *(
                part[index] if part.ndim > shared else part
                for part, shared in ((weights.state, 1), (weights.control, 0), (weights.terminal, 1))
            )
        )
        parts = (part[:, index] for part in (self.cost, self.decay, self.gains))
        return ClosedLoops(pendulums, own, *parts)


def regulate(pendulums: Pendulums, weights: Weights) -> ClosedLoops:
    """Close the loop with the finite-horizon regulator (Eqs 4.2 and 4.4)."""
    return with_cost(pendulums, weights, cost_to_go(pendulums, weights))


def with_cost(pendulums: Pendulums, weights: Weights, cost: np.ndarray) -> ClosedLoops:
    """Close the loop with the gain of a given solution S of the Riccati equation."""
    gains = np.stack(gain(pendulums, weights.control, cost), axis=-1)
    return ClosedLoops(pendulums, weights, cost, decay_matrix(pendulums, weights, cost), gains)


def close_loops(
    trajectories: Sequence[Trajectory], sign: str | Sequence[str], settings: StabilitySettings
) -> ClosedLoops:
    """Put the trajectories under the regulator of the configuration; `sign` as of `gather`."""
    given = settings.pendulum
    pendulums = gather(trajectories, sign, given.damping_N_m_s, given.gravity_m_s2, settings.knots)
    return regulate(pendulums, Weights.of(settings.regulator))
