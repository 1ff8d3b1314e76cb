"""Comparison and location of a model's error by the public functions: definitions, and known errors at their causes."""

import numpy as np
import pandas as pd
import pytest
from effect_entries import base_model, record_of_model
from periodic_records import multisine, noise
from scipy.signal import lfilter

import lumbar
from case_tables import cases

MODEL = base_model()
DETECTION_GRID = [line for line in range(1, 50, 2) if line % 9 != 0]
"""Odd lines, of which 9, 27 and 45 are left out."""


def located(error, sigma: float = 0.05, seed: int = 1, lines=None, samples: int = 500, periods: int = 8):
    """Locate a known error and noise."""
    position = multisine(periods, samples, lines, seed)
    white = sigma * noise(len(position), seed + 1)
    return locate_last(record_of_model(MODEL, position, lambda z, v, t: error(z, v, t) + white, "multisine"))


def locate_last(*records):
    """Return the location of the model's error on the last record; noise floors are those of the first."""
    return lumbar.locate(records, MODEL, train=records[0].name)[records[-1].name].location


ERRORS = {
    "cubic": lambda z, v, t: 0.002 * z**3,
    "quadratic": lambda z, v, t: 0.01 * z**2,
    "friction": lambda z, v, t: 0.5 * np.tanh(v / 2),
    "drift": lambda z, v, t: 0.03 * t,
    "line": lambda z, v, t: 0.5 * np.sin(2 * np.pi * 0.537 * t),
    "stiffness": lambda z, v, t: 0.2 * z,
    "relaxation": lambda z, v, t: 0.5 * lfilter([0.05], [1, -0.95], z),
    "offset": lambda z, v, t: 0.5 + 0 * z,
}


def test_noise_has_no_location():
    location = located(lambda z, v, t: 0 * z)
    assert location.is_noise
    assert set(location.shares.values()) == {0.0}


@pytest.mark.parametrize(("error", "view", "share"), cases(__file__, "seen"))
def test_error_is_located_at_its_cause(error, view, share):
    location = located(ERRORS[error])
    assert not location.is_noise
    if error == "stiffness":
        assert location.shares[view] > share
    else:
        assert next(iter(location.shares)) == view
    assert location.shares[view] >= share
    assert location.p_values[view] < 1e-6


def test_damping_is_distinguished_from_linear_dynamics():
    """Linear dynamics resemble a damping that grows with speed so well that a richer model seems worth trying."""
    hidden = located(lambda z, v, t: 0.001 * v * np.abs(v))
    assert hidden.causes[0].name == "position and velocity"
    causes = {cause.name: cause for cause in hidden.causes}
    taken, outside = causes["position and velocity"], ("constant offset", "linear dynamics")
    rest = 1 - sum(item.share for item in hidden.causes if item.name in outside)
    assert taken.share_of_rest == pytest.approx(taken.share / rest) and taken.share_of_rest > 0.8


def test_constant_offset_is_its_own_cause():
    location = located(ERRORS["offset"])
    assert location.offset_share > 0.99
    assert all(share < 0.05 for share in location.shares.values())
    assert location.causes[0].name == "constant offset"


def test_friction_changes_at_reversals_by_twice_its_force():
    view = located(ERRORS["friction"]).views["reversals"]
    assert view.numbers["change"] == pytest.approx(1.0, rel=0.1)
    assert view.numbers["opposed"]
    table = view.table
    assert table["mean"][table["time"] > 0.02] == pytest.approx(0.5, rel=0.1)
    assert table["mean"][table["time"] < -0.02] == pytest.approx(-0.5, rel=0.1)
    assert not located(ERRORS["cubic"]).views["reversals"].numbers["opposed"]


def test_map_separates_even_and_odd_errors():
    """An odd grid moves equally in both directions, so every bin of the map has its mirror image."""
    cubic, quadratic = (
        located(ERRORS[name], lines=DETECTION_GRID).views["position and velocity"]
        for name in ("cubic", "quadratic")
    )
    assert cubic.numbers["odd_share"] > 0.7 and cubic.numbers["even_share"] < 0.05
    assert quadratic.numbers["even_share"] > 0.7 and quadratic.numbers["odd_share"] < 0.05


def test_detection_lines_separate_even_and_odd_errors():
    even = located(ERRORS["quadratic"], lines=DETECTION_GRID).views["frequency"]
    odd = located(ERRORS["cubic"], lines=DETECTION_GRID).views["frequency"]
    assert even.numbers["share even lines"] > 0.97 and even.numbers["share odd lines left out"] < 0.01
    assert odd.numbers["share even lines"] < 0.01 and odd.numbers["share odd lines left out"] > 0.1
    linear = located(ERRORS["relaxation"], lines=DETECTION_GRID).views["frequency"]
    assert linear.numbers["share excited lines"] > 0.95


