"""A stylus that nobody holds: m ẍ + b ẋ + F sign(ẋ) + k x = f(t − τ) + f₀, for many stretches and parameters at once.

The commanded force f is held between two ticks and acts late by τ, so that it changes once within every tick. Between two
changes the motion has a closed form, and it comes to rest at most once. The weak spring k of cables and the like is held over
such a piece, at the place that the stylus would pass in its middle.
"""

from __future__ import annotations

import numpy as np

from lumbar.tissue.haptics.device_identification.stretches import Stretches

PARAMETERS = ("mass", "damping", "friction", "delay", "offset", "spring")
"""m in kg, b in N·s/m, F in N, τ in s, f₀ in N and k in N/m: rows of every array of parameters."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a search that goes astray turns back
def free_motion(stretches: Stretches, parameters: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Simulate every stretch with every set of parameters: way in m from its first sample, shape (length, stretches, sets).

    Parameters
    ----------
    parameters : numpy.ndarray, shape (6, sets)
        `PARAMETERS`; mass and damping above 0. A friction below 0 drives; the delay may be negative or longer than a tick.
    velocities : numpy.ndarray, shape (stretches, sets)
        At the first sample of each stretch, m/s.
    """
    mass, damping, friction, delay, offset, spring = parameters
    late = np.floor(delay / stretches.step).astype(int)
    split = delay - late * stretches.step
    pieces = [_Piece(mass, damping, friction, seconds) for seconds in (split, stretches.step - split)]
    # What the spring pulls with at the start of a stretch counts as constant.
    constant = offset - spring * stretches.readings[0][:, None]
    way, velocity = np.zeros_like(velocities), np.array(velocities)
    ways = np.empty((stretches.length, *velocities.shape))
    for tick in range(stretches.length):
        ways[tick] = way
        newest = stretches.starts[:, None] + tick - late
        for piece, sample in zip(pieces, (newest - 1, newest), strict=True):
            force = stretches.forces[np.clip(sample, 0, len(stretches.forces) - 1)] + constant
            moved, velocity = piece.moved(velocity, force - spring * (way + 0.5 * piece.seconds * velocity))
            way = way + moved
    return ways


class _Piece:
    """The motion over a time in which the force is held."""

    def __init__(self, mass: np.ndarray, damping: np.ndarray, friction: np.ndarray, seconds: np.ndarray):
        self.damping, self.friction, self.seconds = damping, friction, seconds
        self.relaxation = mass / damping
        self.lost = -np.expm1(-seconds / self.relaxation)

    def moved(self, velocity: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Way and velocity at the end."""
        starting = np.where(np.abs(force) > self.friction, np.sign(force), 0.0)
        direction = np.where(velocity == 0.0, starting, np.sign(velocity))
        final = (force - direction * self.friction) / self.damping
        way = self.relaxation * self.lost * (velocity - final) + final * self.seconds
        after = velocity + (final - velocity) * self.lost
        way[direction == 0.0] = after[direction == 0.0] = 0.0
        turns = (velocity * after < 0.0).nonzero()
        if len(turns[0]):
            way[turns], after[turns] = self._turned(velocity[turns], force[turns], final[turns], turns[1])
        return way, after

    def _turned(self, velocity, force, final, which) -> tuple[np.ndarray, np.ndarray]:
        """The same where the stylus comes to rest within the time: then it sticks, or goes back."""
        relaxation = self.relaxation[which]
        stop = relaxation * np.log1p(-velocity / final)
        rest = self.seconds[which] - stop
        back = np.sign(force) * np.maximum(np.abs(force) - self.friction[which], 0.0) / self.damping[which]
        lost = -np.expm1(-rest / relaxation)
        return final * stop + relaxation * velocity + back * (rest - relaxation * lost), back * lost
