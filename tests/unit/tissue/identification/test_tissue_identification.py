"""Identification of a record set, its tables and file; its estimators against normal equations, statsmodels, a scan, truth."""

import csv
import dataclasses
import json
from itertools import chain

import numpy as np
import pytest
import statsmodels.api as sm
from periodic_records import record
from viscoelastic import discretise, kelvin_boltzmann

from lumbar.base.errors import InputError, NumericalError
from lumbar.records.record import Channel, Record
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.identification.arx_search import IdentificationData, ReducedRegression, search, select
from lumbar.tissue.identification.identify_tissue import distinct, identify, inverted_model
from lumbar.tissue.identification.metrics import block_bootstrap
from lumbar.tissue.identification.model_tables import physical_parameters_table, table_3_1
from lumbar.tissue.identification.output_error import (
    fit_output_error,
    relaxation_starts,
    simulation_sensitivities,
    stabilise,
)
from lumbar.tissue.models.fitted_model import models_document, read_models
from lumbar.tissue.models.model_data import Port
from lumbar.tissue.models.tissue_models import HO, KB, MAXWELL, MW, higher_order_structures
from lumbar.tissue.models.transfer_function import ArxStructure, TransferFunction
from study_settings import changed

SETTINGS = TissueSettings.model_validate(
    {
        "settling_s": 0.5,
        "search": {"order_max": 3, "condition_max": 5000, "selection": "training"},
        "ridge": {"alpha_min": 0.01, "alpha_max": 100, "alpha_points": 9},
        "bootstrap": {"block_s": 0.5, "resamples": 200, "confidence": 0.95},
        "inverted_linear": {"force_max": 5.0, "travel": 40.0},
    },
)
TRUTH = {"k1": 0.4, "k2": 3.2, "b": 0.126}


def tissue_record(name, seed, samples=1500, noise=0.3, offset=(3.0, -2.0), scale=(1.0, 1.0), step=0.01):
    rng = np.random.default_rng([11, seed])
    motion = np.convolve(rng.standard_normal(samples + 20), np.hanning(15))[20 : samples + 20]
    force = discretise(kelvin_boltzmann(**TRUTH), 0.01).simulate(motion)
    force = force + noise * force.std() * rng.standard_normal(samples)
    return record(scale[0] * motion + offset[0], scale[1] * force + offset[1], name, step=step)


@pytest.fixture(scope="module")
def records():
    return [tissue_record("long", 1, 3000), tissue_record("a", 2), tissue_record("b", 3)]


@pytest.fixture(scope="module")
def identified(records):
    results = []
    for training in records:
        tests = [record for record in records if record is not training]
        models, _ = identify(training, tests, SETTINGS, seed=1)
        results.append([*models, inverted_model(training, tests, 0.5, 5.0, 40.0)])
    return results


def fit_of(result, name, estimator):
    (fit,) = [fit for fit in result if (fit.name, fit.estimator) == (name, estimator)]
    return fit


def test_the_output_error_fit_never_simulates_worse_than_arx_and_contains_kb(identified):
    for result in identified:
        for name in ("LE", "MW", "Maxwell", "KB", "HO"):
            arx, output_error = fit_of(result, name, "arx"), fit_of(result, name, "output_error")
            assert output_error.scores.vaf_percent >= arx.scores.vaf_percent - 0.02
        higher = fit_of(result, "HO", "output_error")
        if all(higher.structure.numerator[:2]):
            assert higher.scores.vaf_percent >= fit_of(result, "KB", "output_error").scores.vaf_percent - 1e-3


def test_metrics_match_simulation_written_out(records, identified):
    fit = fit_of(identified[0], "KB", "arx")
    training, test = records[0], records[1]
    (b0, b1), (_, a1) = fit.structure.numerator, fit.structure.denominator
    u, y = training["input"] - training["input"].mean(), training["output"] - training["output"].mean()
    modelled = [(b0 + b1) / (1 + a1) * u[0]]
    for k in range(1, len(u)):
        modelled.append(b0 * u[k] + b1 * u[k - 1] - a1 * modelled[-1])
    error = (np.array(modelled) - y)[50:]
    assert fit.scores.vaf_percent == pytest.approx(100 * (1 - error.var() / y[50:].var()), rel=1e-9)
    assert fit.scores.fit_percent == pytest.approx(
        100 * (1 - np.sqrt(np.mean(error**2)) / y[50:].std()), rel=1e-9
    )
    assert fit.scores.mean_residual == pytest.approx(np.abs(error).mean(), rel=1e-9)
    u, y = test["input"] - test["input"].mean(), test["output"] - test["output"].mean()
    one_step = y[1:] - (b0 * u[1:] + b1 * u[:-1] - a1 * y[:-1])
    assert fit.scores.nmse_tests[0] == pytest.approx(np.sum(one_step**2) / np.sum(y[1:] ** 2), rel=1e-9)


