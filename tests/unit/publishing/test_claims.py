"""The thesis's claims against a run's results; the printed Table 3.1 against its own equations; the twin's tissue."""

import re

import numpy as np
import pandas as pd
import pytest

from lumbar.lifting.stability.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import (
    BUILT_IN,
    BY_DEFINITION,
    CANNOT_BE_TESTED,
    DOES_NOT_HOLD,
    HOLDS,
)
from lumbar.publishing.reproduction.claims import (
    TABLE_3_1,
    agreement_note,
    all_claims,
    examine_claims,
    impossible_mru,
    least_mru,
    vaf_note,
)
from lumbar.settings.twin import SyntheticTissueSettings
from lumbar.tissue.identification.arx_search import ReducedRegression
from lumbar.tissue.models.tissue_models import KB, higher_order_structures
from lumbar.twin.tissue_recordings import tissue_force, tissue_test
from refusing import has_tokens


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


@pytest.fixture
def judged(published):
    """Examine all claims on results and return ``claims.csv`` by claim."""

    def examine(results, synthetic=False, **groups):
        claims = all_claims(published, **groups)
        return examine_claims(claims, results, synthetic, "test").set_index("claim")

    return examine


def test_thesis_agrees_with_its_own_cells(judged, thesis_as_results):
    frame = judged(thesis_as_results)
    cells = frame[frame.index.str.startswith("table_")]
    assert len(cells) == 9 * 10 + 4 * 4 + 6 + 9 * 2
    is_alpha = cells.index.str.endswith(".alpha")
    of_one_pole = cells.index.str.fullmatch(r".*\.(MW|KB)\.order")
    assert set(cells[~is_alpha & ~of_one_pole].verdict) == {HOLDS}
    assert set(cells[is_alpha].verdict) == {CANNOT_BE_TESTED}
    assert cells[of_one_pole].verdict.tolist() == 6 * [BY_DEFINITION]


HELD_BY_THESIS = """
highest_vaf ho_best_vaf ho_best_fit ho_best_residual ho_poorest_condition ho_poorest_uncertainty ho_slightly_better
models_stable multisine_best highest_median_mode mode_count closer_is_preferred expert_larger lateral_largest
expert_unchanged novice_susceptible
"""


def test_thesis_agrees_with_its_own_sentences(judged, thesis_as_results):
    verdicts = judged(thesis_as_results).verdict
    assert set(verdicts[HELD_BY_THESIS.split()]) == {HOLDS}
    assert verdicts["mw_is_maxwell"] == DOES_NOT_HOLD
    assert verdicts["bandwidth"] == CANNOT_BE_TESTED


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
    ("readings", "verdict"),
    [((2.47, 4.5, 5.19), BUILT_IN), ((3.5, 2.5, 2.5), DOES_NOT_HOLD), ((3.5, 4.5, None), DOES_NOT_HOLD)],
)
def test_bandwidth_is_judged_by_its_share_of_the_power(judged, readings, verdict):
    frame = judged({"bandwidth": bandwidths_of(*readings)}, synthetic=True)
    assert frame.at["bandwidth", "verdict"] == DOES_NOT_HOLD
    row = frame.loc["bandwidth_velocity"]
    assert row.verdict == verdict and "cells of 0.1 Hz" in row.remark
    for value in readings:
        assert ("none" if value is None else f"{value:.2f} Hz") in row.this_run


def test_other_groups_replace_expert_and_novice(judged, thesis_as_results):
    groups = ("trained", "untrained")
    table = thesis_as_results["table_4_1"]
    renamed = table.assign(comparison=table["comparison"].map(comparison_names(groups)))
    frame = judged({**thesis_as_results, "table_4_1": renamed}, groups=groups)
    assert list(frame.index) == list(judged({}).index)
    cells = frame[frame.index.str.startswith("table_4_1")]
    sentences = frame.loc[["expert_larger", "lateral_largest", "expert_unchanged", "novice_susceptible"]]
    assert {*cells.verdict, *sentences.verdict} == {HOLDS}
    statement = frame.at["expert_larger", "statement"]
    assert "trained" in statement and "expert" not in statement
    assert judged(thesis_as_results, groups=groups).at["expert_larger", "verdict"] == CANNOT_BE_TESTED


def test_changed_number_does_not_hold(judged, thesis_as_results):
    table = thesis_as_results["table_3_1"]
    row = (table.trained_on == "multisine") & (table.model == "KB")
    table.loc[row, "vaf_percent"] = 60.0
    verdicts = judged(thesis_as_results).verdict
    assert verdicts["table_3_1.multisine.KB.vaf_percent"] == DOES_NOT_HOLD
    assert verdicts["ho_slightly_better"] == DOES_NOT_HOLD


def test_small_number_has_no_tolerance_of_ten_points(judged, thesis_as_results):
    table = thesis_as_results["table_3_1"]
    row = (table.trained_on == "noise") & (table.model == "MW")
    table.loc[row, "fit_percent"] = 10.06
    verdict = judged(thesis_as_results, synthetic=True).at["table_3_1.noise.MW.fit_percent", "verdict"]
    assert verdict == DOES_NOT_HOLD


def test_numbers_of_other_rows_seldom_meet_a_criterion(judged, thesis_as_results):
    (note,) = agreement_note(judged(thesis_as_results).reset_index())
    chances = re.findall(r"of (\d) [^;(]*\((\d+) %\)", note)
    assert [int(cells) for cells, _ in chances] == [3, *(9 for _ in range(len(TABLE_3_1) - 2))]
    assert all(int(chance) <= 40 for _, chance in chances)


