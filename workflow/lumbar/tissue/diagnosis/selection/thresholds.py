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
"""Largest probability of a false alarm of a selected effect."""
UNSEEN = 2.33
"""Smallest fall of the loss on unseen records, in standard errors, for an effect to be selected (one-sided 1 %)."""
COMPLETE = 1.2
"""Largest error in noise floors, on training and unseen records, of a complete refined model that no further effect improves. It
is larger than 1, because estimated parameters add a small error on records to which they were not fitted."""
EXPLAINS = 0.5
"""Smallest share of the base's unseen error variance, without known noise, that named effects remove."""
MANY_SCATTERS = 10.0
"""Ratio of the error left to the scatter of neighbouring samples above which `EXPLAINS_NEARLY_ALL` replaces `EXPLAINS`, if no
record repeats."""
EXPLAINS_NEARLY_ALL = 0.95
"""Smallest share of the base's unseen error variance that named effects remove if the error left is many times the scatter."""
TIED = 9.2
"""Difference in twice the log-likelihood below which two effects cannot be distinguished (odds of 100 to 1)."""
STRUCTURED = 0.2
"""Largest structured difference between periods, in noise floors, of an adequate model."""
WORTHWHILE = 0.007
"""Smallest share of the base's explainable training error that a further effect must remove; it must also remove as much as the
noise. A wrong mathematical form of the first effect leaves a small error that any other effect can absorb. (On unseen records,
on which forms are extrapolated, this error may be large.)"""
MOST_OF_REST = 0.5
"""Share of the smaller model's explainable error that also makes a further effect worthwhile: if one effect is far larger than
all others (inertia at high frequency), a share of the base's error would hide the others."""
BLIND = 0.95
"""Largest ratio of the unseen errors with and without a selected effect if the noise is unknown: the likelihood then treats the
remaining error as white noise, and is too certain if this error is coloured."""
WORTHWHILE_BLIND = 0.02
"""Smallest share of the base's squared error that a further effect must remove if the noise floor is unknown."""


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Sorted likelihood-ratio statistics of simulated null experiments."""

    ratios: np.ndarray
    """Likelihood-ratio statistics in ascending order."""
    forms: int
    """Number of candidate forms; each statistic is the largest among these forms."""

    def p_value(self, ratio: float, forms: int | None = None) -> float:
        """Return the probability of as large a likelihood-ratio statistic of the best candidate if nothing is missing.

        Beyond the table the tail falls like exp(−ratio/2), the tail of a chi-square distribution. `forms` is the number of forms
        that were tried; default that of the table. The probability is proportional to this number.
        """
        size = len(self.ratios)
        above = size - int(np.searchsorted(self.ratios, ratio, side="left"))
        share = (above + 1) / (size + 1)
        tail = self.ratios[int(0.98 * size)]
        if ratio > tail:
            share = min(share, 0.02 * float(np.exp(-0.5 * (ratio - tail))))
        return float(min(1.0, share * (forms or self.forms) / self.forms))

    def threshold(self, forms: int) -> float:
        """Return the smallest likelihood-ratio statistic of an effect that may be selected: its p-value is `LEVEL`."""
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
