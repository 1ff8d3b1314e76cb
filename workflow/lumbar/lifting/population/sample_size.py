"""How many persons, with how many trials each, a study needs to see a difference: noncentral t on person means."""

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.population.variance_components import FEWEST_PERSONS

MOST_PERSONS = 100_000
"""Persons (of each group) beyond which a study is called out of reach."""
CONFIDENCE = 0.95


def person_mean_sd(person_sd: float, trial_sd: float, trials: float) -> float:
    """Return √(σ_person² + σ_trial²/trials), the standard deviation of the mean of one person's trials."""
    return float(np.hypot(person_sd, trial_sd / np.sqrt(trials)))


def power(
    difference: float, sd: float, persons: int, *, paired: bool = False, significance: float = 0.05
) -> float:
    """Return the probability that a two-sided t test on person means sees a difference.

    Parameters
    ----------
    difference : float
        True difference.
    sd : float
        Standard deviation of the persons' means (`person_mean_sd`) or, `paired`, of their differences.
    persons : int
        Of each group or, `paired`, altogether.

    Examples
    --------
    >>> round(power(0.5, 1.0, 64), 3)  # Cohen, Statistical Power Analysis, 1988, Table 2.4.1
    0.801
    """
    from scipy.stats import nct, t

    freedom = persons - 1 if paired else 2 * persons - 2
    if freedom < 1:
        return 0.0
    noncentrality = abs(difference) / sd * np.sqrt(persons if paired else persons / 2)
    limit = t.ppf(1 - significance / 2, freedom)
    # The lower tail is the upper one of the mirrored distribution; nct.cdf returns NaN there from 8 standard errors on.
    return float(nct.sf(limit, freedom, noncentrality) + nct.sf(limit, freedom, -noncentrality))


def persons_needed(
    difference: float,
    sd: float,
    *,
    paired: bool = False,
    power_wanted: float = 0.8,
    significance: float = 0.05,
) -> int | None:
    """Return the smallest number of persons, of each group or paired, with the power wanted; None beyond `MOST_PERSONS`.

    Parameters are as of `power`.

    Raises
    ------
    InputError
        A difference of 0, or no standard deviation.

    Examples
    --------
    >>> persons_needed(0.8, 1.0)  # Cohen (1988), Table 2.4.1
    26
    """
    if not difference or not sd > 0:
        raise InputError(f"difference {difference:g}, standard deviation {sd:g}: both must differ from 0")

    def enough(persons: int) -> bool:
        return power(difference, sd, persons, paired=paired, significance=significance) >= power_wanted

    low, high = FEWEST_PERSONS - 1, FEWEST_PERSONS
    while not enough(high):
        if high >= MOST_PERSONS:
            return None
        low, high = high, min(2 * high, MOST_PERSONS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def sd_interval(sd: float, freedom: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval of a standard deviation that was estimated with some degrees of freedom (chi-square).

    Examples
    --------
    >>> [round(end, 2) for end in sd_interval(1.0, 18)]  # a pilot of 10 + 10 persons
    [0.76, 1.48]
    """
    from scipy.stats import chi2

    tails = (1 + confidence) / 2, (1 - confidence) / 2
    low, high = (float(sd * np.sqrt(freedom / chi2.ppf(tail, freedom))) for tail in tails)
    return low, high


def assured_sd(sd: float, freedom: float, assurance: float) -> float:
    """Return what the true standard deviation stays below with a probability of `assurance`, by a pilot with `freedom`.

    A study planned with it has the power wanted in so many of the pilots; planned with the pilot's own, in fewer than half
    (Browne, *Statistics in Medicine* 14, 1995, 1933-1940).
    """
    return sd_interval(sd, freedom, 2 * assurance - 1)[1]


def detectable_difference(
    sd: float, persons: int, *, paired: bool = False, power_wanted: float = 0.8, significance: float = 0.05
) -> float:
    """Return the smallest difference that a number of persons (of each group) sees with the power wanted."""
    from scipy.optimize import brentq

    def lacking(difference: float) -> float:
        return power(difference, 1.0, persons, paired=paired, significance=significance) - power_wanted

    return float(sd * brentq(lacking, 1e-9, 40.0))
