"""The sheet of artefacts: every table, figure and file that a study makes."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from lumbar.config.chapters import CHAPTERS
from lumbar.errors import Problems


@dataclass(frozen=True)
class Artefact:
    """One table, figure or file of the thesis: a row of ``config/artefacts.tsv``.

    Attributes
    ----------
    id : str
        Name of its target, e.g. ``"table_3_1"``.
    rule : str
        Rule that makes it.
    path : str
        Below the study's results; ``{csv,tex,html}`` stands for each of these, ``{lift}`` for every lift,
        ``{model}`` for every exported model, ``{record_set}`` for every record set of the improvement chapter.
    chapter : str
        One of `CHAPTERS`.
    """

    id: str
    rule: str
    path: str
    chapter: str

    def expanded(self, **choices: Iterable[str]) -> Artefact:
        """Return the artefact with ``{name}`` standing for each of the choices given for it."""
        path = self.path
        for name, values in choices.items():
            path = path.replace(f"{{{name}}}", "{" + ",".join(values) + "}")
        return replace(self, path=path)

    def paths(self, lifts: Iterable[str] = ()) -> list[str]:
        """Every file of the artefact, below the study's results."""
        patterns = [self.path]
        if "{lift}" in self.path:
            patterns = [self.path.replace("{lift}", lift) for lift in lifts]
        return [path for pattern in patterns for path in _expand_braces(pattern)]


def _expand_braces(pattern: str) -> list[str]:
    before, opening, rest = pattern.partition("{")
    if not opening:
        return [pattern]
    choices, _, after = rest.partition("}")
    return [before + choice + tail for choice in choices.split(",") for tail in _expand_braces(after)]


def read_artefacts(path: Path) -> list[Artefact]:
    """Read the sheet of artefacts (tab-separated: id, rule, path, chapter)."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    problems = Problems(str(path))
    for line, row in enumerate(rows, start=2):
        if row["chapter"] not in CHAPTERS:
            problems.add(f"line {line}", f"chapter {row['chapter']!r}", f"allowed: {', '.join(CHAPTERS)}")
        if row["id"] in (earlier["id"] for earlier in rows[: line - 2]):
            problems.add(f"line {line}", f"{row['id']!r} stands twice", "ids are names of targets")
    problems.raise_if_any()
    return [Artefact(row["id"], row["rule"], row["path"], row["chapter"]) for row in rows]
