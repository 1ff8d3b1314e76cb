"""Rate-independent operators, exact between reversals of the motion.

Between two reversals a rate-independent element whose state s depends on the distance d moved since the last one
by an autonomous equation ds/dd = g(s) has the solution s = Γ(Γ⁻¹(s₀) + d) with one master curve Γ. Play and stop
are of this kind too. No time step enters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import wrightomega


def monotone_parts(position: np.ndarray) -> Iterator[tuple[slice, float]]:
    """Yield slices (ends shared with the neighbours) in which a motion does not reverse, and their direction."""
    change = np.diff(position)
    moving = np.flatnonzero(change)
    if not moving.size:
        return
    signs = np.sign(change[moving])
    turns = moving[np.flatnonzero(signs[1:] != signs[:-1]) + 1]
    bounds = np.concatenate([[0], turns, [len(position) - 1]])
    directions = np.concatenate([[signs[0]], np.sign(change[turns])])
    for first, last, direction in zip(bounds[:-1], bounds[1:], directions, strict=True):
        yield slice(first, last + 1), float(direction)


def stop(position: np.ndarray, yield_length: float) -> np.ndarray:
    """Elongation of a spring that slides beyond `yield_length` (Prandtl's stop, Jenkins's element)."""
    state = np.zeros_like(position)
    for part, direction in monotone_parts(position):
        moved = position[part] - position[part.start]
        limit = np.minimum if direction > 0 else np.maximum
        state[part] = limit(state[part.start] + moved, direction * yield_length)
    return state


def play(position: np.ndarray, half_gap: float) -> np.ndarray:
    """Position behind a gap of ±half_gap, in its middle at the start (Prandtl's play)."""
    return position - stop(position, half_gap)


def smooth_play(position: np.ndarray, half_gap: float, rounding: float) -> np.ndarray:
    """Play whose flanks engage gradually.

    The share 1/(1 + exp(−(lag − half_gap)/rounding)) of every movement is passed on, lag being how far the
    follower is behind. With x = (lag − half_gap)/rounding, dx/dd = 1/(rounding (1 + eˣ)), so x + eˣ grows
    linearly with the distance and x follows from Wright's omega function.
    """
    lag = np.zeros_like(position)
    for part, direction in monotone_parts(position):
        moved = np.abs(position[part] - position[part.start]) / rounding
        start = (direction * lag[part.start] - half_gap) / rounding
        total = start + np.exp(start) + moved
        lag[part] = direction * (half_gap + rounding * (total - wrightomega(total).real))
    return position - lag


def dahl(position: np.ndarray, yield_length: float, exponent: float) -> np.ndarray:
    """Dahl's friction per unit of Coulomb force: ds/dd = (1 − s)^exponent / yield_length, s in [−1, 1]."""
    if exponent == 1.0:
        return _follow(
            position, lambda s: -np.log1p(-s) * yield_length, lambda d: -np.expm1(-d / yield_length)
        )
    power = exponent - 1.0
    # d = yield_length ((1 − s)^(1−i) − 1)/(i − 1), counted from s = 0.
    return _follow(
        position,
        lambda s: yield_length * ((1 - s) ** -power - 1) / power,
        lambda d: 1 - (1 + power * d / yield_length) ** (-1 / power),
    )


def bouc_wen(position: np.ndarray, yield_length: float, sharpness: float, loading: float) -> np.ndarray:
    """Bouc and Wen's hysteretic displacement, scaled to [−1, 1].

    ds/dd = (1 − |s|ⁿ (β sgn s + γ)) / yield_length along the direction of motion with β = `loading` and
    γ = 1 − β, so that s ends at 1; n is `sharpness`.
    """

    def slope(_, state):
        return (1 - np.abs(state) ** sharpness * (loading * np.sign(state) + 1 - loading)) / yield_length

    reach = yield_length * (8.0 + 12.0 / loading)
    distance = np.linspace(0.0, reach, 6001)
    curve = solve_ivp(slope, (0.0, reach), [-1.0], t_eval=distance, method="DOP853", rtol=1e-9, atol=1e-12).y[
        0
    ]
    curve = np.maximum.accumulate(np.minimum(curve, 1.0))
    return _follow(
        position, lambda s: float(np.interp(s, curve, distance)), lambda d: np.interp(d, distance, curve)
    )


def _follow(position: np.ndarray, inverse: Callable, master: Callable) -> np.ndarray:
    """State along the motion, from its master curve and the inverse of that, beginning at 0."""
    state = np.zeros_like(position)
    for part, direction in monotone_parts(position):
        moved = np.abs(position[part] - position[part.start])
        state[part] = direction * master(inverse(direction * state[part.start]) + moved)
    return state
