"""The damped pendulum of Eq. 4.1 about a reference trajectory, and its regulator (Eqs 4.2 to 4.4), for many pendulums together.

    I·θ̈ + b·θ̇ + σ·m·g·ℓ·sin θ = u,      I = m·ℓ²

σ = +1 is the equation as published: a hanging pendulum, although the thesis calls it inverted. σ = −1 is the inverted one. With
u = u0(t) − K(t)·x̄ the error x̄ = (e, ω) about the reference obeys

    ė = ω,   ω̇ = a21·e + a22·ω − K·x̄/I − (σ·m·g·ℓ/I)·h(e),   h(e) = sin(θ0 + e) − sin θ0 − e·cos θ0

with everything in h that the linearisation (Eq. 4.3) omits.

The differential Riccati equation gives the cost-to-go S, and S gives the feedback K = R⁻¹BᵀS of the finite-horizon
linear-quadratic regulator; `ClosedLoops` has both, and V̇ of V = x̄ᵀSx̄ along the loop in coordinates in which the ellipse V = ρ
is a circle. A symmetric 2×2 matrix is stored as its three entries (s11, s12, s22) along the last axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.pendulum_trajectories import SIGNS, Trajectory, pendulum_label
from lumbar.settings.lifting import RegulatorSettings, StabilitySettings


class LinearPendulum(NamedTuple):
    """Linearised pendulum with A = [[0, 1], [a21, a22]] and B = [0, b2] (Eq. 4.3)."""

    a21: np.ndarray
    """Shape (..., pendulums): entry of A, 1/s²."""
    a22: np.ndarray
    """Shape (pendulums,): entry of A, 1/s."""
    b2: np.ndarray
    """Shape (pendulums,): entry of B, 1/(kg·m²)."""


@dataclass(frozen=True)
class Pendulums:
    """Pendulums that are computed together."""

    labels: tuple[str, ...]
    """Names of the pendulums, for messages."""
    inertia: np.ndarray
    """Shape (pendulums,): m·ℓ² in kg·m²."""
    damping: np.ndarray
    """Shape (pendulums,): b in N·m·s/rad."""
    gravity_torque: np.ndarray
    """Shape (pendulums,): σ·m·g·ℓ in N·m, with its sign."""
    duration: np.ndarray
    """Shape (pendulums,): length T of each trajectory in seconds."""
    angle: np.ndarray
    """Shape (points, pendulums): θ0 in rad on an even grid from t = 0 to T, at the knots and halfway between them."""

    def linearisation(self, angle: np.ndarray) -> LinearPendulum:
        """Return the linearised pendulum (Eq. 4.3) at some angles.

        Parameters
        ----------
        angle : numpy.ndarray, shape (..., pendulums)
            θ0 in rad.
        """
        stiffness = self.gravity_torque * np.cos(angle)
        return LinearPendulum(-stiffness / self.inertia, -self.damping / self.inertia, 1 / self.inertia)


def gather(
    trajectories: Sequence[Trajectory],
    sign: str | Sequence[str],
    damping: float | np.ndarray,
    gravity: float,
    knots: int,
) -> Pendulums:
    """Interpolate trajectories on one grid, scaled to the duration of each.

    Parameters
    ----------
    trajectories : sequence of Trajectory
        Valid trajectories.
    sign : {"hanging", "inverted"} or sequence of them
        Sign of gravity of all trajectories, or one per trajectory.
    damping : float or numpy.ndarray, shape (pendulums,)
        b in N·m·s/rad.
    gravity : float
        Gravitational acceleration in m/s².
    knots : int
        Number of points in time at which the basin is computed (the thesis: 1000).
    """
    from scipy.interpolate import CubicSpline

    signs = [sign] * len(trajectories) if isinstance(sign, str) else sign
    phase = np.linspace(0.0, 1.0, 2 * knots - 1)
    mass, length = (
        np.array([getattr(item, name) for item in trajectories]) for name in ("mass_kg", "length_m")
    )
    splines = [CubicSpline((item.time - item.time[0]) / item.duration, item.angle) for item in trajectories]
    return Pendulums(
        labels=tuple(pendulum_label(item, sign) for item, sign in zip(trajectories, signs, strict=True)),
        inertia=mass * length**2,
        damping=np.full(len(trajectories), damping, dtype=float),
        gravity_torque=np.array([SIGNS[sign] for sign in signs]) * mass * gravity * length,
        duration=np.array([item.duration for item in trajectories]),
        angle=np.stack([spline(phase) for spline in splines], axis=1),
    )


def feedforward_torque(trajectory: Trajectory, sign: str, damping: float, gravity: float) -> np.ndarray:
    """Return u0(t) in N·m by inverse dynamics of the reference states (Eq. 4.1), shape (samples,).

    Parameters
    ----------
    trajectory : Trajectory
        Reference states of one pendulum.
    sign : {"hanging", "inverted"}
        Sign of gravity.
    damping, gravity : float
        b in N·m·s/rad; gravitational acceleration in m/s².
    """
    inertia = trajectory.mass_kg * trajectory.length_m**2
    gravity_torque = SIGNS[sign] * trajectory.mass_kg * gravity * trajectory.length_m
    return (
        inertia * trajectory.angular_acceleration
        + damping * trajectory.angular_velocity
        + gravity_torque * np.sin(trajectory.angle)
    )


def remainder(angle: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return h(e) = sin(θ0 + e) − sin θ0 − e·cos θ0, without cancellation for small e.

    Parameters
    ----------
    angle, error : numpy.ndarray, shape (...)
        θ0 and e in rad, broadcast with each other.
    """
    return np.cos(angle) * (np.sin(error) - error) - 2 * np.sin(angle) * np.sin(error / 2) ** 2


