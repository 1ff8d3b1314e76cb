"""Rigid parts are found from how markers move, not from how they rest."""

from __future__ import annotations

import numpy as np
import pytest

from lumbar.lifting.quality.lengths import off_its_part

RATE = 100.0
TIME = np.arange(0, 30, 1 / RATE)


def ramp(start, stop):
    share = np.clip((TIME - start) / (stop - start), 0, 1)
    return (share**2 * (3 - 2 * share))[:, None]


def part(names, origin, movement):
    places = np.array([[0, 0, 0], [0.15, 0, 0.02], [0.05, 0.08, 0], [0.1, -0.06, 0.05]])
    return {name: origin + place + movement for name, place in zip(names, places, strict=True)}


@pytest.fixture
def two_feet():
    """A person stands for half a minute and steps once: the heel first, then the other foot's whole."""
    step = [0, 0.3, 0] * ramp(14.0, 14.5)
    left = part(("L_HEEL", "L_TOE", "L_ANKLE", "L_FOOT"), np.zeros(3), step)
    left["L_HEEL"] = left["L_HEEL"] + [0, 0, 0.12] * (ramp(13.8, 14.0) - ramp(14.5, 14.7))
    right = part(("R_HEEL", "R_TOE", "R_ANKLE", "R_FOOT"), np.array([0.3, 0, 0]), 0 * step)
    noise = np.random.default_rng(1)
    return {name: places + noise.normal(0, 2e-4, places.shape) for name, places in (left | right).items()}


def test_two_feet_on_the_ground_are_not_one_body(two_feet):
    assert off_its_part(two_feet, RATE) == []


def test_a_marker_off_a_box_that_is_carried_is_found(two_feet):
    names = ("BOX_1", "BOX_2", "BOX_3", "BOX_4")
    box = part(names, np.array([0, 0.5, 0.3]), [0, 0.2, 0.7] * ramp(10.0, 13.0))
    box["BOX_3"][1150:1162] += [0.05, 0, 0]
    [(label, stretch, seen)] = off_its_part(two_feet | box, RATE)
    assert (label, stretch) == ("BOX_3", slice(1150, 1162))
    assert "BOX_1" in seen
