"""Synthetic tissue tests and surgeon trials against the matrix exponential and independent estimators."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

from hidden_effects.experiment import Plan, make_experiment
from hidden_effects.settings import HiddenEffectsSettings
from lumbar.base.errors import InputError
from lumbar.records.columns import read_record
from lumbar.settings.tissue import TissueSettings
from lumbar.settings.twin import SyntheticTissueSettings, TwinSettings
from lumbar.twin.surgeon_recordings import minimum_jerk_chain, surgeon_trial, tremor_noise
from lumbar.twin.tissue_recordings import play, tissue_force
from lumbar.twin.two_hidden_effects import chirp_motion, draw_motions, two_hidden_effects
from study_settings import study_settings

TISSUE = SyntheticTissueSettings(
    k1_N_per_mm=0.4, k2_N_per_mm=3.2, relaxation_s=0.035, cubic_N_per_mm3=0.01, noise_variance_share=0.14
)
LAYOUT = TissueSettings().layout


def write_signal(path, samples=2000):
    time = 0.01 * np.arange(samples)
    position = 3 * np.sin(2 * np.pi * 0.7 * time) + np.cos(2 * np.pi * 2.3 * time)
    pd.DataFrame({"time_s": time, "position_mm": position}).to_csv(path, index=False)
    return time, position


def test_force_solves_the_equation_of_motion_between_ramps():
    rng = np.random.default_rng(0)
    time, position = 0.01 * np.arange(40), 2 + rng.standard_normal(40)
    k1, k2, tau, cubic = 0.4, 3.2, 0.035, 0.01
    b = tau * (k1 + k2)
    # b·ẇ = k2·(x − w) − k1·w (the force in k2 is that in k1 and the dashpot), ẋ = v, v̇ = 0 on each ramp
    equation = np.array([[-(k1 + k2) / b, k2 / b, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    # The speed jumps at the samples, so that each ramp is solved separately; the matrix exponential is exact to rounding.
    over_a_step = expm(0.01 * equation)
    elongation = np.empty(40)
    elongation[0] = k2 * position[0] / (k1 + k2)
    for now in range(1, 40):
        speed = (position[now] - position[now - 1]) / 0.01
        elongation[now] = over_a_step[0] @ [elongation[now - 1], position[now - 1], speed]
    expected = k2 * (position - elongation) + cubic * position**3
    force = tissue_force(time, position, k1, k2, tau, cubic)
    tolerance = 50 * np.finfo(float).eps * np.abs(expected).max()
    np.testing.assert_allclose(force, expected, rtol=0, atol=tolerance)


def test_recording_has_declared_noise_and_depends_on_number(tmp_path):
    time, position = write_signal(tmp_path / "signal.csv")
    for name, number in (("one", 0), ("two", 0), ("three", 1)):
        play(tmp_path / "signal.csv", tmp_path / f"{name}.csv", TISSUE, seed=45, number=number)
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()
    record = read_record(tmp_path / "one.csv", LAYOUT)
    np.testing.assert_array_equal(record["input"], position)
    noise = record["output"] - tissue_force(time, position, 0.4, 3.2, 0.035, 0.01)
    assert noise.var() / record["output"].var() == pytest.approx(0.14, rel=0.1)
    other = read_record(tmp_path / "three.csv", LAYOUT)["output"] - record["output"] + noise
    assert abs(np.corrcoef(noise, other)[0, 1]) < 0.1
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.1


def test_file_without_signal_is_rejected(tmp_path):
    (tmp_path / "signal.csv").write_text("t,x\n0,1\n")
    with pytest.raises(InputError, match="header t,x; a signal has time_s,position_mm"):
        play(tmp_path / "signal.csv", tmp_path / "out.csv", TISSUE, seed=45, number=0)


TWIN = TwinSettings()


def test_records_are_those_of_pair_of_benchmark():
    ours = two_hidden_effects(TWIN.two_hidden_effects, TWIN.seed)
    wanted = HiddenEffectsSettings(
        seed=TWIN.seed,
        noise_share=(0.01, 0.01),
        noise_colours={"white": 1.0, "autoregressive": 0.0, "flicker": 0.0},
        residual_over_noise=(16.0, 16.0),
    )
    plan = Plan("pair_0001", "pair", 1, ("coulomb_friction", "hardening_stiffness"), level=0.0)
    theirs = make_experiment(plan, wanted)
    assert theirs.label["form"] == ["coulomb_friction:arctan", "hardening_stiffness:cubic"]
    assert ours.keys() == theirs.records.keys()
    for name, record in ours.items():
        assert np.array_equal(record, theirs.records[name])


@pytest.mark.parametrize("kind", ["multisine", "chirp", "noise"])
def test_velocity_and_acceleration_are_derivatives(kind):
    motion = draw_motions(np.random.default_rng(1), 5.0, -0.5, schroeder=False, periods=2)[kind]
    for values, derivative in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        central = (values[2:] - values[:-2]) / (2 * motion.step)
        assert np.allclose(central, derivative[1:-1], atol=1e-3 * np.abs(derivative).max())
    assert np.abs(motion.sampled(motion.position)).max() == pytest.approx(5.0, rel=2e-3)


def test_multisine_has_fifty_lines_and_low_crest_factor():
    motions = draw_motions(np.random.default_rng(1), 5.0, 0.0, schroeder=True, periods=3)
    position = motions["multisine"].sampled(motions["multisine"].position)
    assert len(position) == 3000
    assert np.allclose(position[:1000], position[1000:2000])
    spectrum = np.abs(np.fft.rfft(position[:1000]))
    assert np.allclose(spectrum[1:51], spectrum[1])
    assert spectrum[51:].max() < 1e-9 * spectrum[1]
    # 1.72 for 50 flat lines is the published crest factor of Schroeder's phases.
    assert np.abs(position).max() / position.std() == pytest.approx(1.72, abs=0.02)
    noise = motions["noise"].sampled(motions["noise"].position)
    assert not np.isclose(noise[0], noise[-1], atol=1e-3)

    # ∫f dt of the chirp from 0.1 to 5 Hz is 25.5 turns: 51 half turns less the one at the very end.
    chirp = chirp_motion("chirp", 10.0, 1.0)
    assert np.count_nonzero(np.diff(np.sign(chirp.position[1:]))) == 50


@pytest.fixture(scope="module")
def settings(project):
    return study_settings().twin.surgeon


def test_strokes_become_shallower(settings):
    """Over many trials without noise: depth of the strokes in the last third against the first."""
    surgeons = {"one": settings.surgeons["surgeon_1"].model_copy(update={"tremor_rms_mm": 0.0})}
    zeros = dict.fromkeys(("noise_rms_mm", "reposition_mm", "gain_mm_per_stroke"), 0.0)
    quiet = settings.model_copy(update={**zeros, "surgeons": surgeons})
    depths = [surgeon_trial(f"t{index}", "one", quiet, 1).z_mm.to_numpy() for index in range(30)]
    early = np.mean([depth[1000:2000].max() for depth in depths]) - settings.puncture_mm
    late = np.mean([depth[4900:5900].max() for depth in depths]) - settings.puncture_mm
    assert late / early == pytest.approx(0.49 / 0.85, abs=0.12)


def test_tremor_has_declared_rms_and_band():
    tremor = tremor_noise(200_000, 100.0, 9.0, 1.0, np.random.default_rng(1))
    assert np.sqrt(np.mean(tremor**2)) == pytest.approx(1, abs=0.03)
    frequency = np.fft.rfftfreq(len(tremor), 0.01)
    power = np.abs(np.fft.rfft(tremor)) ** 2
    centre = np.average(frequency, weights=power)
    assert centre == pytest.approx(9, abs=0.05)
    assert np.sqrt(np.average((frequency - centre) ** 2, weights=power)) == pytest.approx(1, abs=0.05)


def test_minimum_jerk_movement_has_closed_form():
    time = np.linspace(0, 3, 3001)
    position = minimum_jerk_chain(time, np.array([1.0]), np.array([0.5]), np.array([2.0, 12.0]))
    assert position[time <= 1].tolist() == [2.0] * 1001
    assert position[time >= 1.5] == pytest.approx(12.0)
    assert np.abs(np.gradient(position, time)).max() == pytest.approx(1.875 * 10 / 0.5, rel=1e-4)
    assert position[1250] == pytest.approx(7.0)


def test_trial_depends_only_on_name_and_seed(settings):
    fewer = settings.model_copy(update={"surgeons": {"surgeon_1": settings.surgeons["surgeon_1"]}})
    cases = (("1", settings, 45), ("1", fewer, 45), ("2", settings, 45), ("1", settings, 46))
    first, same, *others = (
        surgeon_trial(f"surgeon_1_trial_{number}", "surgeon_1", chosen, seed).to_csv()
        for number, chosen, seed in cases
    )
    assert first == same and first not in others
    short = surgeon_trial("any", "surgeon_2", settings.model_copy(update={"duration_s": 5}), 3)
    assert len(short) == 5 * settings.rate_Hz
    assert np.isfinite(short.to_numpy()).all()


def test_unknown_surgeon_is_rejected_with_known_ones(settings):
    with pytest.raises(InputError, match=r"any is by 'nobody'.*surgeon_1, surgeon_2"):
        surgeon_trial("any", "nobody", settings, 1)
