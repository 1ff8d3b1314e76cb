"""Experiments as wholes: independent of order, read blind, and another's recordings."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hidden_effects.catalogue import form_named
from hidden_effects.diagnosing import diagnose_folders
from hidden_effects.experiment import make_experiment, plan_batch, write_experiments
from hidden_effects.form import HiddenEffect, simulate
from hidden_effects.settings import HiddenEffectsSettings
from hidden_effects_cases import recorded_motion
from lumbar.base.errors import NumericalError
from lumbar.twin.kelvin_boltzmann import Tissue, residual_rms

SHORT = HiddenEffectsSettings(periods=2, slices=1)


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
