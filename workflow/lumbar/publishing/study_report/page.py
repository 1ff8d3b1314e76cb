"""The report of a study as one HTML page that needs nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.templates import template
from lumbar.publishing.reproduction.claim import DOES_NOT_HOLD
from lumbar.publishing.study_report.contents import Chapter
from lumbar.publishing.study_report.published_values import counted, not_holding
from lumbar.publishing.study_report.troubles import FAILS, recordings, troubles
from lumbar.tables.layout import split

if TYPE_CHECKING:
    import pandas as pd

PAGE = "publishing/study_report/report.html.jinja"


@dataclass(frozen=True)
class StudyFacts:
    """What the head of the page says."""

    name: str
    title: str
    data: str
    people: tuple[str, ...]
    """Person and box of every lift."""
    seed: int
    versions: dict[str, str]


def report_page(
    facts: StudyFacts, results: Path, made: Sequence[Chapter], claims: pd.DataFrame | None
) -> str:
    """Return the page.

    Parameters
    ----------
    results : pathlib.Path
        ``results/<study>``: what fails or warns is read from it.
    """
    found = troubles(results)
    sentences, cells = ((), ()) if claims is None else not_holding(claims, DOES_NOT_HOLD)
    entries = [entry for chapter in made for entry in chapter.entries]
    return template(PAGE).render(
        facts=facts,
        chapters=made,
        failing=[item for item in found if item.grade == FAILS],
        warning=[item for item in found if item.grade != FAILS],
        recordings=recordings(results),
        sentences=sentences,
        cells=cells,
        counted=() if claims is None else counted(claims),
        missing=[entry for entry in entries if entry.missing],
        pages=[entry for entry in entries if entry.page],
        split=split,
    )
