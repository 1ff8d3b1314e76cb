"""Peaks of the commanded motion against closed forms, and the messages for a machine that cannot follow."""

import re

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.signals.motion_range import Kinematics, check_machine_limits, peak_kinematics

LIMITS = Kinematics(30, 1000, 20000)


@pytest.mark.parametrize("frequency", [0.3, 2.5, 5.0])
@pytest.mark.parametrize("phase", [0.0, 0.2, 1.1])
def test_peaks_of_a_sine_between_its_samples(frequency, phase):
    omega = 2 * np.pi * frequency
    motion = peak_kinematics(3 * np.cos(omega * np.arange(2000) / 100 + phase), 100.0)
    assert motion.displacement == pytest.approx(3, rel=1e-3)
    assert motion.velocity == pytest.approx(3 * omega, rel=1e-3)
    assert motion.acceleration == pytest.approx(3 * omega**2, rel=3e-3)


def test_peaks_of_a_constant_acceleration():
    time = np.arange(101) / 100
    motion = peak_kinematics(5 * time**2, 100.0)
    assert (motion.displacement, motion.velocity, motion.acceleration) == pytest.approx((5, 10, 10), rel=1e-6)


def test_a_signal_within_all_limits_passes():
    check_machine_limits({"chirp": Kinematics(30, 1000, 20000)}, LIMITS)


def test_every_violation_is_named_with_value_limit_and_factor():
    motions = {"chirp": Kinematics(40, 10, 10), "noise": Kinematics(1, 1500, 30000)}
    with pytest.raises(InputError) as error:
        check_machine_limits(motions, LIMITS)
    text = str(error.value)
    assert "3 problems" in text
    assert "chirp: peak displacement is 40 mm, the machine's limit is 30 mm" in text
    assert "noise: peak velocity is 1500 mm/s, the machine's limit is 1000 mm/s" in text
    assert "at most 0.750" in text and "at most 0.666" in text


@pytest.mark.parametrize("excess", [1.0001, 1.37, 7.3, 12345.6])
def test_following_the_advice_is_enough(excess):
    with pytest.raises(InputError) as error:
        check_machine_limits({"noise": Kinematics(30 * excess, 0, 0)}, LIMITS)
    factor = float(re.search(r"at most ([0-9.]+)", str(error.value))[1])
    assert 0.99 / excess <= factor <= 1 / excess
    check_machine_limits({"noise": Kinematics(30 * excess * factor, 0, 0)}, LIMITS)
