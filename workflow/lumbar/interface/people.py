"""``lumbar.compare_groups`` and ``lumbar.sample_size``: what differs between people, and how many it takes to see it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.interface.verb import Result, data_label, read_table
from lumbar.lifting.population.comparison import (
    Comparison,
    check_long_table,
    compare_people,
    comparison_table,
    planning_table,
)
from lumbar.lifting.population.sample_size import MOST_PERSONS, assured_sd, person_mean_sd, persons_needed
from lumbar.settings.population import PopulationSettings
from lumbar.settings.stability import GROUPS
from lumbar.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def compare_groups(
    table: pd.DataFrame | str | os.PathLike | Sequence[str | os.PathLike],
    *,
    groups: tuple[str, str] | None = None,
    settings: PopulationSettings | None = None,
    data: str = "",
) -> PeopleCompared:
    """Compare two groups of people at the same box, and the boxes within each group, measure by measure.

    Parameters
    ----------
    table : pandas.DataFrame, path or sequence of paths
        Long: one row per lift, measure and plane, columns ``person, group, box_mass_kg, measure, plane, value``, and if
        they are known ``unit`` and ``safer`` (``higher`` or ``lower``). Several CSV files are joined.
    groups : tuple of str, optional
        The first is compared with the second; default expert and novice or, where the table has other labels, these.
    data : str
        Words for the source of the data.

    Raises
    ------
    InputError
        For a file or table that is none of this kind, and for groups that nobody belongs to.

    Examples
    --------
    >>> import lumbar
    >>> import pandas as pd
    >>> margins = {"expert": (31, 28, 35, 33), "novice": (19, 24, 22, 20)}
    >>> rows = [
    ...     {"person": f"{group} {number}", "group": group, "value": value}
    ...     for group, values in margins.items() for number, value in enumerate(values)
    ... ]
    >>> table = pd.DataFrame(rows).assign(box_mass_kg=15, measure="margin", plane="all", unit="mm", safer="higher")
    >>> print(lumbar.compare_groups(table))
    expert_vs_novice, 15 kg, margin, all: 10.5 mm (5.95 to 15.1), p = 0.0013, 4 + 4 persons: expert is safer
    """
    settings = settings or PopulationSettings()
    frame, sources = _read(table)
    check_long_table(frame)
    chosen = groups or _groups_of(frame)
    unknown = [group for group in chosen if group not in set(frame["group"])]
    if unknown:
        there = ", ".join(sorted(map(str, frame["group"].unique())))
        raise InputError(f"groups: nobody is labelled {' or '.join(map(repr, unknown))}; there are: {there}")
    found = tuple(compare_people(frame, chosen))
    return PeopleCompared(found, chosen, settings, data_label(data, sources))


def _read(table) -> tuple[pd.DataFrame, list[str]]:
    if isinstance(table, pd.DataFrame):
        return table, []
    paths = [table] if isinstance(table, str | os.PathLike) else list(table)
    frames = [read_table(path, "measures") for path in paths]
    return pd.concat(frames, ignore_index=True), [os.fspath(path) for path in paths]


def _groups_of(frame: pd.DataFrame) -> tuple[str, str]:
    labels = sorted(map(str, frame["group"].unique()))
    if set(GROUPS) <= set(labels):
        return GROUPS
    if len(labels) != 2:
        raise InputError(
            f"groups: which two of {', '.join(labels)}? Name them, e.g. groups=('expert', 'novice')"
        )
    return labels[0], labels[1]


@dataclass(frozen=True, eq=False, repr=False)
class PeopleCompared(Result):
    """What differs between groups and boxes."""

    comparisons: tuple[Comparison, ...]
    groups: tuple[str, str]
    settings: PopulationSettings
    data: str

    @cached_property
    def table(self) -> Table:
        """Differences with intervals and p values."""
        return comparison_table(self.comparisons, self.data)

    @cached_property
    def planning(self) -> Table:
        """Scatter between people and trials, and how many persons a study needs."""
        return planning_table(self.comparisons, self.settings, self.data)

    def figure(self) -> Figure:
        """Return all measures at one glance: who is safer, and how certain that is."""
        from lumbar.publishing.figures.people_figures import comparison_figure

        return comparison_figure(self.comparisons, self.groups)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``measure_comparison`` and ``measure_planning`` as tables, and the figure."""
        yield "measure_comparison", self.table
        yield "measure_planning", self.planning
        yield "measure_comparison", self.figure()

    def __str__(self) -> str:
        return "\n".join(map(_sentence, self.comparisons))

    def __repr__(self) -> str:
        return (
            f"<PeopleCompared: {len(self.comparisons)} comparisons of {self.groups[0]} and {self.groups[1]}>"
        )


