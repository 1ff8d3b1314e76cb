"""``lumbar.analyse_survey``: participants' ratings of the models."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lumbar.interface.result import UNKNOWN_SOURCE, Result, data_label
from lumbar.records.ratings import Ratings, read_ratings
from lumbar.settings.section import SEED
from lumbar.settings.survey import SurveySettings
from lumbar.tables.table import Table
from lumbar.tissue.survey.survey_analysis import SurveyAnalysis
from lumbar.tissue.survey.survey_analysis import analyse_survey as analyse

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def analyse_survey(
    ratings: Ratings | str | os.PathLike,
    *,
    settings: SurveySettings | None = None,
    seed: int = SEED,
    source_label: str = "",
) -> Survey:
    """Analyse ratings by the thesis's method (Table 3.2), and within participants.

    Parameters
    ----------
    ratings : Ratings or path
        Answers, or the file with them.
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
    >>> from lumbar.settings.survey import SurveySettings
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
    """Tables, and all results as plain data."""
    settings: SurveySettings
    source_label: str

    @property
    def table(self) -> Table:
        """Table 3.2."""
        return self.analysis.tables["table_3_2"]

    def figures(self) -> dict[str, Figure]:
        """Return the pictures by file name."""
        from lumbar.publishing.figures.survey_figures import best_picks_figure, likert_figure

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