def test_note_has_printed_vaf_and_this_runs(judged, thesis_as_results):
    table = thesis_as_results["table_3_1"]
    table.loc[(table.trained_on == "noise") & (table.model == "MW"), "vaf_percent"] = 19.14
    (note,) = vaf_note(judged(thesis_as_results).reset_index())
    assert has_tokens(
        note, "multisine…12.24, 81.16, 82.64 in print, 12.24…3 of 3…noise…2.09, 66.16…19.14, 66.16…2 of 3"
    )
    assert vaf_note(judged({}).reset_index()) == ()


@pytest.mark.parametrize(("inputs", "biproper"), [(1, True), (3, False), (3, True)])
def test_claims_that_follow_from_nested_regressors_are_no_evidence(
    judged, thesis_as_results, inputs, biproper
):
    """HO contains KB if it has u[k] and u[k − 1]."""
    table = thesis_as_results["table_3_1"]
    table.loc[table.model == "HO", "nmse_train"] = 0.01
    table = table.assign(biproper=biproper, parameters=table.order + inputs, remark=None)
    verdicts = judged({"table_3_1": table}).verdict
    expected = BY_DEFINITION if biproper and inputs > 1 else HOLDS
    assert verdicts["ho_best_nmse_train"] == verdicts["ho_poorest_condition"] == expected
    assert verdicts["ho_poorest_uncertainty"] == HOLDS


@pytest.mark.parametrize("seed", range(4))
def test_nested_regressors_lower_the_nmse_and_raise_the_condition_number(seed):
    rng = np.random.default_rng(seed)
    inputs, outputs = rng.standard_normal((2, 300))
    regression = ReducedRegression(inputs, inputs + 0.1 * outputs, 4)
    simple = regression.path(KB.structure)
    for structure in higher_order_structures(4):
        path = regression.path(structure)
        if {0, 1} <= set(structure.input_lags):
            assert path.residual_sum_of_squares(0) <= simple.residual_sum_of_squares(0)
            assert path.condition_number >= simple.condition_number
        elif structure.input_lags[0] == 1:
            # The output follows u[k], which a strictly proper model does not have.
            assert path.residual_sum_of_squares(0) > simple.residual_sum_of_squares(0)


def test_claims_that_the_twin_was_made_to_show_do_not_hold(judged, thesis_as_results):
    frame = judged(thesis_as_results, synthetic=True)
    assert frame.at["table_3_1.multisine.KB.vaf_percent", "verdict"] == BUILT_IN
    assert frame.at["table_3_2.KB.median", "verdict"] == BUILT_IN
    assert frame.at["table_3_1.multisine.HO.mru_percent", "verdict"] == HOLDS
    lifters = frame[frame.index.str.startswith("table_4_1")]
    assert set(lifters.verdict) == {CANNOT_BE_TESTED}
    assert lifters.this_run.notna().all()


def test_study_without_results_cannot_test_claims(judged):
    frame = judged({})
    assert frame.index.is_unique
    assert set(frame.verdict) == {CANNOT_BE_TESTED}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("alpha", [0.0, 30.0])
def test_mru_is_at_least_its_bound(seed, alpha):
    """Columns of any scale and correlation, ridge or none: Eqs 3.13 to 3.16 written out."""
    rng = np.random.default_rng(seed)
    rows, parameters = 400, int(rng.integers(2, 7))
    regressors = rng.standard_normal((rows, parameters)) @ rng.standard_normal((parameters, parameters))
    regressors *= 10.0 ** rng.uniform(-2, 2, parameters)
    target = regressors @ rng.standard_normal(parameters)
    target += rng.uniform(0.05, 2) * target.std() * rng.standard_normal(rows)
    gram = regressors.T @ regressors
    solution = np.linalg.solve(gram + alpha**2 * np.eye(parameters), regressors.T @ target)
    square = np.sum((target - regressors @ solution) ** 2)
    deviations = np.sqrt(square / (rows - parameters) * np.diag(np.linalg.inv(gram)))
    mru = 100 * np.max(deviations / np.abs(solution))
    nmse = square / np.sum(target**2)
    assert mru >= least_mru(np.linalg.cond(regressors), nmse, rows, parameters)


def test_printed_mru_of_mw_contradict_the_equations(project):
    printed = pd.read_csv(project / "resources" / "thesis" / "table_3_1.csv")
    assert set(impossible_mru(printed)) == {"MW on multisine", "MW on noise", "MW on chirp"}
    possible = printed.assign(mru_percent=100.0)
    assert impossible_mru(possible) == {}


def test_noise_of_the_twin_has_its_size_correlation_and_delay():
    time = 0.01 * np.arange(40_000)
    position = np.sin(2 * np.pi * time)
    tissue = SyntheticTissueSettings()
    quiet = tissue.model_copy(update={"noise_N": 0.0})
    force = tissue_test(time, position, quiet, 1, 0)
    np.testing.assert_allclose(force, tissue_force(time, position, 0.405, 3.24, 0.035, 0.0202))
    coloured = tissue.model_copy(update={"noise_N": 0.7, "noise_correlation_s": 0.05})
    noise = tissue_test(time, position, coloured, 1, 0) - force
    assert noise.std() == pytest.approx(0.7, rel=0.05)
    lagged = np.corrcoef(noise[:-5], noise[5:])[0, 1]
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.03)
    late = tissue_test(time, position, quiet.model_copy(update={"delay_s": 0.03}), 1, 0)
    np.testing.assert_allclose(late[3:], force[:-3], atol=1e-9)
