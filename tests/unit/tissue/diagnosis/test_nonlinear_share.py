"""How much of an error is nonlinear distortion, against records whose nonlinearity is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from periodic_records import multisine, noise, record, relaxing_force
from scipy.signal import lfilter

from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.linear.frequency_response import distortion_power, nonlinear_share
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure


def share(force, base: str = "KB", periods: int = 8, lines=None):
    """Share of a base's error on a multisine, whose force is a function of its position."""
    position = multisine(periods, lines=lines)
    measured = force(position) + 0.01 * noise(len(position), 3)
    test = multisine(4, seed=7)
    experiment = prepare([record(position, measured, "training"), record(test, force(test), "test")])
    return nonlinear_share(experiment, fit_base(Structure(BASES[base]), experiment.training))


def test_what_a_spring_leaves_of_a_relaxing_material_is_linear():
    assert share(relaxing_force, base="LE") < 0.02


def test_what_a_second_order_material_leaves_is_linear():
    assert share(lambda z: lfilter([0.5, -0.6, 0.3], [1.0, -1.5, 0.7], z)) < 0.02


def test_an_even_force_is_all_distortion():
    """Between odd lines the square of the motion falls on even ones only."""
    odd = np.arange(1, 51, 2)
    assert share(lambda z: relaxing_force(z) + 0.02 * z**2, lines=odd) > 0.9


def test_friction_leaves_more_distortion_than_linear_dynamics_do():
    assert share(lambda z: relaxing_force(z) + 0.3 * np.sign(np.gradient(z))) > 0.3


def test_none_where_nothing_repeats_few_lines_are_excited_or_only_noise_is_left():
    assert share(lambda z: 0.7 * z) is None
    assert share(relaxing_force, base="LE", lines=[1, 4, 9, 16]) is None
    once = multisine(1, samples=4000)
    experiment = prepare([record(once, relaxing_force(once))])
    assert nonlinear_share(experiment, fit_base(Structure(BASES["LE"]), experiment.training)) is None


def test_distortion_is_estimated_without_bias():
    """Noise of power 1 beside a smooth response, at lines that the input excites and at those it does not."""
    random = np.random.default_rng(0)
    lines = np.arange(2001)
    excited = lines[1:1500:2]
    inputs = np.zeros(len(lines), complex)
    inputs[excited] = 50 * np.exp(2j * np.pi * random.uniform(size=len(excited)))
    smooth = 1 / (1 + 2j * lines / 1000 - (lines / 800) ** 2)
    distortion = (random.standard_normal(2001) + 1j * random.standard_normal(2001)) / np.sqrt(2)
    power = distortion_power(inputs, smooth * inputs + distortion, excited)
    assert power[excited].mean() == pytest.approx(1.0, abs=0.1)
    assert_allclose(power[2:1500:2], np.abs(distortion[2:1500:2]) ** 2)
