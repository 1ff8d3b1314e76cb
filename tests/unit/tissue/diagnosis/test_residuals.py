"""Parts of comparisons and locations: intervals, nonlinear share, trends, correlations, and sizes under noise only."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from periodic_records import STEP, multisine, noise, noisy_record, record, relaxing_force
from scipy.signal import lfilter
from scipy.stats import kendalltau

import lumbar
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.linear.linear_dynamics import distortion_power, nonlinear_share
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.candidate_causes import CAUSE_EFFECTS, cross_correlation, rank_causes
from lumbar.tissue.diagnosis.residuals.compare import (
    RESAMPLES,
    block_groups,
    compare_record,
)
from lumbar.tissue.diagnosis.residuals.locate import Location, residual_after, residual_of
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversals
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.residuals.time_frequency import mann_kendall_p, time_view
from lumbar.tissue.effects.catalogue import MOTION_SENSOR, PENDULUM, TISSUE
from lumbar.tissue.identification.metrics import fit_ratio, mean_residual, variance_accounted_for
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure
from refusing import has_tokens


def aperiodic(size: int, sigma: float, seed: int, pole: float = 0.0):
    position = noise(size, seed, 0.97)
    force = relaxing_force(position)
    return record(position, force + sigma * noise(size, seed + 1, pole), "noise"), force


def test_repeated_error_does_not_narrow_intervals():
    """Ten periods of the same error tell no more about another excitation than one."""
    position = multisine(10, seed=4)
    force = relaxing_force(position)
    error = np.tile(noise(500, 9, 0.95), 10)
    test = record(position, force + error + 1e-3 * noise(5000, 3))
    many = compare_record(test, force, noise_floor(test)).rms
    one = compare_record(record(position[:500], (force + error)[:500]), force[:500], start=0.0).rms
    assert many.high - many.low == pytest.approx(one.high - one.low, rel=0.35)
    unaware = compare_record(test, force).rms
    assert unaware.high - unaware.low < 0.7 * (many.high - many.low)


@pytest.mark.parametrize(("size", "period"), [(1000, None), (4950, 500), (37, None), (700, 500)])
def test_groups_contain_every_sample_and_keep_phases(size, period):
    groups = block_groups([noise(size, 1, 0.9)], period)
    assert sorted(np.concatenate(groups)) == list(range(size))
    assert len(groups) >= 8
    if period and period < size:
        for group in groups:
            phases = np.unique(group % period)
            assert np.ptp(phases) == len(phases) - 1


def test_intervals_match_resampled_records():
    test, force = aperiodic(1000, 0.3, 1)
    result = compare_record(test, force, start=0.0, seed=3)
    measured, residual = test["output"], test["output"] - force
    groups = block_groups([residual, measured - measured.mean()], None)
    draws = np.random.default_rng(3).integers(len(groups), size=(RESAMPLES, len(groups)))
    chosen = [np.concatenate([groups[group] for group in draw]) for draw in draws]
    for name, figure in (
        ("vaf", variance_accounted_for),
        ("fit", fit_ratio),
        ("mean_residual", mean_residual),
    ):
        resampled = [figure(measured[samples], force[samples]) for samples in chosen]
        interval = getattr(result, name)
        assert [interval.low, interval.high] == pytest.approx(np.quantile(resampled, [0.025, 0.975]))


def test_invalid_simulations_are_rejected():
    test, force = aperiodic(1000, 0.3, 1)
    with pytest.raises(lumbar.InputError, match=r"\(999,\).*\b1000 samples"):
        compare_record(test, force[:-1])
    force[500] = np.nan
    with pytest.raises(lumbar.InputError, match=r"\bnan\b.*\b5 s\b"):
        compare_record(test, force)
    with pytest.raises(lumbar.InputError, match=r"\b10 s\b.*\b0 samples\b.*\b20 s\b"):
        compare_record(test, np.zeros(1000), start=20.0)
    with pytest.raises(lumbar.NumericalError, match=r"^multisine: .*\boutput\b.*\b0 s\b"):
        compare_record(record(test["input"], np.zeros(1000)), np.zeros(1000))


def share(force, base: str = "KB", periods: int = 8, lines=None):
    """Share of a base's error on a multisine, whose force is a function of its position."""
    position = multisine(periods, lines=lines)
    measured = force(position) + 0.01 * noise(len(position), 3)
    test = multisine(4, seed=7)
    experiment = prepare([record(position, measured, "training"), record(test, force(test), "test")])
    return nonlinear_share(experiment, fit_base(Structure(BASES[base]), experiment.training))


