"""Levels of significance and thresholds of a diagnosis, and the gain of the best candidate if nothing is missing.

The tables next to this module, one per catalogue, contain the largest likelihood-ratio statistic among all its candidates
for simulated experiments in which the base model is true, base refitted each time. Gains of white noise do not depend
on the record's length, so the tables are made once (``benchmarks/null_gains.py``) and shipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.files import read_json

if TYPE_CHECKING:
    from lumbar.tissue.models.form import Effect

LEVEL = 0.01
"""An effect is selected only at this probability of a false alarm."""
UNSEEN = 2.33
"""Standard errors by which the squared error on unseen records must fall (one-sided 1 %)."""
COMPLETE = 1.2
"""Error in noise floors, on training and unseen records, up to which a refined model that nothing further improves counts
as complete: its parameters are estimates, and cost a little on records that they were not fitted to."""
EXPLAINS = 0.5
"""Share of the base's unseen variance, without that of known noise, that effects must remove to be named."""
TIED = 9.2
"""Difference in twice the log-likelihood below which two effects cannot be distinguished (odds of 100 to 1)."""
STRUCTURED = 0.2
"""Largest structured difference between periods, in noise floors, of an adequate model."""
WORTHWHILE = 0.007
"""A further effect must remove this share of what the base leaves to explain of the training record, and as much as
the noise itself: the wrong mathematical form of the first effect leaves a little that any other one can absorb. (On
unseen records, where forms are extrapolated, that little may be a lot.)"""
MOST_OF_REST = 0.5
"""A further effect is worthwhile too if it removes this share of what the model before it leaves to explain: if one
effect dwarfs all others (inertia at high frequency), a share of what the base leaves would hide them."""
BLIND = 0.95
"""Largest factor on the unseen error for an effect if the noise is unknown: the likelihood then treats the rest as white
noise, and is too certain if it is coloured."""
WORTHWHILE_BLIND = 0.02
"""`WORTHWHILE` as a share of the base's squared error, if the noise floor is unknown."""


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Sorted likelihood-ratio statistics of simulated null experiments."""

    ratios: np.ndarray
    """Ascending."""
    forms: int
    """Number of candidate forms they are the best of."""

    def p_value(self, ratio: float, forms: int | None = None) -> float:
        """Return the probability that the best candidate gains as much (likelihood-ratio statistic) if nothing is missing.

        Beyond the table the tail falls as that of chi-square ratios, exp(−ratio/2). `forms` is the number of candidates tried
        if it differs from the table's: the probability grows in proportion.
        """
        size = len(self.ratios)
        above = size - int(np.searchsorted(self.ratios, ratio, side="left"))
        share = (above + 1) / (size + 1)
        tail = self.ratios[int(0.98 * size)]
        if ratio > tail:
            share = min(share, 0.02 * float(np.exp(-0.5 * (ratio - tail))))
        return float(min(1.0, share * (forms or self.forms) / self.forms))

    def threshold(self, forms: int) -> float:
        """Return the smallest likelihood-ratio statistic of an effect that may be selected, with the probability `LEVEL`."""
        candidates = np.linspace(0.0, 4 * self.ratios[-1], 4001)
        probabilities = np.array([self.p_value(ratio, forms) for ratio in candidates])
        return float(candidates[np.argmax(probabilities <= LEVEL)])


def number_of_forms(catalogue: dict[str, Effect]) -> int:
    """Return the number of forms of a catalogue that are searched."""
    return sum(len(effect.forms) for effect in catalogue.values() if not effect.rival)


@cache
def null_distribution(system: str = "tissue") -> NullDistribution:
    """Return the table that comes with the project for a system's catalogue."""
    content = read_json(Path(__file__).with_name(f"null_distribution_{system}.json"))
    return NullDistribution(np.sort(np.array(content["gains"])), content["forms"])