def test_physical_parameters_of_the_output_error_fit_hold_the_truth(identified):
    model = fit_of(identified[0], "KB", "output_error")
    for name, truth in TRUTH.items():
        assert model[name].low < model[name].value < model[name].high
        assert model[name].value == pytest.approx(truth, rel=0.1)
    assert model["b"].unit == "N·s/mm"
    assert fit_of(identified[0], "MW", "arx").parameters == ()
    assert "Eq. 3.3" in fit_of(identified[0], "MW", "arx").no_parameters_because


def test_units_and_offsets_do_not_matter(records):
    reference, _ = identify(records[1], [], SETTINGS, seed=1)
    moved, _ = identify(tissue_record("a", 2, offset=(1e3, 50.0), scale=(1e-3, 1e2)), [], SETTINGS, seed=1)
    for one, two in zip(reference, moved, strict=True):
        assert one.alpha == two.alpha
        assert one.scores.vaf_percent == pytest.approx(two.scores.vaf_percent, abs=1e-4)
        if one.name != HO.name:
            assert one.scores.condition_number == pytest.approx(two.scores.condition_number, rel=1e-4)
        np.testing.assert_allclose(
            two.structure.numerator, np.multiply(one.structure.numerator, 1e5), rtol=0.02, atol=10
        )


def test_selection_on_test_records_picks_the_best_on_them(records):
    settings = changed(SETTINGS, search={"selection": "test"})
    _, grid = identify(records[1], records[2:], settings, seed=1)
    higher = [row for row in grid if row["model"] == "HO" and row["stable"]]
    (chosen,) = [row for row in higher if row["selected"]]
    allowed = [row for row in higher if row["condition_number"] <= settings.search.condition_max]
    assert chosen["test_vaf_percent"] == max(row["test_vaf_percent"] for row in allowed)


def higher_order_record(noise, samples=3000):
    """A biproper system of second order: its present input acts at once."""
    rng = np.random.default_rng(3)
    inputs = rng.standard_normal(samples)
    force = TransferFunction((2.0, -1.0, 0.5), (1.0, -1.2, 0.5)).simulate(inputs)
    force = force + noise * force.std() * rng.standard_normal(samples)
    return record(inputs, force, "biproper")


def test_a_biproper_system_is_found_so_and_its_feed_through_is_that_of_the_system():
    models, _ = identify(higher_order_record(0.001), [], SETTINGS, 1)
    fit = fit_of(models, "HO", "arx")
    assert fit.structure.biproper
    assert fit.structure.numerator[0] == pytest.approx(2.0, rel=0.01)
    frame = table_3_1(models, SETTINGS, "x").frame
    assert frame[frame.model == "HO"].biproper.all()
    assert not frame[frame.model == "MW"].biproper.any()


def test_candidates_above_cap_have_no_free_run(records):
    _, grid = identify(records[1], records[2:], changed(SETTINGS, search={"condition_max": 100.0}), 1)
    higher = [row for row in grid if row["model"] == "HO"]
    beyond = [row for row in higher if row["condition_number"] > 100]
    within = [row for row in higher if row["condition_number"] <= 100 and row["stable"]]
    assert beyond and {row["vaf_percent"] for row in beyond} == {None}
    assert within and all(row["vaf_percent"] is not None for row in within)
    tested = [row for row in within if row["test_vaf_percent"] is not None]
    structure = ("order", "input_lag_first", "input_lag_last")
    assert len(tested) == len({tuple(row[key] for key in structure) for row in within})


def test_conditioning_cap_limits_choice(records):
    chosen = [row for row in identify(records[1], [], SETTINGS, 1)[1] if row["selected"]]
    assert all(row["condition_number"] <= SETTINGS.search.condition_max for row in chosen)
    result, grid = identify(records[1], [], changed(SETTINGS, search={"condition_max": 1.0}), 1)
    fit = fit_of(result, "HO", "arx")
    assert "every structure exceeds condition_max 1" in fit.remark
    assert fit.scores.condition_number == min(row["condition_number"] for row in grid if row["model"] == "HO")


