"""The program of the synthetic device; its motion is held to that which identifies devices."""

import numpy as np
import pytest

from lumbar.settings.runtime import DeviceSettings
from lumbar.twin.device_recordings import TRAVEL_MM, device_recording, moved, play

DEVICE = DeviceSettings(mass_kg=0.2, damping_N_s_m=1.6, friction_N=0.3, encoder_um=30, rate_Hz=500)


def test_forces_act_late_by_the_delay_and_hold_the_spring():
    device = DeviceSettings(mass_kg=0.2, damping_N_s_m=1.6, delay_ms=5.0, encoder_um=0, rate_Hz=500)
    record = play(device, np.ones(20), spring_N_m=50.0)
    # 5 ms are two and a half ticks: at the third tick it has been pushed for half of one.
    assert record["input"][:3].tolist() == [0.0, 0.0, 0.0]
    first = moved(device, 0.0, 0.0, 1.0, 1e-3)[0]
    assert 1e-3 * record["input"][3] == pytest.approx(first, rel=1e-9)
    np.testing.assert_allclose(record["output"], 1.0 - 0.05 * record["input"], atol=1e-15)


def test_it_stays_within_its_travel_on_the_encoder_s_grid():
    record = device_recording(DEVICE)
    assert TRAVEL_MM / 4 < np.abs(record["input"]).max() < 1.2 * TRAVEL_MM
    np.testing.assert_allclose(record["input"] / 0.03, np.round(record["input"] / 0.03), atol=1e-9)
