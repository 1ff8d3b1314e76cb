"""How much the best of all candidates gains when nothing is missing.

The tables beside this module, one per catalogue, hold the largest likelihood-ratio statistic among all its candidates
for simulated experiments in which the base model is true, base refitted each time. Gains of white noise do not depend
on the record's length, so the tables are made once (``benchmarks/null_gains.py``) and shipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from lumbar.base.files import read_json

TABLES = {
    "tissue": Path(__file__).with_name("null_distribution_tissue.json"),
    "pendulum": Path(__file__).with_name("null_distribution_pendulum.json"),
}
"""Table of the catalogue of each system."""


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Sorted likelihood-ratio statistics of simulated null experiments."""

    ratios: np.ndarray
    """Ascending."""
    forms: int
    """Number of candidate forms they are the best of."""

    def p_value(self, ratio: float, forms: int | None = None) -> float:
        """Probability that the best candidate gains as much where nothing is missing.

        Beyond the table the tail falls as that of chi-square ratios, exp(−ratio/2), from its last tenth.

        Parameters
        ----------
        ratio : float
            Likelihood-ratio statistic.
        forms : int, optional
            Number of candidates tried, where it differs from the table's: the probability grows in proportion.
        """
        size = len(self.ratios)
        above = size - int(np.searchsorted(self.ratios, ratio, side="left"))
        share = (above + 1) / (size + 1)
        tail = self.ratios[int(0.98 * size)]
        if ratio > tail:
            share = min(share, 0.02 * float(np.exp(-0.5 * (ratio - tail))))
        return float(min(1.0, share * (forms or self.forms) / self.forms))


@cache
def shipped(system: str = "tissue") -> NullDistribution:
    """Return the table that comes with the project for a system's catalogue."""
    content = read_json(TABLES[system])
    return NullDistribution(np.sort(np.array(content["gains"])), content["forms"])
