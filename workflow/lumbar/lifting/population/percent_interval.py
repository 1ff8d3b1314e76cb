"""Interval of a percent difference of means over persons, as Table 4.1 shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lumbar.lifting.population.contrast import Interval, between_groups, within_persons
from lumbar.lifting.population.person_means import PersonMeans
from lumbar.lifting.population.variance_components import variance_components

Trials = Mapping[str, Sequence[float]]


def percent_interval(
    first: Trials, second: Trials, paired: bool, names: tuple[str, str] = ("first", "second")
) -> Interval:
    """Return the 95 % interval of 100(first − second)/second over persons, or why there is none.

    Parameters
    ----------
    first, second : mapping of str to sequence of float
        Trials of every person.
    paired : bool
        Whether the same persons are on both sides; those found on one side alone are left out.
    names : tuple of str
        Of the sides, for messages.

    Examples
    --------
    >>> before = {"ann": [10.0, 10.2], "bob": [12.0], "eve": [11.0]}
    >>> after = {"ann": [11.0, 11.4], "bob": [13.1], "eve": [12.2]}
    >>> found = percent_interval(after, before, paired=True)
    >>> round(found.low, 1), round(found.high, 1)
    (8.1, 13.5)
    """
    sides = [PersonMeans.of(trials) for trials in (first, second)]
    absent = [name for name, side in zip(names, sides, strict=True) if not len(side)]
    if absent:
        return Interval(remark=f"no interval: nobody of {' and of '.join(absent)}")
    if paired and set(sides[0].persons).isdisjoint(sides[1].persons):
        return Interval(remark="no interval: nobody is on both sides")
    if paired:
        return within_persons(*sides, name=names[0]).percent_interval
    return between_groups(*sides, variance_components(sides).variance_ratio, names=names).percent_interval
