"""Interval arithmetic on arrays with outward rounding: every result contains the exact one.

Only what `interval_proof` needs. A floating-point operation is correct to half a unit in the last place, so a
step of one unit outward encloses it; sine and cosine of numpy are correct to 4 units, for which 2⁻⁵⁰ is added (Moore,
Kearfott & Cloud, Introduction to Interval Analysis, 2009).
"""

from __future__ import annotations

import numpy as np

TRIGONOMETRIC_ERROR = 2.0**-50
UNIT, TINY = 2.0**-52, 2.0**-1074


class Interval:
    """Closed intervals [low, high], element by element; both arrays have the same shape."""

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
        products = (
            self.low * other.low,
            self.low * other.high,
            self.high * other.low,
            self.high * other.high,
        )
        low = np.minimum(np.minimum(products[0], products[1]), np.minimum(products[2], products[3]))
        high = np.maximum(np.maximum(products[0], products[1]), np.maximum(products[2], products[3]))
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
        first, second = np.sin(self.low), np.sin(self.high)
        low, high = np.minimum(first, second), np.maximum(first, second)
        high = np.where(self._contains(np.pi / 2), 1.0, high + TRIGONOMETRIC_ERROR)
        low = np.where(self._contains(-np.pi / 2), -1.0, low - TRIGONOMETRIC_ERROR)
        return Interval(np.maximum(low, -1.0), np.minimum(high, 1.0))

    def cos(self) -> Interval:
        """Return the cosines."""
        first, second = np.cos(self.low), np.cos(self.high)
        low, high = np.minimum(first, second), np.maximum(first, second)
        high = np.where(self._contains(0.0), 1.0, high + TRIGONOMETRIC_ERROR)
        low = np.where(self._contains(np.pi), -1.0, low - TRIGONOMETRIC_ERROR)
        return Interval(np.maximum(low, -1.0), np.minimum(high, 1.0))

    def _contains(self, angle: float) -> np.ndarray:
        """Whether the interval, a little enlarged, contains the angle plus a multiple of 2π."""
        slack = 1e-9 * (1.0 + np.abs(self.high))
        turns = np.ceil((self.low - slack - angle) / (2 * np.pi))
        return angle + 2 * np.pi * turns <= self.high + slack


def _interval(value) -> Interval:
    return value if isinstance(value, Interval) else Interval(value)


def _outward(low: np.ndarray, high: np.ndarray) -> Interval:
    # |x|·2⁻⁵² is one to two units in the last place of x: this is nextafter or a little more, at a third of its time.
    return Interval(low - (np.abs(low) * UNIT + TINY), high + (np.abs(high) * UNIT + TINY))
