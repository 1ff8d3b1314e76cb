"""Angles made smooth before they are differentiated, against exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.measured_motion import for_base, with_smooth_angle
from lumbar.tissue.models.motion import Motion

STEP = 0.01
TIME = np.arange(3000) * STEP
LINES = np.array([0.13, 0.4, 0.75, 1.1, 1.5])
SIZES = np.array([0.3, 0.2, 0.15, 0.08, 0.05])


def record(noise=0.0, decimals=None):
    angle = np.sin(2 * np.pi * np.outer(TIME, LINES)) @ SIZES
    angle = angle + noise * np.random.default_rng(1).standard_normal(len(TIME))
    angle = angle if decimals is None else np.round(angle, decimals)
    channels = {"input": Channel(angle, "angle", "rad"), "output": Channel(angle, "moment", "N m")}
    return Record("swing", TIME, channels)


def acceleration_error(item):
    exact = -np.sin(2 * np.pi * np.outer(TIME, LINES)) @ (SIZES * (2 * np.pi * LINES) ** 2)
    return np.sqrt(np.mean((Motion.of(item).acceleration - exact)[50:] ** 2))


def test_an_exact_angle_is_left_as_it_is():
    assert with_smooth_angle(record()) is not None
    assert np.array_equal(with_smooth_angle(record())["input"], record()["input"])


@pytest.mark.parametrize(
    ("made", "allowed"),
    [
        ({"decimals": 6}, 2e-3),
        ({"decimals": 5}, 6e-3),
        ({"decimals": 4}, 0.03),
        ({"decimals": 3}, 0.15),
        ({"noise": 1e-4}, 0.06),
        ({"noise": 1e-3}, 0.3),
    ],
)
def test_noise_and_rounding_do_not_reach_the_acceleration(made, allowed):
    measured = record(**made)
    assert acceleration_error(with_smooth_angle(measured)) < allowed
    assert acceleration_error(with_smooth_angle(measured)) < 0.2 * acceleration_error(measured)


def test_smoothing_twice_is_smoothing_once():
    once = with_smooth_angle(record(noise=1e-3))
    again = with_smooth_angle(once)
    assert acceleration_error(again) == pytest.approx(acceleration_error(once), rel=0.05)


def test_degrees_taken_for_radians_are_told():
    in_degrees = record()
    values = np.degrees(in_degrees["input"])
    channels = {**in_degrees.channels, "input": Channel(values, "angle", "rad")}
    with pytest.raises(
        InputError, match=r"more than a full turn; if it is in degrees, give its column scale"
    ):
        for_base(Record("swing", TIME, channels), BASES["pendulum"])


def test_only_a_pendulum_has_its_input_made_smooth():
    rough = record(noise=1e-3)
    assert for_base(rough, BASES["KB"]) is rough
    made = for_base(rough, BASES["pendulum"])
    assert made["input"] is not rough["input"]
    assert made["output"] is rough["output"]
