"""Basins of attraction as funnels {x̄ᵀS(t)x̄ ≤ ρ(t)} around a trajectory, and the exact method.

With two states no semidefinite programme is needed. The largest invariant funnel of the given V that ends in the goal set is the
solution, backward from ρ(T), of the scalar equation

    d ln ρ/dt = max over V = ρ of V̇/ρ

with the true sine. The thesis's method (`eqs_4_5_to_4_7_alternation`) returns the same `Funnels`.

The ellipse V = ρ is the unit circle in normal coordinates z, in which z1 is proportional to the angle:

    e = √ρ·a·z1,   ω = √ρ·(p·z1 + q·z2),   a = √(s22/det S),  p = −a·s12/s22,  q = 1/√s22

so that s12·e + s22·ω = √(ρ·s22)·z2 and, along an S(t) with −Ṡ = M + SA_c + A_cᵀS under the linear loop A_c,

    V̇/ρ = −(α·z1² + 2β·z1·z2 + γ·z2²) − κ·z2·h(√ρ·a·z1),   κ = 2·(σmgℓ/I)·√(s22/ρ)

with [[α, β], [β, γ]] = M in normal coordinates (`NormalForm`) and the remainder h of the sine. For the solution of Eq. 4.2
with the feedback of Eq. 4.4 M is Q + SBR⁻¹BᵀS. On the circle this is a function of one angle; its maximum is found by sampling
and Newton's method.

A better V: the controller is fixed, but V need not be its cost. For every share λ in [0, 1] the Lyapunov equation

    −Ṡ = A_cᵀS + SA_c + λ·(Q + KᵀRK),   S(T) = Qf

gives a V = x̄ᵀSx̄. λ = 1 is the Riccati solution, the thesis's V. λ = 0 makes every ellipse the exact preimage of the goal set
under the linear loop: without gravity's nonlinearity no funnel is larger (Liouville). With it the best share is between 0 and 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    ClosedLoops,
    NormalForm,
    determinant,
    normal_axes,
    remainder,
)

SAMPLES, SECTORS = 48, 4
"""Samples on the boundary, and its sectors with one Newton start each, for semi-axes up to `SMALL_SEMI_AXIS_RAD`."""
SMALL_SEMI_AXIS_RAD = 2.0
"""Largest |e| on the ellipse for which `SAMPLES` and `SECTORS` suffice: a wider ellipse has more peaks."""
MAX_DOUBLINGS = 4
"""Largest number of times that samples and sectors are doubled for wider ellipses."""
MAX_SEMI_AXIS_RAD = SMALL_SEMI_AXIS_RAD * 2**MAX_DOUBLINGS
"""Largest |e| for which the maximum is reliable: five turns, more than any useful basin."""
NEWTON_STEPS = 2


@cache
def _circle(samples: int) -> tuple[np.ndarray, ...]:
    """Return cos φ, sin φ, cos²φ, 2·cos φ·sin φ, sin²φ at the samples."""
    position = np.linspace(0.0, 2 * np.pi, samples, endpoint=False)
    c, s = np.cos(position), np.sin(position)
    return c, s, c**2, 2 * c * s, s**2


def boundary_growth(form: NormalForm, level: np.ndarray) -> np.ndarray:
    """Return the largest V̇/ρ on the boundary V = ρ in 1/s, shape (...).

    If it is negative, states on the boundary move inward everywhere; {V ≤ ρ(t)} is invariant as long as ρ̇/ρ is not below it.

    Parameters
    ----------
    form : NormalForm
        V̇/ρ in normal coordinates.
    level : numpy.ndarray, shape (...)
        ρ > 0, dimensionless; additional leading axes are further levels of the same pendulums.
    """
    # Sample the boundary, more densely for wider ellipses.
    root = np.sqrt(level)
    semi_axis, kappa = form.amplitude * root, form.coupling / root
    doublings = int(np.clip(np.ceil(np.log2(semi_axis.max() / SMALL_SEMI_AXIS_RAD)), 0, MAX_DOUBLINGS))
    c, s, c2, cs2, s2 = _circle(SAMPLES << doublings)
    values = kappa[..., None] * s * remainder(form.angle[..., None], semi_axis[..., None] * c)
    values += form.alpha[..., None] * c2
    values += form.beta[..., None] * cs2
    values += form.gamma[..., None] * s2
    np.negative(values, out=values)
    # Climb from the best sample of every sector to its peak: the growth is nearly the same on opposite sides of the ellipse, so
    # the highest sample of all may belong to the lower of two peaks.
    count, samples = SECTORS << doublings, values.shape[-1]
    sectors = values.reshape(*values.shape[:-1], count, samples // count)
    spacing = 2 * np.pi / samples
    start = (sectors.argmax(axis=-1) + np.arange(count) * (samples // count)) * spacing
    polished = _newton(form, semi_axis, kappa, start, spacing)
    return np.maximum(sectors.max(axis=-1), polished).max(axis=-1)


def _newton(
    form: NormalForm, semi_axis: np.ndarray, kappa: np.ndarray, start: np.ndarray, spacing: float
) -> np.ndarray:
    """Climb from each start to its peak and return the heights, shape (..., starts).

    With z = exp iφ the quadratic part of V̇/ρ is −((α + γ)/2 + Re(((α − γ)/2 − iβ)·z²)).
    """
    angle, semi_axis, kappa = form.angle[..., None], semi_axis[..., None], kappa[..., None]
    half = (0.5 * (form.alpha - form.gamma) - 1j * form.beta)[..., None]
    mean = (0.5 * (form.alpha + form.gamma))[..., None]
    sine, cosine = np.sin(angle), np.cos(angle)
    position = start
    for _ in range(NEWTON_STEPS):
        z = np.exp(1j * position)
        quadratic = half * z * z
        s = z.imag
        error, across = semi_axis * z.real, semi_axis * s
        there = np.exp(1j * (angle + error))
        # The remainder of the sine and its slope, with cancellation: it moves the position, not the height.
        h1 = there.real - cosine
        h = there.imag - sine - error * cosine
        slope = 2 * quadratic.imag - kappa * (z.real * h - across * s * h1)
        bend = 4 * quadratic.real + kappa * s * (h + 3 * error * h1 + across * across * there.imag)
        # Steps are taken only if the function bends down, and end at the neighbouring samples.
        step = np.divide(-slope, bend, out=np.zeros_like(slope), where=bend < 0)
        position = position + np.minimum(np.maximum(step, -spacing), spacing)
    z = np.exp(1j * position)
    return -mean - (half * z * z).real - kappa * z.imag * remainder(angle, semi_axis * z.real)


KINK = 1e-7
"""Least difference of predicted and corrected change of ln ρ per knot that indicates a kink."""


@dataclass(frozen=True)
class Funnels:
    """Basins of attraction of several pendulums at the same knots, scaled to the duration of each pendulum."""

    method: str
    duration: np.ndarray
    """Shape (pendulums,): duration of the trajectories, s."""
    cost: np.ndarray
    """Shape (knots, pendulums, 3): S(t)."""
    level: np.ndarray
    """Shape (knots, pendulums): ρ(t), dimensionless."""

    @property
    def area(self) -> np.ndarray:
        """Cross-section πρ/√det S in rad²/s, shape (knots, pendulums)."""
        return np.pi * self.level / np.sqrt(determinant(self.cost))

    @property
    def mean_area(self) -> np.ndarray:
        """Average cross-section (1/T)∫πρ/√det S dt in rad²/s (Simpson's rule), shape (pendulums,)."""
        from scipy.integrate import simpson

        return simpson(self.area, x=np.linspace(0.0, 1.0, len(self.level)), axis=0)

    @property
    def reach(self) -> np.ndarray:
        """Largest |θ − θ0| and |θ̇ − θ̇0| over all cross-sections, √(ρ(S⁻¹)ᵢᵢ) in rad and rad/s, shape (pendulums, 2)."""
        squares = self.level[..., None] * self.cost[..., [2, 0]] / determinant(self.cost)[..., None]
        return np.sqrt(squares.max(axis=0))


@dataclass(frozen=True)
class FunnelVariants:
    """The largest funnels, and two variants that check them."""

    exact: Funnels
    with_margin: Funnels
    """Slightly smaller funnels, so that a proof with finite precision can succeed (`interval_proof`)."""
    negative_control: Funnels
    """Too large funnels: starts on their boundaries leave (`monte_carlo_check`)."""


def exact_funnels(loops: ClosedLoops, terminal_level: float = 1.0) -> Funnels:
    """Compute the largest invariant funnels of V = x̄ᵀSx̄ that end in {V ≤ ρ(T)}.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator, with the V of the funnels.
    terminal_level : float, default 1.0
        ρ(T), dimensionless.

    Raises
    ------
    NumericalError
        If a basin extends more than `MAX_SEMI_AXIS_RAD` from its trajectory: the settings are not useful.
    """
    return funnel_variants(loops, terminal_level).exact


def funnel_variants(
    loops: ClosedLoops, terminal_level: float = 1.0, margin: float = 0.0, negative_control: float = 0.0
) -> FunnelVariants:
    """Compute the exact funnels, funnels with a margin and the negative control in one pass.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator, with the V of the funnels.
    terminal_level : float, default 1.0
        ρ(T), dimensionless.
    margin : float, default 0.0
        Excess of d ln ρ/dt over the largest V̇/ρ in 1/s, for the funnels with a margin; their area is about exp(−margin·T/2)
        of the exact area.
    negative_control : float, default 0.0
        Share of |d ln ρ/dt| by which ρ falls faster in the negative control. (A scaled ρ would be no control: the funnel
        of a linear loop stays invariant.)

    Raises
    ------
    NumericalError
        If the goal set extends π rad or more from the trajectory, or a basin more than `MAX_SEMI_AXIS_RAD`.
    """
    pendulums = loops.pendulums
    # A goal set with the pendulum in every position: no funnel about a trajectory contains it.
    goal_axis = np.sqrt(terminal_level) * normal_axes(loops.cost[-1])[0]
    if (goal_axis >= np.pi).any():
        index = int(goal_axis.argmax())
        raise NumericalError(
            f"{pendulums.labels[index]}: the goal set reaches {goal_axis[index]:.3g} rad from the trajectory's end, "
            "outside any funnel (π rad)",
            label=pendulums.labels[index],
        )
    wanted = [(0.0, 0.0), (margin, 0.0), (0.0, negative_control)]
    changes, which = np.unique(wanted, axis=0, return_inverse=True)
    excess, faster = changes[:, :1], changes[:, 1:]

    def slope(point, log_level):
        growth = boundary_growth(loops.form(point), np.exp(log_level))
        return growth + excess - faster * np.abs(growth)

    goal = np.full((len(changes), len(pendulums.labels)), np.log(terminal_level))
    level = np.exp(integrate_backward(loops, goal, slope))[:, which.ravel()]
    semi_axis = normal_axes(loops.cost[::2])[0] * np.sqrt(level[:, 0])
    lost = ~(semi_axis < MAX_SEMI_AXIS_RAD)
    if lost.any():
        index = int(np.argwhere(lost)[-1][1])
        raise NumericalError(
            f"{pendulums.labels[index]}: the basin reaches {semi_axis[:, index].max():.3g} rad from its "
            f"trajectory; at most {MAX_SEMI_AXIS_RAD:g} rad are allowed",
            label=pendulums.labels[index],
        )
    methods = ("exact", f"exact, margin {margin:g} 1/s", "exact, negative control")
    levels = zip(methods, np.moveaxis(level, 1, 0), strict=True)
    return FunnelVariants(*(Funnels(name, pendulums.duration, loops.cost[::2], rho) for name, rho in levels))


def integrate_backward(loops: ClosedLoops, goal: np.ndarray, slope: Callable) -> np.ndarray:
    """Integrate ln ρ backward from its value at T, from knot to knot, and return it, shape (knots, ..., pendulums).

    Adams's method of order 4, predicted and corrected with one search of the boundary per knot, started by Runge–Kutta steps: the
    equation for ln ρ is not stiff. The slope has a kink if another peak becomes the largest: if predicted and corrected slope
    differ by more than `KINK`, the largest of the predicted, corrected and trapezoidal slope is used. The trapezoidal slope is
    never below the mean of a convex slope, so that ρ is not too large.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    goal : numpy.ndarray, shape (..., pendulums)
        ln ρ(T).
    slope : callable
        Returns d ln ρ/dt in 1/s from a point of the grid and ln ρ.
    """
    log_level = np.empty((loops.knots, *goal.shape))
    log_level[-1] = goal
    step = loops.step
    history = [slope(2 * (loops.knots - 1), goal)]
    for knot in range(loops.knots - 1, 0, -1):
        now, point = log_level[knot], 2 * knot
        if len(history) < 4:
            # Runge–Kutta's method until four slopes are known.
            middle = slope(point - 1, now - 0.5 * step * history[0])
            again = slope(point - 1, now - 0.5 * step * middle)
            last = slope(point - 2, now - step * again)
            log_level[knot - 1] = now - step * (history[0] + 2 * middle + 2 * again + last) / 6
            new = slope(point - 2, log_level[knot - 1])
        else:
            # Adams–Bashforth predictor, Adams–Moulton corrector, and the safe slope at a kink.
            predicted = (55 * history[0] - 59 * history[1] + 37 * history[2] - 9 * history[3]) / 24
            new = slope(point - 2, now - step * predicted)
            corrected = (9 * new + 19 * history[0] - 5 * history[1] + history[2]) / 24
            kink = step * np.abs(corrected - predicted) > KINK
            safe = np.maximum(np.maximum(corrected, predicted), 0.5 * (new + history[0]))
            log_level[knot - 1] = now - step * np.where(kink, safe, corrected)
        history = [new, *history[:3]]
    return log_level


def reachable_area(loops: ClosedLoops, terminal_level: float = 1.0) -> np.ndarray:
    """Return the exact area of all states at t = 0 that reach the goal set, in rad²/s, shape (pendulums,).

    By Liouville's theorem an area in phase space shrinks at the rate (b + K2)/I, whatever the
    nonlinearity: the result is the area of the goal set times exp ∫(b + K2)/I dt. No funnel can be larger;
    the difference shows the cost of the choice of V.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    terminal_level : float, default 1.0
        ρ(T), dimensionless.
    """
    from scipy.integrate import simpson

    pendulums = loops.pendulums
    rate = (pendulums.damping + loops.gains[..., 1]) / pendulums.inertia
    exponent = pendulums.duration * simpson(rate, x=np.linspace(0.0, 1.0, len(rate)), axis=0)
    return np.pi * terminal_level / np.sqrt(determinant(loops.cost[-1])) * np.exp(exponent)


LYAPUNOV_TOLERANCE = 1e-9


def replace_lyapunov_function(loops: ClosedLoops, share: float | np.ndarray) -> ClosedLoops:
    """Return the loops with the V of one λ, or of one λ per pendulum.

    Parameters
    ----------
    loops : ClosedLoops
        Loops with the Riccati solution.
    share : float or numpy.ndarray, shape (pendulums,)
        λ from 0 to 1.

    Raises
    ------
    NumericalError
        If the integration fails or S is not positive definite.
    """
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    pendulums = loops.pendulums
    points, count = pendulums.angle.shape
    share = np.broadcast_to(share, count)
    phase = np.linspace(0.0, 1.0, points)
    curves = CubicSpline(
        phase, np.concatenate([pendulums.angle[..., None], loops.gains, loops.decay], axis=-1)
    )
    inertia, damping = pendulums.inertia, pendulums.damping

    def backward(remaining, flat):
        angle, k1, k2, *decay = np.moveaxis(curves(1.0 - remaining), -1, 0)
        s11, s12, s22 = flat.reshape(3, count)
        a21 = -(pendulums.gravity_torque * np.cos(angle) + k1) / inertia
        a22 = -(damping + k2) / inertia
        rate = np.stack([2 * s12 * a21, s11 + s12 * a22 + s22 * a21, 2 * (s12 + s22 * a22)])
        return (pendulums.duration * (rate + share * np.stack(decay))).ravel()

    solution = solve_ivp(
        backward,
        (0.0, 1.0),
        loops.cost[-1].T.ravel(),
        method="DOP853",
        t_eval=phase,
        rtol=LYAPUNOV_TOLERANCE,
        atol=LYAPUNOV_TOLERANCE * float(np.abs(loops.cost[-1]).max()),
    )
    if not solution.success:
        raise NumericalError(f"Lyapunov equation of {pendulums.labels[0]}: {solution.message}")
    cost = np.moveaxis(solution.y.reshape(3, count, points)[..., ::-1], (0, 1, 2), (2, 1, 0))
    lost = ~((cost[..., 0] > 0) & (cost[..., 0] * cost[..., 2] > cost[..., 1] ** 2))
    if lost.any():
        index = int(np.argwhere(lost)[-1][1])
        raise NumericalError(
            f"{pendulums.labels[index]}: the Lyapunov function of share {share[index]:g} is indefinite",
            label=pendulums.labels[index],
        )
    return ClosedLoops(pendulums, loops.weights, cost, share[:, None] * loops.decay, loops.gains)


def best_of_family(loops: ClosedLoops, terminal_level: float, shares: Sequence[float]) -> Funnels:
    """Return for each pendulum the exact funnel with the largest average cross-section in the family of V.

    Parameters
    ----------
    loops : ClosedLoops
        Loops with the Riccati solution.
    terminal_level : float
        ρ(T), dimensionless.
    shares : sequence of float
        Each λ to try, from 0 to 1.
    """
    count = len(loops.pendulums.labels)
    every = loops.select(np.tile(np.arange(count), len(shares)))
    funnels = exact_funnels(replace_lyapunov_function(every, np.repeat(shares, count)), terminal_level)
    largest = funnels.mean_area.reshape(len(shares), count).argmax(axis=0) * count + np.arange(count)
    cost, level = funnels.cost[:, largest], funnels.level[:, largest]
    return Funnels("best of family", funnels.duration[largest], cost, level)
