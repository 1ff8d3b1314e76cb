"""``lumbar.compare_groups`` and ``lumbar.analyse_survey``: differences between groups of subjects, and ratings."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.interface.result import UNKNOWN_SOURCE, Result, data_label, read_table
from lumbar.lifting.measures.compare_groups import GroupComparison, compare_people, comparison_table
from lumbar.records.ratings import Ratings, read_ratings
from lumbar.settings.lifting import GROUPS
from lumbar.settings.runtime import SurveySettings
from lumbar.settings.section import SEED
from lumbar.tables.table import Table
from lumbar.tissue.survey.survey_analysis import SurveyAnalysis
from lumbar.tissue.survey.survey_analysis import analyse_survey as analyse

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def compare_groups(
    table: pd.DataFrame | str | os.PathLike | Sequence[str | os.PathLike],
    *,
    groups: tuple[str, str] | None = None,
    source_label: str = "",
) -> GroupDifferences:
    """Compare two groups of people at the same box, and the boxes within each group, measure by measure.

    Parameters
    ----------
    table : pandas.DataFrame, path or sequence of paths
        Long table: one row per lift, measure and plane, columns ``person, group, box_mass_kg, measure, plane, value``, and
        optionally ``unit`` and ``safer`` (``higher`` or ``lower``). Several CSV files are joined.
    groups : tuple of str, optional
        Two groups that are compared; default expert and novice or, if the table has two other labels, these two.
    source_label : str
        Name of the source of the data.

    Raises
    ------
    InputError
        If the file or table is of another kind, or a group has no subjects.

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
    sources: list[str] = []
    if not isinstance(table, pd.DataFrame):
        paths = [table] if isinstance(table, str | os.PathLike) else list(table)
        sources = [os.fspath(path) for path in paths]
        table = pd.concat([read_table(path, "measures") for path in paths], ignore_index=True)
    missing = [name for name in _COLUMNS if name not in table]
    if missing:
        raise InputError(
            f"no columns {', '.join(missing)}; a comparison needs {', '.join(_COLUMNS)}, one row per lift and measure"
        )
    counts = table.groupby("person")["group"].nunique()
    if (counts > 1).any():
        raise InputError(f"{counts.idxmax()}: a person of {counts.max()} groups; each belongs to one")
    labels = sorted(map(str, table["group"].unique()))
    if groups is None and not set(GROUPS) <= set(labels) and len(labels) != 2:
        raise InputError(
            f"groups: which two of {', '.join(labels)}? Name them, e.g. groups=('expert', 'novice')"
        )
    first, second = groups or (GROUPS if set(GROUPS) <= set(labels) else labels)
    unknown = [group for group in (first, second) if group not in set(table["group"])]
    if unknown:
        names = " or ".join(map(repr, unknown))
        raise InputError(f"groups: no subject is labelled {names}; labels: {', '.join(labels)}")
    comparisons = tuple(compare_people(table, (first, second)))
    return GroupDifferences(comparisons, (first, second), data_label(source_label, sources))


_COLUMNS = ("person", "group", "box_mass_kg", "measure", "plane", "value")
"""Columns of a long table, one row per lift, measure and plane."""