def aperiodic(error, name: str = "noise"):
    """Return a record of slow random motion, which never repeats."""
    white = 0.05 * noise(3000, 2)
    return record_of_model(MODEL, noise(3000, 1, 0.97), lambda z, v, t: error(z, v, t) + white, name)


def test_location_without_noise_floor():
    location = locate_last(aperiodic(lambda z, v, t: 0.3 * z**2))
    assert next(iter(location.shares)) == "depth"
    assert location.views["frequency"].share == 0.0


def test_location_with_noise_floor_of_another_record():
    white = 0.05 * noise(5000, 5)
    periodic = record_of_model(MODEL, multisine(10, seed=1), lambda z, v, t: white, "multisine")
    assert locate_last(periodic, aperiodic(lambda z, v, t: 0 * z)).is_noise
    worse = locate_last(periodic, aperiodic(lambda z, v, t: 0.1 * z))
    assert worse.shares["linear dynamics"] > 0.9


def test_position_at_rest_has_no_relation_to_the_error():
    """A ramp that is held afterwards, and a record of the hold only."""
    ramp, hold = (
        record_of_model(
            MODEL,
            np.minimum((np.arange(2000) + start) / 1000, 1.0),
            lambda z, v, t, start=start: 0.01 * t + 0.02 * noise(2000, start),
            f"from_{start}",
        )
        for start in (0, 1000)
    )
    location = locate_last(ramp, hold)
    motion = location.views["position and velocity"]
    assert (motion.share, motion.p_value, len(motion.table["mean"])) == (0.0, 1.0, 0)
    assert (
        location.shares["depth"] == location.shares["reversals"] == location.views["frequency"].share == 0.0
    )


def test_constant_speed_has_one_bin():
    ramp = record_of_model(MODEL, 0.005 * np.arange(2000), lambda z, v, t: 0.01 * noise(2000, 1), "ramp")
    moving = record_of_model(MODEL, multisine(10, seed=1), lambda z, v, t: 0.01 * noise(5000, 3))
    assert np.isfinite(locate_last(moving, ramp).views["position and velocity"].p_value)


def periodic(error=0.0, seed: int = 1):
    """Return a record of ten periods with noise of 0.3 N and an error in proportion to the position."""
    position = multisine(10, seed=seed)
    added = error * position / np.std(position) + 0.3 * noise(len(position), seed + 10_000)
    return record_of_model(MODEL, position, lambda z, v, t: added, "multisine")


def white_record():
    return record_of_model(MODEL, noise(3000, 1, 0.97), lambda z, v, t: 0.3 * noise(3000, 2), "noise")


def test_values_follow_their_definitions():
    test = white_record()
    result = lumbar.compare([test], MODEL)["noise"].comparison
    measured, residual = test["output"][50:], (test["output"] - MODEL.simulate(test))[50:]
    assert result.samples == 2950
    assert result.rms.value == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert result.vaf.value == pytest.approx(100 * (1 - np.var(residual) / np.var(measured)))
    assert result.fit.value == pytest.approx(100 * (1 - np.sqrt(np.mean(residual**2)) / np.std(measured)))
    assert result.mean_residual.value == pytest.approx(np.mean(np.abs(residual)))
    for estimate in (result.rms, result.vaf, result.fit, result.mean_residual):
        assert estimate.low < estimate.value < estimate.high
    assert result.explainable_rms is None and result.is_noise is None


def test_noise_and_explainable_error_add_up():
    test = periodic(0.4)
    result = lumbar.compare([test], MODEL)["multisine"].comparison
    assert result.floor_from == "multisine"
    assert result.explainable_rms == pytest.approx(0.4, rel=0.03)
    assert result.rms.value**2 == pytest.approx(result.explainable_rms**2 + result.floor.rms**2)
    variance = np.var(test["output"][50:])
    assert result.explainable_percent == pytest.approx(100 * 0.16 / variance, rel=0.06)
    assert result.explainable_vaf == pytest.approx(100 * (1 - 0.16 / (variance - 0.09)), abs=0.03)
    assert not result.is_noise


def test_true_model_leaves_noise():
    result = lumbar.compare([periodic()], MODEL)["multisine"].comparison
    assert result.is_noise
    assert result.explainable_vaf > 99.9


def test_table_has_comparisons_of_all_records(tmp_path):
    comparisons = lumbar.compare([periodic(), white_record()], MODEL, train="multisine")
    comparisons.save(tmp_path)
    table, results = pd.read_csv(tmp_path / "compare.csv"), [item.comparison for item in comparisons.reports]
    assert list(table["record"]) == ["multisine", "noise"]
    assert list(table["noise_floor_from"]) == ["multisine", "multisine"]
    assert table["rms"].tolist() == pytest.approx([item.rms.value for item in results])
    assert table["vaf_percent"].tolist() == pytest.approx([item.vaf.value for item in results])
    lumbar.compare([white_record()], MODEL).save(tmp_path)
    assert pd.read_csv(tmp_path / "compare.csv")["noise_floor_rms"].isna().all()
