"""Bounds of g, the growth of |z|² on a funnel's boundary, on boxes of time and angle in interval arithmetic.

g and what is stated about it are in `interval_proof`; what torque limits and uncertain masses add is in
`saturation_intervals`. The bound is the mean-value form: g in the middle of a box plus its derivatives over the box times
half its extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.stability.proof.interval import Interval
from lumbar.lifting.stability.proof.saturation_intervals import (
    saturation_coefficient_rates,
    saturation_coefficients,
    saturation_part,
    saturation_part_arc,
    saturation_part_time,
)

ARC_OVERLAP = 1e-13
"""By which arcs overlap, so that the rounding of their centres leaves no gap; in rad."""


@dataclass(frozen=True)
class Interpolants:
    """Cubic pieces of θ0, K1/I, (b + K2)/I, A, P and Q."""

    pieces: dict[str, np.ndarray]
    """Shape (4, intervals, pendulums): coefficients in t − tᵢ, highest power first."""
    step: np.ndarray
    """Shape (pendulums,): length of an interval in s."""
    gravity: np.ndarray
    """Shape (pendulums,): G in 1/s²."""
    drag: np.ndarray
    """Shape (pendulums,): b/I in 1/s."""
    torque: np.ndarray
    """Shape (pendulums,): U/I in 1/s²."""
    bias: np.ndarray
    """Shape (pendulums,): middle of the torques allowed, over I, in 1/s²."""
    ratios: tuple[float, ...] = ()
    """m/m_true of the extreme masses; empty for a loop without limits."""


class IntervalBounds:
    """Pieces of time times arcs of the boundary.

    Holds the coefficients of g on the pieces: in the middle, over the piece, and their rates over the piece.
    """

    def __init__(self, curves: Interpolants, index: np.ndarray, middle: np.ndarray, width: float):
        count = len(curves.step)
        pendulum = index % count
        step = curves.step[pendulum]
        self.size = len(index)
        # A little longer than the piece, so that neighbours overlap whatever the rounding.
        self.half = 0.5 * width * step * (1 + 1e-12)
        self.ratios = curves.ratios
        self.torque = curves.torque[pendulum]
        constants = Interval(curves.gravity[pendulum]), Interval(curves.drag[pendulum]), bool(self.ratios)
        local = {name: values.reshape(4, -1)[:, index] for name, values in curves.pieces.items()}
        centre = Interval(middle * step)
        self.centre = _coefficients(_derivatives(local, centre, Interval(0 * self.half)), *constants)
        whole = _derivatives(local, centre, Interval(-self.half, self.half))
        self.whole = _coefficients(whole, *constants)
        if self.ratios:
            for part in (self.centre, self.whole):
                part["x0"] = part["x0"] - curves.bias[pendulum]
        self.rates = _coefficient_rates(whole, self.whole, *constants)

    def bounds(self, piece: np.ndarray, arcs: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a lower bound of g in the middle of each box and an upper bound on it, each of all masses."""
        angle = Interval(arcs)
        c, s = angle.cos(), angle.sin()
        at = {name: values[piece] for name, values in self.centre.items()}
        over = {name: values[piece] for name, values in self.whole.items()}
        rates = {name: values[piece] for name, values in self.rates.items()}
        half = self.half[piece]
        reach = radius + ARC_OVERLAP
        arc = Interval(arcs - reach, arcs + reach)
        arc_c, arc_s = arc.cos(), arc.sin()
        duration, extent = Interval(-half, half), Interval(-reach, reach)
        centre = _g(at, c, s)
        change = _g_time(over, rates, c, s) * duration + _g_arc(over, arc_c, arc_s) * extent
        if not self.ratios:
            return centre.low, (centre + change).high
        torque = self.torque[piece]
        bounds = []
        for ratio in self.ratios:
            here = centre + saturation_part(at, c, s, torque, ratio)
            time_part = saturation_part_time(over, rates, c, s, torque, ratio) * duration
            arc_part = saturation_part_arc(over, arc_c, arc_s, torque, ratio) * extent
            bounds.append((here.low, (here + change + time_part + arc_part).high))
        return tuple(np.max(bounds, axis=0))


