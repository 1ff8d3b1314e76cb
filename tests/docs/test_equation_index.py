"""Every equation of the thesis leads to the object that computes it, and the page says what the docstrings say."""

from __future__ import annotations

import importlib
import re
from functools import reduce

from generate.equation_index import LIBRARY, NOT_COMPUTED, PAGE, between, entries, equations, page


def test_every_equation_of_the_thesis_is_computed_or_said_not_to_be(shared):
    text = next((shared / "thesis").glob("*.txt")).read_text(encoding="utf-8")
    numbered = set(re.findall(r"\(([1-5]\.\d{1,2})\)", text))
    computed = {item.equation for item in entries()}
    left_out = {number for span in NOT_COMPUTED for number in between(*span)}
    assert computed | left_out == numbered
    assert not computed & left_out


def test_every_entry_is_an_object_of_the_library():
    for item in entries():
        found = reduce(getattr, item.name.split("."), importlib.import_module(item.module))
        assert found is not None


def test_the_page_is_up_to_date(project):
    assert (project / "docs" / PAGE).read_text(encoding="utf-8") == page(), "run 'make docs'"


def test_ways_of_naming_equations():
    assert equations("Eq. 4.1 and Eqs 4.5–4.7, then Eqs 3.17 and 3.18") == [
        "4.1", "4.5", "4.6", "4.7", "3.17", "3.18",
    ]  # fmt: skip


def test_equations_are_spelt_in_one_way():
    """Published cells of Table 2.1 keep theirs: they are data."""
    other = re.compile(r"\b(eqs?\.? |[Ee]quations? |Eqs\. |Eq )\(?[1-5]\.\d")
    for path in LIBRARY.rglob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            assert "transfer=" in line or not other.search(line), f"{path.name}: {line.strip()}"
