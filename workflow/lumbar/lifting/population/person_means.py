"""Trials of several persons, one mean each: what statements about people rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

FEWEST_PERSONS = 3
"""Persons of a group below which no interval is given: with two, one difference stands for all scatter between people.
From three on the tests hold their level (benchmarks/population.py)."""


@dataclass(frozen=True, eq=False)
class PersonMeans:
    """Trials by person, and one mean of each."""

    persons: tuple[str, ...]
    values: tuple[np.ndarray, ...]
    """Trials of each person."""

    @classmethod
    def of(cls, trials: Mapping[str, Sequence[float]]) -> PersonMeans:
        """Trials by person; persons without one are left out.

        Examples
        --------
        >>> PersonMeans.of({"ann": [1.0, 3.0], "bob": [5.0], "eve": []}).mean.tolist()
        [2.0, 5.0]
        """
        found = {person: np.asarray(values, float) for person, values in trials.items() if len(values)}
        return cls(tuple(found), tuple(found.values()))

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean of each person's trials, shape (persons,)."""
        return np.array([values.mean() for values in self.values])

    @cached_property
    def trials(self) -> np.ndarray:
        """Number of each person's trials, shape (persons,)."""
        return np.array([len(values) for values in self.values], dtype=int)

    @cached_property
    def squares(self) -> float:
        """Sum of squared deviations of all trials from their person's mean."""
        return float(sum(np.square(values - values.mean()).sum() for values in self.values))

    def __len__(self) -> int:
        return len(self.persons)

    def weights(self, variance_ratio: float | None) -> np.ndarray:
        """Weights of the means in inverse proportion to their variances σ_person² + σ_trial²/trials.

        Parameters
        ----------
        variance_ratio : float or None
            σ_trial²/σ_person²; None, where it cannot be estimated, weighs all persons alike.
        """
        if variance_ratio is None:
            return np.ones(len(self))
        return 1 / (1 + variance_ratio / self.trials)


def too_few(**counts: int) -> str:
    """Return why there is no interval, or nothing where there are persons enough.

    Examples
    --------
    >>> too_few(expert=2, novice=8)
    'no interval: 2 persons (expert), at least 3 are needed'
    """
    short = [
        f"{count} person{'' if count == 1 else 's'} ({name})"
        for name, count in counts.items()
        if count < FEWEST_PERSONS
    ]
    return f"no interval: {', '.join(short)}, at least {FEWEST_PERSONS} are needed" if short else ""
