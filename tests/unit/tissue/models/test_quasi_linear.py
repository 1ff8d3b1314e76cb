"""Quasi-linear bases: an elastic response times a reduced relaxation, against convolutions and records of ramps and holds."""

import numpy as np
import pytest
from effect_entries import QUASI_LINEAR_NUMBERS, base_model
from scipy.signal import fftconvolve

import lumbar
from lumbar.base.errors import NumericalError
from lumbar.records.record import Channel, Record
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion

STEP = 0.01
TIME = STEP * np.arange(600)
RAMP = 1.5 * np.clip(TIME / 2.0, 0, 1)
"""A ramp, then a hold."""


def relaxation_of(name: str, time: np.ndarray) -> np.ndarray:
    """Return the force after a step of the elastic response, from the parameters' definition."""
    linear, (_, *nonlinear) = QUASI_LINEAR_NUMBERS[name]
    if name == "QLV-power":
        # Branches s^p e^-s over ln s, at every fourfold time of a far wider range than the base has.
        (force,), (shortest, order) = linear, nonlinear
        share = 4.0 ** -np.arange(60)
        return force * np.exp(-np.outer(time, share / shortest)) @ (share**order * np.exp(-share))
    return linear[0] + sum(
        force * np.exp(-time / tau) for force, tau in zip(linear[1:], nonlinear, strict=True)
    )


@pytest.mark.parametrize("name", QUASI_LINEAR_NUMBERS)
def test_force_is_the_convolution(name):
    linear, nonlinear = QUASI_LINEAR_NUMBERS[name]
    fine = STEP / 50
    time = fine * np.arange(50 * (len(TIME) - 1) + 1)
    for sign in (1, -1):
        response = sign * np.expm1(np.interp(time, TIME, RAMP) / nonlinear[0])
        middle = relaxation_of(name, time + fine / 2)
        expected = np.append(0.0, fftconvolve(np.diff(response), middle)[: len(time) - 1])[::50]
        motion = Motion(TIME, sign * RAMP, STEP)
        force = np.array(BASES[name].form.columns(motion, np.array(nonlinear))).T @ linear
        np.testing.assert_allclose(force, expected, atol=2e-3 * np.abs(expected).max())


def test_power_law_is_its_closed_form():
    _, (_, shortest, order) = QUASI_LINEAR_NUMBERS["QLV-power"]
    time = np.geomspace(1e-3, 1e3, 40)
    relaxed = relaxation_of("QLV-power", time) * (1 + time / shortest) ** order
    assert np.ptp(relaxed) < 0.01 * relaxed.mean()


def test_an_exponential_and_a_power_law_are_found_to_the_noise():
    """One ramp and hold at 2 Hz; the relaxation is (t + 0.02 s)^-0.2, the exponential's length 0.5 mm."""
    fine, every = np.arange(60_000) / 1000, slice(None, None, 500)
    position = 2 * np.clip(fine / 6, 0, 1)
    middle = (fine + 0.0205) ** -0.2
    force = np.append(0, fftconvolve(np.diff(np.expm1(position / 0.5)), middle)[: len(fine) - 1])
    noise = 0.03 * np.random.default_rng(8).standard_normal(120)
    channels = {
        "input": Channel(position[every], "position", "mm"),
        "output": Channel(force[every] * 10 / np.expm1(4) + noise, "force", "N"),
    }
    refined = lumbar.refine([Record("ramp", fine[every], channels)], [], base="QLV-power")
    assert refined.path[-1].train_rms < 0.035
    for name, true in (("hardening_length", 0.5), ("order", 0.2)):
        parameter = refined.model[name]
        assert parameter.low < true < parameter.high
        assert parameter.value == pytest.approx(true, rel=0.03)


def test_quasi_linear_bases_have_no_transfer_function():
    with pytest.raises(NumericalError, match="nonlinear elastic"):
        base_model("QLV").to_control()
