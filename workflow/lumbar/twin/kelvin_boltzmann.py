"""A Kelvin–Boltzmann tissue, and the strength at which an effect hidden in it leaves a wanted residual."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import lfilter

from lumbar.twin.tool_motion import RATE_HZ, ToolMotion

SETTLING_S = 0.5
"""Left out at the start of every record when a residual is measured."""
_FIT_STRIDE = 4
"""The fit runs on every fourth grid point, 500 Hz: its trapezoidal error is below 0.05 % up to 5 Hz."""
_TOLERANCE = 0.01
"""Relative accuracy of the wanted residual."""
_STEPS = 6
"""Severities tried on the way up."""


@dataclass(frozen=True)
class Tissue:
    """Spring beside a Maxwell branch (spring and dashpot in series)."""

    elastic: float
    """Stiffness at rest kₑ, N/mm."""
    relaxing: float
    """Stiffness k₂ of the Maxwell branch, N/mm."""
    relaxation_s: float
    """Time constant τ of the branch."""

    def force(self, motion: ToolMotion) -> np.ndarray:
        """Force in newtons, the branch relaxed at the first position."""
        branch = maxwell_force(motion.position, motion.step, self.relaxing, self.relaxation_s)
        return self.elastic * motion.position + branch


def maxwell_force(position: np.ndarray, step: float, stiffness: float, relaxation_s: float) -> np.ndarray:
    """Force of a Maxwell branch, Ḟ = k ż − F/τ with F(0) = 0, by the trapezoidal rule.

    Position of shape (points,) in mm, stiffness in N/mm; `step` seconds lie between points, and the relative error at frequency f
    is about (2π f step)²/12.
    """
    half = 0.5 * step / relaxation_s
    change = np.diff(position, prepend=position[0])
    return lfilter([stiffness / (1 + half)], [1.0, -(1 - half) / (1 + half)], change)


def kelvin_boltzmann_residual(motion: ToolMotion, force: np.ndarray) -> np.ndarray:
    """What the best Kelvin–Boltzmann tissue, fitted by least squares, leaves of a recorded force.

    Newtons at the recorded samples, shape (samples,), from `SETTLING_S` on. Stiffnesses are free, the time constant is sought
    between 2 ms and 20 s.
    """
    start = round(SETTLING_S * RATE_HZ)
    coarse, step = motion.position[::_FIT_STRIDE], motion.step * _FIT_STRIDE
    elastic = motion.sampled(motion.position)[start:]
    target = force[start:]

    def residual(log_relaxation: float) -> np.ndarray:
        branch = maxwell_force(coarse, step, 1.0, np.exp(log_relaxation))
        return _unexplained(elastic, branch[:: motion.stride // _FIT_STRIDE][start:], target)

    grid = np.log([0.004, 0.02, 0.05, 0.1, 0.2, 0.4, 1.2, 8.0])
    costs = [float(np.sum(residual(value) ** 2)) for value in grid]
    best = int(np.argmin(costs))
    low = grid[best - 1] if best > 0 else np.log(0.002)
    high = grid[best + 1] if best < len(grid) - 1 else np.log(20.0)
    found = minimize_scalar(
        lambda value: float(np.sum(residual(value) ** 2)),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-4},
    )
    return residual(found.x)


def _unexplained(first: np.ndarray, second: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Residual of the projection on two regressors, by the normal equations: fast, and both are of like size."""
    gram = np.array([[first @ first, first @ second], [first @ second, second @ second]])
    weights = np.linalg.solve(gram, [first @ target, second @ target])
    return target - weights[0] * first - weights[1] * second


def severity_leaving(
    wanted_N: float, motion: ToolMotion, force_at: Callable[[float], np.ndarray], least_N: float
) -> float:
    """Return the least severity at which the best Kelvin–Boltzmann tissue leaves a residual; else that which leaves most.

    The residual need not grow with the strength throughout (a very fast branch replaces the base's own, a signal
    clipped to nothing is explained by no tissue): the weakest effect that will do is the plausible one.

    Parameters
    ----------
    wanted_N : float
        RMS of the residual on the record of `motion`.
    force_at : callable
        Noise-free force on the simulation's grid, by severity between 0 (weakest) and 1 (strongest).
    least_N : float
        What counts as no residual.
    """

    @cache
    def excess(severity: float) -> float:
        return float(np.log(max(residual_rms(motion, force_at(severity)), least_N) / wanted_N))

    def near(severity: float) -> float:
        return 0.0 if abs(excess(severity)) < _TOLERANCE else excess(severity)

    tried = [step / _STEPS for step in range(_STEPS + 1)]
    for low, high in pairwise(tried):
        if excess(high) > 0:
            return 0.0 if excess(low) > 0 else float(brentq(near, low, high, xtol=1e-4))
    return max(tried, key=excess)


def residual_rms(motion: ToolMotion, force: np.ndarray) -> float:
    """RMS of what the best Kelvin–Boltzmann tissue leaves of a force on the simulation's grid, newtons."""
    return float(np.sqrt(np.mean(kelvin_boltzmann_residual(motion, motion.sampled(force)) ** 2)))
