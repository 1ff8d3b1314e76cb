"""Identification of a record set by `lumbar.identify`: models, search, tables and file."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from periodic_records import record
from viscoelastic import discretise, kelvin_boltzmann

import lumbar
from study_settings import changed

SETTINGS = lumbar.StudySettings.model_validate(
    {
        "tissue": {
            "settling_s": 0.5,
            "search": {"order_max": 3, "condition_max": 5000, "selection": "training"},
            "ridge": {"alpha_min": 0.01, "alpha_max": 100, "alpha_points": 9},
            "bootstrap": {"block_s": 0.5, "resamples": 200, "confidence": 0.95},
            "inverted_linear": {"force_max": 5.0, "travel": 40.0},
        },
        "seed": 1,
    }
)
TRUTH = {"k1": 0.4, "k2": 3.2, "b": 0.126}
FITTED = ("LE", "MW", "Maxwell", "KB", "HO")


def tissue_record(name, seed, samples=1500, offset=(3.0, -2.0), scale=(1.0, 1.0), step=0.01):
    rng = np.random.default_rng([11, seed])
    motion = np.convolve(rng.standard_normal(samples + 20), np.hanning(15))[20 : samples + 20]
    force = discretise(kelvin_boltzmann(**TRUTH), 0.01).simulate(motion)
    force = force + 0.3 * force.std() * rng.standard_normal(samples)
    return record(scale[0] * motion + offset[0], scale[1] * force + offset[1], name, step=step)


def identify(*records, train=None, **tissue):
    """Identify on the first record, with changed settings of the tissue."""
    settings = changed(SETTINGS, tissue=tissue) if tissue else SETTINGS
    return lumbar.identify(records, train or records[0].name, settings=settings, source_label="twin")


@pytest.fixture(scope="module")
def records():
    return [tissue_record("long", 1, 3000), tissue_record("a", 2), tissue_record("b", 3)]


@pytest.fixture(scope="module")
def identified(records):
    return identify(*records, train=["long", "a", "b"])


def rows_of(identification, model):
    return identification.search[identification.search["model"] == model]


def test_output_error_never_simulates_worse_than_arx_and_contains_kb(identified, records):
    for training in (item.name for item in records):
        for name in FITTED:
            arx, output_error = (identified.get(name, kind, training) for kind in ("arx", "output_error"))
            assert output_error.scores.vaf_percent >= arx.scores.vaf_percent - 0.02
        higher, kb = (identified.get(name, "output_error", training) for name in ("HO", "KB"))
        if all(higher.structure.numerator[:2]):
            assert higher.scores.vaf_percent >= kb.scores.vaf_percent - 1e-3


def test_metrics_match_simulation_written_out(records, identified):
    model, (training, test) = identified["KB"], records[:2]
    (b0, b1), (_, a1) = model.structure.numerator, model.structure.denominator
    u, y = training["input"] - training["input"].mean(), training["output"] - training["output"].mean()
    modelled = [(b0 + b1) / (1 + a1) * u[0]]
    for k in range(1, len(u)):
        modelled.append(b0 * u[k] + b1 * u[k - 1] - a1 * modelled[-1])
    error, scores = (np.array(modelled) - y)[50:], model.scores
    fit_percent = 100 * (1 - np.sqrt(np.mean(error**2)) / y[50:].std())
    assert scores.vaf_percent == pytest.approx(100 * (1 - error.var() / y[50:].var()), rel=1e-9)
    assert scores.fit_percent == pytest.approx(fit_percent, rel=1e-9)
    assert scores.mean_residual == pytest.approx(np.abs(error).mean(), rel=1e-9)
    u, y = test["input"] - test["input"].mean(), test["output"] - test["output"].mean()
    one_step = y[1:] - (b0 * u[1:] + b1 * u[:-1] - a1 * y[:-1])
    assert scores.nmse_tests[0] == pytest.approx(np.sum(one_step**2) / np.sum(y[1:] ** 2), rel=1e-9)


def test_intervals_of_output_error_contain_the_physical_parameters(identified):
    model = identified.get("KB", "output_error")
    for name, truth in TRUTH.items():
        assert model[name].low < model[name].value < model[name].high
        assert model[name].value == pytest.approx(truth, rel=0.1)
    assert model["b"].unit == "N·s/mm"
    assert identified["MW"].parameters == ()
    assert "Eq. 3.3" in identified["MW"].no_parameters_because


def test_units_and_offsets_do_not_matter(records):
    scaled = identify(tissue_record("a", 2, offset=(1e3, 50.0), scale=(1e-3, 1e2)))
    for one, two in zip(identify(records[1]), scaled, strict=True):
        if one.estimator == "given":
            continue
        assert one.alpha == two.alpha
        assert one.scores.vaf_percent == pytest.approx(two.scores.vaf_percent, abs=1e-4)
        if one.name != "HO":
            assert one.scores.condition_number == pytest.approx(two.scores.condition_number, rel=1e-4)
        expected = np.multiply(one.structure.numerator, 1e5)
        np.testing.assert_allclose(two.structure.numerator, expected, rtol=0.02, atol=10)


def test_selection_on_test_records_picks_the_best_on_them(records):
    rows = rows_of(identify(*records[1:], search={"selection": "test"}), "HO")
    allowed = rows[rows["stable"] & (rows["condition_number"] <= 5000)]
    (chosen,) = rows[rows["selected"]]["test_vaf_percent"]
    assert chosen == allowed["test_vaf_percent"].max()


def test_biproper_system_is_found_with_its_feedthrough():
    """The present input acts at once."""
    rng = np.random.default_rng(3)
    inputs = rng.standard_normal(3000)
    force = np.zeros(3000)
    for k in range(3000):
        past = [(force[k - i], inputs[k - i]) if k >= i else (0.0, 0.0) for i in (1, 2)]
        force[k] = 2 * inputs[k] - past[0][1] + 0.5 * past[1][1] + 1.2 * past[0][0] - 0.5 * past[1][0]
    force += 0.001 * force.std() * rng.standard_normal(3000)
    identification = identify(record(inputs, force, "biproper"))
    assert identification["HO"].structure.biproper
    assert identification["HO"].structure.numerator[0] == pytest.approx(2.0, rel=0.01)
    frame = identification.table_3_1.frame
    assert frame[frame.model == "HO"].biproper.all()
    assert not frame[frame.model == "MW"].biproper.any()


def test_candidates_above_the_condition_limit_have_no_free_run(records):
    rows = rows_of(identify(*records[1:], search={"condition_max": 100.0}), "HO")
    beyond = rows[rows["condition_number"] > 100]
    within = rows[(rows["condition_number"] <= 100) & rows["stable"]]
    assert len(beyond) and beyond["vaf_percent"].isna().all()
    assert len(within) and within["vaf_percent"].notna().all()
    structures = within.groupby(["order", "input_lag_first", "input_lag_last"])
    assert (structures["test_vaf_percent"].count() == 1).all()


def test_condition_limit_restricts_the_choice(records):
    chosen = identify(records[1]).search.query("selected")
    assert (chosen["condition_number"] <= 5000).all()
    identification = identify(records[1], search={"condition_max": 1.0})
    least = rows_of(identification, "HO")["condition_number"].min()
    assert "condition_max 1" in identification["HO"].remark
    assert identification["HO"].scores.condition_number == least


def test_pure_sine_determines_two_coefficients():
    angle = 2 * np.pi * 0.01 * np.arange(2000)
    identification = identify(record(np.sin(angle), np.cos(angle), "sine"))
    kb, higher = identification["KB"], identification["HO"]
    assert (kb.scores.rank, kb.scores.free_parameters) == (2, 3)
    assert kb.scores.condition_number is None
    assert kb.scores.mru_percent is None
    assert kb.parameters == ()
    assert higher.scores.rank == 2
    assert "condition_max" in higher.remark
    frame = identification.table_3_1.frame
    assert frame[(frame.model == "KB") & (frame.estimator == "arx")].condition_number.isna().all()


def convert_to_pounds(item):
    channels = {**item.channels, "output": replace(item.channels["output"], unit="lbf")}
    return replace(item, channels=channels)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (tissue_record("b", 3, step=0.02), r"\bb .*50 Hz.*long .*100 Hz.*tissue\.rate_Hz"),
        (convert_to_pounds(tissue_record("b", 3)), r"\bb: output .*\blbf\b.*\bN\b.*\blong\b"),
        (tissue_record("b", 3, samples=40), r"\bb: 0\.4 s .*0\.5 s .*tissue\.settling_s"),
    ],
)
def test_incompatible_records_are_rejected(records, other, message):
    with pytest.raises(lumbar.InputError, match=message):
        identify(records[0], other)


def test_unsuitable_training_records_are_rejected(records):
    still = tissue_record("b", 3)
    still["output"][50:] = 1.0
    with pytest.raises(lumbar.InputError, match=r"b: .*output.*0\.5 s .*tissue\.settling_s"):
        identify(still)
    with pytest.raises(lumbar.InputError, match=r"b: (?=.*\b15\b).*\border 3\b"):
        identify(tissue_record("b", 3, samples=15), settling_s=0.0)
    with pytest.raises(lumbar.InputError, match=r"tissue\.search\.selection .*'test'.*'training'"):
        identify(records[0], search={"selection": "test"})


def test_saved_table_3_1_has_the_rows_of_the_thesis(identified, tmp_path):
    identified.save(tmp_path)
    frame = pd.read_csv(tmp_path / "table_3_1.csv")
    thesis = frame[(frame.estimator == "arx") & frame.model.isin(["MW", "KB", "HO"])]
    assert list(zip(thesis.trained_on, thesis.model, strict=True)) == [
        (name, model) for name in ("long", "a", "b") for model in ("MW", "KB", "HO")
    ]
    assert set(frame.data) == {"twin"}
    assert frame.test_records[0] == "a; b"


def test_table_3_1_of_a_single_record_with_another_unit(records):
    channels = {**records[1].channels, "output": lumbar.Channel(records[1]["output"], "moment", "N·m")}
    frame = identify(replace(records[1], channels=channels)).table_3_1.frame
    assert "mean_residual_N_m" in frame.columns
    assert not any(column.startswith("nmse_test") for column in frame.columns)


def test_saved_models_keep_their_contract_and_simulate_the_same(identified, records, tmp_path):
    identified.save(tmp_path)
    content = json.loads((tmp_path / "models.json").read_text("utf-8"))
    assert (content["schema"], content["data"]) == ("lumbar.models/2", "twin")
    models = lumbar.load_models(tmp_path / "models.json")
    assert models[:-1] == [model for model in identified if model.estimator != "given"]
    assert len(models) == 3 * 5 * 2 + 1
    given = models[-1]
    assert (given.name, given.trained_on, given.scores.vaf_percent) == ("IL", None, None)
    assert given.structure.numerator == (-0.125,)
    measured, kb = records[0]["output"], identified["KB"]
    error = (kb.simulate(records[0]) - measured)[50:]
    assert abs(error.mean()) < 0.05  # the offsets of position (3 mm) and force (−2 N) are included
    vaf_percent = 100 * (1 - error.var() / measured[50:].var())
    assert vaf_percent == pytest.approx(kb.scores.vaf_percent, rel=1e-9)


def test_table_of_physical_parameters_has_fitted_and_derived_ones(identified):
    frame = identified.physical_parameters.frame
    fitted = frame[(frame.model == "KB") & (frame.estimator == "output_error") & (frame.trained_on == "long")]
    assert list(fitted.derived) == [False] * 3 + [True] * 6
    assert list(fitted.parameter[:3]) == ["spring_stiffness", "branch_stiffness", "relaxation_time"]
