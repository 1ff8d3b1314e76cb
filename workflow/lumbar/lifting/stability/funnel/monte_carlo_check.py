"""Monte Carlo check: starts inside a basin are simulated with the true dynamics, and the starts that leave it are counted."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import Funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops, normal_axes

LEVEL_TOLERANCE = 1e-6
"""Largest relative excess of V over ρ at which a state counts as inside: half of the starts are on the boundary."""
MAX_STEP = 0.25
"""Largest product of the closed loop's rate and the step of the simulation (Runge–Kutta of order 4)."""
COMFORTABLE_STEP = 0.1
"""Largest product of rate and step for a step over several knots: the error is a tenth of the tolerance."""
MAX_STRIDE = 9
"""Largest number of knots that one step of the simulation may span."""


@dataclass(frozen=True)
class MonteCarloCheck:
    """Result of the simulated starts."""

    exits: np.ndarray
    """Shape (pendulums,): number of starts with V > ρ at any checked point."""
    starts: int
    """Number of starts per pendulum."""

    @property
    def share_high(self) -> np.ndarray:
        """Upper end of the exact (Clopper–Pearson) 95 % interval of the share of starts that leave, shape (pendulums,)."""
        from scipy.special import betaincinv

        inside = self.starts - self.exits
        return np.where(inside > 0, betaincinv(self.exits + 1.0, np.maximum(inside, 1.0), 0.975), 1.0)


