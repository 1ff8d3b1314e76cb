"""The benchmark's hidden effects: every form against a closed form or a solver, experiments as wholes, scores by hand counts."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hidden_effects.catalogue import OUTSIDE_FORMS, SINGLE, form_named
from hidden_effects.diagnosing import diagnose_folders
from hidden_effects.experiment import make_experiment, plan_batch, write_experiments
from hidden_effects.form import HiddenEffect, Scales, simulate
from hidden_effects.rate_independent import bouc_wen, dahl, smooth_play
from hidden_effects.scores import outcome
from hidden_effects.settings import HiddenEffectsSettings
from hidden_effects_cases import diagnosis, recorded_motion
from lumbar.base.errors import NumericalError
from lumbar.twin.two_hidden_effects import Tissue, ToolMotion, draw_motions, residual_rms

TISSUE = Tissue(0.5, 1.0, 0.15)


def smooth_motion(duration: float = 4.0, step: float = 0.0005) -> ToolMotion:
    """Two sines whose reversals are of many sizes."""
    time = step * np.arange(round(duration / step) + 1)
    waves = ((3.0, 2 * np.pi * 0.7, 0.3), (1.5, 2 * np.pi * 2.3, 1.1))
    position = sum(a * np.sin(w * time + p) for a, w, p in waves)
    velocity = sum(a * w * np.cos(w * time + p) for a, w, p in waves)
    acceleration = sum(-a * w**2 * np.sin(w * time + p) for a, w, p in waves)
    return ToolMotion("multisine", step, position, velocity, acceleration)


def integrate(motion: ToolMotion, slope, start: float = 0.0) -> np.ndarray:
    """Solution of ds/dt = slope(s, z, v), by an adaptive solver kept from stepping over reversals."""
    time = motion.time
    found = solve_ivp(
        lambda t, s: slope(s, np.interp(t, time, motion.position), np.interp(t, time, motion.velocity)),
        (0.0, time[-1]),
        [start],
        t_eval=time,
        max_step=0.002,
        rtol=1e-7,
        atol=1e-9,
    )
    return found.y[0]


@pytest.mark.parametrize(
    ("operator", "given", "slope"),
    [
        (dahl, (0.8, 1.6), lambda s, z, v: v * np.maximum(1 - np.sign(v) * s, 0.0) ** 1.6 / 0.8),
        (
            bouc_wen,
            (0.8, 1.5, 0.8),
            lambda s, z, v: v * (1 - np.abs(s) ** 1.5 * (0.8 * np.sign(v * s) + 0.2)) / 0.8,
        ),
        (smooth_play, (0.6, 0.05), lambda s, z, v: v / (1 + np.exp(-(np.sign(v) * (z - s) - 0.6) / 0.05))),
    ],
)
def test_operators_solve_their_differential_equations(operator, given, slope):
    motion = smooth_motion()
    expected = integrate(motion, slope, start=motion.position[0] if operator is smooth_play else 0.0)
    assert np.allclose(operator(motion.position, *given), expected, atol=3e-3)


@pytest.mark.parametrize("form", [*SINGLE, *OUTSIDE_FORMS], ids=lambda form: form.label)
def test_every_form_is_weak_at_its_weakest_and_deterministic(form):
    motion = draw_motions(np.random.default_rng(2), 5.0, 0.0, schroeder=True, periods=2)["multisine"]
    scales = Scales.measure(motion, TISSUE)
    shape = form.draw(np.random.default_rng(7), scales)
    assert shape == form.draw(np.random.default_rng(7), scales)
    weak = simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 0.0), shape)])
    strong = [
        simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 1.0), shape)]) for _ in "ab"
    ]
    base = TISSUE.force(motion)
    assert np.array_equal(*strong)
    assert np.std(weak - base) < 0.01 * base.std() < np.std(strong[0] - base)


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


FRICTION, HARDENING = "coulomb_friction", "hardening_stiffness"


@pytest.mark.parametrize(
    ("kind", "hidden", "said", "expected"),
    [
        ("single", [FRICTION], diagnosis("named", [FRICTION]), "named"),
        ("single", [FRICTION], diagnosis("named", [FRICTION, HARDENING]), "extra"),
        ("single", [FRICTION], diagnosis("named", [HARDENING]), "wrong"),
        ("single", [FRICTION], diagnosis("tied", ["hysteresis"], [FRICTION]), "tied"),
        ("single", [FRICTION], diagnosis("unexplained", [FRICTION]), "unexplained"),
        ("single", [FRICTION], diagnosis("adequate"), "missed"),
        ("single", [FRICTION], {"error": "did not converge"}, "failed"),
        ("pair", [FRICTION, HARDENING], diagnosis("named", [HARDENING, FRICTION]), "named"),
        ("pair", [FRICTION, HARDENING], diagnosis("named", [HARDENING]), "partly"),
        ("pair", [FRICTION, HARDENING], diagnosis("tied", [HARDENING, "hysteresis"], [FRICTION]), "tied"),
        ("outside", ["outside"], diagnosis("unexplained"), "unexplained"),
        ("outside", ["outside"], diagnosis("named", ["drift"]), "wrong"),
        ("outside", ["outside"], diagnosis("named", ["drift"], after="unexplained"), "incomplete"),
        ("null", [], diagnosis("adequate"), "adequate"),
        ("null", [], diagnosis("named", [FRICTION]), "accused"),
    ],
)
def test_outcome(kind, hidden, said, expected):
    assert outcome(kind, hidden, said) == expected
