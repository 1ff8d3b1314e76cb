"""Published tables: the same content as CSV, LaTeX and HTML, nothing missing without being said."""

from __future__ import annotations

import csv
import math
from html.parser import HTMLParser

import pandas as pd
import pytest

from lumbar.errors import NumericalError
from lumbar.tables import Table


def made(**changes) -> Table:
    content = {
        "title": "A table & its title.",
        "frame": pd.DataFrame({"model": ["A_1", "<B>"], "value_N": [1 / 3, 2000.0], "p": [None, 0.5]}),
        "definitions": {"model": "Name", "value_N": "Force in N, 100 % scale", "p": "p-value", "unused": "x"},
        "data": "synthetic twin",
        "notes": ("A note < 5 %.",),
        "may_be_empty": frozenset({"p"}),
    }
    return Table(**(content | changes))


class Cells(HTMLParser):
    """Cells of the only table of a page."""

    def __init__(self):
        super().__init__()
        self.cells, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        self.inside = tag in ("td", "th")
        if self.inside:
            self.cells.append("")

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.cells[-1] += data


def test_three_formats_hold_the_same_cells(tmp_path):
    made().write(tmp_path / "table")
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [row["model"] for row in rows] == ["A_1", "<B>"]
    assert float(rows[0]["value_N"]) == 1 / 3
    assert {row["data"] for row in rows} == {"synthetic twin"}
    page = Cells()
    page.feed((tmp_path / "table.html").read_text(encoding="utf-8"))
    assert page.cells == ["model", "value_N", "p", "A_1", "0.3333", "–", "<B>", "2000", "0.5"]
    tex = (tmp_path / "table.tex").read_text(encoding="utf-8")
    assert r"A\_1 & 0.3333 & – \\" in tex
    assert r"\textless{}B\textgreater{} & 2000 & 0.5 \\" in tex
    assert r"100 \% scale" in tex
    assert r"A table \& its title. Data: synthetic twin." in tex
    assert "unused" not in tex


def test_decimals_are_those_asked_for():
    assert "0.333" in made(decimals={"value_N": 3}).to_html()
    assert made(decimals={"value_N": 0}).cell("value_N", 2.6) == "3"


def test_page_needs_nothing_from_outside_and_escapes_text():
    page = made(notes=("<script>alert(1)</script>",)).to_html()
    assert "<script" not in page
    assert "http" not in page
    assert "Data: synthetic twin" in page


def test_columns_need_definitions():
    with pytest.raises(ValueError, match="value_N"):
        made(definitions={"model": "Name", "p": "p"})


@pytest.mark.parametrize("bad", [math.nan, None])
def test_missing_values_are_refused_where_not_announced(bad):
    frame = pd.DataFrame({"model": ["A", "B"], "value_N": [1.0, bad], "p": [0.1, 0.2]})
    with pytest.raises(NumericalError, match="value_N, row 2"):
        made(frame=frame)


def test_infinite_values_are_refused_everywhere():
    frame = pd.DataFrame({"model": ["A", "B"], "value_N": [1.0, 2.0], "p": [0.1, math.inf]})
    with pytest.raises(NumericalError, match="inf in column p, row 2"):
        made(frame=frame)


def test_an_empty_table_can_be_written(tmp_path):
    made(frame=pd.DataFrame({"model": [], "value_N": [], "p": []})).write(tmp_path / "table")
    assert (tmp_path / "table.csv").read_text() == "model,value_N,p,data\n"
