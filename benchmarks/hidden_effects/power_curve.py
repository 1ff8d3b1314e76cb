"""Power curve: how often an effect is named, as a function of its strength.

Two estimates stand side by side: a logistic curve over the logarithm of the strength, with Firth's penalty so that
it exists when strong effects are always named (Biometrika 80, 1993), and isotonic regression, which assumes nothing
but that stronger effects are named more often.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import isotonic_regression, minimize
from scipy.special import expit, logit

from lumbar.base.errors import InputError, NumericalError


@dataclass(frozen=True)
class PowerCurve:
    """Share of effects named as a function of strength."""

    strength: np.ndarray
    """Shape (n,): residual over noise of the effects, ascending."""
    named: np.ndarray
    """Shape (n,)."""
    intercept: float
    slope: float
    """`intercept`, `slope`: of the logistic curve: share = expit(intercept + slope ln strength)."""
    isotonic: np.ndarray
    """Shape (n,): isotonic estimate of the share at `strength`."""

    def share(self, strength: np.ndarray) -> np.ndarray:
        """Share named by the logistic curve."""
        return expit(self.intercept + self.slope * np.log(strength))

    def strength_at(self, share: float) -> float | None:
        """Strength from which the logistic curve says that this share is named; None where it lies outside.

        Outside is beyond the strongest effect tested, or anywhere if the curve does not rise. Where the share is
        exceeded throughout it is the weakest effect tested: nothing is said of weaker ones.
        """
        if self.slope <= 0:
            return None
        found = (logit(share) - self.intercept) / self.slope
        if found > np.log(self.strength[-1]):
            return None
        return max(float(np.exp(found)), float(self.strength[0]))

    def isotonic_strength_at(self, share: float) -> float | None:
        """Least strength tested from which the isotonic estimate is at least this share; None if nowhere."""
        reached = np.flatnonzero(self.isotonic >= share - 1e-12)
        return float(self.strength[reached[0]]) if reached.size else None


def fit_power_curve(strength: np.ndarray, named: np.ndarray) -> PowerCurve:
    """Fit both curves.

    Parameters
    ----------
    strength : array_like, shape (n,)
        Positive; residual of the best base model over the noise.
    named : array_like of bool, shape (n,)
        Whether the effect was named.

    Raises
    ------
    InputError
        With fewer than three experiments, or all of one strength.
    """
    strength, named = np.asarray(strength, dtype=float), np.asarray(named, dtype=bool)
    if len(strength) < 3 or np.ptp(strength) == 0:
        raise InputError(
            f"power curve: {len(strength)} experiments with {len(np.unique(strength))} strengths; at least three "
            "experiments of different strength are needed: raise experiments_per_form"
        )
    order = np.argsort(strength, kind="stable")
    strength, named = strength[order], named[order]
    intercept, slope = _firth_logistic(np.log(strength), named.astype(float))
    share, weights = _pooled(strength, named)
    isotonic = isotonic_regression(share, weights=weights).x
    isotonic = isotonic[np.unique(strength, return_inverse=True)[1]]
    return PowerCurve(strength, named, intercept, slope, isotonic)


def _pooled(strength: np.ndarray, named: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share named and weight of each distinct strength."""
    _, inverse, count = np.unique(strength, return_inverse=True, return_counts=True)
    return np.bincount(inverse, named) / count, count.astype(float)


def _firth_logistic(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Intercept and slope that maximise the likelihood times the root of the determinant of its information.

    Its gradient is the modified score Xᵀ(y − p + h(½ − p)) with the leverages h.
    """
    centre, spread = x.mean(), x.std()
    design = np.column_stack([np.ones_like(x), (x - centre) / spread])

    def objective(weights: np.ndarray) -> tuple[float, np.ndarray]:
        linear = design @ weights
        share = expit(linear)
        variance = share * expit(-linear)
        information = design.T @ (design * variance[:, None])
        penalised = np.sum(y * linear - np.logaddexp(0.0, linear)) + 0.5 * np.linalg.slogdet(information)[1]
        leverage = variance * np.sum(design @ np.linalg.inv(information) * design, axis=1)
        return -penalised / len(x), -design.T @ (y - share + leverage * (0.5 - share)) / len(x)

    found = minimize(objective, np.zeros(2), jac=True, method="BFGS", options={"gtol": 1e-8})
    # BFGS may stop for lack of precision with the gradient at rounding level: what counts is the gradient.
    if np.abs(found.jac).max() > 1e-5:
        raise NumericalError(f"power curve: the logistic fit did not converge ({found.message})")
    intercept, slope = found.x
    return float(intercept - slope * centre / spread), float(slope / spread)


def strength_interval(
    curve: PowerCurve, share: float, confidence: float, resamples: int, seed: int
) -> tuple[float | None, float | None]:
    """Percentile bootstrap interval of `PowerCurve.strength_at`.

    Resamples in which the share is not reached count as infinitely strong; a bound among them is None.
    """
    rng = np.random.default_rng([seed, 95])
    found = []
    for _ in range(resamples):
        picked = rng.integers(0, len(curve.strength), len(curve.strength))
        strength, named = curve.strength[picked], curve.named[picked]
        if np.ptp(strength) == 0:
            continue
        intercept, slope = _firth_logistic(np.log(strength), named.astype(float))
        value = replace(curve, intercept=intercept, slope=slope).strength_at(share)
        found.append(np.inf if value is None else value)
    tail = (1 - confidence) / 2
    low, high = np.quantile(found, [tail, 1 - tail], method="inverted_cdf")
    return (float(low) if np.isfinite(low) else None, float(high) if np.isfinite(high) else None)
