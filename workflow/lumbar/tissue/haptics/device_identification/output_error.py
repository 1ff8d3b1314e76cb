"""The device whose motion is nearest to the recorded one, with intervals: output error.

What is compared with the encoder is the motion that the commanded forces alone lead to, over stretches that each begin at a
position and a velocity of their own.

The fit begins at a linear regression on the equation of motion, integrated twice,
m x + b ∫x + F ∫∫sign(ẋ) − f₀ ∫∫1 = ∫∫f(t − τ) + a + c t in each stretch, so that nothing that was read is differentiated but
for the direction of the motion. Where the stylus rests friction balances all forces, and none is counted.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import scipy

from lumbar.tissue.haptics.device_identification.free_motion import MARGIN, PARAMETERS, Stretches, free_motion

_LATEST = (-2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, MARGIN - 2)
"""Delays that are tried, in samples, each with any part of the time to the next one."""
_LEAST = 1e-5
"""Mass in kg and damping in N·s/m to begin with at least."""


def regress(stretches: Stretches) -> np.ndarray:
    """Return the parameters that were found at each delay, the nearest motion first; shape (delays, 6), without a spring."""
    step, velocity = stretches.step, stretches.velocity[stretches.ticks]
    moving, way = velocity != 0.0, stretches.readings - stretches.readings[0]

    def twice(values: np.ndarray) -> np.ndarray:
        """Integral of what is held from sample to sample and acts while the stylus moves."""
        once = np.cumsum(values * moving, axis=0) - values * moving
        return step**2 * (np.cumsum(once, axis=0) - 0.5 * once)

    columns = [
        way,
        step * (np.cumsum(way, axis=0) - 0.5 * way),
        twice(np.sign(velocity)),
        twice(-1.0 * moving),
    ]
    found = []
    for late, later in pairwise(_LATEST):
        first, second = (twice(stretches.forces[stretches.ticks - item]) for item in (late, later))
        whole = _apart_from_lines(np.stack([*columns, first - second, first], axis=-1)).reshape(-1, 6)
        sizes = np.sqrt((whole**2).sum(axis=0)) + np.finfo(float).tiny
        # Of the triangle the last column is what the others should add up to.
        triangle = np.linalg.qr(whole / sizes, mode="r")
        limits = np.array([[_LEAST, _LEAST, 0.0, -np.inf, 0.0], [np.inf, np.inf, np.inf, np.inf, 1.0]])
        solved = scipy.optimize.lsq_linear(triangle[:, :5], triangle[:, 5], limits * sizes[:5] / sizes[5]).x
        *dynamic, offset, part = solved * sizes[5] / sizes[:5]
        found.append([*dynamic, step * (late + part * (later - late)), offset, 0.0])
    sets = np.array(found).T
    starts = np.repeat(stretches.velocity[stretches.starts][:, None], sets.shape[1], axis=1)
    left = _apart_from_lines(stretches.readings[..., None] - free_motion(stretches, sets, starts))
    return sets.T[np.argsort((left**2).sum(axis=(0, 1)))]


def _apart_from_lines(values: np.ndarray) -> np.ndarray:
    """What a straight line in each stretch leaves of values of shape (length, stretches, n)."""
    lines = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(values)), 2))[0]
    return values - np.tensordot(lines, np.tensordot(lines.T, values, axes=1), axes=1)


CONFIDENCE = 0.95
_RELATIVE_STEP, _PRECISION, _EVALUATIONS = 1e-5, 1e-12, 60
"""Of the differences that derivatives are taken by; where and when the search ends."""
_SHORT, NOTICED = 10, 0.002
"""Evaluations of a short search; share of the motion that is unexplained from which on it is searched anew, and said."""
_SINGULAR = 1e12
"""Condition number, of parameters scaled to one information each, beyond which one of them is another in disguise."""
_LEAST_ERROR_M = 1e-9
"""Of a reading: no encoder reads finer, and the search ends within it."""
_SIGNIFICANT = 4.0
"""Standard errors that what neighbouring readings share must be above."""


@dataclass(frozen=True)
class DeviceFit:
    """Fitted parameters and what they leave."""

    stretches: Stretches
    parameters: np.ndarray
    """Shape (6,), as `PARAMETERS`."""
    residuals: np.ndarray
    """Shape (length, stretches): read less simulated, m, about its mean in each stretch."""
    derivatives: np.ndarray
    """Shape (length, stretches, 6): of the motion by the parameters, apart from what other starts would make up for."""

    def intervals(self) -> tuple[np.ndarray, np.ndarray]:
        """Half of the 95 % intervals, shape (6,), and the correlations of their errors, shape (6, 6).

        From what each stretch that is left out changes (jackknife: an encoder errs to one side as long as the stylus creeps,
        and noise need not be equal), or from errors that are equal and independent, whichever is wider: where few stretches
        tell most, the first may be too narrow. Degrees of freedom after Satterthwaite (R. M. Bell and D. F. McCaffrey, Survey
        Methodology 28, 2002). Infinite where the recording does not tell one parameter from the others.
        """
        weights, count = self.stretches.weights, len(self.stretches.starts)
        size = np.sqrt(np.einsum("ts,tsi->i", weights, self.derivatives**2)) + np.finfo(float).tiny
        scaled = self.derivatives / size
        information = np.einsum("ts,tsi,tsj->sij", weights, scaled, scaled)
        whole = information.sum(axis=0)
        if not np.linalg.cond(whole) < _SINGULAR:
            return np.full(len(PARAMETERS), np.inf), np.zeros(whole.shape)
        slopes = np.einsum("ts,tsi,ts->si", weights, scaled, self.residuals)
        changes = (np.linalg.pinv(whole - information) @ slopes[:, :, None])[:, :, 0]
        jackknife = (count - 1) / count * ((changes - changes.mean(axis=0)) ** 2).sum(axis=0)
        power = (weights * self.residuals**2).sum() / max(weights.sum() - len(size) - 2 * count, 1.0)
        covariance = np.linalg.inv(whole)
        equal = np.diag(covariance)
        variance = np.maximum(jackknife, max(power, _LEAST_ERROR_M**2) * equal)
        # What each stretch has of the variance that equal errors give; few stretches that tell most are few degrees of freedom.
        shares = np.einsum("ij,sjk,ki->si", covariance, information, covariance) / equal
        half = scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, 1.0 / (shares**2).sum(axis=0)) * np.sqrt(variance)
        return half / size, covariance / np.sqrt(np.outer(equal, equal))

    def unexplained(self) -> float:
        """Motion that the equation does not give, as a share of what is no straight line in the stretches: root mean squares.

        Errors of neighbouring readings that differ have nothing in common but what the encoder's steps hide: at rest, or
        where a motion comes back, up to half a step in each. What they share beside that, and beside chance, is motion.
        """
        stretches, runs = self.stretches, self.stretches.runs
        means = np.bincount(runs.T.ravel(), self.residuals.T.ravel()) / np.bincount(runs.T.ravel())
        products = np.delete(means[1:] * means[:-1], runs[0, 1:] - 1)  # not from stretch to stretch
        chance = _SIGNIFICANT * products.std() / np.sqrt(len(products))
        if products.mean() < max(chance, stretches.resolution**2 / 4.0):
            return 0.0
        line = np.linspace(-1.0, 1.0, stretches.length)
        readings = stretches.readings - stretches.readings.mean(axis=0)
        curved = readings - np.outer(line, line @ readings) / (line @ line)
        return float(np.sqrt(products.mean() / np.average(curved**2, weights=stretches.weights)))


def nearest_fit(stretches: Stretches) -> DeviceFit:
    """The fit that begins at the nearest motion; where that leaves more than `NOTICED`, at the best of short ones from all."""
    begins = regress(stretches)
    found = fit_device(stretches, begins[0])
    if found.unexplained() < NOTICED:
        return found
    short = [fit_device(stretches, begin, _SHORT) for begin in begins[1:]]
    best = min(short, key=lambda fit: (stretches.weights * fit.residuals**2).sum())
    return min(found, fit_device(stretches, best.parameters), key=DeviceFit.unexplained)


@np.errstate(over="ignore", invalid="ignore")
def fit_device(stretches: Stretches, begin: np.ndarray, evaluations: int = _EVALUATIONS) -> DeviceFit:
    """Fit `PARAMETERS` and the start of every stretch; the search begins at parameters of shape (6,)."""
    count, number = len(PARAMETERS), len(stretches.starts)
    sizes, roots = _sizes(stretches, begin), np.sqrt(stretches.weights)
    scales = np.concatenate([sizes[:count], np.full(number, sizes[count])])

    @lru_cache(maxsize=1)
    def motion(key: bytes) -> tuple[np.ndarray, np.ndarray]:
        values = np.frombuffer(key)
        return _motion(stretches, values[:count], values[count:], _RELATIVE_STEP * sizes)

    def residuals(values: np.ndarray) -> np.ndarray:
        return (roots * motion(values.tobytes())[0]).T.ravel()

    def jacobian(values: np.ndarray) -> np.ndarray:
        by = -(roots[..., None] * motion(values.tobytes())[1]).transpose(1, 0, 2)
        whole = np.zeros((number, stretches.length, count + number))
        whole[..., :count] = by[..., :count]
        whole[np.arange(number), :, count + np.arange(number)] = by[..., count]
        return whole.reshape(-1, count + number)

    # Mass and damping are positive; friction may come out below 0 by its error: a bound there would pull at the others.
    lowest = np.where(np.arange(count + number) < 2, 1e-6, -np.inf)
    found = scipy.optimize.least_squares(
        residuals,
        np.maximum([*begin, *stretches.velocity[stretches.starts]], lowest + 1e-3 * scales),
        jacobian,
        bounds=(lowest, np.inf),
        x_scale=scales,
        **dict.fromkeys(("xtol", "ftol", "gtol"), _PRECISION),
        max_nfev=evaluations,
    )
    left, by = motion(found.x.tobytes())
    by, by_velocity = by[..., :count], by[..., count]
    size = (stretches.weights * by_velocity**2).sum(axis=0)
    share = np.einsum("ts,ts,tsi->si", stretches.weights, by_velocity, by)
    # A stylus that rests has no velocity that could be another.
    apart = by - by_velocity[..., None] * (share / np.where(size > 0, size, np.inf)[:, None])
    return DeviceFit(stretches, found.x[:count], left, apart)


def _motion(stretches, parameters, velocities, steps) -> tuple[np.ndarray, np.ndarray]:
    """Residuals about their mean in each stretch, and derivatives by the parameters and by the velocity at the start."""
    count = len(parameters)
    sets, starts = (np.repeat(item[:, None], count + 2, axis=1) for item in (parameters, velocities))
    sets[np.arange(count), np.arange(count)] += steps[:count]
    starts[:, count] += steps[count]
    ways = free_motion(stretches, sets, starts)
    weights = stretches.weights[..., None] / stretches.weights.sum(axis=0)[:, None]
    by = (ways[..., :-1] - ways[..., -1:]) / steps
    left = stretches.readings[..., None] - ways[..., -1:]
    return (left - (weights * left).sum(axis=0))[..., 0], by - (weights * by).sum(axis=0)


def _sizes(stretches: Stretches, begin: np.ndarray) -> np.ndarray:
    """Sizes of the parameters, and of a velocity, that matter in this recording."""
    force, speed = stretches.rms(stretches.forces), stretches.rms(stretches.velocity)
    mass = max(begin[0], 0.01 * force / speed * stretches.length * stretches.step)
    damping, way = max(begin[1], 0.01 * force / speed), float(np.std(stretches.readings))
    return np.array([mass, damping, force, stretches.step, force, force / way, speed])