RELATIVE_TOLERANCE = 1e-10
STIFF = 3000.0
"""Least product of fastest rate and duration at which the implicit method is faster than the explicit method."""


@dataclass(frozen=True)
class Weights:
    """Weights of the regulator's dimensionless cost ∫(x̄ᵀQx̄ + R·ū²)dt + x̄(T)ᵀ·Qf·x̄(T)."""

    state: np.ndarray
    """Shape (..., 3): Q, positive semidefinite, in 1/s per rad², rad²/s and rad²/s²."""
    control: np.ndarray
    """Shape (...): R > 0 in 1/(N²·m²·s)."""
    terminal: np.ndarray
    """Shape (..., 3): Qf, positive definite; the goal set is x̄ᵀ·Qf·x̄ ≤ ρ(T)."""

    @classmethod
    def from_settings(cls, settings: RegulatorSettings) -> Weights:
        """Return the weights of a configuration.

        Parameters
        ----------
        settings : RegulatorSettings
            Settings of the regulator.
        """
        matrices = settings.state_weight, settings.terminal_weight
        state, terminal = (np.array([matrix[0][0], *matrix[1]]) for matrix in matrices)
        return cls(state, np.asarray(settings.control_weight), terminal)


def determinant(matrix: np.ndarray) -> np.ndarray:
    """Return the determinants of symmetric 2×2 matrices, shape (...).

    Parameters
    ----------
    matrix : numpy.ndarray, shape (..., 3)
        Entries 11, 12, 22.
    """
    return matrix[..., 0] * matrix[..., 2] - matrix[..., 1] ** 2


