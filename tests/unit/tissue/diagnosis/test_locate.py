"""Where a model fails: known errors are seen where they are, and noise is not seen anywhere."""

import json

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, noisy_record, record, relaxing_force
from scipy.signal import lfilter
from scipy.stats import kendalltau

from case_tables import cases
from lumbar.interface.reading import read
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.candidate_causes import cross_correlation, rank_causes
from lumbar.tissue.diagnosis.residuals.locate import locate, residual_of
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import reversals
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.residuals.time_frequency import (
    EVEN,
    EXCITED,
    ODD,
    excited_lines,
    line_classes,
    mann_kendall_p,
)

DETECTION_GRID = [line for line in range(1, 50, 2) if line % 9 != 0]
"""Odd lines, of which 9, 27 and 45 are left out."""


def located(error, sigma: float = 0.05, seed: int = 1, lines=None, samples: int = 500, periods: int = 8):
    """Locate a known error: a function of position, velocity and time."""
    position = multisine(periods, samples, lines, seed)
    time = np.arange(len(position)) * STEP
    velocity = np.gradient(position, STEP)
    force = relaxing_force(position)
    test = record(position, force + error(position, velocity, time) + sigma * noise(len(position), seed + 1))
    return locate(test, force, noise_floor(test))


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


def test_noise_is_seen_nowhere():
    location = located(lambda z, v, t: 0 * z)
    assert location.is_noise
    assert set(location.shares.values()) == {0.0}


@pytest.mark.parametrize(
    ("error", "view", "share"),
    cases(__file__, "seen"),
)
def test_an_error_is_seen_where_it_is(error, view, share):
    location = located(ERRORS[error])
    assert not location.is_noise
    if error == "stiffness":
        assert location.shares[view] > share
    else:
        assert next(iter(location.shares)) == view
    assert location.shares[view] >= share
    assert location.p_values[view] < 1e-6


def test_what_linear_dynamics_resemble_is_told_from_them():
    """Linear dynamics resemble a damping that grows with speed so well that a richer model seems worth trying."""
    hidden = located(lambda z, v, t: 0.001 * v * np.abs(v))
    assert hidden.causes[0].name == "position and velocity"
    causes = {cause.name: cause for cause in hidden.causes}
    taken, outside = causes["position and velocity"], ("constant offset", "linear dynamics")
    rest = 1 - sum(item.share for item in hidden.causes if item.name in outside)
    assert taken.share_of_rest == pytest.approx(taken.share / rest) and taken.share_of_rest > 0.8


def test_a_constant_offset_is_called_one_and_not_credited_to_a_view():
    location = located(ERRORS["offset"])
    assert location.offset == pytest.approx(0.5, abs=0.01) and location.offset_share > 0.99
    assert all(share < 0.05 for share in location.shares.values())
    assert location.causes[0].name == "constant offset"


def test_friction_jumps_at_reversals_by_twice_its_force():
    view = located(ERRORS["friction"]).views["reversals"]
    assert view.numbers["change"] == pytest.approx(1.0, rel=0.1)
    assert view.numbers["opposed"]
    table = view.table
    assert table["mean"][table["time"] > 0.02] == pytest.approx(0.5, rel=0.1)
    assert table["mean"][table["time"] < -0.02] == pytest.approx(-0.5, rel=0.1)
    assert not located(ERRORS["cubic"]).views["reversals"].numbers["opposed"]


def test_parity_of_the_map():
    """An odd grid moves alike in both directions, so every bin of the map has its mirror image."""
    cubic, quadratic = (
        located(ERRORS[name], lines=DETECTION_GRID).views["position and velocity"]
        for name in ("cubic", "quadratic")
    )
    assert cubic.numbers["odd_share"] > 0.7 and cubic.numbers["even_share"] < 0.05
    assert quadratic.numbers["even_share"] > 0.7 and quadratic.numbers["odd_share"] < 0.05


def test_detection_lines_tell_even_from_odd():
    even = located(ERRORS["quadratic"], lines=DETECTION_GRID).views["frequency"]
    odd = located(ERRORS["cubic"], lines=DETECTION_GRID).views["frequency"]
    assert even.numbers["lines_are_odd"] and even.numbers["excited_lines"] == len(DETECTION_GRID)
    assert even.numbers[f"share {EVEN}"] > 0.97 and even.numbers[f"share {ODD}"] < 0.01
    assert odd.numbers[f"share {EVEN}"] < 0.01 and odd.numbers[f"share {ODD}"] > 0.1
    linear = located(ERRORS["relaxation"], lines=DETECTION_GRID).views["frequency"]
    assert linear.numbers[f"share {EXCITED}"] > 0.95


def test_lines_are_found_and_classed():
    lines = np.array(DETECTION_GRID)
    found = excited_lines(multisine(1, 500, lines))
    assert list(found) == list(lines)
    classes = line_classes(found, 60)
    assert classes[9] == classes[27] == classes[51] == ODD
    assert classes[0] == classes[2] == classes[58] == EVEN
    assert classes[1] == EXCITED
    assert excited_lines(multisine(1, 500) + 1e-4 * noise(500, 1)).tolist() == list(range(1, 26))


