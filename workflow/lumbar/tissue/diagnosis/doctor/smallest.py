"""The smallest strength at which an effect is named, by bisection from where the prediction says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.doctor.outcome import Kind, Outcome

CLOSE = 1.5
"""Ratio of the smallest strength named and the largest below it that was not, within which the search is done."""
_MOST_TRIALS = 6
_ABOVE = 1.25
"""First strength tried in the bisection, in predicted ones; from there it goes by factors of 2, and between them by halves."""
_QUICK = 2.0
"""Strength of the one trial that confirms a prediction, in predicted ones."""


@dataclass(frozen=True, eq=False)
class Search:
    """Strengths that were tried, and what was said at each."""

    trials: dict[float, Outcome]
    """In the order tried."""
    smallest: float | None
    """Smallest strength at which the effect was named; None where it never was."""
    missed: float | None
    """Largest strength tried below it at which it was not named, or where it never was, the largest of all; None where it
    was named at all."""

    @property
    def at_strongest(self) -> Outcome:
        """What was said at the largest strength tried."""
        return self.trials[max(self.trials)]

    @property
    def at_missed(self) -> Outcome | None:
        """What was said at `missed`."""
        return None if self.missed is None else self.trials[self.missed]


def search(outcome_at: Callable[[float], Outcome], expected: float, strongest: float, quick: bool) -> Search:
    """Find the smallest strength that is named, to within `CLOSE`.

    Parameters
    ----------
    outcome_at : callable
        From a strength to the outcome.
    expected : float
        Where it is predicted; NaN where it is not expected to be seen.
    strongest : float
        Strength tried first.
    quick : bool
        Only confirm the prediction, by one trial a little above it.
    """
    trials: dict[float, Outcome] = {}

    def named(strength: float) -> bool:
        trials[strength] = outcome_at(strength)
        return trials[strength].kind is Kind.NAMED

    expected = min(expected, strongest) if expected == expected else strongest
    high = min(_QUICK * expected, strongest) if quick else strongest
    if not named(high):
        # What a strong effect is mistaken for may be out of the question for a weaker one.
        weaker = float(np.sqrt(strongest * expected))
        if quick or weaker > high / CLOSE or not named(weaker):
            return Search(trials, None, max(trials))
        high = weaker
    if quick:
        return Search(trials, high, None)
    low, trial = None, min(_ABOVE * expected, high / CLOSE)
    while len(trials) < _MOST_TRIALS and (low is None or high > CLOSE * low):
        high, low = (trial, low) if named(trial) else (high, trial)
        trial = high / 2 if low is None else min(2 * low, float(np.sqrt(low * high)))
    return Search(trials, high, low)
