"""The thesis item by item: nothing of the thesis is left out, and what each item names is real."""

import pkgutil
import re
from fnmatch import fnmatch

import pandas as pd
import pytest

from generate.equation_index import between
from generate.thesis_items import DOCS, anchor, default_values, files, read_items

ITEMS = read_items()
NUMBERED = re.compile(r"\b(Figures?|Tables?) (\d\.\d)(?:–(\d\.\d)| and (\d\.\d))?")


def numbered(text: str) -> set[str]:
    """Figures and tables that a text names, as ``Figure 2.1``; a dash stands for all between two."""
    found = set()
    for kind, first, last, other in NUMBERED.findall(text):
        numbers = between(first, last) if last else [first, *filter(None, [other])]
        found |= {f"{kind.removesuffix('s')} {number}" for number in numbers}
    return found


@pytest.fixture(scope="module")
def thesis(shared):
    """The thesis's text."""
    return next((shared / "thesis").glob("*.txt")).read_text(encoding="utf-8")


LAST = {"Eq.": {2: 17, 3: 18, 4: 7}, "Figure": {1: 1, 2: 4, 3: 5, 4: 4}, "Table": {2: 2, 3: 2, 4: 1, 5: 1}}
"""Last number of each kind in each chapter of the thesis."""
ALL = {
    kind: [
        f"{kind} {way}"
        for chapter, last in chapters.items()
        for way in between(f"{chapter}.1", f"{chapter}.{last}")
    ]
    for kind, chapters in LAST.items()
}


def test_every_equation_figure_and_table_is_an_item():
    assert sorted(f"Eq. {way}" for item in ITEMS for way in item.equations) == sorted(ALL["Eq."])
    assert set().union(*(numbered(item.item) for item in ITEMS)) == {*ALL["Figure"], *ALL["Table"]}


def test_these_are_all_that_the_thesis_numbers(thesis):
    assert {f"Eq. {way}" for way in re.findall(r"\(([1-5]\.\d{1,2})\)", thesis)} == set(ALL["Eq."])
    printed = {" ".join(pair) for pair in re.findall(r"(Figure|Table) (\d\.\d)", thesis)}
    assert printed == {*ALL["Figure"], *ALL["Table"]}


def test_every_section_of_the_thesis_has_an_item(thesis):
    headed = set(re.findall(r"^ ?([1-5](?:\.\d)+) [A-Z]", thesis, flags=re.M))
    chapters = set(re.findall(r"^ ?Chapter (\d)$", thesis, flags=re.M))
    assert headed | chapters <= {name for item in ITEMS for name in sections(item.section)}


def sections(named: str) -> list[str]:
    """Sections of an item, each with its chapter."""
    return [way for name in named.split(", ") for way in (name, name[0])]


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.item)
def test_what_an_item_names_is_real(item):
    for name in item.all_objects:
        assert pkgutil.resolve_name(f"lumbar.{name}") is not None
    assert set(item.keys) <= set(default_values())
    assert {way: default_values()[way] for way in item.thesis} == item.thesis, "no longer the thesis's number"
    assert set(item.artefacts) <= set(files())
    for way in item.pages:
        name, _, part = way.partition("#")
        assert not part or part in anchors(name), f"{name} has no {part}"


def anchors(name: str) -> set[str]:
    """What a page of the docs can be linked to by."""
    headings = re.findall(r"^#+ (.*)", (DOCS / name).read_text(encoding="utf-8"), flags=re.M)
    return set(map(anchor, headings))


def test_items_name_all_claims_and_only_claims(project):
    claims = set(pd.read_csv(project / "tests" / "reference" / "claims.csv").claim)
    patterns = {pattern for item in ITEMS for pattern in item.claims}
    assert all(any(fnmatch(claim, pattern) for claim in claims) for pattern in patterns)
    assert not [claim for claim in claims if not any(fnmatch(claim, pattern) for pattern in patterns)]


def test_everything_published_is_named_by_an_item():
    named = {name for item in ITEMS for name in item.artefacts}
    assert set(files()) == named, "name it under artefacts: of its item in resources/thesis/items.yaml"