def test_linear_material_leaves_linear_error():
    assert share(relaxing_force, base="LE") < 0.02
    assert share(lambda z: lfilter([0.5, -0.6, 0.3], [1.0, -1.5, 0.7], z)) < 0.02


def test_even_force_is_distortion():
    """Between odd lines the square of the motion falls on even ones only."""
    odd = np.arange(1, 51, 2)
    assert share(lambda z: relaxing_force(z) + 0.02 * z**2, lines=odd) > 0.9


def test_friction_leaves_distortion():
    assert share(lambda z: relaxing_force(z) + 0.3 * np.sign(np.gradient(z))) > 0.3


def test_nonlinear_share_is_unknown_without_enough_lines():
    assert share(lambda z: 0.7 * z) is None
    assert share(relaxing_force, base="LE", lines=[1, 4, 9, 16]) is None
    once = multisine(1, samples=4000)
    experiment = prepare([record(once, relaxing_force(once))])
    assert nonlinear_share(experiment, fit_base(Structure(BASES["LE"]), experiment.training)) is None


def test_distortion_is_estimated_without_bias():
    """Noise of power 1 added to a smooth response, at lines that the input excites and at those it does not."""
    random = np.random.default_rng(0)
    lines = np.arange(2001)
    excited = lines[1:1500:2]
    inputs = np.zeros(len(lines), complex)
    inputs[excited] = 50 * np.exp(2j * np.pi * random.uniform(size=len(excited)))
    smooth = 1 / (1 + 2j * lines / 1000 - (lines / 800) ** 2)
    distortion = (random.standard_normal(2001) + 1j * random.standard_normal(2001)) / np.sqrt(2)
    power = distortion_power(inputs, smooth * inputs + distortion, excited)
    assert power[excited].mean() == pytest.approx(1.0, abs=0.1)
    assert_allclose(power[2:1500:2], np.abs(distortion[2:1500:2]) ** 2)


def locate(record, simulated, *noise, **start):
    residual = residual_after(record, simulated, *noise, **start)
    return Location.from_residual(record.name, residual, rank_causes([residual]))


@pytest.mark.statistical
@pytest.mark.parametrize(("pole", "repeating"), [(0.0, True), (0.9, True), (0.0, False)])
def test_sizes_under_the_null(pole, repeating):
    """At the 5 % level no test of a true model's residual rejects in clearly more than 5 % of the cases."""
    trials = 300 if pole == 0.0 and repeating else 150
    p_values: dict[str, list[float]] = {}
    accused = 0
    for seed in range(trials):
        test = noisy_record(6, 0.3, seed, pole, samples=160)
        floor = noise_floor(test, period=1.6)
        location = locate(test, relaxing_force(test["input"]), floor, "" if repeating else "another")
        accused += not location.is_noise
        for name, value in location.p_values.items():
            p_values.setdefault(name, []).append(value)
        for kind in ("p even", "p odd"):
            p_values.setdefault(kind, []).append(location.views["candidate causes"].numbers[kind])
    # Three standard errors, and a little for the noise's spectrum being estimated.
    scatter = 3 * np.sqrt(0.05 * 0.95 / trials)
    allowed = 0.05 + scatter + (0.01 if pole == 0 else 0.03)
    rejected = {name: np.mean(np.array(values) < 0.05) for name, values in p_values.items()}
    assert max(rejected.values()) <= allowed, rejected
    assert accused / trials <= 0.05 + scatter


def test_drift_of_the_mean_is_a_trend():
    """The RMS of a straight drift about its middle falls and rises again: it has no trend."""
    position, drift = noise(4000, 3, 0.97), np.linspace(-0.5, 0.5, 4000)
    force = relaxing_force(position)
    for added, is_drift in ((drift, True), (0 * drift, False)):
        residual = residual_after(record(position, force + added + 0.05 * noise(4000, 4)), force)
        assert has_tokens(time_view(residual).sentence, "mean drifts by +1") == is_drift
    repeated = multisine(10, seed=4)
    clean = relaxing_force(repeated)
    test = record(repeated, clean + np.linspace(-0.5, 0.5, 5000) + 0.05 * noise(5000, 5))
    assert has_tokens(time_view(residual_after(test, clean, noise_floor(test))).sentence, "mean drifts by +")


