"""The gallery lists every figure as the sheet and the captions have it, and its Python lines are real."""

from __future__ import annotations

import re

import lumbar
from generate.gallery import IN_PYTHON, PAGE, figures, page


def test_the_page_is_up_to_date(project):
    assert (project / "docs" / PAGE).read_text(encoding="utf-8") == page(project), "run 'make docs'"


def test_every_figure_is_there_with_a_picture_to_show(project):
    text, rows = page(project), figures(project)
    assert len(rows) > 15
    assert len(re.findall("<!-- picture: .*svg -->", text)) == len(rows)
    assert all(f"`{row.id}`, by the rule `{row.rule}`" in text for row in rows)


def test_lines_of_python_call_verbs_on_figures_that_exist(project):
    assert set(IN_PYTHON) <= {row.id for row in figures(project)}
    for line in IN_PYTHON.values():
        assert re.match(r"lumbar\.(\w+)\(", line)[1] in lumbar.__all__
