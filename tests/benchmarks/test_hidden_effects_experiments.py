"""Experiments as wholes: strengths as wanted, independent of order, files in the agreed format, another's recordings."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from hidden_effects.catalogue import form_named
from hidden_effects.diagnosing import diagnose_folders, read_folder
from hidden_effects.experiment import make_experiment, plan_batch, write_experiments
from hidden_effects.form import HiddenEffect, simulate
from hidden_effects.settings import HiddenEffectsSettings
from hidden_effects_cases import recorded_motion
from lumbar.base.errors import InputError, NumericalError
from lumbar.twin.kelvin_boltzmann import Tissue, residual_rms

SHORT = HiddenEffectsSettings(periods=2, slices=1)


def ramp_invariant_kelvin_boltzmann(position: np.ndarray, parameters: np.ndarray, step: float) -> np.ndarray:
    """Kelvin–Boltzmann force for a motion in ramps: another discretisation than the generator's."""
    elastic, relaxing, log_relaxation = parameters
    relaxation = np.exp(log_relaxation)
    decay = np.exp(-step / relaxation)
    gain = relaxing * relaxation / step * (1 - decay)
    return elastic * position + lfilter([gain], [1.0, -decay], np.diff(position, prepend=position[0]))


def left_by_best_model(record: np.ndarray) -> float:
    """RMS error of the best Kelvin–Boltzmann model, fitted to a band-limited position resampled to 1 kHz."""
    position, force = record[:, 1], record[:, 2]
    fine = np.fft.irfft(np.fft.rfft(position) * 10, 10 * len(position))

    def error(parameters):
        return (ramp_invariant_kelvin_boltzmann(fine, parameters, 0.001)[::10] - force)[50:]

    found = least_squares(error, [0.5, 1.0, np.log(0.15)], x_scale=[0.1, 0.1, 0.3])
    return float(np.sqrt(np.mean(found.fun**2)))


@pytest.mark.parametrize("number", [0, 5, 13, 17, 26, 33])
def test_the_residual_is_as_wanted_by_another_fit(number):
    (plan,) = [plan for plan in plan_batch("single", 0, SHORT) if plan.number == number]
    experiment = make_experiment(plan, replace(SHORT, residual_over_noise=(7.99, 8.01)))
    noise = experiment.label["noise_rms_N"]
    assert experiment.label["residual_over_noise"] == pytest.approx([8.0], rel=0.02)
    # The noise adds its own square: √(8² + 1).
    assert left_by_best_model(experiment.records["multisine"]) / noise == pytest.approx(np.sqrt(65), rel=0.03)


def test_an_experiment_depends_on_seed_kind_and_number_alone():
    plan = plan_batch("single", 0, SHORT)[7]
    first = make_experiment(plan, SHORT)
    make_experiment(plan_batch("single", 0, SHORT)[8], SHORT)
    again = make_experiment(
        plan_batch("single", 0, replace(SHORT, experiments_per_form=9, nulls=0))[7], SHORT
    )
    assert first.label == again.label
    for name, values in first.records.items():
        assert np.array_equal(values, again.records[name])
    other = make_experiment(plan, replace(SHORT, seed=1))
    assert not np.allclose(first.records["multisine"], other.records["multisine"])


def test_files_have_the_agreed_format_and_read_back(tmp_path):
    plans = plan_batch("single", 0, HiddenEffectsSettings(slices=1))[9:10]
    write_experiments(tmp_path / "made", tmp_path / "labels.json", plans, HiddenEffectsSettings())
    folder = tmp_path / "made" / "single_0009"
    assert sorted(file.name for file in folder.iterdir()) == ["chirp.csv", "multisine.csv", "noise.csv"]
    lines = (folder / "multisine.csv").read_text().splitlines()
    assert lines[0] == "time_s,position_mm,force_N"
    assert len(lines) == 10001
    assert len((folder / "chirp.csv").read_text().splitlines()) == 1001
    assert lines[-1].startswith("99.99,")
    label = json.loads((tmp_path / "labels.json").read_text())["single_0009"]
    records = {record.name: record for record in read_folder(folder)}
    # Branches are relaxed at the first position, and clock and path begin anew in every file.
    for record in records.values():
        begin = label["ke"] * record["input"][0]
        assert record.time[0] == 0.0
        assert record["output"][0] == pytest.approx(begin, abs=5 * label["noise_rms_N"])


