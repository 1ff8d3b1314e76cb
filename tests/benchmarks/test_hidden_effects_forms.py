"""Every building block of the generator against a closed form or an ODE solver."""

import ast
import sys
from math import gamma

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hidden_effects import channel, outside
from hidden_effects.catalogue import MECHANISMS, OUTSIDE_FORMS, PAIRS, SINGLE, form_named
from hidden_effects.form import HiddenEffect, Scales, simulate
from hidden_effects.noise import COLOURS, draw_noise
from hidden_effects.rate_independent import bouc_wen, dahl, play, rounded_play, stop
from lumbar.base.errors import InputError
from lumbar.twin.kelvin_boltzmann import Tissue
from lumbar.twin.tool_motion import ToolMotion, draw_motions

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


def test_imports_nothing_that_later_looks_for_the_effect(project):
    folder = project / "benchmarks" / "hidden_effects"
    own = ("hidden_effects", "lumbar.twin", "lumbar.base.files", "lumbar.base.errors")
    looking = {"diagnosing", "scores", "power_curve", "figures", "run"}
    generator = [file for file in folder.glob("*.py") if file.stem not in looking]
    assert len(generator) == 11
    for file in generator:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                root = name.split(".")[0]
                allowed = (
                    root in ("numpy", "scipy") or root in sys.stdlib_module_names or name.startswith(own)
                )
                assert allowed, f"{file.name} imports {name}"


def test_catalogue_covers_the_fifteen_mechanisms_with_distinct_forms():
    assert len(MECHANISMS) == 15
    labels = [form.label for form in (*SINGLE, *OUTSIDE_FORMS)]
    assert len(set(labels)) == len(labels)
    assert {mechanism for pair in PAIRS for mechanism in pair} <= set(MECHANISMS)
    with pytest.raises(InputError, match="there are: hardening_stiffness:cubic"):
        form_named("hardening_stiffness:quartic")


def brute_force_play(position, half_gap):
    follower, result = position[0], []
    for value in position:
        follower = min(max(follower, value - half_gap), value + half_gap)
        result.append(follower)
    return np.array(result)


@pytest.mark.parametrize("half_gap", [0.2, 1.0, 20.0])
def test_play_and_stop_equal_their_sample_by_sample_definition(half_gap):
    position = np.cumsum(np.random.default_rng(5).standard_normal(3000)) * 0.1
    expected = brute_force_play(position, half_gap)
    assert np.allclose(play(position, half_gap), expected)
    assert np.allclose(stop(position, half_gap), position - expected)


@pytest.mark.parametrize("exponent", [1.0, 1.6])
def test_dahl_solves_its_differential_equation(exponent):
    motion = smooth_motion()

    def slope(s, z, v):
        return v * np.maximum(1 - np.sign(v) * s, 0.0) ** exponent / 0.8

    assert np.allclose(dahl(motion.position, 0.8, exponent), integrate(motion, slope), atol=3e-3)


@pytest.mark.parametrize(("sharpness", "loading"), [(1.0, 0.5), (1.5, 0.8), (3.0, 0.4)])
def test_bouc_wen_solves_its_differential_equation(sharpness, loading):
    motion = smooth_motion()

    def slope(s, z, v):
        return v * (1 - np.abs(s) ** sharpness * (loading * np.sign(v * s) + 1 - loading)) / 0.8

    found = bouc_wen(motion.position, 0.8, sharpness, loading)
    assert np.allclose(found, integrate(motion, slope), atol=3e-3)


def test_rounded_play_solves_its_differential_equation_and_tends_to_play():
    motion = smooth_motion()

    def slope(follower, z, v):
        return v / (1 + np.exp(-(np.sign(v) * (z - follower) - 0.6) / 0.05))

    expected = integrate(motion, slope, start=motion.position[0])
    assert np.allclose(rounded_play(motion.position, 0.6, 0.05), expected, atol=3e-3)
    sharp = play(motion.position, 0.6)
    assert np.abs(rounded_play(motion.position, 0.6, 1e-4) - sharp).max() < 2e-3


def test_spring_pot_gives_the_fractional_derivative_of_a_ramp():
    step = 0.0005
    time = step * np.arange(4001)
    ramp = ToolMotion("chirp", step, time, np.ones_like(time), np.zeros_like(time))
    found = outside.spring_pot(ramp, TISSUE, 2.0, 0.4)
    assert np.allclose(found[200:], 2.0 * time[200:] ** 0.6 / gamma(1.6), rtol=2e-3)


def test_all_pass_delays_a_sine_by_its_phase_and_keeps_its_size():
    motion = smooth_motion(duration=20.0)
    omega = 2 * np.pi * 3.0
    found = channel.all_pass(motion, np.sin(omega * motion.time), 0.012)
    expected = np.sin(omega * motion.time - 2 * np.arctan(omega * 0.012 / 2))
    assert np.allclose(found[2000:], expected[2000:], atol=1e-3)


def test_transport_delay_is_exact_between_samples():
    motion = smooth_motion()
    found = channel.transport(motion, np.sin(20 * motion.time), 0.01234)
    assert np.allclose(found[100:], np.sin(20 * (motion.time[100:] - 0.01234)), atol=1e-7)
    assert np.allclose(found[:20], 0.0)


@pytest.mark.parametrize("form", [*SINGLE, *OUTSIDE_FORMS], ids=lambda form: form.label)
def test_every_form_is_weak_at_its_weakest_and_deterministic(form):
    motion = draw_motions(np.random.default_rng(2), 5.0, 0.0, schroeder=True, periods=2)["multisine"]
    scales = Scales.of(motion, TISSUE)
    shape = form.draw(np.random.default_rng(7), scales)
    assert shape == form.draw(np.random.default_rng(7), scales)
    weak = simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 0.0), shape)])
    strong = [
        simulate(motion, TISSUE, [HiddenEffect(form, form.strength(scales, shape, 1.0), shape)]) for _ in "ab"
    ]
    base = TISSUE.force(motion)
    assert np.array_equal(*strong)
    assert np.std(weak - base) < 0.01 * base.std() < np.std(strong[0] - base)


@pytest.mark.statistical
@pytest.mark.parametrize("colour", COLOURS)
def test_noise_has_its_rms_and_its_spectrum(colour):
    rng = np.random.default_rng(11)
    draws = np.array([draw_noise(rng, 1000, 0.3, colour, 0.6, 100) for _ in range(400)])
    assert np.sqrt(np.mean(draws**2)) == pytest.approx(0.3, rel=0.02)
    assert np.mean(draws[:, 0] ** 2) == pytest.approx(np.mean(draws[:, 500] ** 2), rel=0.3)
    power = np.mean(np.abs(np.fft.rfft(draws)) ** 2, axis=0)
    slope = np.polyfit(np.log(np.arange(2, 200)), np.log(power[2:200]), 1)[0]
    if colour == "flicker":
        assert slope == pytest.approx(-1.0, abs=0.05)
    elif colour == "white":
        assert slope == pytest.approx(0.0, abs=0.05)
    else:
        neighbours = np.mean(draws[:, 1:] * draws[:, :-1]) / np.mean(draws**2)
        assert neighbours == pytest.approx(0.6, abs=0.02)
