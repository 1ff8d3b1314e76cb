"""Parts of a comparison: bootstrap intervals, rejected simulations, and the nonlinear share of an error."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from periodic_records import multisine, noise, record, relaxing_force
from scipy.signal import lfilter

from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.linear.linear_dynamics import distortion_power, nonlinear_share
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.residuals.compare import (
    RESAMPLES,
    block_groups,
    compare_record,
)
from lumbar.tissue.identification.metrics import fit_ratio, mean_residual, variance_accounted_for
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure


def aperiodic(size: int, sigma: float, seed: int, pole: float = 0.0):
    position = noise(size, seed, 0.97)
    force = relaxing_force(position)
    return record(position, force + sigma * noise(size, seed + 1, pole), "noise"), force


def test_repeated_error_does_not_narrow_intervals():
    """Ten periods of the same error tell no more about another excitation than one."""
    position = multisine(10, seed=4)
    force = relaxing_force(position)
    error = np.tile(noise(500, 9, 0.95), 10)
    test = record(position, force + error + 1e-3 * noise(5000, 3))
    many = compare_record(test, force, noise_floor(test)).rms
    one = compare_record(record(position[:500], (force + error)[:500]), force[:500], start=0.0).rms
    assert many.high - many.low == pytest.approx(one.high - one.low, rel=0.35)
    unaware = compare_record(test, force).rms
    assert unaware.high - unaware.low < 0.7 * (many.high - many.low)


@pytest.mark.parametrize(("size", "period"), [(1000, None), (4950, 500), (37, None), (700, 500)])
def test_groups_contain_every_sample_and_keep_phases(size, period):
    groups = block_groups([noise(size, 1, 0.9)], period)
    assert sorted(np.concatenate(groups)) == list(range(size))
    assert len(groups) >= 8
    if period and period < size:
        for group in groups:
            phases = np.unique(group % period)
            assert np.ptp(phases) == len(phases) - 1


def test_intervals_match_resampled_records():
    test, force = aperiodic(1000, 0.3, 1)
    result = compare_record(test, force, start=0.0, seed=3)
    measured, residual = test["output"], test["output"] - force
    groups = block_groups([residual, measured - measured.mean()], None)
    draws = np.random.default_rng(3).integers(len(groups), size=(RESAMPLES, len(groups)))
    chosen = [np.concatenate([groups[group] for group in draw]) for draw in draws]
    for name, figure in (
        ("vaf", variance_accounted_for),
        ("fit", fit_ratio),
        ("mean_residual", mean_residual),
    ):
        resampled = [figure(measured[samples], force[samples]) for samples in chosen]
        interval = getattr(result, name)
        assert [interval.low, interval.high] == pytest.approx(np.quantile(resampled, [0.025, 0.975]))


def test_invalid_simulations_are_rejected():
    test, force = aperiodic(1000, 0.3, 1)
    with pytest.raises(InputError, match="simulation of shape"):
        compare_record(test, force[:-1])
    force[500] = np.nan
    with pytest.raises(InputError, match=r"nan from 5 s on: the model is unstable"):
        compare_record(test, force)
    with pytest.raises(InputError, match="leave 0 samples after the first 20 s"):
        compare_record(test, np.zeros(1000), start=20.0)
    with pytest.raises(NumericalError, match="output does not move"):
        compare_record(record(test["input"], np.zeros(1000)), np.zeros(1000))


def share(force, base: str = "KB", periods: int = 8, lines=None):
    """Share of a base's error on a multisine, whose force is a function of its position."""
    position = multisine(periods, lines=lines)
    measured = force(position) + 0.01 * noise(len(position), 3)
    test = multisine(4, seed=7)
    experiment = prepare([record(position, measured, "training"), record(test, force(test), "test")])
    return nonlinear_share(experiment, fit_base(Structure(BASES[base]), experiment.training))


def test_linear_material_leaves_linear_error():
    assert share(relaxing_force, base="LE") < 0.02
    assert share(lambda z: lfilter([0.5, -0.6, 0.3], [1.0, -1.5, 0.7], z)) < 0.02


def test_even_force_is_distortion():
    """Between odd lines the square of the motion falls on even ones only."""
    odd = np.arange(1, 51, 2)
    assert share(lambda z: relaxing_force(z) + 0.02 * z**2, lines=odd) > 0.9


def test_friction_leaves_distortion():
    assert share(lambda z: relaxing_force(z) + 0.3 * np.sign(np.gradient(z))) > 0.3


def test_nonlinear_share_is_unknown_without_enough_lines():
    assert share(lambda z: 0.7 * z) is None
    assert share(relaxing_force, base="LE", lines=[1, 4, 9, 16]) is None
    once = multisine(1, samples=4000)
    experiment = prepare([record(once, relaxing_force(once))])
    assert nonlinear_share(experiment, fit_base(Structure(BASES["LE"]), experiment.training)) is None


def test_distortion_is_estimated_without_bias():
    """Noise of power 1 added to a smooth response, at lines that the input excites and at those it does not."""
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
