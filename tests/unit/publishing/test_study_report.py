"""The report of a study: its page, and the thesis's statements held against a run's tables."""

import pkgutil
import re
from html import unescape

import pandas as pd
import pytest

from generate.equation_index import equations
from generate.thesis_items import read_items
from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.publishing.reproduction import article_claims as article
from lumbar.publishing.reproduction import basin_claims as basins
from lumbar.publishing.reproduction.claim import BUILT_IN, CANNOT_BE_TESTED, DOES_NOT_HOLD, HOLDS
from lumbar.publishing.reproduction.register import all_claims, examine_claims
from lumbar.publishing.study_report.contents import beside, chapters, smaller
from lumbar.publishing.study_report.page import FAILS, WARNS, troubles
from lumbar.study.artefacts import read_artefacts
from small_report import CHOICES, CLAIMS, SHEET, make_results, page_of


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return make_results(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def page(results):
    return page_of(results)


def test_of_many_lifts_the_first_are_shown_and_the_others_linked(results):
    many = {**CHOICES, "lift": {f"p{number}_1kg": "p" for number in range(100)}}
    events = [row for row in SHEET if row.id == "events"]
    (chapter,) = chapters(results, results / "captions", events, many, None)
    ((artefact, files),) = chapter.files
    assert (len(chapter.entries), artefact.id, len(files)) == (24, "events", 2 * 76)


def test_published_cells_stand_beside_this_runs():
    found = beside(CLAIMS, "table_3_1")
    assert found.head == ("Trained on", "Model", "VAF (%)", "Order")
    assert found.rows[0] == ("noise", "KB", ("80.21", "66.16", "does not hold"), ("1", "1", "holds"))
    assert found.rows[1][2:] == (("–", "–", ""), ("–", "4", "cannot be tested on this data"))
    assert found.fractions == [3, 0]
    assert beside(CLAIMS, "table_4_1") is None


def test_what_fails_comes_before_what_warns(results, page):
    found = troubles(results)
    assert [(item.grade, item.where) for item in found] == [
        (FAILS, "diagnosis of two"),
        (FAILS, "a 1 kg, thorax, lateral bending"),
        (FAILS, "KB_fmi3.fmu"),
        (FAILS, "MW_fmi3.fmu"),
        (WARNS, "diagnosis of one"),
        (WARNS, "diagnosis of two"),
        (WARNS, "diagnosis of two"),
        (WARNS, "export/fmu"),
    ]
    assert found[-1].sentence == "not safe:\n  MW is unstable\n  raise the rate"
    first = [
        page.index(words)
        for words in ("exact: ρ is negative", "1 of the thesis's sentences", "MW is unstable")
    ]
    assert first == sorted(first) and first[-1] < page.index('id="chapter-tissue"')


def test_every_file_is_linked_and_nothing_comes_from_elsewhere(results, page):
    links = set(map(unescape, re.findall(r'href="([^"#]+)"', page)))
    files = {
        str(path.relative_to(results))
        for path in results.rglob("*")
        if path.suffix in (".svg", ".pdf", ".tex")
    }
    assert files | {"tissue/models.json", "tables/table_3_1.csv"} <= links
    assert not [
        link
        for link in links
        if not (results / link).exists() and "basins" not in link and "run_config" not in link
    ]
    targets = set(re.findall(r'href="#([^"]+)"', page))
    assert targets <= set(re.findall(r'id="([^"]+)"', page)) | {"claims_table"}
    assert "http" not in page and "<script" not in page and set(re.findall(r'src="(.{5})', page)) == {"data:"}


def test_the_same_results_make_the_same_bytes(results, page):
    assert page_of(results) == page


def test_pictures_lose_digits_nobody_sees_and_nothing_else():
    svg = '<svg>\n   <path id="a1.23456" d="M 1.23456 -0.00012 L 12.5 3"/>\n  <text>1.23456</text>\n</svg>\n'
    assert (
        smaller(svg) == '<svg>\n<path id="a1.23456" d="M 1.23 -0 L 12.5 3"/>\n<text>1.23456</text>\n</svg>\n'
    )


def test_every_artefact_of_the_sheet_says_where_it_comes_from(project):
    known = {number for item in read_items() for number in item.equations}
    shown = [row for row in read_artefacts(project / "config" / "artefacts.tsv") if row.label]
    for row in shown:
        assert callable(pkgutil.resolve_name(row.function)), row.id
        assert row.source, row.id
        assert {number for number in equations(row.source) if number > "3"} <= known, row.id


@pytest.fixture(scope="module")
def published(project):
    folder = project / "resources" / "thesis"
    return {name: pd.read_csv(folder / f"{name}.csv") for name in ("table_3_1", "table_3_2", "table_4_1")}


@pytest.fixture
def thesis_as_results(published):
    """The thesis's own tables in the shape of a run's results; p-values within what it prints."""
    table = published["table_3_2"].copy()
    for column in ("p_vs_MW", "p_vs_KB", "p_vs_HO"):
        table[column] = [
            float(text[1:]) / 2 if isinstance(text, str) and text.startswith("<") else float(text)
            for text in table[column]
        ]
    return {
        "table_3_1": published["table_3_1"].assign(estimator="arx", stable=True),
        "table_3_2": table,
        "table_4_1": published["table_4_1"],
    }


def judged(claims, results, synthetic=False):
    return examine_claims(claims, results, synthetic, "test").set_index("claim")


def test_the_thesis_agrees_with_itself_cell_by_cell(published, thesis_as_results):
    frame = judged(all_claims(published, synthetic=False), thesis_as_results)
    cells = frame[frame.index.str.startswith("table_")]
    assert len(cells) == 9 * 10 + 4 * 4 + 6 + 9 * 2
    testable = cells[~cells.index.str.endswith(".alpha")]
    assert set(testable.verdict) == {HOLDS}
    assert set(cells[cells.index.str.endswith(".alpha")].verdict) == {CANNOT_BE_TESTED}


def test_the_thesis_bears_out_its_own_sentences(published, thesis_as_results):
    frame = judged(article.identification_sentences(), thesis_as_results)
    for name in ("highest_vaf", "ho_best_vaf", "ho_best_fit", "ho_best_residual", "ho_poorest_condition",
                 "ho_poorest_uncertainty", "ho_slightly_better", "models_stable"):  # fmt: skip
        assert frame.at[name, "verdict"] == HOLDS, name
    assert frame.at["multisine_best", "verdict"] == HOLDS
    assert frame.at["mw_is_maxwell", "verdict"] == DOES_NOT_HOLD
    assert frame.at["bandwidth", "verdict"] == CANNOT_BE_TESTED
    people = judged(article.rating_sentences(), thesis_as_results)
    for name in ("highest_median_mode", "mode_count", "closer_is_preferred"):
        assert people.at[name, "verdict"] == HOLDS, name
    lifters = judged(basins.sentences(synthetic=False), thesis_as_results)
    for name in ("expert_larger", "lateral_largest", "expert_unchanged", "novice_susceptible"):
        assert lifters.at[name, "verdict"] == HOLDS, name


def bandwidths_of(limited, unlimited, level):
    rules = {
        "power_share": {"value_Hz": limited, "without_limit_Hz": unlimited},
        "level": {"value_Hz": level},
    }
    return {
        "rules": {"power_share": 0.95, "level_dB": -20},
        "analysis_band_Hz": [0.1, 6.0],
        "position": {"power_share": {"value_Hz": 0.53, "without_limit_Hz": 0.53}, "level": {"value_Hz": 0.7}},
        "velocity": rules,
    }


@pytest.mark.parametrize(
    ("readings", "verdict", "remark"),
    [
        ((2.47, 4.5, 5.19), BUILT_IN, "only by: 95 % of the power below 6 Hz"),
        ((2.4, 2.5, 2.6), BUILT_IN, ""),
        ((3.5, 4.5, None), DOES_NOT_HOLD, ""),
    ],
)
def test_the_bandwidth_is_said_by_every_rule_of_position_and_velocity(readings, verdict, remark):
    frame = judged(
        article.identification_sentences(), {"bandwidth": bandwidths_of(*readings)}, synthetic=True
    )
    assert frame.at["bandwidth", "verdict"] == DOES_NOT_HOLD
    assert frame.at["bandwidth", "this_run"].count("Hz") == 4
    assert (frame.at["bandwidth_velocity", "verdict"], frame.at["bandwidth_velocity", "remark"]) == (
        verdict,
        remark,
    )
    for value in readings:
        assert ("none" if value is None else f"{value:.2f} Hz") in frame.at["bandwidth_velocity", "this_run"]


def test_other_groups_take_the_place_of_expert_and_novice(published, thesis_as_results):
    groups = ("trained", "untrained")
    table = thesis_as_results["table_4_1"]
    results = {
        **thesis_as_results,
        "table_4_1": table.assign(comparison=table["comparison"].map(comparison_names(groups))),
    }
    claims = all_claims(published, False, groups)
    assert [claim.id for claim in claims] == [claim.id for claim in all_claims(published, False)]
    frame = judged(claims, results)
    assert set(frame[frame.index.str.startswith("table_4_1")].verdict) == {HOLDS}
    for name in ("expert_larger", "lateral_largest", "expert_unchanged", "novice_susceptible"):
        assert frame.at[name, "verdict"] == HOLDS, name
    assert frame.at["expert_larger", "statement"].startswith("The trained's basins")
    assert judged(claims, thesis_as_results).at["expert_larger", "verdict"] == CANNOT_BE_TESTED


def test_a_changed_number_no_longer_holds(published, thesis_as_results):
    table = thesis_as_results["table_3_1"]
    row = (table.trained_on == "multisine") & (table.model == "KB")
    table.loc[row, "vaf_percent"] = 60.0
    frame = judged(all_claims(published, synthetic=False), thesis_as_results)
    assert frame.at["table_3_1.multisine.KB.vaf_percent", "verdict"] == DOES_NOT_HOLD
    assert frame.at["ho_slightly_better", "verdict"] == DOES_NOT_HOLD


def test_what_a_twin_was_made_to_show_is_never_said_to_hold(published, thesis_as_results):
    frame = judged(all_claims(published, synthetic=True), thesis_as_results, synthetic=True)
    assert frame.at["table_3_1.multisine.KB.vaf_percent", "verdict"] == BUILT_IN
    assert frame.at["table_3_2.KB.median", "verdict"] == BUILT_IN
    assert frame.at["table_3_1.multisine.HO.mru_percent", "verdict"] == HOLDS
    lifters = frame[frame.index.str.startswith("table_4_1")]
    assert set(lifters.verdict) == {CANNOT_BE_TESTED}
    assert lifters.this_run.notna().all()


def test_a_study_without_a_chapter_cannot_test_its_claims(published):
    frame = judged(all_claims(published, synthetic=False), {})
    assert set(frame.verdict) == {CANNOT_BE_TESTED}
    assert frame.remark.str.contains("this study has no").all()
