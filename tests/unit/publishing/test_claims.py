"""Verdicts on claims: the published tables agree with themselves, changed ones do not."""

from __future__ import annotations

import pandas as pd
import pytest

from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.publishing.reproduction import basin_claims as basins
from lumbar.publishing.reproduction import identification_claims as identification
from lumbar.publishing.reproduction import rating_claims as ratings
from lumbar.publishing.reproduction.claim import (
    BUILT_IN,
    CANNOT_BE_TESTED,
    DOES_NOT_HOLD,
    HOLDS,
    Claim,
    Finding,
    examine,
    verdict,
)
from lumbar.publishing.reproduction.register import all_claims, examine_claims, summary_table


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
    frame = judged(identification.sentences(), thesis_as_results)
    for name in ("highest_vaf", "ho_best_vaf", "ho_best_fit", "ho_best_residual", "ho_poorest_condition",
                 "ho_poorest_uncertainty", "ho_slightly_better", "models_stable"):  # fmt: skip
        assert frame.at[name, "verdict"] == HOLDS, name
    assert frame.at["multisine_best", "verdict"] == HOLDS
    assert frame.at["mw_is_maxwell", "verdict"] == DOES_NOT_HOLD
    assert frame.at["bandwidth", "verdict"] == CANNOT_BE_TESTED
    people = judged(ratings.sentences(), thesis_as_results)
    for name in ("highest_median_mode", "mode_count", "closer_is_preferred"):
        assert people.at[name, "verdict"] == HOLDS, name
    lifters = judged(basins.sentences(synthetic=False), thesis_as_results)
    for name in ("expert_larger", "lateral_largest", "expert_unchanged", "novice_susceptible"):
        assert lifters.at[name, "verdict"] == HOLDS, name


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


def test_verdicts():
    claim = Claim(
        "c", "l", "s", 1.0, "criterion", (), lambda results: Finding(1.0, True), built_into_twin=True
    )
    finding = examine(claim, {})
    assert verdict(claim, finding, synthetic=True) == BUILT_IN
    assert verdict(claim, finding, synthetic=False) == HOLDS
    assert verdict(claim, Finding(2.0, False), synthetic=True) == DOES_NOT_HOLD
    assert verdict(claim, Finding(None, None), synthetic=False) == CANNOT_BE_TESTED


def test_summary_counts_the_verdicts(published, thesis_as_results):
    claims = examine_claims(all_claims(published, synthetic=True), thesis_as_results, True, "synthetic twin")
    table = summary_table(claims, "synthetic twin")
    assert len(table.frame) == len(claims)
    assert f"{len(claims)} claims" in table.notes[0]
