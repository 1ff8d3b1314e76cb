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
    """Below the study's results; ``{csv,tex,html}`` stands for each of these, ``{lift}`` for every lift, ``{model}`` for
    every exported model, ``{record_set}`` for every record set of the improvement chapter."""
    chapter: str
    """One of `CHAPTERS`."""
    label: str = ""
    """What the report calls it; empty where it is not shown there."""
    source: str = ""
    """Equations, figure, table or section of the thesis that it follows."""
    function: str = ""
    """Dotted name of what computes it in Python."""
    check: str = ""
    """One of ``stability.checks`` without which it would be empty: then it is not made."""

    def expanded(self, **choices: Iterable[str]) -> Self:
        """Return the artefact with ``{name}`` standing for each of the choices given for it."""
        path = self.path
        for name, values in choices.items():
            values = list(values)
            choice = "{" + ",".join(values) + "}" if len(values) > 1 else "".join(values)
            path = path.replace(f"{{{name}}}", choice)
        return replace(self, path=path)

    def paths(self, lifts: Iterable[str] = ()) -> list[str]:
        """Every file of the artefact, below the study's results."""
        return [path for path, _ in self.labelled(lifts)]

    def labelled(self, lifts: Iterable[str] = ()) -> list[tuple[str, str]]:
        """Every file of the artefact with what the report calls it; other names in braces stay."""
        choices = lifts if "{lift}" in self.path else [""]
        return [
            (path, self.label.replace("{lift}", lift))
            for lift in choices
            for path in _expand_braces(self.path.replace("{lift}", lift))
        ]


def _expand_braces(pattern: str) -> list[str]:
    """Return what ``a{b,c}`` stands for; a name alone in braces is a wildcard and stays."""
    found = re.search(r"\{([^{}]*,[^{}]*)\}", pattern)
    if found is None:
        return [pattern]
    before, after = pattern[: found.start()], pattern[found.end() :]
    return [path for choice in found[1].split(",") for path in _expand_braces(before + choice + after)]


def read_artefacts(path: Path) -> list[Artefact]:
    """Read the sheet of artefacts (tab-separated: id, rule, path, chapter, label in the report, source, function, check)."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    problems = Problems(str(path))
    for line, row in enumerate(rows, start=2):
        if row["chapter"] not in CHAPTERS:
            problems.add(f"line {line}", f"chapter {row['chapter']!r}", f"allowed: {', '.join(CHAPTERS)}")
        if row["id"] in (earlier["id"] for earlier in rows[: line - 2]):
            problems.add(f"line {line}", f"{row['id']!r} is repeated", "ids are names of targets")
        if row["label"] and row["label"] in (earlier["label"] for earlier in rows[: line - 2]):
            problems.add(
                f"line {line}", f"label {row['label']!r} is repeated", "the report could show one only"
            )
    problems.raise_if_any()
    optional = ("label", "source", "function", "check")
    return [
        Artefact(
            row["id"], row["rule"], row["path"], row["chapter"], *(row.get(name) or "" for name in optional)
        )
        for row in rows
    ]
