"""The report of a study: its chapters, troubles and page."""

import pkgutil
import re
from html import unescape
from xml.etree import ElementTree

import pandas as pd
import pytest

from generate.equation_index import equations
from generate.thesis_items import read_items
from lumbar.publishing.figures.style import new_figure, save
from lumbar.publishing.pages.sketches import ladder_sketch, lift_sketch
from lumbar.publishing.reproduction.claim import CANNOT_BE_TESTED, DOES_NOT_HOLD, HOLDS
from lumbar.publishing.study_report.contents import chapters, compare_cells, shorten_svg
from lumbar.publishing.study_report.main_results import main_results
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


def test_troubles_are_grouped_and_failures_precede_warnings(results, page):
    result = troubles(results)
    assert {kind: [(item.grade, item.where) for item in items] for kind, items in result.items()} == {
        "Diagnoses": [
            (FAILS, "diagnosis of two"),
            *[(WARNS, f"diagnosis of {name}") for name in ("one", "two", "two")],
        ],
        "Basins of attraction": [(FAILS, "a 1 kg, thorax, lateral bending")],
        "FMUs": [(FAILS, "KB_fmi3.fmu"), (FAILS, "MW_fmi3.fmu")],
        "Logs": [(WARNS, "export/fmu")],
    }
    assert result["Logs"][0].sentence == "not safe:\n  MW is unstable\n  raise the rate"
    overview = page[page.index('id="overview"') : page.index('id="chapter-tissue"')]
    assert "1 failed, 3 remarks" in overview and "MW is unstable" not in overview
    assert "1 sentence of the thesis</a> not reproduced by this run, and 1 numbers" in overview


def test_main_results_are_computed(results, page):
    first, second = main_results(results, ["diagnoses-one", "diagnoses-two"], CLAIMS)
    assert (first.key, first.figures) == ("diagnoses-one", "0.4 → 0.123 N")
    assert "KB model on data of “one” to which it was not fitted, without and with inertia" in first.sentence
    assert (second.key, second.figures) == ("state-claims", "1 of 2")
    assert main_results(results, [], None) == []
    assert "0.4 → 0.123 N" in page


def test_report_links_every_file_and_loads_nothing(results, page):
    links = set(map(unescape, re.findall(r'href="([^"#]+)"', page)))
    written = {str(path.relative_to(results)) for path in results.rglob("*.*")}
    shown = {name for name in written if name.endswith((".svg", ".pdf", ".tex"))}
    assert shown | {"tissue/models.json", "tables/table_3_1.csv"} <= links
    assert all(link in written or "basins" in link or "run_config" in link for link in links)
    targets = set(re.findall(r'href="#([^"]+)"', page))
    assert targets <= set(re.findall(r'id="([^"]+)"', page)) | {"claims_table"}
    assert "<script" not in page and set(re.findall(r'src="(.{5})', page)) == {"data:"}
    assert not re.search(r'(src|href)="?(https?:)?//|url\(["\']?https?:|@import', page)


def test_report_is_reproducible(results, page):
    assert page_of(results) == page


def test_shortened_svg_keeps_texts_and_formulas(tmp_path):
    figure, axis = new_figure(3.0, 2.0)
    axis.plot([0, 1 / 3], [0, 2 / 3])
    axis.set_title("Force & $x_1$")
    axis.set_ylabel("Position (mm)")
    save(figure, tmp_path / "a", "synthetic twin")
    long = (tmp_path / "a.svg").read_text(encoding="utf-8")
    short = shorten_svg(long)
    tree = ElementTree.fromstring(short)
    texts = [item.text for item in tree.iter("{http://www.w3.org/2000/svg}text")]
    assert {"Position (mm)", "0.3", "Data: synthetic twin"} <= set(texts) and len(short) < 0.6 * len(long)
    assert "Force & $x_1$" not in texts
    used = set(re.findall(r'xlink:href="#([^"]+)"', short))
    assert used and used <= set(re.findall(r' id="([^"]+)"', short))


def test_sketches_show_what_is_known():
    bars = ladder_sketch(
        {"ladder": [{"test_rms": 2.0}, {"test_rms": None}, {"test_rms": 1.0}], "noise_floor_rms": 1.0}
    )
    heights = [float(value) for value in re.findall(r'height="([\d.]+)"', bars)]
    assert heights[0] == 2 * heights[1] and "<path" in bars
    assert ladder_sketch({"ladder": [{}], "noise_floor_rms": None}) == ""
    points = {"L4L5": [0.0, 1.0], "L5S1": [0.0, 0.8], "LOAD": [0.4, 0.5]}
    body = pd.DataFrame(
        {
            f"{name}_{axis}_m": [value] * 9
            for name, at in points.items()
            for axis, value in zip("xyz", [0.0, *at], strict=True)
        }
    )
    assert lift_sketch(body).count("<polyline") == 3 and lift_sketch(body).count("<circle") == 3
    assert lift_sketch(body[["LOAD_x_m", "LOAD_y_m", "LOAD_z_m"]]) == ""


def test_artefacts_cite_known_equations(project):
    known = {number for item in read_items() for number in item.equations}
    shown = [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.label]
    for row in shown:
        assert callable(pkgutil.resolve_name(row.function)), row.id
        assert row.source, row.id
        assert {number for number in equations(row.source) if number > "3"} <= known, row.id