def test_an_unstable_model_has_no_free_run_in_any_table():
    """An output that grows by itself: every ridge solution of MW keeps its pole outside the unit circle."""
    rng = np.random.default_rng(0)
    inputs = rng.standard_normal(400)
    outputs = np.zeros(400)
    for k in range(1, 400):
        outputs[k] = 1.04 * outputs[k - 1] + 0.1 * inputs[k - 1]
    data = IdentificationData.from_record(record(inputs, outputs, "growing"), 0.5)
    data = dataclasses.replace(data, outputs=outputs)
    regression = ReducedRegression(inputs, outputs, 2)
    candidates = search("MW", [ArxStructure(1, (1,))], np.array([0.0, 0.01]), regression, data, [data])
    chosen, remark = select(candidates, "training", None)
    assert not chosen.stable
    assert chosen.training is None
    assert chosen.test_vaf_percent is None
    assert remark == "unstable for every alpha"


def test_pure_sine_determines_two_coefficients():
    turns = 2 * np.pi * 0.01 * np.arange(2000)
    result, _ = identify(record(np.sin(turns), np.cos(turns), "sine"), [], SETTINGS, 1)
    fit = fit_of(result, "KB", "arx")
    assert (fit.scores.rank, fit.scores.free_parameters) == (2, 3)
    assert fit.scores.condition_number is None
    assert fit.scores.mru_percent is None
    assert fit.parameters == ()
    higher = fit_of(result, "HO", "arx")
    assert higher.scores.rank == 2
    assert "every structure exceeds condition_max" in higher.remark
    frame = table_3_1(result, SETTINGS, "x").frame
    assert frame[(frame.model == "KB") & (frame.estimator == "arx")].condition_number.isna().all()


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (tissue_record("b", 3, step=0.02), "b is sampled at 50 Hz, long at 100 Hz.*rate_Hz"),
        (
            Record(
                "b",
                0.01 * np.arange(100),
                {
                    "input": Channel(np.arange(100.0), "position", "mm"),
                    "output": Channel(np.arange(100.0), "force", "lbf"),
                },
            ),
            "force in lbf, but force in N in long",
        ),
        (tissue_record("b", 3, samples=40), r"the first 0\.5 s"),
    ],
)
def test_incompatible_records_are_rejected(records, other, message):
    with pytest.raises(InputError, match=message):
        identify(records[0], [other], SETTINGS, 1)


def test_a_record_that_moves_only_while_settling_is_refused(records):
    still = tissue_record("b", 3)
    still["output"][50:] = 1.0
    with pytest.raises(InputError, match=r"the output does not move after the first 0\.5 s"):
        identify(still, [], SETTINGS, 1)


def test_too_short_a_training_record_and_selection_without_tests_are_refused(records):
    settings = changed(SETTINGS, settling_s=0.0)
    with pytest.raises(InputError, match="too few for order 3"):
        identify(tissue_record("b", 3, samples=15), [], settings, 1)
    with pytest.raises(InputError, match="single record"):
        identify(records[0], [], changed(SETTINGS, search={"selection": "test"}), 1)


