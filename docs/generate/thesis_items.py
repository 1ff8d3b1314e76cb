"""The thesis item by item, as printed and as here, from ``resources/thesis/items.yaml``, renewed by ``make docs``.

What names can say comes from where it stands: the objects of an equation from docstrings, the value of a key from the settings,
the files of an artefact from the sheet.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass, field
from fnmatch import fnmatch
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml

from generate import equation_index, gallery
from generate.configuration_reference import STUDY_PAGE, keys
from lumbar.base.files import write_text
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.validation import Key, defaults_of
from lumbar.study.study import read_artefacts

DOCS = Path(__file__).resolve().parents[1]
SOURCE = DOCS.parent / "resources" / "thesis" / "items.yaml"
PAGE = "thesis.md"
CHAPTERS = {
    "1": "Introduction",
    "2": "Literature review",
    "3": "Tissue: identification and simulation",
    "4": "Lifting: basins of attraction",
    "5": "Discussion and conclusion",
    "6": "Discussion and conclusion",
}
_HEAD = """\
# The thesis, item by item

<!-- Made by "make docs" from resources/thesis/items.yaml; change that. -->

Every numbered equation, table and figure, every stated parameter and every claim of method, with its section: as the thesis
prints it, how it is *here*, and what is *otherwise*, and why; without that line nothing differs. Modules are those below
`lumbar` (`tissue.signals.multisine` is the file `workflow/lumbar/tissue/signals/multisine.py`); keys are shown with their
defaults; files are below `results/<study>/`. A *claim* is a row of `claims.csv` and `tables/claims`, which hold its
criterion and what a study shows; this page has the verdict of the default study on the synthetic twin.
"""


@dataclass(frozen=True)
class Item:
    """One item; the head of the YAML file explains the fields."""

    item: str
    section: str
    printed: str
    here: str = ""
    objects: list[str] = field(default_factory=list)
    keys: list[str] = field(default_factory=list)
    thesis: dict[str, Any] = field(default_factory=dict)
    artefacts: list[str] = field(default_factory=list)
    claims: list[str] = field(default_factory=list)
    pages: list[str] = field(default_factory=list)
    differs: str = ""

    @property
    def equations(self) -> list[str]:
        """Numbers of its equations."""
        return equation_index.equations(self.item)

    @property
    def all_objects(self) -> list[str]:
        """Objects that compute its equations, by their docstrings, and those that it names."""
        computing_objects = [
            f"{entry.module.removeprefix('lumbar.')}:{entry.name}"
            for number in self.equations
            for entry in computing().get(number, ())
        ]
        return list(dict.fromkeys([*computing_objects, *self.objects]))


def read_items() -> list[Item]:
    """Return the items in the thesis's order."""
    return [Item(**entry) for entry in yaml.safe_load(SOURCE.read_text(encoding="utf-8"))]


@cache
def computing() -> dict[str, list[equation_index.Entry]]:
    """Return objects by the equation that they compute."""
    return {
        number: list(rows) for number, rows in groupby(equation_index.entries(), lambda row: row.equation)
    }


@cache
def default_values() -> dict[str, Any]:
    """Return the default of every configuration key."""
    return {path: value for path, _, value in keys(Key.from_class(StudySettings), defaults_of(StudySettings))}


@cache
def files() -> dict[str, Any]:
    """Return the artefacts of the study by their ids."""
    return {row.id: row for row in read_artefacts(DOCS.parent / "config" / "artefacts.tsv")}


def anchor(heading: str) -> str:
    """Return the anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


def _key(path: str) -> str:
    section, _, rest = path.partition(".")
    page = section if rest and (DOCS / "config" / f"{section}.md").is_file() else STUDY_PAGE
    return f"[`{path}`](config/{page}.md): {_value(default_values()[path])}"


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).replace("'", "")


def _artefact(name: str) -> str:
    row = files()[name]
    path = f"`{re.sub(r'{[^}]*,[^}]*}$', '*', row.path)}`"
    return f"[{path}]({gallery.PAGE}#{anchor(gallery.title(row))})" if "svg" in row.path else path


@cache
def verdicts() -> dict[str, str]:
    """Return the verdict of the default study on every claim."""
    with (DOCS.parent / "tests" / "reference" / "claims.csv").open(encoding="utf-8", newline="") as file:
        return {row["claim"]: row["verdict"] for row in csv.DictReader(file)}


def _claim(pattern: str) -> str:
    """Return claims with their verdict, or with the count of each verdict. Claims newer than the reference have none."""
    counts = Counter(verdict for name, verdict in verdicts().items() if fnmatch(name, pattern))
    verdict_counts = [
        verdict if len(counts) == count == 1 else f"{count} × {verdict}" for verdict, count in counts.items()
    ]
    return f"*claim* `{pattern}`: {', '.join(verdict_counts)}" if verdict_counts else f"*claim* `{pattern}`"


def _page(target: str) -> str:
    """Return a link to a page or to one of its headings."""
    name, _, part = target.partition("#")
    headings = re.findall(r"^#+ (.*)", (DOCS / name).read_text(encoding="utf-8"), flags=re.M)
    return f"[{next(heading for heading in headings if not part or anchor(heading) == part)}]({target})"


def _here(item: Item) -> str:
    parts = [item.here] if item.here else []
    parts += [f"`{name}`" for name in item.all_objects]
    parts += [_key(way) for way in [*item.thesis, *item.keys]]
    parts += [_artefact(name) for name in item.artefacts]
    parts += map(_claim, item.claims)
    return "; ".join(parts)


def _entry(item: Item) -> str:
    """Return the item as printed, as computed here, and the difference if there is one."""
    otherwise = f"otherwise: {item.differs}" if item.differs else ""
    more = f"more: {', '.join(map(_page, item.pages))}" if item.pages else ""
    lines = [f"here: {_here(item)}", *filter(None, [otherwise, more])]
    return "\n    - ".join([f"- **{item.item}** ({item.section}): {item.printed}", *lines])


def page() -> str:
    """Text of the page."""
    parts = [_HEAD]
    for title, rows in groupby(read_items(), key=lambda item: CHAPTERS[item.section[0]]):
        parts += [f"## {title}", "", *map(_entry, rows), ""]
    return "\n".join(parts)


if __name__ == "__main__":
    write_text(DOCS / PAGE, page())
