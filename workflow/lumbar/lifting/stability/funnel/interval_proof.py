"""Proof that a funnel is invariant at all times, not only at its knots: interval branch-and-bound with the true sine.

The proof uses interpolants, cubic splines through the knots (not-a-knot), of the reference θ0, the feedback gains K1 and K2, and
the three numbers that describe the ellipse, including ρ,

    e = A·cos φ,   ω = P·cos φ + Q·sin φ.

With x̄ = N(t)·z the boundary is |z| = 1, and states stay inside if g = ½·d|z|²/dt < 0 on it for all φ and t:

    g = q11·cos²φ + q12·cos φ·sin φ + q22·sin²φ − (G/Q)·sin φ·(sin(θ0 + A·cos φ) − sin θ0)
    q11 = W = (P − Ȧ)/A,   q12 = Q/A − (k1·A + k2·P + Ṗ + P·W)/Q,   q22 = −k2 − Q̇/Q − P/A

with k1 = K1/I, k2 = (b + K2)/I, G = σmgℓ/I.

Time is divided into pieces and the circle into arcs; on each box g is bounded by the mean-value form in interval arithmetic: g in
the middle of the box plus the derivatives of g over the box times half the extent of the box. Arcs without a proof are halved,
then pieces of time with such an arc; the share of time that remains without a proof is reported.

Intervals are rounded outward, so that every result contains the exact one: a floating-point operation is correct to half a
unit in the last place, and a step of one unit outward encloses it; sine and cosine of numpy are correct to 4 units, for which
2⁻⁵⁰ is added (Moore, Kearfott & Cloud, Introduction to Interval Analysis, 2009).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import Funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops, normal_axes

TRIGONOMETRIC_ERROR = 2.0**-50
UNIT, TINY = 2.0**-52, 2.0**-1074


class Interval:
    """Closed intervals [low, high], element by element.

    Parameters
    ----------
    low : array_like
        Lower ends.
    high : array_like, optional
        Upper ends, same shape; default: `low`.
    """

    __slots__ = ("high", "low")

    def __init__(self, low, high=None):
        self.low = np.asarray(low, dtype=float)
        self.high = self.low if high is None else np.asarray(high, dtype=float)

    def __getitem__(self, index) -> Interval:
        return Interval(self.low[index], self.high[index])

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other) -> Interval:
        other = _interval(other)
        return _outward(self.low + other.low, self.high + other.high)

    def __sub__(self, other) -> Interval:
        return self + -_interval(other)

    def __mul__(self, other) -> Interval:
        other = _interval(other)
        ends = self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high
        low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
        high = np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
        return _outward(low, high)

    def __truediv__(self, other) -> Interval:
        other = _interval(other)
        if ((other.low <= 0) & (other.high >= 0)).any():
            raise ZeroDivisionError("an interval that is divided by contains zero")
        return self * _outward(1 / other.high, 1 / other.low)

    __rmul__ = __mul__

    def square(self) -> Interval:
        """Return the squares, never below zero."""
        first, second = self.low * self.low, self.high * self.high
        crosses = (self.low <= 0) & (self.high >= 0)
        low = np.where(crosses, 0.0, np.minimum(first, second))
        squared = _outward(low, np.maximum(first, second))
        return Interval(np.maximum(squared.low, 0.0), squared.high)

    def sin(self) -> Interval:
        """Return the sines."""
        return self._enclose(np.sin, maximum=np.pi / 2, minimum=-np.pi / 2)

    def cos(self) -> Interval:
        """Return the cosines."""
        return self._enclose(np.cos, maximum=0.0, minimum=np.pi)

    def _enclose(self, function: Callable, maximum: float, minimum: float) -> Interval:
        first, second = function(self.low), function(self.high)
        low, high = np.minimum(first, second), np.maximum(first, second)
        high = np.where(self._contains(maximum), 1.0, high + TRIGONOMETRIC_ERROR)
        low = np.where(self._contains(minimum), -1.0, low - TRIGONOMETRIC_ERROR)
        return Interval(np.maximum(low, -1.0), np.minimum(high, 1.0))

    def _contains(self, angle: float) -> np.ndarray:
        """Return whether the slightly enlarged interval contains the angle plus a multiple of 2π."""
        slack = 1e-9 * (1.0 + np.abs(self.high))
        turns = np.ceil((self.low - slack - angle) / (2 * np.pi))
        return angle + 2 * np.pi * turns <= self.high + slack


def _interval(value) -> Interval:
    return value if isinstance(value, Interval) else Interval(value)


def _outward(low: np.ndarray, high: np.ndarray) -> Interval:
    # |x|·2⁻⁵² is one to two units in the last place of x: this is nextafter or a little more, at a third of its time.
    return Interval(low - (np.abs(low) * UNIT + TINY), high + (np.abs(high) * UNIT + TINY))


ARC_OVERLAP_RAD = 1e-13
"""Overlap of arcs, so that the rounding of their centres leaves no gap."""


@dataclass(frozen=True)
class Interpolants:
    """Cubic pieces of θ0, K1/I, (b + K2)/I, A, P and Q."""

    pieces: dict[str, np.ndarray]
    """Shape (4, intervals, pendulums): coefficients in t − tᵢ, highest power first."""
    step: np.ndarray
    """Shape (pendulums,): length of an interval in s."""
    gravity: np.ndarray
    """Shape (pendulums,): G in 1/s²."""


class IntervalBounds:
    """Bounds of g on boxes: pieces of time times arcs of the boundary.

    The coefficients of g are stored for each piece: in its middle, over the piece, and their rates over the piece.

    Parameters
    ----------
    curves : Interpolants
        Interpolants through the knots.
    index : numpy.ndarray, shape (pieces,)
        Interval and pendulum of each piece: interval times the number of pendulums, plus the pendulum.
    middle : numpy.ndarray, shape (pieces,)
        Middle of each piece as a share of its interval.
    width : float
        Length of the pieces as a share of an interval.
    """

    def __init__(self, curves: Interpolants, index: np.ndarray, middle: np.ndarray, width: float):
        count = len(curves.step)
        pendulum = index % count
        step = curves.step[pendulum]
        self.size = len(index)
        # A little longer than the piece, so that neighbours overlap whatever the rounding.
        self.half = 0.5 * width * step * (1 + 1e-12)
        gravity = Interval(curves.gravity[pendulum])
        local = {name: values.reshape(4, -1)[:, index] for name, values in curves.pieces.items()}
        centre = Interval(middle * step)
        self.centre = _coefficients(_derivatives(local, centre, Interval(0 * self.half)), gravity)
        whole = _derivatives(local, centre, Interval(-self.half, self.half))
        self.whole = _coefficients(whole, gravity)
        self.rates = _coefficient_rates(whole, self.whole, gravity)

    def bounds(self, piece: np.ndarray, arcs: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a lower bound of g in the middle of each box and an upper bound on it, in 1/s, each of shape (boxes,).

        Parameters
        ----------
        piece, arcs : numpy.ndarray, shape (boxes,)
            Index of each box's piece of time; middle of each box's arc, φ in rad.
        radius : float
            Half the length of the arcs in rad.
        """
        c, s = Interval(arcs).cos(), Interval(arcs).sin()
        at, over, rates = (
            {name: values[piece] for name, values in each.items()}
            for each in (self.centre, self.whole, self.rates)
        )
        half, reach = self.half[piece], radius + ARC_OVERLAP_RAD
        arc = Interval(arcs - reach, arcs + reach)
        duration, extent = Interval(-half, half), Interval(-reach, reach)
        gravity = (at["angle"] + at["A"] * c).sin() - at["angle"].sin()
        centre = _quadratic(at, c, s) - at["weight"] * s * gravity
        by_time, by_arc = _slopes_of_g(over, rates, (c, s), (arc.cos(), arc.sin()))
        change = by_time * duration + by_arc * extent
        return centre.low, (centre + change).high