def _derivatives(local: dict, centre: Interval, offset: Interval) -> dict[str, tuple[Interval, ...]]:
    """Value and derivatives of every curve over centre + offset, by Taylor's formula (exact)."""
    result = {}
    for name, (c3, c2, c1, c0) in local.items():
        value = ((centre * c3 + c2) * centre + c1) * centre + c0
        first = (centre * (3 * Interval(c3)) + 2 * Interval(c2)) * centre + c1
        second = centre * (6 * Interval(c3)) + 2 * Interval(c2)
        result[name] = (
            value + offset * (first + offset * (second * 0.5 + offset * c3)),
            first + offset * (second + offset * (3 * Interval(c3))),
            second + offset * (6 * Interval(c3)),
            6 * Interval(c3),
        )
    return result


def _coefficients(curves: dict, gravity: Interval, drag: Interval, limited: bool) -> dict[str, Interval]:
    (a, a1, *_), (p, p1, *_), (q, q1, *_) = curves["A"], curves["P"], curves["Q"]
    k1, k2 = curves["k1"][0], curves["k2"][0]
    w = (p - a1) / a
    n = k1 * a + k2 * p + p1 + p * w
    saturation = saturation_coefficients(curves, gravity, drag) if limited else {}
    return {
        **saturation,
        "q11": w,
        "q12": q / a - n / q,
        "q22": -(k2 + q1 / q + p / a),
        "n": n,
        "weight": gravity / q,
        "A": a,
        "angle": curves["angle"][0],
    }


def _coefficient_rates(
    curves: dict, over: dict[str, Interval], gravity: Interval, drag: Interval, limited: bool
) -> dict[str, Interval]:
    """Time derivatives of `_coefficients`."""
    (a, a1, a2, _), (p, p1, p2, _), (q, q1, q2, _) = curves["A"], curves["P"], curves["Q"]
    (k1, k1_rate, *_), (k2, k2_rate, *_) = curves["k1"], curves["k2"]
    w, n = over["q11"], over["n"]
    w_rate = (p1 - a2 - w * a1) / a
    n_rate = k1_rate * a + k1 * a1 + k2_rate * p + k2 * p1 + p2 + p1 * w + p * w_rate
    saturation = saturation_coefficient_rates(curves, gravity, drag) if limited else {}
    return {
        **saturation,
        "q11": w_rate,
        "q12": (q1 - q / a * a1) / a - (n_rate - n / q * q1) / q,
        "q22": -(k2_rate + (q2 - (q1 / q) * q1) / q + (p1 - p / a * a1) / a),
        "weight": -(gravity / q) * (q1 / q),
        "A": a1,
        "angle": curves["angle"][1],
    }


def _g(at: dict[str, Interval], c: Interval, s: Interval) -> Interval:
    gravity = (at["angle"] + at["A"] * c).sin() - at["angle"].sin()
    return _quadratic(at, c, s) - at["weight"] * s * gravity


def _quadratic(at: dict[str, Interval], c: Interval, s: Interval) -> Interval:
    return at["q11"] * c.square() + at["q12"] * (c * s) + at["q22"] * s.square()


def _g_time(over: dict, rates: dict, c: Interval, s: Interval) -> Interval:
    displaced = over["angle"] + over["A"] * c
    gravity = displaced.sin() - over["angle"].sin()
    cosine = displaced.cos()
    change = rates["angle"] * (cosine - over["angle"].cos()) + rates["A"] * c * cosine
    return _quadratic(rates, c, s) - s * (rates["weight"] * gravity + over["weight"] * change)


def _g_arc(over: dict, c: Interval, s: Interval) -> Interval:
    displaced = over["angle"] + over["A"] * c
    gravity = displaced.sin() - over["angle"].sin()
    turned = c * gravity - s.square() * over["A"] * displaced.cos()
    quadratic = 2 * (over["q22"] - over["q11"]) * (c * s) + over["q12"] * (c.square() - s.square())
    return quadratic - over["weight"] * turned
