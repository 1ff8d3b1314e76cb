"""Cluster bootstrap: whole persons are drawn again, never single trials.

Studentised (Davison & Hinkley, 1997, ch. 5.2), on the persons' means: percentiles of the difference itself are too narrow
with few persons (a 5 % test rejects in 8–20 % with 3 to 10 of each group). Drawing trials within the persons drawn
counts their scatter twice (§ 3.8), so that the level then hangs on the intraclass correlation; benchmarks/population.py
prints all three.
"""

from __future__ import annotations

import numpy as np

from lumbar.lifting.population.contrast import CONFIDENCE, Interval

FEWEST_RESAMPLED = 5
"""Persons of each group below which few different samples can be drawn."""


def cluster_bootstrap(
    first: np.ndarray, second: np.ndarray | None, seed: int, resamples: int = 2000
) -> Interval:
    """Return the 95 % bootstrap-t interval of a difference of means over persons.

    Parameters
    ----------
    first, second : numpy.ndarray, shape (persons,)
        Means of each person's trials; second is None where `first` holds the differences of paired means.
    """
    generator = np.random.default_rng(seed)
    sides = [first] if second is None else [first, second]
    fewest = min(map(len, sides))
    if fewest < FEWEST_RESAMPLED:
        return Interval(remark=f"no bootstrap: {fewest} persons, at least {FEWEST_RESAMPLED} are needed")
    drawn = [values[generator.integers(0, len(values), (resamples, len(values)))] for values in sides]
    differences, errors = _difference(drawn)
    difference, error = (float(value) for value in _difference(sides))
    # A sample of one person again and again has no scatter of its own: it tells nothing.
    scattered = errors > 1e-12 * error
    if not error > 0 or not scattered.any():
        return Interval(remark="no bootstrap: persons do not differ")
    studentised = (differences[scattered] - difference) / errors[scattered]
    low, high = np.quantile(studentised, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(difference - high * error), float(difference - low * error))


def _difference(sides: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Difference of means along the last axis, and its standard error."""
    means = [values.mean(axis=-1) for values in sides]
    variance = sum(values.var(axis=-1, ddof=1) / values.shape[-1] for values in sides)
    return (means[0] if len(sides) == 1 else means[0] - means[1]), np.sqrt(variance)
