"""Pages that are generated: up to date; every figure is there, equations are found by docstrings, and what they name is real."""

import importlib
import re
from functools import reduce

import pytest

from generate import equation_index, gallery, import_diagram, marker_sets, thesis_items


@pytest.mark.parametrize(
    ("generated", "page"),
    [
        (gallery, gallery.page),
        (import_diagram, lambda project: import_diagram.page()),
        (thesis_items, lambda project: thesis_items.page()),
        (marker_sets, lambda project: marker_sets.page()),
    ],
    ids=["gallery", "imports", "thesis", "markers"],
)
def test_the_page_is_up_to_date(project, generated, page):
    assert (project / "docs" / generated.PAGE).read_text(encoding="utf-8") == page(project), "run 'make docs'"


def test_every_figure_is_there_with_a_picture_to_show(project):
    text, rows = gallery.page(project), gallery.figures(project)
    assert len(rows) > 15
    assert len(re.findall("<!-- picture: .*svg -->", text)) == len(rows)
    assert all(f"`{row.id}`, by the rule `{row.rule}`" in text for row in rows)


def test_every_entry_is_an_object_of_the_library():
    for item in equation_index.entries():
        found = reduce(getattr, item.name.split("."), importlib.import_module(item.module))
        assert found is not None


def test_ways_of_naming_equations():
    assert equation_index.equations("Eq. 4.1 and Eqs 4.5–4.7, then Eqs 3.17 and 3.18") == [
        "4.1", "4.5", "4.6", "4.7", "3.17", "3.18",
    ]  # fmt: skip
