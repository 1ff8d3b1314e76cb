"""The stylus with dry friction in the simulated loop, against the closed form of a mass that slides on a spring."""

import numpy as np
import pytest
from scipy.signal import argrelextrema

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.simulation import simulate

FRICTION, STIFFNESS = 0.05, 300.0


def moved(**device):
    """What the hand alone does to the stylus: it is pushed by 50 mm and let swing about there."""
    stylus = DeviceSettings(damping_N_s_m=1e-9, hand_stiffness_N_m=STIFFNESS, encoder_um=0, **device)
    return simulate(lambda time, position: 0.0, [1e-3], stylus, 15.0, push_mm=50.0)


def test_every_half_swing_is_shorter_by_twice_the_friction_over_the_stiffness():
    run = moved(friction_N=FRICTION)
    late = run.time > 0.3
    position = run.position[late]
    peaks = np.sort(np.concatenate([argrelextrema(position, kind)[0] for kind in (np.greater, np.less)]))
    sizes = np.abs(position[peaks] - 50e-3)
    lost = -np.diff(sizes)
    assert len(lost) > 2
    # Peaks are read to a millisecond and friction is late by one: a few µm of each swing.
    np.testing.assert_allclose(lost, 2 * FRICTION / STIFFNESS, atol=4e-6)


def test_it_sticks_where_the_spring_is_weaker_than_the_friction():
    position = moved(friction_N=FRICTION).position
    assert np.ptp(position[-100:]) < 1e-12
    assert abs(position[-1] - 50e-3) <= FRICTION / STIFFNESS
    assert np.ptp(moved().position[-500:]) > 5e-3


def test_more_friction_than_any_force_holds_it():
    assert np.abs(moved(friction_N=15.1).position).max() == pytest.approx(0.0, abs=1e-15)


def test_a_force_that_drifts_does_not_oscillate():
    """By 50 mN a second; a sine of the same size does."""
    stylus = DeviceSettings(encoder_um=0)
    drifting, swinging = (
        simulate(lambda time, position, shape=shape: 0.05 * shape(time), [1e-3], stylus, 15.0)
        for shape in (float, lambda time: np.sin(20.0 * time))
    )
    assert drifting.peak_to_peak == pytest.approx(0.05, rel=0.01)
    assert drifting.calm and swinging.oscillates