def _derivatives(local: dict, centre: Interval, offset: Interval) -> dict[str, tuple[Interval, ...]]:
    """Return the value and derivatives of every curve over centre + offset, by Taylor's formula (exact)."""
    result = {}
    for name, (c3, c2, c1, c0) in local.items():
        value = ((centre * c3 + c2) * centre + c1) * centre + c0
        first = (centre * (3 * Interval(c3)) + 2 * Interval(c2)) * centre + c1
        second = centre * (6 * Interval(c3)) + 2 * Interval(c2)
        result[name] = (
            value + offset * (first + offset * (second * 0.5 + offset * c3)),
            first + offset * (second + offset * (3 * Interval(c3))),
            second + offset * (6 * Interval(c3)),
        )
    return result


def _coefficients(curves: dict, gravity: Interval) -> dict[str, Interval]:
    (a, a1, *_), (p, p1, *_), (q, q1, *_) = curves["A"], curves["P"], curves["Q"]
    k1, k2 = curves["k1"][0], curves["k2"][0]
    w = (p - a1) / a
    n = k1 * a + k2 * p + p1 + p * w
    return {
        "q11": w,
        "q12": q / a - n / q,
        "q22": -(k2 + q1 / q + p / a),
        "n": n,
        "weight": gravity / q,
        "A": a,
        "angle": curves["angle"][0],
    }


