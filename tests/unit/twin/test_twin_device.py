"""The synthetic device: its motion against closed forms of coasting and against an integration, its program's bookkeeping."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lumbar.settings.runtime import DeviceSettings
from lumbar.twin.device_recordings import TRAVEL_MM, device_recording, moved, play, write_example

DEVICE = DeviceSettings(mass_kg=0.2, damping_N_s_m=1.6, friction_N=0.3, encoder_um=30, rate_Hz=500)


def test_a_coasting_stylus_stops_where_and_when_dry_and_viscous_friction_stop_it():
    speed = 0.4
    time = 0.2 / 1.6 * math.log(1 + 1.6 * speed / 0.3)
    way = 0.2 * speed / 1.6 - 0.3 / 1.6 * time
    assert moved(DEVICE, 0.0, speed, 0.0, 10.0) == pytest.approx((way, 0.0), rel=1e-12)
    assert moved(DEVICE, 0.0, -speed, 0.0, 10.0) == pytest.approx((-way, 0.0), rel=1e-12)
    assert moved(DEVICE, 0.0, speed, 0.0, 0.99 * time)[1] > 0


def test_it_sticks_under_less_than_the_friction_and_turns_under_more():
    assert moved(DEVICE, 0.01, 0.0, -0.3, 1.0) == (0.01, 0.0)

    def motion(_, state):
        return [state[1], (-0.9 - 1.6 * state[1] - 0.3 * np.sign(state[1])) / 0.2]

    stop = solve_ivp(motion, (0, 1), [0.0, 0.1], events=_stops, rtol=1e-12, atol=1e-14)
    at, place = stop.t_events[0][0], stop.y_events[0][0][0]
    back = solve_ivp(motion, (at, 0.2), [place, -1e-15], rtol=1e-12, atol=1e-14).y[:, -1]
    assert moved(DEVICE, 0.0, 0.1, -0.9, 0.2) == pytest.approx(tuple(back), rel=1e-8)


def _stops(_, state):
    return state[1]


_stops.terminal = True


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


@pytest.mark.nightly
def test_the_example_is_the_same_every_time(tmp_path):
    for name in ("one.csv", "other.csv"):
        write_example(tmp_path / name)
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()
