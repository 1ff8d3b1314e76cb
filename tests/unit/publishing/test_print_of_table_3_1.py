"""Table 3.1 against the print: what its own equations allow, and experiments on the twin."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from periodic_records import record

from lumbar.publishing.reproduction.table_3_1_experiments import EXPERIMENTS, FORCE, table_3_1_experiments
from lumbar.publishing.reproduction.table_cells import (
    BY_MEAN,
    MEAN_SQUARE,
    agreeing,
    impossible_mru,
    least_mru,
)
from lumbar.settings.plain import from_plain
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.twin import SyntheticTissueSettings
from lumbar.tissue.identification.identify_tissue import identify
from lumbar.tissue.identification.model_tables import table_3_1
from lumbar.tissue.signals.excitation import design_excitation
from lumbar.twin.tissue_recordings import tissue_force, tissue_test

QUICK = {
    "tissue": {"search": {"order_max": 2}, "ridge": {"alpha_points": 9}, "bootstrap": {"resamples": 100}},
    "signals": {"multisine": {"periods": 2}},
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("alpha", [0.0, 30.0])
def test_no_data_give_a_smaller_mru_than_the_bound(seed, alpha):
    """Columns of any scale and correlation, ridge or none: Eqs 3.13 to 3.16 written out."""
    rng = np.random.default_rng(seed)
    rows, parameters = 400, int(rng.integers(2, 7))
    regressors = rng.standard_normal((rows, parameters)) @ rng.standard_normal((parameters, parameters))
    regressors *= 10.0 ** rng.uniform(-2, 2, parameters)
    target = regressors @ rng.standard_normal(parameters)
    target += rng.uniform(0.05, 2) * target.std() * rng.standard_normal(rows)
    gram = regressors.T @ regressors
    found = np.linalg.solve(gram + alpha**2 * np.eye(parameters), regressors.T @ target)
    square = np.sum((target - regressors @ found) ** 2)
    deviations = np.sqrt(square / (rows - parameters) * np.diag(np.linalg.inv(gram)))
    mru = 100 * np.max(deviations / np.abs(found))
    nmse = square / np.sum(target**2)
    assert mru >= least_mru(np.linalg.cond(regressors), nmse, rows, parameters)


def test_the_printed_mru_of_mw_are_not_those_of_the_equations(project):
    printed = pd.read_csv(project / "resources" / "thesis" / "table_3_1.csv")
    assert set(impossible_mru(printed)) == {"MW on multisine", "MW on noise", "MW on chirp"}
    possible = printed.assign(mru_percent=100.0)
    assert impossible_mru(possible) == {}


def test_noise_of_the_twin_has_its_size_its_correlation_and_its_delay():
    time = 0.01 * np.arange(40_000)
    position = np.sin(2 * np.pi * time)
    tissue = SyntheticTissueSettings()
    quiet = replace(tissue, noise_N=0.0)
    force = tissue_test(time, position, quiet, 1, 0)
    np.testing.assert_allclose(force, tissue_force(time, position, 0.405, 3.24, 0.035, 0.0202))
    noise = tissue_test(time, position, replace(tissue, noise_N=0.7, noise_correlation_s=0.05), 1, 0) - force
    assert noise.std() == pytest.approx(0.7, rel=0.05)
    lagged = np.corrcoef(noise[:-5], noise[5:])[0, 1]
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.03)
    late = tissue_test(time, position, replace(quiet, delay_s=0.03), 1, 0)
    np.testing.assert_allclose(late[3:], force[:-3], atol=1e-9)


@pytest.fixture(scope="module")
def experiments(project):
    settings = from_plain(StudySettings, {"study": "quick", **QUICK})
    played = design_excitation(5.0, settings.signals, settings.seed).signals
    records = []
    for number, signal in enumerate(played):
        force = tissue_test(signal.time, signal.position, settings.twin.tissue, settings.twin.seed, number)
        records.append(record(signal.position, force, signal.name))
    models = []
    for one in records:
        tests = [other for other in records if other is not one]
        models += identify(one, tests, settings.tissue, settings.seed)[0]
    here = table_3_1(models, settings.tissue, "x").frame
    printed = pd.read_csv(project / "resources" / "thesis" / "table_3_1.csv")
    return table_3_1_experiments(printed, here, settings, 5.0, "synthetic twin")


def cell(table, quantity, record, model, column):
    frame = table.frame.set_index(["quantity", "trained_on", "model"])
    return float(frame.at[(quantity, record, model), column])


def test_correlated_noise_is_foreseen_one_step_ahead_and_white_noise_is_not(experiments):
    white = cell(experiments, "nmse_train", "multisine", "KB", "here")
    assert white > 0.14  # the noise's share of the variance
    assert cell(experiments, "nmse_train", "multisine", "KB", "correlated") < white / 2.5
    assert cell(experiments, "nmse_train", "multisine", "KB", "noisier") > 1.5 * white


def test_equal_peaks_make_the_noise_record_weak(experiments):
    equal_rms = cell(experiments, FORCE, "noise", "KB", "here")
    assert cell(experiments, FORCE, "noise", "KB", "equal_peaks") < 0.75 * equal_rms
    assert (
        cell(experiments, "vaf_percent", "noise", "KB", "equal_peaks")
        < cell(experiments, "vaf_percent", "noise", "KB", "here") - 5
    )
    np.testing.assert_allclose(
        cell(experiments, "vaf_percent", "multisine", "KB", "equal_peaks"),
        cell(experiments, "vaf_percent", "multisine", "KB", "here"),
        atol=0.5,
    )


def test_what_meets_the_print_is_found_by_column_and_definition(experiments):
    frame = experiments.frame
    every = agreeing(frame, "mru_percent", "multisine", "KB", lambda printed, found: True)
    assert set(every) == {f"{name}{how}" for name in ("here", *EXPERIMENTS) for how in ("", BY_MEAN)}
    ratio = every["here"] / every[f"here{BY_MEAN}"]
    assert ratio == pytest.approx(np.sqrt(2000))  # two periods of 10 s at 100 Hz
    assert agreeing(frame, "vaf_percent", "noise", "KB", lambda printed, found: False) == {}
    closest = frame[frame.quantity == MEAN_SQUARE].closest
    assert closest.isin(["here", *EXPERIMENTS]).all()