def _sentence(item: Comparison) -> str:
    contrast, interval = item.contrast, item.contrast.interval
    persons = " + ".join(str(len(side)) for side in item.values)
    start = f"{item.name}, {item.box} kg, {item.measure}, {item.plane}: {contrast.difference:.3g} {item.unit}".rstrip()
    if not interval.is_known:
        return f"{start}, {interval.remark}"
    verdict = f"{item.verdict} is safer" if item.verdict in item.sides else item.verdict
    return f"{start} ({interval.low:.3g} to {interval.high:.3g}), p = {contrast.p_value:.2g}, {persons} persons: {verdict}"


def sample_size(
    difference: float,
    *,
    person_sd: float,
    trial_sd: float = 0.0,
    trials: int = 1,
    paired: bool = False,
    power: float = 0.8,
    significance: float = 0.05,
    pilot_df: float | None = None,
    assurance: float = 0.8,
) -> int:
    """Return how many persons (of each group; altogether if paired) a study needs to see a difference.

    Standard deviations from a pilot are uncertain: planned with them as they are, fewer than half of all studies have the power
    wanted. With `pilot_df` the size is the one that has it in a share `assurance` of pilots.

    Parameters
    ----------
    difference : float
        That is to be seen.
    person_sd : float
        Standard deviation between people of a group; if paired, between people's changes. With `trial_sd` it is a column
        of the table ``measure_planning``.
    trial_sd : float
        Standard deviation between the trials of one person under one condition.
    trials : int
        Of each person and condition.
    paired : bool
        Whether every person goes through both conditions.
    power : float
        Probability to see the difference.
    significance : float
        Level of the two-sided t test on the persons' means.
    pilot_df : float, optional
        Degrees of freedom with which the standard deviations were estimated (``df`` in the table ``measure_comparison``: the
        pilot's persons less its groups); without them they count as known.

    Raises
    ------
    InputError
        For numbers that make no study, and where more than 100 000 persons would be needed.

    Examples
    --------
    >>> import lumbar
    >>> lumbar.sample_size(10, person_sd=10, trial_sd=8, trials=1), lumbar.sample_size(10, person_sd=10, trial_sd=8, trials=5)
    (27, 19)
    >>> lumbar.sample_size(10, person_sd=10, trial_sd=8, trials=5, pilot_df=18)  # a pilot of 10 + 10 persons
    26
    """
    if min(person_sd, trial_sd) < 0 or trials < 1 or not 0 < significance < power < 1:
        raise InputError(
            f"person_sd {person_sd:g}, trial_sd {trial_sd:g}, trials {trials:g}, power {power:g}, significance "
            f"{significance:g}: deviations from 0 on, trials from 1 on, 0 < significance < power < 1"
        )
    # A paired difference has the trials' scatter of both conditions.
    sd = person_mean_sd(person_sd, trial_sd, trials / 2 if paired else trials)
    if pilot_df is not None:
        if not (pilot_df > 0 and 0.5 <= assurance < 1):
            raise InputError(
                f"pilot_df {pilot_df:g}, assurance {assurance:g}: pilot_df above 0, assurance from 0.5 to below 1"
            )
        sd = assured_sd(sd, pilot_df, assurance)
    found = persons_needed(difference, sd, paired=paired, power_wanted=power, significance=significance)
    if found is None:
        raise InputError(f"difference {difference:g}: more than {MOST_PERSONS} persons would be needed")
    return found
