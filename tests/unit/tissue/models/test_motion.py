"""Derivatives of a measured motion: no velocity at rest, an exact velocity of smooth motion."""

import numpy as np
import pytest

from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import relaxation

STEP = 0.01


def _motion(position) -> Motion:
    position = np.asarray(position, dtype=float)
    return Motion(np.arange(len(position)) * STEP, position, STEP)


@pytest.mark.parametrize("edge", [[], [0.5], [0.02, 0.45, 0.96], list(np.linspace(0.1, 0.9, 9))])
def test_tool_at_rest_has_no_velocity(edge):
    position = [*[0.0] * 40, *edge, *[1.0] * 40, *edge[::-1], *[0.0] * 40]
    motion = _motion(position)
    rests = np.ones(len(position), dtype=bool)
    for first in (40, 80 + len(edge)):
        rests[first : first + len(edge)] = False
    assert np.abs(motion.velocity[rests]).max() < 1e-9
    assert np.abs(motion.acceleration[rests]).max() < 1e-6
    # A slow branch follows a step at once.
    assert relaxation(motion, 1e3) == pytest.approx(motion.position, abs=2e-3)


def test_levels_of_a_coarse_sensor_are_no_rests():
    time = np.arange(2000) * STEP
    coarse = _motion(np.round(np.sin(2 * np.pi * 0.1 * time) / 0.01) * 0.01)
    assert np.corrcoef(coarse.velocity, np.cos(2 * np.pi * 0.1 * time))[0, 1] > 0.6


@pytest.mark.parametrize(("frequency", "tau"), [(1.0, 0.3), (5.0, 0.3), (5.0, 4.0), (8.0, 0.01)])
def test_branch_agrees_with_its_closed_form(frequency, tau):
    time, rate = np.arange(1000) * STEP, 2 * np.pi * frequency
    steady = (rate / (1j * rate + 1 / tau) * np.exp(1j * rate * time)).real
    exact = steady - steady[0] * np.exp(-time / tau)
    error = relaxation(_motion(np.sin(rate * time)), tau) - exact
    assert np.abs(error[50:-50]).max() < 2e-4 * np.abs(exact).max()