@dataclass(frozen=True, eq=False, repr=False)
class GroupDifferences(Result):
    """Result of the comparison of groups and boxes."""

    comparisons: tuple[GroupComparison, ...]
    groups: tuple[str, str]
    source_label: str

    @cached_property
    def table(self) -> Table:
        """Table of differences with intervals and p values."""
        return comparison_table(self.comparisons, self.source_label)

    def figure(self) -> Figure:
        """Return the picture of all measures: the safer group of each, with its interval."""
        from lumbar.publishing.figures.people_figures import group_comparison_figure

        return group_comparison_figure(self.comparisons, self.groups)

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``measure_comparison`` as a table and as a figure."""
        yield "measure_comparison", self.table
        yield "measure_comparison", self.figure()

    def __str__(self) -> str:
        lines = []
        for item in self.comparisons:
            result = item.difference
            start = f"{item.name}, {item.box} kg, {item.measure}, {item.plane}: {result.difference:.3g} {item.unit}"
            if result.low is None:
                lines.append(f"{start.rstrip()}, {result.remark}")
                continue
            interval = f"({result.low:.3g} to {result.high:.3g}), p = {result.p_value:.2g}"
            persons = " + ".join(map(str, result.persons))
            verdict = f"{item.verdict} is safer" if item.verdict in item.sides else item.verdict
            lines.append(f"{start.rstrip()} {interval}, {persons} persons: {verdict}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        first, second = self.groups
        return f"<GroupDifferences: {len(self.comparisons)} comparisons of {first} and {second}>"


def analyse_survey(
    ratings: Ratings | str | os.PathLike,
    *,
    settings: SurveySettings | None = None,
    seed: int = SEED,
    source_label: str = "",
) -> Survey:
    """Analyse ratings between models by the method of the thesis (Table 3.2), and within participants.

    Parameters
    ----------
    ratings : Ratings or path
        Answers, or the file with the answers.
    settings : SurveySettings, optional
        Scale, statement, baseline and layout.
    seed : int
        Seed of the bootstrap.
    source_label : str
        Name of the source of the data; default the file they were read from.

    Raises
    ------
    NumericalError
        If the answers do not differ at all.

    Examples
    --------
    >>> import lumbar
    >>> import numpy as np
    >>> from lumbar.records.ratings import Ratings
    >>> scores = np.random.default_rng(1).integers(1, 4, (20, 3)) + [[0, 1, 2]]
    >>> people, models = tuple(map(str, range(20))), ("IL", "MW", "KB")
    >>> ratings = Ratings(people, models, scores, 5, ("KB",) * 20, groups={})
    >>> from lumbar.settings.runtime import SurveySettings
    >>> survey = lumbar.analyse_survey(ratings, settings=SurveySettings(baseline="IL", resamples=1000))
    >>> print(survey)
    20 participants rated IL, MW, KB (source unknown)
    kruskal_wallis: 29.40, 2 degrees of freedom, p = 4.1e-07
    friedman: 18.33, 2 degrees of freedom, p = 0.00010
    """
    settings = settings or SurveySettings()
    if isinstance(ratings, str | os.PathLike):
        source_label = data_label(source_label, [os.fspath(ratings)])
        ratings = read_ratings(ratings, settings.layout)
    source_label = source_label or UNKNOWN_SOURCE
    analysis = analyse(ratings, settings, seed, source_label)
    # The ratings may add to the label, e.g. that they are not real answers.
    return Survey(ratings, analysis, settings, analysis.results["data"])


@dataclass(frozen=True, eq=False, repr=False)
class Survey(Result):
    """Results of a survey."""

    ratings: Ratings
    analysis: SurveyAnalysis
    """Result of the analysis: tables, and all results as plain data."""
    settings: SurveySettings
    source_label: str

    @property
    def table(self) -> Table:
        """Table 3.2 with the statistics of the ratings."""
        return self.analysis.tables["table_3_2"]

    def figures(self) -> dict[str, Figure]:
        """Return the pictures by file name."""
        from lumbar.publishing.figures.people_figures import best_picks_figure, likert_figure

        counts, settings = self.ratings.counts(), self.settings
        picks = best_picks_figure(self.analysis.results["best_picks"], settings.confidence)
        likert = likert_figure(self.ratings.models, counts, settings.scale_labels, settings.statement)
        return {"survey_likert": likert, "survey_best_picks_figure": picks}

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield the tables, ``survey.json`` and the figures."""
        yield from self.analysis.tables.items()
        yield "survey.json", self.analysis.results
        yield from self.figures().items()

    def __repr__(self) -> str:
        return f"<Survey of {len(self.ratings)} participants>"

    def __str__(self) -> str:
        results = self.analysis.results
        models = ", ".join(self.ratings.models)
        lines = [f"{len(self.ratings)} participants rated {models} ({self.source_label})"]
        for name in ("kruskal_wallis", "friedman"):
            test = results[name]
            freedom = f"{test['dof']} degrees of freedom"
            lines.append(f"{name}: {test['statistic']:.2f}, {freedom}, p = {test['p_value']:#.2g}")
        return "\n".join(lines)