def test_blind_reading_sees_recordings_only(tmp_path):
    plans = plan_batch("null", 0, HiddenEffectsSettings(nulls=2))
    write_experiments(tmp_path / "made", tmp_path / "labels.json", plans, HiddenEffectsSettings())
    (tmp_path / "made" / "null_0000" / "labels.json").write_text("{}")
    seen = []

    def diagnose(records):
        seen.append([record.name for record in records])
        if len(seen) == 2:
            raise NumericalError("did not converge")
        return {"verdict": "adequate"}

    found = diagnose_folders(tmp_path / "made", diagnose)
    assert seen == [["chirp", "multisine", "noise"]] * 2
    assert found == {"null_0000": {"verdict": "adequate"}, "null_0001": {"error": "did not converge"}}


def test_empty_folders_are_named(tmp_path):
    with pytest.raises(InputError, match="holds no folder of an experiment"):
        diagnose_folders(tmp_path, lambda records: {})
    with pytest.raises(InputError, match="holds no CSV file"):
        read_folder(tmp_path)


def test_contradictory_settings_are_refused():
    colours = dict.fromkeys(("white", "autoregressive", "flicker"), 0)
    with pytest.raises(InputError, match="2 problems") as caught:
        HiddenEffectsSettings(relaxation_s=(0.3, 0.1), noise_colours=colours)
    assert "relaxation_s: [0.3, 0.1]" in str(caught.value)
    assert "noise_colours: all weights are 0" in str(caught.value)


# 36 recordings that somebody else's generator made: how the labels' one "shape" number and their forms read in this
# generator's terms. Their delays were rounded down to a grid of 0.25 ms, which the phase of the recorded force shows.
FORMS = {
    "hardening_stiffness": ("cubic", lambda shape: {}),
    "quadratic_stiffness": ("quadratic", lambda shape: {}),
    "coulomb_friction": ("tanh", lambda shape: {"speed_mm_s": shape}),
    "hysteresis": ("dahl", lambda shape: {"yield_mm": shape, "exponent": 1.0}),
    "contact_loss": ("sharp", lambda shape: {}),
    "depth_dependent_damping": ("bilinear", lambda shape: {"offset_mm": shape}),
    "quadratic_damping": ("quadratic", lambda shape: {}),
    "inertia": ("mass", lambda shape: {}),
    "second_relaxation": ("slow", lambda shape: {"relaxation_s": shape}),
    "delay": ("transport", lambda shape: {}),
    "saturation": ("clip", lambda shape: {}),
    "drift": ("settling", lambda shape: {"settling_s": shape}),
    "softening": ("path_exponential", lambda shape: {"path_mm": shape}),
    "periodic_disturbance": (
        "sine",
        lambda shape: {"frequency_Hz": shape, "phase_rad": 0.7, "overtones": []},
    ),
    "backlash": ("sharp", lambda shape: {}),
}
DELAY_GRID_S = 0.00025


def labelled_effects(label: dict) -> list[HiddenEffect]:
    effects = []
    for mechanism, strength, shape in zip(label["effects"], label["strengths"], label["shape"], strict=True):
        name, read = FORMS[mechanism]
        if mechanism == "delay":
            strength = np.floor(strength / DELAY_GRID_S) * DELAY_GRID_S
        effects.append(HiddenEffect(form_named(f"{mechanism}:{name}"), strength, read(shape)))
    return effects


@pytest.mark.parametrize("number", range(36))
def test_labelled_parameters_reproduce_the_recordings_to_the_noise(shared, number):
    folder = shared / "hidden_effects"
    label = json.loads((folder / "labels.json").read_text())[f"case_{number:02d}"]
    tissue = Tissue(label["ke"], label["k2"], label["tau_s"])
    squares, residual = [], None
    for name in ("multisine", "chirp", "noise"):
        time, position, force = np.loadtxt(
            folder / f"case_{number:02d}" / f"{name}.csv", delimiter=",", skiprows=1
        ).T
        motion = recorded_motion(name, time, position)
        effects = labelled_effects(label)
        squares.append((force - motion.sampled(simulate(motion, tissue, effects)))[50:] ** 2)
        if name == "multisine" and len(effects) == 1:
            residual = residual_rms(motion, simulate(motion, tissue, effects))
    ratio = np.sqrt(np.mean(np.concatenate(squares))) / label["noise_rms_N"]
    assert ratio == pytest.approx(1.0, abs=0.03)
    # Their strengths were measured in the same way, but on a shorter piece, which matters for what changes
    # with time.
    if residual is not None and label["effects"][0] not in ("drift", "softening"):
        wanted = label["residual_over_noise"][0]
        assert residual / label["noise_rms_N"] == pytest.approx(wanted, rel=0.04)
