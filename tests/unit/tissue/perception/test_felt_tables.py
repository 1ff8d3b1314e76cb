"""What is felt in the tables: static laws and models with time, rates, the rated models, and where an error is felt."""

from dataclasses import replace

import numpy as np
import pytest

from lumbar import compare, identify, locate, refine
from lumbar.records.ratings import Ratings
from lumbar.records.record import Channel, Record
from lumbar.settings.perception import PerceptionSettings
from lumbar.settings.runtime import RuntimeSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.haptics.judgement import judge
from lumbar.tissue.haptics.rates import rates, rates_table
from lumbar.tissue.identification.static_models import static_laws
from lumbar.tissue.perception.thresholds import Hands
from lumbar.tissue.survey.felt_models import felt_pairs, spearman, survey_felt_table, survey_power_table
from lumbar.twin.examples import example_records


@pytest.fixture(scope="module")
def records():
    return example_records()


@pytest.fixture(scope="module")
def found(records):
    return identify(records, "multisine")


def test_static_laws_find_a_law_of_their_own_kind():
    position = np.linspace(-3, 3, 400)
    for force, law, parameters in (
        (0.5 * position + 0.02 * position**3, "odd polynomial, degree 3", 2),
        (2 * np.expm1(0.4 * position), "exponential", 2),
        (0.5 * position + 2 * np.maximum(position, 0), "piecewise linear, 2 pieces", 2),
    ):
        channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
        fitted = static_laws(Record("x", np.arange(400) * 0.01, channels), 0)
        errors = {item.name: np.abs(item.force(position) - force).max() for item in fitted}
        assert errors[law] < 0.02 * np.ptp(force) and min(errors, key=errors.get) in (
            law,
            "odd polynomial, degree 7",
        )
        assert {item.parameters for item in fitted if item.name == law} == {parameters}
        assert errors["linear"] > 3 * errors[law]


def test_a_relaxing_tissue_needs_time_and_table_3_1_says_what_is_felt(found):
    table = found.static_or_dynamic.frame
    best = table.groupby("kind")["felt_jnd"].min()
    assert best["static"] > best["dynamic"] > 1  # friction is neither
    errors = found.table_3_1.frame.dropna(subset="felt_jnd")
    assert errors.loc[errors["model"] == "IL", "felt_jnd"].item() == errors["felt_jnd"].max()
    assert (errors["felt_low"] <= errors["felt_jnd"]).all() and (
        errors["felt_jnd"] <= errors["felt_high"]
    ).all()


def test_an_error_that_is_noise_alone_is_not_felt_and_friction_is_where_it_turns(records):
    refined = refine(records, ["coulomb_friction"])
    assert refined.compare()["other"].comparison.felt.jnd.value < 0.2
    assert "no hand feels what is left" in str(refined)
    base = refine(records, [])
    felt = base.compare()["other"].comparison.felt
    assert felt.jnd.low > 1 and felt.told_apart_percent.value > 95
    where = base.locate().felt.frame
    whole = where[(where["record"] == "other") & (where["along"] == "all")]["felt_jnd"].item()
    octaves = where[(where["record"] == "other") & (where["along"] == "frequency")]["felt_jnd"]
    assert whole == pytest.approx(felt.jnd.value)
    assert 0.3 * whole < np.sqrt(np.sum(octaves**2)) < 1.5 * whole
    dull = StudySettings(
        perception=PerceptionSettings(force_floor_N=(1.0, 2.0, 3.0), vibration_floor_N=(1.0, 2.0, 3.0))
    )
    assert (
        compare(records, base.model, settings=dull)["other"].comparison.felt.jnd.value < 0.3 * felt.jnd.value
    )
    assert "Felt most by a hand" in str(locate(records, base.model))


def _with_unit(records, unit):
    outputs = [replace(item.channels["output"], unit=unit) for item in records]
    return [
        replace(item, channels={**item.channels, "output": own})
        for item, own in zip(records, outputs, strict=True)
    ]


def test_other_outputs_than_forces_are_not_felt(records):
    turned = _with_unit(records, "N·m")
    refined = refine(turned, [])
    assert refined.compare()["other"].comparison.felt is None
    assert "hand" not in str(refined) and "hand" not in str(refined.compare())
    assert refined.locate().felt.frame.empty


def test_rates_that_hold_a_force_longer_are_felt_more(records, found):
    settings = RuntimeSettings(estimator="output_error")
    played, untrained = rates(records[0], records[1:], found.settings, settings, Hands.of())
    assert not untrained
    own = [
        item
        for item in played
        if item.model.name == "KB" and item.trained_Hz == max(one.trained_Hz for one in played)
    ]
    felt = {item.played_Hz: item.felt.jnd.value for item in own}
    assert felt[1000.0] == 0.0 and felt[100.0] > 1 > felt[250.0] > felt[500.0]
    stiffness = {item.played_Hz: item.stable_stiffness for item in own}
    assert stiffness[1000.0] > 5 * stiffness[100.0]
    short = [
        replace(
            item,
            time=item.time[:130] / 4,
            channels={
                role: replace(channel, values=channel.values[:130]) for role, channel in item.channels.items()
            },
        )
        for item in records
    ]
    refused = rates(short[0], short[1:], found.settings, settings, Hands.of())[1]
    assert [reason.partition(": ")[0] for reason in refused] == ["Not trained at 50 Hz"]
    turned = _with_unit(records, "N·m")
    moments, _ = rates(turned[0], turned[1:], found.settings, settings, Hands.of())
    frame = rates_table(moments, [], turned[0], "x").frame
    assert len(frame) > 3 and frame[["stable_stiffness", "felt_jnd"]].isna().all(axis=None)
    (slow, fast), _ = judge([found.get("KB", "output_error")], RuntimeSettings())
    assert slow.felt.jnd.value > 3 > fast.felt.jnd.value
    assert "to a hand rate, average and delay change a push by" in slow.finding


def test_rated_models_are_put_beside_their_ratings(records, found):
    models = {name: found[name] for name in ("MW", "KB", "HO")}
    felt = felt_pairs(models, records[0], None, Hands.of())
    order = sorted(models, key=lambda name: felt["", name].jnd.value)
    scores = np.array([[5 - 2 * order.index(name) for name in models]] * 12)
    ratings = Ratings(tuple(map(str, range(12))), tuple(models), scores, 5, (order[0],) * 12, {})
    table = survey_felt_table(ratings, felt, "multisine", 1, "synthetic twin")
    assert len(table.frame) == 3 and set(table.frame["closer"]) <= {order[0], order[1]}
    assert (
        "over 3 models: -1 (-1 to -1" in table.notes[0]
        and "p = 0.33 and cannot be significant" in table.notes[0]
    )
    power = survey_power_table(ratings, 1, "x").frame
    assert (power.loc[power["models"] == 4, "power_percent"] == 0).all()


def test_spearman_is_scipys():
    from scipy.stats import spearmanr

    rows = np.random.default_rng(4).integers(1, 4, (20, 6)).astype(float)
    fixed = np.arange(6.0)
    expected = [spearmanr(fixed, row).statistic for row in rows]
    assert spearman(fixed, rows) == pytest.approx(np.nan_to_num(expected))
