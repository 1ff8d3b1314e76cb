"""The report of a study: its chapters, troubles and page."""

import pkgutil
import re
from html import unescape

import pytest

from generate.equation_index import equations
from generate.thesis_items import read_items
from lumbar.publishing.reproduction.claim import CANNOT_BE_TESTED, DOES_NOT_HOLD, HOLDS
from lumbar.publishing.study_report.contents import chapters, compare_cells, shorten_svg
from lumbar.publishing.study_report.report_page import FAILS, WARNS, troubles
from lumbar.study.study import read_artefacts
from small_report import CHOICES, CLAIMS, SHEET, make_results, page_of


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return make_results(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def page(results):
    return page_of(results)


def test_report_shows_first_lifts_only(results):
    many = {**CHOICES, "lift": {f"p{number}_1kg": "p" for number in range(100)}}
    events = [row for row in SHEET if row.id == "events"]
    (chapter,) = chapters(results, results / "captions", events, many, None)
    ((artefact, files),) = chapter.files
    assert (len(chapter.entries), artefact.id, len(files)) == (24, "events", 2 * 76)


def test_cells_are_compared_with_published_values():
    rows = list(CLAIMS.itertuples())
    result = compare_cells(rows, "table_3_1")
    assert result.head == ("Trained on", "Model", "VAF (%)", "Order")
    assert result.rows[0] == ("noise", "KB", ("80.21", "66.16", DOES_NOT_HOLD), ("1", "1", HOLDS))
    assert result.rows[1][2:] == (("–", "–", ""), ("–", "4", CANNOT_BE_TESTED))
    assert result.fractions == [3, 0]
    assert compare_cells(rows, "table_4_1") is None


def test_failures_precede_warnings(results, page):
    result = troubles(results)
    assert [(item.grade, item.where) for item in result] == [
        (FAILS, "diagnosis of two"),
        (FAILS, "a 1 kg, thorax, lateral bending"),
        (FAILS, "KB_fmi3.fmu"),
        (FAILS, "MW_fmi3.fmu"),
        (WARNS, "diagnosis of one"),
        (WARNS, "diagnosis of two"),
        (WARNS, "diagnosis of two"),
        (WARNS, "export/fmu"),
    ]
    assert result[-1].sentence == "not safe:\n  MW is unstable\n  raise the rate"
    texts = ("exact: ρ is negative", 'href="#state-claims">1 ', "MW is unstable")
    first = [page.index(text) for text in texts]
    assert first == sorted(first) and first[-1] < page.index('id="chapter-tissue"')


def test_report_links_every_file_and_loads_nothing(results, page):
    links = set(map(unescape, re.findall(r'href="([^"#]+)"', page)))
    written = {str(path.relative_to(results)) for path in results.rglob("*.*")}
    shown = {name for name in written if name.endswith((".svg", ".pdf", ".tex"))}
    assert shown | {"tissue/models.json", "tables/table_3_1.csv"} <= links
    assert all(link in written or "basins" in link or "run_config" in link for link in links)
    targets = set(re.findall(r'href="#([^"]+)"', page))
    assert targets <= set(re.findall(r'id="([^"]+)"', page)) | {"claims_table"}
    assert "http" not in page and "<script" not in page and set(re.findall(r'src="(.{5})', page)) == {"data:"}


def test_report_is_reproducible(results, page):
    assert page_of(results) == page


def test_svg_is_shortened_to_hundredths_of_a_point():
    svg = '<svg>\n   <path id="a1.23456" d="M 1.23456 -0.00012 L 12.5 3"/>\n  <text>1.23456</text>\n</svg>\n'
    short = '<svg>\n<path id="a1.23456" d="M 1.23 -0 L 12.5 3"/>\n<text>1.23456</text>\n</svg>\n'
    assert shorten_svg(svg) == short


def test_artefacts_cite_known_equations(project):
    known = {number for item in read_items() for number in item.equations}
    shown = [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.label]
    for row in shown:
        assert callable(pkgutil.resolve_name(row.function)), row.id
        assert row.source, row.id
        assert {number for number in equations(row.source) if number > "3"} <= known, row.id