def _coefficient_rates(curves: dict, over: dict[str, Interval], gravity: Interval) -> dict[str, Interval]:
    """Return the time derivatives of `_coefficients`."""
    (a, a1, a2), (p, p1, p2), (q, q1, q2) = curves["A"], curves["P"], curves["Q"]
    (k1, k1_rate, *_), (k2, k2_rate, *_) = curves["k1"], curves["k2"]
    w, n = over["q11"], over["n"]
    w_rate = (p1 - a2 - w * a1) / a
    n_rate = k1_rate * a + k1 * a1 + k2_rate * p + k2 * p1 + p2 + p1 * w + p * w_rate
    return {
        "q11": w_rate,
        "q12": (q1 - q / a * a1) / a - (n_rate - n / q * q1) / q,
        "q22": -(k2_rate + (q2 - (q1 / q) * q1) / q + (p1 - p / a * a1) / a),
        "weight": -(gravity / q) * (q1 / q),
        "A": a1,
        "angle": curves["angle"][1],
    }


def _quadratic(at: dict[str, Interval], c: Interval, s: Interval) -> Interval:
    return at["q11"] * c.square() + at["q12"] * (c * s) + at["q22"] * s.square()


def _slopes_of_g(
    over: dict, rates: dict, middle: tuple[Interval, Interval], arc: tuple[Interval, Interval]
) -> tuple[Interval, Interval]:
    """Return the derivatives of g by time in the middle of arcs and by φ over the arcs, from cosine and sine of φ."""
    c, s = middle
    displaced = over["angle"] + over["A"] * c
    gravity, cosine = displaced.sin() - over["angle"].sin(), displaced.cos()
    change = rates["angle"] * (cosine - over["angle"].cos()) + rates["A"] * c * cosine
    by_time = _quadratic(rates, c, s) - s * (rates["weight"] * gravity + over["weight"] * change)
    c, s = arc
    displaced = over["angle"] + over["A"] * c
    slope = c * (displaced.sin() - over["angle"].sin()) - s.square() * over["A"] * displaced.cos()
    quadratic = 2 * (over["q22"] - over["q11"]) * (c * s) + over["q12"] * (c.square() - s.square())
    return by_time, quadratic - over["weight"] * slope


ARCS = 24
"""Initial number of arcs of the circle."""
ARC_HALVINGS = 9
TIME_HALVINGS = 3
BOXES_AT_ONCE = 200_000