def test_without_a_floor_the_views_still_work():
    position = noise(3000, 1, 0.97)
    force = relaxing_force(position)
    test = record(position, force + 0.3 * position**2 + 0.05 * noise(3000, 2), "noise")
    location = locate(test, force)
    assert next(iter(location.shares)) == "depth"
    assert location.views["frequency"].share == 0.0


@pytest.mark.parametrize("repeats", [True, False])
def test_position_at_rest_has_no_relation_to_the_error(repeats):
    """A ramp that is over before the first sample that counts, held afterwards; the error drifts."""
    position = np.minimum(np.arange(2000) / 40, 1.0)
    force = 0.7 * position + 0.02 * noise(2000, 1)
    floor = noise_floor(noisy_record(10, 0.02, 1)) if repeats else None
    location = locate(record(position, force, "hold"), 0.5 * position, floor, "multisine", start=0.5)
    motion = location.views["position and velocity"]
    assert (motion.share, motion.p_value, len(motion.table["mean"])) == (0.0, 1.0, 0)
    assert (
        location.shares["depth"] == location.shares["reversals"] == location.views["frequency"].share == 0.0
    )
    assert {cause.name for cause in location.causes} <= {"constant offset", "linear dynamics", "time"}


def test_constant_speed_has_one_bin():
    position = np.arange(2000.0)
    location = locate(record(position, 0.7 * position + 0.01 * noise(2000, 1)), 0.7 * position)
    assert np.isfinite(location.views["position and velocity"].p_value)


def test_a_floor_of_another_record_serves():
    periodic = noisy_record(10, 0.05, 1)
    position = noise(3000, 1, 0.97)
    force = relaxing_force(position)
    test = record(position, force + 0.05 * noise(3000, 2), "noise")
    assert locate(test, force, noise_floor(periodic), "multisine").is_noise
    worse = locate(test, force + 0.1 * position, noise_floor(periodic), "multisine")
    assert worse.shares["linear dynamics"] > 0.9


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


def test_mann_kendall_agrees_with_kendalls_tau():
    values = noise(40, 3) + 0.03 * np.arange(40)
    assert mann_kendall_p(values) == pytest.approx(kendalltau(np.arange(40), values).pvalue, abs=0.02)
    assert mann_kendall_p(np.arange(10.0)) < 0.001


def test_cross_correlation_is_the_sum_it_says():
    test = noisy_record(6, 0.3, 2)
    residual = locate(test, relaxing_force(test["input"]), noise_floor(test)).residual
    signal = residual.position - residual.position.mean()
    found = cross_correlation(residual, signal)
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    direct = [np.sum(residual.values * np.roll(signal, lag)) / scale for lag in found.lags]
    assert found.values == pytest.approx(direct, abs=1e-12)
    assert found.limit == pytest.approx(1.96 / np.sqrt(len(signal)), rel=0.1)


def test_reversals_of_a_noisy_triangle():
    position = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, -1, 200), np.linspace(-1, 0.5, 150)])
    turns, directions = reversals(position + 0.01 * noise(450, 1))
    assert directions.tolist() == [-1, 1]
    assert turns == pytest.approx([100, 300], abs=4)


def test_velocity_of_a_noisy_position_is_steadied():
    time = np.arange(2000) * STEP
    position = 5 * np.sin(2 * np.pi * 0.5 * time)
    expected = 5 * np.pi * np.cos(2 * np.pi * 0.5 * time)
    assert steady_velocity(position, STEP)[5:-5] == pytest.approx(expected[5:-5], abs=0.01)
    noisy = steady_velocity(position + 0.05 * noise(2000, 1), STEP)
    assert np.std(noisy - expected) < 0.15 * np.std(expected)


FIRST_VIEWS = {
    "hardening_stiffness": {"depth"},
    "quadratic_stiffness": {"depth"},
    "coulomb_friction": {"position and velocity"},
    "depth_dependent_damping": {"position and velocity"},
    "delay": {"linear dynamics"},
    "inertia": {"linear dynamics"},
    "second_relaxation": {"linear dynamics"},
    "softening": {"time"},
    "periodic_disturbance": {"time"},
    "drift": {"time"},
    "contact_loss": {"depth", "position and velocity"},
    "saturation": {"depth", "position and velocity"},
    "quadratic_damping": {"position and velocity"},
    "hysteresis": {"reversals"},
    "backlash": {"reversals"},
}
"""What the force of each effect depends on."""


@pytest.mark.statistical
def test_hidden_effects(shared):
    """On all records together what comes first is what the hidden effect depends on; on a chirp alone it often is not."""
    labels = json.loads((shared / "hidden_effects" / "labels.json").read_text())
    for case, label in labels.items():
        seen = read(shared / "hidden_effects" / case)
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
            assert first.is_noise or first.is_all_but_noise, case
        else:
            causes = rank_causes(residuals)
            views = set().union(*(FIRST_VIEWS[name] for name in label["effects"]))
            assert causes[0].name in views, (case, label["effects"], causes)
