"""The generator against 36 recordings that somebody else's generator made, given their labels."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hidden_effects_cases import recorded_motion

from lumbar.twin.hidden_effects.force_simulation import HiddenEffect, residual_rms, simulate
from lumbar.twin.hidden_effects.hidden_catalogue import form_named
from lumbar.twin.hidden_effects.hidden_tissue import Tissue

# How the labels' one "shape" number and their forms read in this generator's terms. Their delays were rounded
# down to a grid of 0.25 ms, which the phase of the recorded force shows.
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
            residual = residual_rms(motion, tissue, effects)
    ratio = np.sqrt(np.mean(np.concatenate(squares))) / label["noise_rms_N"]
    assert ratio == pytest.approx(1.0, abs=0.03)
    # Their strengths were measured in the same way, but on a shorter piece, which matters for what changes
    # with time.
    if residual is not None and label["effects"][0] not in ("drift", "softening"):
        wanted = label["residual_over_noise"][0]
        assert residual / label["noise_rms_N"] == pytest.approx(wanted, rel=0.04)