def test_table_3_1_holds_the_rows_of_the_thesis(identified, tmp_path):
    table_3_1([*chain(*identified)], SETTINGS, "synthetic twin").write(tmp_path / "table_3_1")
    with (tmp_path / "table_3_1.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    thesis = [row for row in rows if row["estimator"] == "arx" and row["model"] in ("MW", "KB", "HO")]
    assert [(row["trained_on"], row["model"]) for row in thesis] == [
        (name, model) for name in ("long", "a", "b") for model in ("MW", "KB", "HO")
    ]
    assert {row["data"] for row in rows} == {"synthetic twin"}
    assert rows[0]["test_records"] == "a; b"


def test_table_3_1_of_one_record_and_of_another_unit(records):
    models, _ = identify(records[1], [], SETTINGS, 1)
    result = [dataclasses.replace(model, output=Port("moment", "N·m")) for model in models]
    frame = table_3_1(result, SETTINGS, "x").frame
    assert "mean_residual_N_m" in frame.columns
    assert not any(column.startswith("nmse_test") for column in frame.columns)


def test_models_file_keeps_its_contract_and_simulates_the_same(identified, records):
    models = distinct([*chain(*identified)])
    content = json.loads(json.dumps(models_document(models, "synthetic twin")))
    assert content["schema"] == "lumbar.models/2"
    assert content["data"] == "synthetic twin"
    assert read_models(content, {}) == models
    assert len(models) == 3 * 5 * 2 + 1
    given = models[-1]
    assert (given.name, given.trained_on, given.scores.vaf_percent) == ("IL", None, None)
    assert given.structure.numerator == (-0.125,)
    measured = records[0]["output"]
    kb = fit_of(identified[0], "KB", "arx")
    error = (kb.simulate(records[0]) - measured)[50:]
    assert abs(error.mean()) < 0.05  # with the offsets of position (3 mm) and force (−2 N) in place
    assert 100 * (1 - error.var() / measured[50:].var()) == pytest.approx(kb.scores.vaf_percent, rel=1e-9)


def test_the_table_of_physical_parameters_has_what_is_fitted_and_what_follows(identified):
    frame = physical_parameters_table([*chain(*identified)], 0.95, "synthetic twin").frame
    kept = frame[
        (frame.model == KB.name) & (frame.estimator == "output_error") & (frame.trained_on == "long")
    ]
    fitted = [item.name for item in (*KB.base.linear, *KB.base.nonlinear)]
    assert list(kept.parameter) == [*fitted, *(element.name for element in KB.elements)]
    assert list(kept.derived) == [False] * 3 + [True] * 6


STRUCTURES = [MW.structure, MAXWELL.structure, KB.structure, *higher_order_structures(4)]


def regressor_matrix(structure, inputs, outputs, lag):
    """Write out A and b of Eq. 3.6 row by row."""
    rows = []
    for k in range(lag, len(inputs)):
        row = [outputs[k - i] for i in range(1, structure.order + 1)]
        if structure.zero_static_gain:
            row.append(inputs[k] - inputs[k - 1])
        else:
            row += [inputs[k - j] for j in structure.input_lags]
        rows.append(row)
    return np.array(rows), outputs[lag:]


@pytest.fixture(scope="module")
def one_record():
    rng = np.random.default_rng(5)
    inputs = np.convolve(rng.standard_normal(420), np.ones(9) / 3)[:400]
    outputs = TransferFunction((1.9, -1.5), (1.0, -0.7)).simulate(inputs) + 0.3 * rng.standard_normal(400)
    return inputs - inputs.mean(), outputs - outputs.mean()


@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
def test_one_factorisation_gives_every_ridge_solution(one_record, structure):
    path = ReducedRegression(*one_record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *one_record, lag=4)
    column_scale, target_scale = np.sqrt(np.mean(regressors**2, axis=0)), np.sqrt(np.mean(target**2))
    scaled, scaled_target = regressors / column_scale, target / target_scale
    np.testing.assert_allclose(path.singular_values, np.linalg.svd(scaled, compute_uv=False), rtol=1e-8)
    assert path.condition_number == pytest.approx(np.linalg.cond(scaled), rel=1e-7)
    for alpha in (0.0, 0.05, 3.0, 100.0):
        expected = np.linalg.solve(
            scaled.T @ scaled + alpha**2 * np.eye(scaled.shape[1]), scaled.T @ scaled_target
        )
        np.testing.assert_allclose(path.standardised_solution(alpha), expected, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            path.solution(alpha), expected * target_scale / column_scale, rtol=1e-6, atol=1e-9
        )
        residual = scaled_target - scaled @ expected
        assert path.residual_sum_of_squares(alpha) == pytest.approx(residual @ residual, rel=1e-9)


@pytest.mark.parametrize("structure", [MW.structure, KB.structure, ArxStructure(3, (0, 1, 2))], ids=str)
def test_parameter_covariance_is_that_of_ordinary_least_squares(one_record, structure):
    path = ReducedRegression(*one_record, lag=4).path(structure)
    regressors, target = regressor_matrix(structure, *one_record, lag=4)
    reference = sm.OLS(target, regressors).fit()
    np.testing.assert_allclose(path.solution(0.0), reference.params, rtol=1e-8)
    deviations = path.standard_deviations(0.0) * path.target_scale / path.column_scale
    np.testing.assert_allclose(deviations, reference.bse, rtol=1e-8)


T = 0.01


def experiment(seed, samples=2000, noise=0.4):
    """Demeaned band-limited motion and the force of a KB tissue with white noise, σ = noise·σ_force."""
    rng = np.random.default_rng([7, seed])
    inputs = np.convolve(rng.standard_normal(samples + 20), np.hanning(15))[20 : samples + 20]
    force = discretise(kelvin_boltzmann(**TRUTH), T).simulate(inputs - inputs.mean())
    outputs = force + noise * force.std() * rng.standard_normal(samples)
    return inputs - inputs.mean(), outputs - outputs.mean()


def arx(structure, inputs, outputs):
    return structure.transfer_function(
        ReducedRegression(inputs, outputs, structure.largest_lag).path(structure).solution(0)
    )


@pytest.mark.parametrize("structure", [KB.structure, MAXWELL.structure, ArxStructure(3, (1, 2))], ids=str)
def test_sensitivities_are_the_derivatives_of_the_free_run(structure):
    inputs, _ = experiment(0, samples=200)
    coefficients = np.linspace(0.4, -0.2, structure.parameter_count)
    found = simulation_sensitivities(structure, coefficients, inputs + 0.7)
    for column in range(structure.parameter_count):
        step = np.zeros(structure.parameter_count)
        step[column] = 1e-6
        ahead = structure.transfer_function(coefficients + step).simulate(inputs + 0.7)
        behind = structure.transfer_function(coefficients - step).simulate(inputs + 0.7)
        np.testing.assert_allclose(found[:, column], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("model", [MW, MAXWELL, KB], ids=lambda model: model.name)
def test_starts_over_all_poles_find_the_lowest_of_several_minima(model):
    """Against a fine scan of the pole with the best numerator for each."""
    inputs, outputs = experiment(5)
    structure = model.structure
    starts = relaxation_starts(structure, inputs, outputs)
    fit = fit_output_error(structure, inputs, outputs, starts, 50)
    scan = relaxation_starts(structure, inputs, outputs, tuple(np.linspace(-0.995, 0.995, 400)))
    lowest = min(np.sum((item.simulate(inputs) - outputs)[50:] ** 2) for item in scan)
    assert np.sum(fit.residuals**2) <= lowest
    assert np.sum(fit.residuals**2) >= 0.98 * lowest


def test_bootstrap_intervals_of_output_error_cover_the_truth_and_those_of_arx_do_not():
    """Of 20 experiments a 95 % interval misses each parameter once on average; ARX is biased."""
    covered, arx_covered = np.zeros(3), 0
    truth = KB.structure.coefficients(discretise(kelvin_boltzmann(**TRUTH), T))
    for seed in range(20):
        inputs, outputs = experiment(100 + seed)
        start = arx(KB.structure, inputs, outputs)
        fit = fit_output_error(KB.structure, inputs, outputs, [start], 50)
        rng = np.random.default_rng(seed)
        draws = fit.coefficients + block_bootstrap(fit.sensitivities, fit.residuals, 50, 400, rng)
        low, high = np.quantile(draws, [0.025, 0.975], axis=0)
        covered += (low <= truth) & (truth <= high)
        regressors = np.column_stack([outputs[:-1], inputs[1:], inputs[:-1]])
        draws = block_bootstrap(regressors, outputs[1:], 50, 400, rng)
        assert np.median(draws[:, 0]) == pytest.approx(-start.denominator[1], abs=0.05)
        low, high = np.quantile(draws[:, 0], [0.025, 0.975])
        arx_covered += low <= truth[0] <= high
    assert (covered >= 15).all(), covered
    assert arx_covered == 0


def test_bootstrap_of_a_ridge_solution_is_centred_on_it():
    rng = np.random.default_rng(6)
    regressors = rng.standard_normal((1000, 2))
    target = regressors @ [1.0, -2.0] + 0.1 * rng.standard_normal(1000)
    ridge = np.linalg.solve(regressors.T @ regressors + 30.0**2 * np.eye(2), regressors.T @ target)
    draws = block_bootstrap(regressors, target, 10, 1000, rng, alpha=30.0)
    np.testing.assert_allclose(draws.mean(axis=0), ridge, atol=0.02)


def test_bootstrap_of_very_few_blocks_is_refused():
    with pytest.raises(InputError, match=r"make 4 blocks.*block_s"):
        block_bootstrap(np.ones((40, 1)), np.ones(40), 10, 100, np.random.default_rng(0))


def test_an_unstable_start_is_reflected_and_still_leads_to_the_minimum():
    inputs, outputs = experiment(3)
    unstable = TransferFunction((3.0, -2.9), (1.0, -1.04))
    assert not unstable.stable
    assert stabilise(unstable).stable
    good = fit_output_error(KB.structure, inputs, outputs, [arx(KB.structure, inputs, outputs)], 50)
    fit = fit_output_error(KB.structure, inputs, outputs, [unstable], 50)
    assert np.sum(fit.residuals**2) == pytest.approx(np.sum(good.residuals**2), rel=1e-6)


def test_no_start_at_all_is_an_error():
    inputs, outputs = experiment(3)
    with pytest.raises(NumericalError, match="no start"):
        fit_output_error(KB.structure, inputs, outputs, [], 50)