def gain(pendulums: Pendulums, control_weight: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K1 (N·m/rad) and K2 (N·m·s/rad) of K = R⁻¹BᵀS (Eq. 4.4), each of shape (..., pendulums).

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    control_weight : numpy.ndarray, shape () or (pendulums,)
        R in 1/(N²·m²·s).
    cost : numpy.ndarray, shape (..., pendulums, 3)
        S.
    """
    scale = 1 / (pendulums.inertia * control_weight)
    return scale * cost[..., 1], scale * cost[..., 2]


def riccati_rate(pendulums: Pendulums, weights: Weights, angle: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Return −Ṡ = Q − SBR⁻¹BᵀS + SA + AᵀS (Eq. 4.2), shape (pendulums, 3).

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    weights : Weights
        Q and R of the regulator.
    angle : numpy.ndarray, shape (pendulums,)
        θ0 in rad.
    cost : numpy.ndarray, shape (pendulums, 3)
        S.
    """
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
    """Integrate the Riccati equation backward from S(T) = Qf, adaptively; S has shape (points, pendulums, 3).

    Method: Dormand–Prince of order 8; Radau's implicit method of order 5 for small inertias, which make the loop stiff.

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    weights : Weights
        Weights of the regulator.

    Raises
    ------
    NumericalError
        If the integration fails or S is not positive definite; the message names the pendulum.
    """
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    points, count = pendulums.angle.shape
    phase = np.linspace(0.0, 1.0, points)
    reference = CubicSpline(phase, pendulums.angle)
    terminal = np.broadcast_to(weights.terminal, (count, 3))

    # Fastest rate of the steady closed loop, √(Q22/R)/I, times the duration: steps that an explicit method needs.
    fastest = np.sqrt(weights.state[..., 2] / weights.control) / pendulums.inertia
    stiffness = float((fastest * pendulums.duration).max())

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
            method="Radau" if stiffness > STIFF else "DOP853",
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


def cost_to_go_euler(pendulums: Pendulums, weights: Weights) -> np.ndarray:
    """Integrate the Riccati equation by Euler's method between knots, as the thesis does; S has shape (knots, pendulums, 3).

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    weights : Weights
        Weights of the regulator.

    Raises
    ------
    NumericalError
        If S is not positive definite (the step is too long for the pendulum's inertia).
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
            f"{remaining:.3g} s before the end",
            label=pendulums.labels[index],
        )


@dataclass(frozen=True)
class NormalForm:
    """Coefficients of V̇/ρ in normal coordinates, without the level ρ; every entry has shape (..., pendulums)."""

    angle: np.ndarray
    """θ0 in rad."""
    amplitude: np.ndarray
    """Largest e on the ellipse V = 1 in rad."""
    alpha: np.ndarray
    """Factor α of −z1² in 1/s."""
    beta: np.ndarray
    """Factor β of −2·z1·z2 in 1/s."""
    gamma: np.ndarray
    """Factor γ of −z2² in 1/s."""
    coupling: np.ndarray
    """Numerator of κ, 2·(σmgℓ/I)·√s22 in 1/s: κ is `coupling` divided by √ρ."""


class NormalAxes(NamedTuple):
    """Coefficients of the ellipse x̄ᵀSx̄ = 1: e = a·z1, ω = p·z1 + q·z2 with z on the unit circle."""

    a: np.ndarray
    """Shape (...): factor of z1 in e, rad."""
    p: np.ndarray
    """Shape (...): factor of z1 in ω, rad/s."""
    q: np.ndarray
    """Shape (...): factor of z2 in ω, rad/s."""


def normal_axes(cost: np.ndarray) -> NormalAxes:
    """Return the axes of the ellipses of S, each of shape (...).

    Parameters
    ----------
    cost : numpy.ndarray, shape (..., 3)
        S.
    """
    s12, s22 = cost[..., 1], cost[..., 2]
    amplitude = np.sqrt(s22 / determinant(cost))
    return NormalAxes(amplitude, -amplitude * s12 / s22, 1 / np.sqrt(s22))


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
        """Time between knots in s, shape (pendulums,)."""
        return self.pendulums.duration / (self.knots - 1)

    def form(self, point) -> NormalForm:
        """Return V̇/ρ in normal coordinates at some points of the grid.

        Parameters
        ----------
        point : int or slice
            Points of the grid.
        """
        return NormalForm(**{name: values[point] for name, values in vars(self._form).items()})

    @cached_property
    def _form(self) -> NormalForm:
        m11, m12, m22 = np.moveaxis(self.decay, -1, 0)
        a, p, q = normal_axes(self.cost)
        return NormalForm(
            angle=self.pendulums.angle,
            amplitude=a,
            alpha=m11 * a**2 + 2 * m12 * a * p + m22 * p**2,
            beta=(m12 * a + m22 * p) * q,
            gamma=m22 * q**2,
            coupling=2 * self.pendulums.gravity_torque / self.pendulums.inertia * np.sqrt(self.cost[..., 2]),
        )

    def select(self, index: np.ndarray) -> ClosedLoops:
        """Return the loops of some pendulums.

        Parameters
        ----------
        index : numpy.ndarray, shape (selected,)
            Indices of the pendulums, which may repeat.
        """
        labels = tuple(self.pendulums.labels[number] for number in index)
        arrays = {
            name: values[..., index] for name, values in vars(self.pendulums).items() if name != "labels"
        }
        # Weights are shared by all pendulums, or have one row for each.
        shared = ((self.weights.state, 1), (self.weights.control, 0), (self.weights.terminal, 1))
        weights = Weights(*(part[index] if part.ndim > least else part for part, least in shared))
        parts = (part[:, index] for part in (self.cost, self.decay, self.gains))
        return ClosedLoops(Pendulums(labels, **arrays), weights, *parts)


def regulate(pendulums: Pendulums, weights: Weights) -> ClosedLoops:
    """Close the loop with the finite-horizon regulator (Eqs 4.2 and 4.4).

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    weights : Weights
        Weights of the regulator.
    """
    return close_with_cost(pendulums, weights, cost_to_go(pendulums, weights))


def close_with_cost(pendulums: Pendulums, weights: Weights, cost: np.ndarray) -> ClosedLoops:
    """Close the loop with the feedback from a given solution of the Riccati equation.

    Parameters
    ----------
    pendulums : Pendulums
        Pendulums that are computed together.
    weights : Weights
        Weights of the regulator.
    cost : numpy.ndarray, shape (points, pendulums, 3)
        S on the grid of ``pendulums.angle``.
    """
    k1, k2 = gain(pendulums, weights.control, cost)
    # Q + SBR⁻¹BᵀS = Q + KᵀRK: V falls along the linear loop as V̇ = −x̄ᵀ(Q + KᵀRK)x̄.
    feedback = np.asarray(weights.control)[..., None] * np.stack([k1**2, k1 * k2, k2**2], axis=-1)
    return ClosedLoops(pendulums, weights, cost, weights.state + feedback, np.stack([k1, k2], axis=-1))


def close_loops(
    trajectories: Sequence[Trajectory], sign: str | Sequence[str], settings: StabilitySettings
) -> ClosedLoops:
    """Close the loops of trajectories with the regulator of the configuration.

    Parameters
    ----------
    trajectories : sequence of Trajectory
        Valid trajectories.
    sign : {"hanging", "inverted"} or sequence of them
        Sign of gravity of all trajectories, or one per trajectory.
    settings : StabilitySettings
        Settings of the study.
    """
    given = settings.pendulum
    pendulums = gather(trajectories, sign, given.damping_N_m_s, given.gravity_m_s2, settings.knots)
    return regulate(pendulums, Weights.from_settings(settings.regulator))
