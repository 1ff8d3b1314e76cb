"""What torque limits and an uncertain mass add to g on boxes of time and angle, in interval arithmetic.

For one mass, r = m/m_true, the part is (1/Q)·sin φ·(r·y − x) with, on the boundary,

    x = x0 + xc·cos φ + xs·sin φ    (u0 − K·x̄ − b·(θ̇0 + ω))/I, wanted torque less drag
    d = d0 + dc·cos φ + ds·sin φ    b·(θ̇0 + ω)/I
    y = clip(x + d, ±U/I) − d

The clipped torque has no derivative at ±U; the mean-value form holds with its generalised one, which lies between
0 and 1 times that of x + d (Clarke, Optimization and Nonsmooth Analysis, 1990, theorem 2.3.7).
"""

from __future__ import annotations

import numpy as np

from lumbar.lifting.stability.proof.interval import Interval


def saturation_coefficients(curves: dict, gravity: Interval, drag: Interval) -> dict[str, Interval]:
    """Coefficients of x and d and 1/Q; `curves` holds values and derivatives by name."""
    angle, velocity, acceleration, _ = curves["angle"]
    a, p, q, k1, k2 = (curves[name][0] for name in ("A", "P", "Q", "k1", "k2"))
    return {
        "x0": acceleration + gravity * angle.sin(),
        "xc": -(k1 * a + k2 * p),
        "xs": -(k2 * q),
        "d0": drag * velocity,
        "dc": drag * p,
        "ds": drag * q,
        "inverse_q": Interval(1.0) / q,
    }


def saturation_coefficient_rates(curves: dict, gravity: Interval, drag: Interval) -> dict[str, Interval]:
    """Time derivatives of `saturation_coefficients`."""
    angle, velocity, acceleration, jerk = curves["angle"]
    (a, a1, *_), (p, p1, *_), (q, q1, *_) = curves["A"], curves["P"], curves["Q"]
    (k1, k1_rate, *_), (k2, k2_rate, *_) = curves["k1"], curves["k2"]
    return {
        "x0": jerk + gravity * angle.cos() * velocity,
        "xc": -(k1_rate * a + k1 * a1 + k2_rate * p + k2 * p1),
        "xs": -(k2_rate * q + k2 * q1),
        "d0": drag * acceleration,
        "dc": drag * p1,
        "ds": drag * q1,
        "inverse_q": -(q1 / q.square()),
    }


def saturation_part(at: dict, c: Interval, s: Interval, torque: np.ndarray, ratio: float) -> Interval:
    """(1/Q)·sin φ·(r·y − x)."""
    x, d = _wanted(at, c, s)
    return at["inverse_q"] * s * _missing(x, d, torque, ratio)


def saturation_part_time(
    over: dict, rates: dict, c: Interval, s: Interval, torque: np.ndarray, ratio: float
) -> Interval:
    """Generalised time derivative of `saturation_part`."""
    x, d = _wanted(over, c, s)
    x_rate, d_rate = _wanted(rates, c, s)
    change = _missing_rate(x + d, x_rate, d_rate, torque, ratio)
    return s * (rates["inverse_q"] * _missing(x, d, torque, ratio) + over["inverse_q"] * change)


def saturation_part_arc(over: dict, c: Interval, s: Interval, torque: np.ndarray, ratio: float) -> Interval:
    """Generalised derivative of `saturation_part` along the boundary."""
    x, d = _wanted(over, c, s)
    x_turn, d_turn = (over[f"{name}s"] * c - over[f"{name}c"] * s for name in ("x", "d"))
    change = _missing_rate(x + d, x_turn, d_turn, torque, ratio)
    return over["inverse_q"] * (c * _missing(x, d, torque, ratio) + s * change)


def _wanted(at: dict, c: Interval, s: Interval) -> tuple[Interval, Interval]:
    """Return x and d."""
    return tuple(at[f"{name}0"] + at[f"{name}c"] * c + at[f"{name}s"] * s for name in ("x", "d"))


def _missing(x: Interval, d: Interval, torque: np.ndarray, ratio: float) -> Interval:
    """Return r·y − x."""
    wanted = x + d
    applied = Interval(np.clip(wanted.low, -torque, torque), np.clip(wanted.high, -torque, torque))
    return ratio * (applied - d) - x


def _missing_rate(wanted: Interval, x: Interval, d: Interval, torque: np.ndarray, ratio: float) -> Interval:
    """Return the generalised derivative of r·y − x from those of x and d."""
    never = (wanted.low > torque) | (wanted.high < -torque)
    always = (wanted.high < torque) & (wanted.low > -torque)
    passed = Interval(np.where(always, 1.0, 0.0), np.where(never, 0.0, 1.0))
    return ratio * (passed * (x + d) - d) - x