def interpolants(loops: ClosedLoops, funnels: Funnels) -> Interpolants:
    """Return the interpolants of the proof through the funnel's knots.

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    funnels : Funnels
        Funnels of the same pendulums.

    Raises
    ------
    NumericalError
        If the funnel has fewer than four knots, or its knots do not divide the knots of `loops` evenly.
    """
    from scipy.interpolate import CubicSpline

    knots = len(funnels.level)
    stride, rest = divmod(loops.knots - 1, knots - 1)
    if knots < 4 or rest:
        raise NumericalError(f"{knots} knots do not lie evenly among {loops.knots}, or are fewer than four")
    pendulums, points = loops.pendulums, slice(None, None, 2 * stride)
    root = np.sqrt(funnels.level)
    a, p, q = (root * axis for axis in normal_axes(funnels.cost))
    curves = {
        "angle": pendulums.angle[points],
        "k1": loops.gains[points][..., 0] / pendulums.inertia,
        "k2": (pendulums.damping + loops.gains[points][..., 1]) / pendulums.inertia,
        "A": a,
        "P": p,
        "Q": q,
    }
    step = pendulums.duration / (knots - 1)
    # On the unit interval the splines of all pendulums are one call; then t is scaled to seconds.
    scale = step[None, :] ** np.arange(3, -1, -1)[:, None]
    pieces = {
        name: CubicSpline(np.arange(knots), values).c / scale[:, None, :] for name, values in curves.items()
    }
    return Interpolants(pieces, step, pendulums.gravity_torque / pendulums.inertia)


def proved_share(loops: ClosedLoops, funnels: Funnels) -> np.ndarray:
    """Return the share of the time axis on which the funnel is proved invariant, shape (pendulums,).

    Parameters
    ----------
    loops : ClosedLoops
        Pendulums under their regulator.
    funnels : Funnels
        Funnels with a margin (`funnel_variants`): exact funnels touch g = 0, which finite precision cannot prove.
    """
    curves = interpolants(loops, funnels)
    intervals, count = next(iter(curves.pieces.values())).shape[1:]
    index = np.arange(intervals * count)
    middle = np.full(len(index), 0.5)
    proved = np.zeros(count)
    chunk = BOXES_AT_ONCE // ARCS
    for halving in range(TIME_HALVINGS + 1):
        # Try to prove every piece of this width, in portions that fit into memory.
        width = 0.5**halving
        is_proved = np.zeros(len(index), dtype=bool)
        for start in range(0, len(index), chunk):
            part = slice(start, start + chunk)
            is_proved[part] = _prove_arcs(IntervalBounds(curves, index[part], middle[part], width))
        proved += width * np.bincount(index[is_proved] % count, minlength=count)
        # Halve the pieces without a proof.
        index, middle = np.tile(index[~is_proved], 2), middle[~is_proved]
        middle = np.concatenate([middle - width / 4, middle + width / 4])
    return proved / intervals


def _prove_arcs(pieces: IntervalBounds) -> np.ndarray:
    is_proved = np.ones(pieces.size, dtype=bool)
    radius = np.pi / ARCS
    arcs = np.tile(2 * radius * np.arange(ARCS), pieces.size)
    piece = np.repeat(np.arange(pieces.size), ARCS)
    for _ in range(ARC_HALVINGS + 1):
        centre, bound = pieces.bounds(piece, arcs, radius)
        # One centre that is certainly outside disproves the whole piece.
        is_proved[piece[centre > 0]] = False
        is_open = (bound >= 0) & is_proved[piece]
        piece, arcs = piece[is_open], arcs[is_open]
        if not len(piece):
            return is_proved
        # Halve the arcs without a proof.
        radius /= 2
        piece = np.tile(piece, 2)
        arcs = np.concatenate([arcs - radius, arcs + radius])
    is_proved[piece] = False
    return is_proved