def test_mann_kendall_agrees_with_kendalls_tau():
    values = noise(40, 3) + 0.03 * np.arange(40)
    assert mann_kendall_p(values) == pytest.approx(kendalltau(np.arange(40), values).pvalue, abs=0.02)
    assert mann_kendall_p(np.arange(10.0)) < 0.001


def test_cross_correlation_equals_its_definition():
    test = noisy_record(6, 0.3, 2)
    residual = residual_after(test, relaxing_force(test["input"]), noise_floor(test))
    signal = residual.position - residual.position.mean()
    result = cross_correlation(residual, signal)
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    direct = [np.sum(residual.values * np.roll(signal, lag)) / scale for lag in result.lags]
    assert result.values == pytest.approx(direct, abs=1e-12)
    assert result.limit == pytest.approx(1.96 / np.sqrt(len(signal)), rel=0.1)


def test_reversals_of_noisy_triangle_are_found():
    position = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, -1, 200), np.linspace(-1, 0.5, 150)])
    turns, directions = reversals(position + 0.01 * noise(450, 1))
    assert directions.tolist() == [-1, 1]
    assert turns == pytest.approx([100, 300], abs=4)


def test_velocity_of_noisy_position_is_smoothed():
    time = np.arange(2000) * STEP
    position = 5 * np.sin(2 * np.pi * 0.5 * time)
    expected = 5 * np.pi * np.cos(2 * np.pi * 0.5 * time)
    assert steady_velocity(position, STEP)[5:-5] == pytest.approx(expected[5:-5], abs=0.01)
    noisy = steady_velocity(position + 0.05 * noise(2000, 1), STEP)
    assert np.std(noisy - expected) < 0.15 * np.std(expected)


def test_every_effect_is_named_for_a_cause():
    assert {name for effects in CAUSE_EFFECTS.values() for name in effects} == {
        *TISSUE,
        *PENDULUM,
        *MOTION_SENSOR,
    }


@pytest.mark.statistical
def test_hidden_effects(shared):
    """The first cause of the error of all records names the hidden effect."""
    labels = json.loads((shared / "hidden_effects" / "labels.json").read_text())
    for case, label in labels.items():
        seen = lumbar.read(shared / "hidden_effects" / case)
        tests = [seen[name] for name in ("multisine", "noise", "chirp")]
        step = tests[0].sampling_time
        # The base model with its true time constant, stiffnesses by least squares.
        decay = np.exp(-step / label["tau_s"])
        held = label["tau_s"] * (1 - decay) / step
        columns = {}
        for test in tests:
            position = test["input"]
            branch = lfilter([held, -held], [1, -decay], position - position[0])
            columns[test.name] = np.column_stack([position, branch])
        stiffness = np.linalg.lstsq(columns["multisine"][50:], tests[0]["output"][50:], rcond=None)[0]
        experiment = prepare(tests, "multisine")
        residuals = [residual_of(test, columns[test.name] @ stiffness, experiment) for test in tests]
        first = locate(tests[0], columns["multisine"] @ stiffness, experiment.floor, start=0.5)
        if not label["effects"]:
            assert first.is_noise or first.is_near_noise_floor, case
        else:
            causes = rank_causes(residuals)
            assert set(label["effects"]) & set(causes[0].effects), (case, label["effects"], causes)


def test_position_at_rest_with_a_noise_floor_has_no_relation_to_the_error():
    position = np.minimum(np.arange(2000) / 40, 1.0)
    hold = record(position, 0.7 * position + 0.02 * noise(2000, 1), "hold")
    floor = noise_floor(noisy_record(10, 0.02, 1))
    location = locate(hold, 0.5 * position, floor, "multisine", start=0.5)
    assert (
        location.shares["depth"] == location.shares["reversals"] == location.views["frequency"].share == 0.0
    )
    assert location.causes[0].name == "constant offset"
