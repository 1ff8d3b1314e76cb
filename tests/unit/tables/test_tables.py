"""Published tables: the same content as CSV, LaTeX and HTML, nothing missing without being said."""

import csv
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
import yaml

import lumbar
from lumbar.base.errors import NumericalError
from lumbar.tables.table import Table, escape_latex, table_from_schema

LIBRARY = Path(lumbar.__file__).parent


def make_table(**changes) -> Table:
    content = {
        "title": "A table & its title.",
        "frame": pd.DataFrame({"model": ["A_1", "<B>"], "value_N": [1 / 3, 2000.0], "p": [None, 0.5]}),
        "definitions": {"model": "Name", "value_N": "Force in N, 100 % scale", "p": "p-value", "unused": "x"},
        "source_label": "synthetic twin",
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
        if tag in ("td", "th"):
            self.inside = True
            self.cells.append("")

    def handle_endtag(self, tag):
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data):
        if self.inside:
            self.cells[-1] += data


def test_three_formats_have_equal_cells(tmp_path):
    make_table().write(tmp_path / "table")
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [row["model"] for row in rows] == ["A_1", "<B>"]
    assert float(rows[0]["value_N"]) == 1 / 3
    assert {row["data"] for row in rows} == {"synthetic twin"}
    page = Cells()
    page.feed((tmp_path / "table.html").read_text(encoding="utf-8"))
    assert page.cells == ["Model", "Value (N)", "p", "A_1", "0.333", "–", "<B>", "2000", "0.5"]
    tex = (tmp_path / "table.tex").read_text(encoding="utf-8")
    assert r"A\_1 & 0.333 & – \\" in tex
    assert r"\textless{}B\textgreater{} & 2000\phantom{.000} & 0.5 \\" in tex
    assert "% Value (N): Force in N, 100 % scale\n" in tex  # a comment
    assert r"A table \& its title. Data: synthetic twin." in tex
    assert "unused" not in tex


def test_decimals_are_applied():
    assert "0.333 " in make_table(decimals={"value_N": 3}).to_latex()
    assert make_table(decimals={"value_N": 0}).cell("value_N", 2.6) == "3"
    assert make_table().cell("value_N", 2.5e-16) == "2.5·10⁻¹⁶"
    assert [make_table().cell("p_value", value) for value in (0.0, 1e-4)] == ["< 0.0001", "0.0001"]


def test_page_is_self_contained_and_escaped():
    page = make_table(notes=("<script>alert(1)</script>",)).to_html()
    assert "<script" not in page
    assert "http" not in page
    assert "Data: synthetic twin" in page


@pytest.mark.parametrize(
    ("change", "error", "place"),
    [
        ({"definitions": {"model": "Name", "p": "p"}}, ValueError, "value_N"),
        ({"value_N": [1.0, math.nan]}, NumericalError, "value_N, row 2"),
        ({"value_N": [1.0, None]}, NumericalError, "value_N, row 2"),
        ({"p": [0.1, math.inf]}, NumericalError, r"\binf\b.*\bp, row 2\b"),
    ],
)
def test_columns_need_definitions_and_values(change, error, place):
    changes = change if "definitions" in change else {"frame": make_table().frame.assign(**change)}
    with pytest.raises(error, match=place):
        make_table(**changes)


def test_an_empty_table_can_be_written(tmp_path):
    make_table(frame=pd.DataFrame({"model": [], "value_N": [], "p": []})).write(tmp_path / "table")
    assert (tmp_path / "table.csv").read_text() == "model,value_N,p,data\n"


def wide(rows: int, columns: int, **changes) -> Table:
    """Table of more columns, and rows, than a page holds."""
    names = ["com", *(f"value_{number}_mm" for number in range(columns))]
    frame = pd.DataFrame({name: [1000.5 + row for row in range(rows)] for name in names}).assign(
        com="abdomen_left"
    )
    return Table("Table 4.1: percent.", frame, dict.fromkeys(names, "x"), "test", **changes)


