"""Chapters of a study, and the sheet of artefacts: every table, figure and file that it makes."""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, get_args

from lumbar.base.errors import Problems
from lumbar.settings.study_settings import Chapter

CHAPTERS: tuple[str, ...] = get_args(Chapter)
NEEDS = {"signals": ["surgeon"], "improvement": ["tissue"], "runtime": ["tissue"], "stability": ["lifting"]}
"""Chapters that build on another one of the same study."""
LIFTED = {"lifting", "population"}
"""Chapters that begin with the recorded lifts."""

OF_ONE_AXIS = {"identify_tissue"}
"""Rules whose artefacts take tissue tests along one axis: not made of records of several."""
OF_SEVERAL_AXES = {"principal_axes"}
"""Artefacts of tissue tests along several axes."""


@dataclass(frozen=True)
class Artefact:
    """One table, figure or file of the thesis: a row of ``config/artefacts.tsv``."""

    id: str
    """Name of its target, e.g. ``"table_3_1"``."""
    rule: str
    """Rule that makes it."""
    path: str
    """Path below the study's results. ``{csv,tex,html}`` means each of these; ``{lift}``, ``{model}`` and ``{record_set}`` mean
    every lift, exported model and record set of the improvement chapter."""
    chapter: str
    """One of `CHAPTERS`."""
    label: str = ""
    """Name in the report; empty if it is not shown there."""
    source: str = ""
    """Equations, figure, table or section of the thesis that it follows."""
    function: str = ""
    """Dotted name of what computes it in Python."""
    check: str = ""
    """One of ``stability.checks`` without which it would be empty: then it is not made."""

    def expanded(self, **choices: Iterable[str]) -> Self:
        """Return the artefact with each of the given choices in place of ``{name}``."""
        path = self.path
        for name, values in choices.items():
            joined = ",".join(values)
            path = path.replace(f"{{{name}}}", f"{{{joined}}}" if "," in joined else joined)
        return replace(self, path=path)

    def paths(self, lifts: Iterable[str] = ()) -> list[str]:
        """Return every file of the artefact, below the study's results."""
        return [path for path, _ in self.labelled(lifts)]

    def labelled(self, lifts: Iterable[str] = ()) -> list[tuple[str, str]]:
        """Return every file of the artefact with its name in the report; other names in braces stay."""
        return [
            (path, self.label.replace("{lift}", lift))
            for lift in (lifts if "{lift}" in self.path else [""])
            for path in _expand_braces(self.path.replace("{lift}", lift))
        ]


def _expand_braces(pattern: str) -> list[str]:
    """Return the paths of ``a{b,c}``; a single name in braces is a wildcard and stays."""
    braces = re.search(r"\{([^{}]*,[^{}]*)\}", pattern)
    if braces is None:
        return [pattern]
    before, after = pattern[: braces.start()], pattern[braces.end() :]
    return [path for choice in braces[1].split(",") for path in _expand_braces(before + choice + after)]


def read_artefacts(path: Path) -> list[Artefact]:
    """Read the sheet of artefacts: tab-separated fields of `Artefact` below a header."""
    with path.open(encoding="utf-8", newline="") as stream:
        cells = csv.DictReader(stream, delimiter="\t")
        rows = [Artefact(**{name: text or "" for name, text in row.items()}) for row in cells]
    problems = Problems(str(path))
    for number, row in enumerate(rows):
        place, earlier = f"line {number + 2}", rows[:number]
        if row.chapter not in CHAPTERS:
            problems.add(place, f"chapter {row.chapter!r}", f"allowed: {', '.join(CHAPTERS)}")
        if row.id in [item.id for item in earlier]:
            problems.add(place, f"{row.id!r} is repeated", "ids are names of targets")
        if row.label and row.label in [item.label for item in earlier]:
            problems.add(place, f"label {row.label!r} is repeated", "the report could show one only")
    problems.raise_if_any()
    return rows
