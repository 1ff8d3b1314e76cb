"""``lumbar.compare_groups``: what differs between groups of people, and between their boxes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.interface.result import Result, data_label, read_table
from lumbar.lifting.measures.compare_groups import GroupComparison, compare_people, comparison_table
from lumbar.settings.stability import GROUPS
from lumbar.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def compare_groups(
    table: pd.DataFrame | str | os.PathLike | Sequence[str | os.PathLike],
    *,
    groups: tuple[str, str] | None = None,
    source_label: str = "",
) -> PeopleCompared:
    """Compare two groups of people at the same box, and the boxes within each group, measure by measure.

    Parameters
    ----------
    table : pandas.DataFrame, path or sequence of paths
        Long: one row per lift, measure and plane, columns ``person, group, box_mass_kg, measure, plane, value``, and if
        they are known ``unit`` and ``safer`` (``higher`` or ``lower``). Several CSV files are joined.
    groups : tuple of str, optional
        The first is compared with the second; default expert and novice or, where the table has other labels, these.
    source_label : str
        Label of the data's source.

    Raises
    ------
    InputError
        For a file or table of another kind, and for groups without subjects.

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
    expert_vs_novice, 15 kg, margin, all: 10.5 mm (5.86 to 15.1), p = 0.0017, 4 + 4 persons: expert is safer
    """
    frame, sources = _read(table)
    _check_long_table(frame)
    chosen = groups or _groups_of(frame)
    unknown = [group for group in chosen if group not in set(frame["group"])]
    if unknown:
        there = ", ".join(sorted(map(str, frame["group"].unique())))
        raise InputError(f"groups: nobody is labelled {' or '.join(map(repr, unknown))}; there are: {there}")
    found = tuple(compare_people(frame, chosen))
    return PeopleCompared(found, chosen, data_label(source_label, sources))


NEEDED = ("person", "group", "box_mass_kg", "measure", "plane", "value")
"""Columns of a long table, one row per lift, measure and plane."""


def _check_long_table(table: pd.DataFrame) -> None:
    lacking = [name for name in NEEDED if name not in table]
    if lacking:
        raise InputError(
            f"no columns {', '.join(lacking)}; a comparison needs {', '.join(NEEDED)}, one row per lift and measure"
        )
    groups = table.groupby("person")["group"].nunique()
    if (groups > 1).any():
        raise InputError(f"{groups.idxmax()}: a person of {groups.max()} groups; each belongs to one")


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
    """Differences between groups and boxes."""

    comparisons: tuple[GroupComparison, ...]
    groups: tuple[str, str]
    source_label: str

    @cached_property
    def table(self) -> Table:
        """Differences with intervals and p values."""
        return comparison_table(self.comparisons, self.source_label)

    def figure(self) -> Figure:
        """Return all measures at one glance: who is safer, and how certain that is."""
        from lumbar.publishing.figures.people_figures import comparison_figure

        return comparison_figure(self.comparisons, self.groups)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``measure_comparison`` as a table and as a figure."""
        yield "measure_comparison", self.table
        yield "measure_comparison", self.figure()

    def __str__(self) -> str:
        return "\n".join(map(_sentence, self.comparisons))

    def __repr__(self) -> str:
        return (
            f"<PeopleCompared: {len(self.comparisons)} comparisons of {self.groups[0]} and {self.groups[1]}>"
        )


def _sentence(item: GroupComparison) -> str:
    found = item.difference
    start = f"{item.name}, {item.box} kg, {item.measure}, {item.plane}: {found.difference:.3g} {item.unit}".rstrip()
    if found.low is None:
        return f"{start}, {found.remark}"
    persons = " + ".join(map(str, found.persons))
    verdict = f"{item.verdict} is safer" if item.verdict in item.sides else item.verdict
    return f"{start} ({found.low:.3g} to {found.high:.3g}), p = {found.p_value:.2g}, {persons} persons: {verdict}"
