"""Extrapolated centre of mass: where the centre of mass goes if nothing brakes it, and the push that makes it leave.

Source: Hof, Gazendam and Sinke, The condition for dynamic stability, J. Biomech. 38 (2005) 1-8. A person as an inverted
pendulum of length l keeps balance without a step as long as x + v/ω0 with ω0 = √(g/l) stays above the base of support.
"""

from __future__ import annotations

import numpy as np


def pendulum_rate(length: np.ndarray | float, gravity: float) -> np.ndarray | float:
    """ω0 = √(g/l) in 1/s of a pendulum of length l in metres."""
    return np.sqrt(gravity / length)


def extrapolated_centre(position: np.ndarray, velocity: np.ndarray, rate: np.ndarray | float) -> np.ndarray:
    """Extrapolated centre of mass x + v/ω0 (Hof et al. 2005, Eq. 5), shape as of `position`.

    Parameters
    ----------
    position, velocity : ndarray, shape (n, d)
        Of the whole body's centre of mass with what it carries, metres and m/s: horizontal coordinates.
    rate : ndarray, shape (n,), or float
        ω0 in 1/s.
    """
    return position + velocity / np.reshape(rate, (-1, 1))


def smallest_impulse(mass: np.ndarray | float, rate: np.ndarray | float, margin: np.ndarray) -> np.ndarray:
    """Horizontal impulse in N·s that just moves the extrapolated centre over the edge: m·ω0·b (Hof et al. 2005).

    A push changes v at once by J/m, and so the extrapolated centre by J/(m·ω0). Negative: it is over the edge already, and
    that impulse would bring it back.

    Parameters
    ----------
    mass : ndarray, shape (n,), or float
        Body with what it carries, kilograms.
    rate : ndarray, shape (n,), or float
        ω0 in 1/s.
    margin : ndarray, shape (n,)
        Signed distance of the extrapolated centre to the edge of the base, metres.
    """
    return mass * rate * margin
