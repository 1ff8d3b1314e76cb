"""The damping that a device needs: published closed forms, a sum over aliases, and hands that use every gap."""

from __future__ import annotations

import numpy as np
import pytest
from loop_draws import drawn_model

from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.passivity import damping_at, required_damping

PERIOD = 0.01
ONE = np.ones(1)


@pytest.mark.parametrize("samples", [1, 2, 3, 5])
def test_an_averaged_spring_needs_half_a_sample_and_the_lag_of_its_average(samples):
    """K (T/2 + (n − 1) T/2): Colgate and Schenkel's K T/2, and the average's mean delay."""
    spring = SampledModel("spring", 1000.0 * np.ones(samples) / samples, ONE, PERIOD)
    assert required_damping(spring).damping == pytest.approx(1000.0 * PERIOD * samples / 2, rel=1e-5)


@pytest.mark.parametrize(("stiffness", "viscosity"), [(800.0, 2.0), (800.0, -2.0), (0.0, 3.0)])
def test_a_virtual_wall_needs_the_published_damping(stiffness, viscosity):
    """b > K T/2 + |B| for H = K + B (z − 1)/(T z): Colgate and Schenkel (1997), equation 39."""
    wall = SampledModel("wall", np.array([stiffness + viscosity / PERIOD, -viscosity / PERIOD]), ONE, PERIOD)
    expected = stiffness * PERIOD / 2 + abs(viscosity)
    if viscosity < 0:  # negative damping acts at low frequencies, where it adds to the spring's
        expected = max(stiffness * PERIOD / 2 - viscosity, expected)
    assert required_damping(wall).damping == pytest.approx(expected, rel=1e-4)


def test_the_worst_frequency_is_found_between_the_points():
    model = SampledModel(
        "KB", 1000.0 * np.convolve([4.638, -4.0663], np.ones(3) / 3), np.array([1, -0.4074]), PERIOD
    )
    fine = damping_at(model, np.linspace(1e-4, np.pi, 400_001))
    assert required_damping(model, points=200).damping == pytest.approx(fine.max(), rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_a_delay_of_a_whole_sample_is_one_more_power_of_z(seed):
    rng = np.random.default_rng([seed, 1])
    model = drawn_model(rng)
    model = SampledModel("", model.numerator, model.denominator, model.sampling_time)
    angles = np.linspace(0.05, np.pi, 50)
    almost = model.late(model.sampling_time * (1 - 1e-7))
    assert almost.delay > 0
    np.testing.assert_allclose(
        damping_at(almost, angles),
        np.maximum(damping_at(model.late(model.sampling_time), angles), 0.0),
        rtol=2e-3,
        atol=2e-3 * np.abs(damping_at(almost, angles)).max(),
    )


@pytest.mark.parametrize("seed", range(20))
def test_no_passive_hand_closes_the_gap_above_the_damping_and_one_does_below(seed):
    """Written out: discs of the admittance at 4000 aliases; a hand may choose a point of each."""
    rng = np.random.default_rng([seed, 2])
    model = drawn_model(rng)
    angle = float(rng.uniform(0.2, 3.0))
    needed = float(damping_at(model, np.array([angle]))[0])
    period = model.sampling_time
    aliases = angle / period + 2 * np.pi / period * np.arange(-2000, 2001)
    held = (
        model.response(np.array([angle]))[0]
        * (1 - np.exp(-1j * angle))
        / period
        * np.exp(-1j * aliases * model.delay)
        / aliases**2
    )

    def closest(damping: float) -> float:
        """Smallest |1 − Σ cₙ Yₙ| that points Yₙ of the discs of centre and radius 1/(2b) reach."""
        centre, radius = 1 - held.sum() / (2 * damping), np.abs(held).sum() / (2 * damping)
        return abs(centre) - radius

    if needed > 1e-6:
        assert closest(1.01 * needed) > 0
        assert closest(0.99 * needed) < 0