def monte_carlo_check(loops: ClosedLoops, funnels: Funnels, starts: int, seed: list[int]) -> MonteCarloCheck:
    """Simulate starts in each pendulum's first cross-section, half of them on the boundary and half inside.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    funnels : Funnels
        Funnels of the same pendulums; their knots divide the knots of `loops` evenly.
    starts : int
        Number of starts per pendulum.
    seed : list of int
        Seed of the random numbers.

    Raises
    ------
    NumericalError
        If the funnels' knots do not divide the knots of `loops` evenly, or the knots of `loops` are too far apart (`simulate`).
    """
    # Starts in the first cross-section.
    generator = np.random.default_rng(seed)
    count = len(loops.pendulums.labels)
    direction = generator.uniform(0.0, 2 * np.pi, (count, starts))
    # Uniform over the area of the disc, and the first half on its edge.
    radius = np.sqrt(generator.uniform(0.0, 1.0, (count, starts)))
    radius[:, : starts // 2] = 1.0
    a, p, q = (axis[:, None] for axis in normal_axes(funnels.cost[0]))
    first, second = radius * np.cos(direction), radius * np.sin(direction)
    root = np.sqrt(funnels.level[0])[:, None]
    start = np.stack([root * a * first, root * (p * first + q * second)])

    # A start leaves if its V exceeds ρ at a knot of the funnel.
    stride, rest = divmod(loops.knots - 1, len(funnels.level) - 1)
    if rest:
        raise NumericalError(f"{len(funnels.level)} levels do not lie evenly among {loops.knots} knots")
    inside = np.ones((count, starts), dtype=bool)
    for knot, state in simulate(loops, start):
        index, between = divmod(knot, stride)
        if not between:
            value = quadratic_form(funnels.cost[index], state)
            inside &= value <= funnels.level[index][:, None] * (1 + LEVEL_TOLERANCE)
    return MonteCarloCheck(starts - inside.sum(axis=1), starts)


def simulate(loops: ClosedLoops, start: np.ndarray):
    """Follow errors x̄ through the closed loop with the true sine.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    start : numpy.ndarray, shape (2, pendulums, starts)
        Error of angle (rad) and angular velocity (rad/s) at t = 0.

    Yields
    ------
    knot : int
        Index of every knot, or of every few knots if the closed loop is slow enough.
    state : numpy.ndarray, shape (2, pendulums, starts)
        Error at this knot, units as in `start`.

    Raises
    ------
    NumericalError
        The knots are too far apart for the closed loop's fastest mode.
    """
    rate, stiffness, damping = _dynamics(loops)
    stride = _stride(loops, stiffness, damping)
    state = start
    yield 0, state
    # A step spans 2·stride points of the grid, whose middle is a point of it too.
    for point in range(0, len(loops.cost) - 1, 2 * stride):
        state = _runge_kutta(rate, point, stride, (loops.step * stride)[:, None], state)
        yield point // 2 + stride, state


def preimage(loops: ClosedLoops, edge: np.ndarray) -> np.ndarray:
    """Return the errors at t = 0, shape of `edge`, that reach `edge` (e.g. of a goal set) at T with the true sine.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    edge : numpy.ndarray, shape (2, pendulums, points)
        Errors x̄ at T in rad and rad/s.

    Raises
    ------
    NumericalError
        The knots are too far apart for the closed loop's fastest mode.
    """
    rate, stiffness, damping = _dynamics(loops)
    _stride(loops, stiffness, damping)
    state = edge
    for point in range(len(loops.cost) - 1, 0, -2):
        state = _runge_kutta(rate, point, -1, -loops.step[:, None], state)
    return state


def _dynamics(loops: ClosedLoops):
    """Return the rate of the state as a function of (point, state), and stiffness and damping of the linear loop."""
    pendulums = loops.pendulums
    angle_gain, velocity_gain = np.moveaxis(loops.gains, -1, 0)
    a21, a22, _ = pendulums.linearisation(pendulums.angle)
    inertia = pendulums.inertia
    stiffness, damping = a21 - angle_gain / inertia, a22 - velocity_gain / inertia
    # The loop is its linear part less gravity·(sin(θ0 + e) − sin θ0 − e·cos θ0): of one sine, in place, it takes half the time.
    gravity = (pendulums.gravity_torque / inertia)[:, None]
    angle, slow, fast = (part[..., None] for part in (pendulums.angle, stiffness, damping))
    along, still = slow + gravity * np.cos(angle), gravity * np.sin(angle)

    def rate(point, state):
        error, velocity = state
        slope = np.empty_like(state)
        slope[0], acceleration = velocity, slope[1]
        np.sin(angle[point] + error, out=acceleration)
        acceleration *= -gravity
        acceleration += along[point] * error + fast[point] * velocity + still[point]
        return slope

    return rate, stiffness, damping


def _runge_kutta(rate: Callable, point: int, stride: int, h: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Take one Runge–Kutta step of order 4 from a point of the grid over 2·stride points; h is the length of the step in s."""
    slope1 = rate(point, state)
    slope2 = rate(point + stride, state + 0.5 * h * slope1)
    slope3 = rate(point + stride, state + 0.5 * h * slope2)
    slope4 = rate(point + 2 * stride, state + h * slope3)
    return state + h / 6 * (slope1 + 2 * slope2 + 2 * slope3 + slope4)


def _stride(loops: ClosedLoops, stiffness: np.ndarray, damping: np.ndarray) -> int:
    """Return the largest number of knots per step that the fastest mode and an even division of the knots allow."""
    rate = np.maximum(np.abs(damping), np.sqrt(np.abs(stiffness))).max(axis=0)
    advance = rate * loops.step
    for stride in range(MAX_STRIDE, 0, -1):
        largest = MAX_STEP if stride == 1 else COMFORTABLE_STEP
        if (loops.knots - 1) % stride == 0 and advance.max() * stride <= largest:
            return stride
    index = int(advance.argmax())
    raise NumericalError(
        f"{loops.pendulums.labels[index]}: {loops.step[index]:.3g} s between knots is too long for a loop "
        f"with a rate of {rate[index]:.3g} 1/s",
        label=loops.pendulums.labels[index],
    )


def quadratic_form(cost: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Return V = x̄ᵀSx̄ (Eq. 4.7), shape (pendulums, starts).

    Parameters
    ----------
    cost : numpy.ndarray, shape (pendulums, 3)
        S.
    state : numpy.ndarray, shape (2, pendulums, starts)
        x̄ in rad and rad/s.
    """
    s11, s12, s22 = (cost[:, entry, None] for entry in range(3))
    return s11 * state[0] ** 2 + 2 * s12 * state[0] * state[1] + s22 * state[1] ** 2
