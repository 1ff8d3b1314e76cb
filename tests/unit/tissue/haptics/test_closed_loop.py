"""The loop of model, hold, device and hand: against python-control, its own poles, and a numerical integration."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from loop_draws import drawn_device, drawn_model
from scipy.integrate import solve_ivp

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import (
    SampledModel,
    largest_pole,
    largest_stable_gain,
    loop_response,
    propagation,
)
from lumbar.tissue.haptics.simulation import difference_equation, encoder_ripple, simulate

STYLUS = DeviceSettings()


def test_device_and_hand_move_as_integrated():
    device = DeviceSettings(hand_mass_kg=0.1, hand_damping_N_s_m=2.0)
    transition, by_force = propagation(device, 0.013)

    def motion(_, state):
        return [state[1], (3.0 - 300.0 * state[0] - 7.5 * state[1]) / 0.35]

    integrated = solve_ivp(motion, (0, 0.013), [0.002, -0.1], rtol=1e-12, atol=1e-15).y[:, -1]
    np.testing.assert_allclose(transition @ [0.002, -0.1] + 3.0 * by_force, integrated, rtol=1e-9)


@pytest.mark.parametrize("average", [1, 3])
def test_largest_gain_is_that_of_python_control(average):
    model = SampledModel(
        "KB", 1000.0 * np.convolve([4.638, -4.0663], np.ones(average) / average), np.array([1, -0.4074]), 0.01
    )
    plant = control.sample_system(control.tf([1], [0.25, 5.5, 300.0]), 0.01, "zoh")
    length = max(len(model.numerator), len(model.denominator))
    tissue = control.tf(
        *(np.pad(p, (0, length - len(p))) for p in (model.numerator, model.denominator)), 0.01
    )
    margins, *_ = control.stability_margins(plant * tissue, returnall=True)
    assert largest_stable_gain(model, STYLUS)[0] == pytest.approx(min(margins), rel=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_a_pole_reaches_the_unit_circle_at_the_largest_gain_and_none_before(seed):
    rng = np.random.default_rng([seed, 3])
    model, device = drawn_model(rng), drawn_device(rng)
    gain, frequency = largest_stable_gain(model, device)
    for share in np.linspace(0.02, 0.98, 40):
        assert abs(largest_pole(model, device, share * gain)) < 1
    pole = largest_pole(model, device, gain)
    assert abs(pole) == pytest.approx(1.0, abs=1e-7)
    assert np.angle(pole) == pytest.approx(2 * np.pi * frequency * model.sampling_time, abs=1e-3)
    assert abs(largest_pole(model, device, 1.02 * gain)) > 1


def test_poles_solve_the_loop_s_characteristic_equation():
    rng = np.random.default_rng(4)
    for _ in range(20):
        model, device = drawn_model(rng), drawn_device(rng)
        pole = largest_pole(model, device, 0.7)
        # The loop's response holds at any z: angles may be complex.
        assert 1 + 0.7 * loop_response(model, device)(-1j * np.log(pole)) == pytest.approx(0, abs=1e-6)


def test_an_unstable_model_has_no_stable_gain():
    assert largest_stable_gain(SampledModel("", np.ones(1), np.array([1, -1.1]), 0.01), STYLUS) == (0.0, 0.0)


@pytest.mark.statistical
def test_simulations_agree_with_the_analysis_and_the_stable_side_never_oscillates():
    """100 draws of model, device, hand and rate on both sides of the largest gain, encoder and force limit included."""
    rng = np.random.default_rng(5)
    wrong, stable_ones, draws = [], 0, 0
    while draws < 100:
        model, device = drawn_model(rng), drawn_device(rng)
        share = np.exp(rng.uniform(np.log(0.25), np.log(4.0)))
        model = replace(model, numerator=share * largest_stable_gain(model, device)[0] * model.numerator)
        growth = abs(np.log(abs(largest_pole(model, device))))
        if growth * 500 < np.log(1e4):
            continue  # within 500 samples it neither grows nor decays
        stable = largest_stable_gain(model, device)[0] > 1
        draws, stable_ones = draws + 1, stable_ones + stable
        run = simulate(
            difference_equation(model),
            model.sampling_time,
            device,
            15.0,
            delay=model.delay,
            ripple=encoder_ripple(model, device) if stable else 0.0,
            duration=0.5 + 2 * np.log(1e4) / growth * model.sampling_time,
        )
        if run.oscillates == stable:
            wrong.append((model, device, run.peak_to_peak, run.ripple))
    assert wrong == []
    assert 30 < stable_ones < 70