def test_wide_table_is_folded_without_loss():
    table = wide(60, 30)
    page = table.to_html()
    shown, folded = page.split("<details>", 1)
    assert shown.count("<tr>") == 13 and folded.count("abdomen left") >= 60
    for block in re.findall("<table>.*?</table>", page, flags=re.S):
        heads = re.findall("<th [^>]*>(.*?)</th>", block)
        assert heads[0] == "Centre of mass" and len(heads) <= 14
    assert {f"Value {number} (mm)" for number in range(30)} <= set(re.findall("<th [^>]*>(.*?)</th>", folded))


def test_first_columns_are_shown_first():
    shown, folded = wide(3, 4, first=("com", "value_2_mm"), first_rows=(1,)).to_html().split("<details>", 1)
    assert "Value 2 (mm)" in shown and "Value 1 (mm)" not in shown and "Value 1 (mm)" in folded
    assert shown.count("<tr>") == 2 and folded.count("<tr>") == 4


def test_latex_numbers_and_splits_long_tables():
    tex = wide(100, 2, first_rows=tuple(range(100))).to_latex()
    assert r"\caption{Percent. Data: test.}" in tex
    assert tex.count(r"\begin{table}") == tex.count(r"\end{table}") == 3
    assert tex.count(r"\addtocounter{table}{-1}") == 2
    assert tex.count("abdomen left") == 100
    assert r"\begin{table*}" in wide(2, 6).to_latex()


def test_latex_is_balanced_and_escaped():
    tex = make_table(notes=("100 % & more_or_less {x} ~ 1.2·10⁻¹⁶.",)).to_latex()
    assert sorted(re.findall(r"\\begin\{(\w+)\}", tex)) == sorted(re.findall(r"\\end\{(\w+)\}", tex))
    bare = re.sub(r"\\[\\%&_{}~#$]", "", tex)
    assert bare.count("{") == bare.count("}")
    assert r"1.2$\cdot10^{-16}$" in tex
    assert (
        r"$-$1.50 &"
        in make_table(frame=make_table().frame.assign(value_N=-1.5), decimals={"value_N": 2}).to_latex()
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [("p = 1.9e-06;", r"p = 1.9$\cdot10^{-6}$;"), ("to 1e-10.", "to $10^{-10}$."), ("HO 1.061e+04", r"HO 1.061$\cdot10^{4}$"),
     ("model 2e, 3e-x", "model 2e, 3e-x"), ("file1e-06", "file1e-06")],
)  # fmt: skip
def test_numbers_in_latex_have_powers_of_ten(text, expected):
    assert escape_latex(text) == expected


def test_latex_omits_only_folded_columns(tmp_path):
    description = "t: {title: T, folded: [more_*], columns: {name: n, more_1: m, added_N: a}}"
    (tmp_path / "tables.yaml").write_text(description)
    table = table_from_schema(str(tmp_path), "t", [{"name": "x", "more_1": 1, "added_N": 2}], "test")
    tex, page = table.to_latex(), table.to_html()
    assert "Added (N)" in tex and "More 1" not in tex
    assert page.index("Added (N)") < page.index("<details>") < page.index("More 1")


def test_latex_note_has_at_most_two_lines_and_whole_sentences():
    notes = ("A short one", "A long one " + "of many words " * 20)
    tex = make_table(notes=notes).to_latex()
    (printed,) = re.findall(r"\\raggedright (A.*?)}\n", tex)
    assert printed == "A short one."
    assert all(f"% {' '.join(note.split())}\n" in tex for note in notes)
    assert "raggedright A" not in make_table(notes=notes[1:]).to_latex()


def test_column_without_header_is_shown():
    assert "Value (N)" in make_table(headers={"model": "Model"}).to_latex()


@pytest.mark.parametrize("file", sorted(LIBRARY.rglob("tables.yaml")), ids=lambda file: file.parent.name)
def test_folded_columns_are_described(file):
    for table in yaml.safe_load(file.read_text()).values():
        assert set(table.get("folded", ())) <= set(table["columns"])
