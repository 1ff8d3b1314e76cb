"""Exported models in the units of a device: the numbers of the thesis's models, effects, FMUs, slower servos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from tissue_fits import COEFFICIENTS, fitted

from lumbar.base.errors import InputError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.judgement import analyse, judge
from lumbar.tissue.haptics.passivity import lowest_rates
from lumbar.tissue.haptics.rendered_model import direction, exported_at, rendered

SETTINGS = RuntimeSettings()
STYLUS = SETTINGS.device


def analysed(name: str, rate: float, settings: RuntimeSettings = SETTINGS, late: bool = False):
    return analyse(rendered(exported_at(fitted(name), settings, rate), STYLUS, late=late), STYLUS)


@pytest.mark.parametrize(
    ("name", "damping", "gain"),
    [("MW", 13.05, 0.624), ("Maxwell", 26.63, 0.282), ("KB", 29.30, 0.303), ("HO", 108.0, 0.295)],
)
def test_at_100_Hz_no_model_is_stable_on_a_light_stylus(name, damping, gain):
    """Against 200 000 frequencies and 20 000 gains, each a product of polynomials written out."""
    found = analysed(name, 100.0)
    assert (found.damping, found.gain) == (pytest.approx(damping, rel=2e-3), pytest.approx(gain, rel=4e-3))
    numerator, denominator = COEFFICIENTS[name]
    angles = np.linspace(1e-3, np.pi, 200_000)
    z = np.exp(1j * angles)
    force = sum(1000 * b * z**-j for j, b in enumerate(numerator)) / sum(
        a * z**-i for i, a in enumerate(denominator)
    )
    averaged = force * (1 + 1 / z + 1 / z**2) / 3
    needed = 0.005 / (1 - np.cos(angles)) * ((1 - 1 / z) * averaged).real
    assert found.damping == pytest.approx(needed.max(), rel=1e-5)
    assert not found.passive
    assert not found.stable


def test_a_thousand_samples_a_second_mend_kelvin_boltzmann():
    assert analysed("KB", 1000.0).damping == pytest.approx(6.82, rel=2e-3)
    assert analysed("KB", 1000.0).gain == pytest.approx(2.59, rel=4e-3)
    assert analysed("KB", 1000.0, without_average()).damping == pytest.approx(3.26, rel=2e-3)


def without_average() -> RuntimeSettings:
    return replace(SETTINGS, moving_average_ms=0.0)


def test_a_client_that_reads_first_gets_the_feedthrough_late():
    """C x[k] + D u[k−1], not the whole force: that would be H/z, which asks for 45 N·s/m of Kelvin–Boltzmann."""
    model = exported_at(fitted("KB"), SETTINGS, 100.0)
    loop = rendered(model, STYLUS, late=True).loops[0]
    rng = np.random.default_rng(1)
    positions = np.concatenate([[0.0], rng.standard_normal(200)])
    averaged = np.convolve(positions, np.ones(3) / 3)[:201]
    expected = 1000 * model.dynamics.late_response(averaged)
    np.testing.assert_allclose(lfilter(loop.numerator, loop.denominator, positions), expected, atol=1e-9)
    assert analysed("KB", 100.0, late=True).damping == pytest.approx(25.09, rel=2e-3)
    whole = analyse(replace_loop(model, 0.01), STYLUS)
    assert whole.damping == pytest.approx(45.1, rel=2e-3)


def replace_loop(model, seconds: float):
    meets = rendered(model, STYLUS)
    return replace(meets, loops=(meets.loops[0].late(seconds),))


@pytest.mark.parametrize("unit", ["m", "cm"])
def test_units_change_nothing(unit):
    factor = {"m": 1e3, "cm": 10.0}[unit]
    model = fitted("KB", unit)
    structure = model.structure.scaled(factor)
    found = rendered(exported_at(replace(model, structure=structure), SETTINGS, 100.0), STYLUS)
    expected = rendered(exported_at(fitted("KB"), SETTINGS, 100.0), STYLUS)
    np.testing.assert_allclose(found.loops[0].numerator, expected.loops[0].numerator, rtol=1e-12)


def test_an_angle_is_no_position_of_a_stylus():
    model = fitted("KB", "rad", "angle")
    with pytest.raises(InputError, match="angle in 'rad'"):
        rendered(exported_at(model, SETTINGS, 100.0), STYLUS)
    judgements, refused = judge([model], SETTINGS)
    assert judgements == []
    assert "angle in 'rad'" in refused[0]


def test_the_inverted_model_is_rendered_with_the_sign_that_resists():
    loop = rendered(exported_at(fitted("IL"), SETTINGS, 100.0), STYLUS).loops[0]
    np.testing.assert_allclose(loop.numerator, 125.0 / 3)
    assert direction(SampledModel("", -np.ones(1), np.ones(1), 0.01)) == -1.0


@pytest.mark.parametrize("numerator", [[2.0, -1.0, 0.3], np.random.default_rng(3).standard_normal(12)])
@pytest.mark.parametrize("denominator", [[1.0], [1.0, -0.8, 0.1]])
def test_a_slower_servo_holds_its_position_for_several_samples(numerator, denominator):
    model = SampledModel("", np.array(numerator), np.array(denominator), 0.001)
    slow = model.every(4)
    ticks = np.random.default_rng(2).standard_normal(50)
    expected = lfilter(model.numerator, model.denominator, np.repeat(ticks, 4))[::4]
    np.testing.assert_allclose(lfilter(slow.numerator, slow.denominator, ticks), expected, atol=1e-9)
    assert slow.sampling_time == pytest.approx(0.004)


def test_lowest_rates_are_where_damping_and_gain_suffice():
    passive, stable = lowest_rates(fitted("KB"), SETTINGS)
    for rate, quantity, needed in ((passive, "damping", 5.5), (stable, "gain", 1.0)):
        at, below = (getattr(analysed_alone("KB", rate * share), quantity) for share in (1.0, 0.97))
        assert min(at, below) < needed < max(at, below) or at == pytest.approx(needed, rel=1e-3)
        assert (at <= needed) == (quantity == "damping")
    assert lowest_rates(fitted("IL"), SETTINGS) == (100.0, 100.0)


def analysed_alone(name: str, rate: float):
    """On a servo that is as fast as the model."""
    device = replace(STYLUS, rate_Hz=rate)
    return analyse(rendered(exported_at(fitted(name), SETTINGS, rate), device), device)


def test_the_simulated_loops_do_what_the_analysis_says():
    """30 N peak to peak at 6 to 20 Hz against the limit of ±15 N at 100 Hz; rest at 1 kHz."""
    judgements, _ = judge([fitted(name) for name in ("MW", "Maxwell", "KB", "HO")], SETTINGS)
    slow = [item for item in judgements if item.analysis.rate == 100.0]
    assert len(slow) == 4
    for item in slow:
        assert item.run.peak_to_peak == 30.0
        assert 6 < item.run.frequency < 20
    fast = {item.analysis.name: item for item in judgements if item.analysis.rate == pytest.approx(1000.0)}
    for name in ("Maxwell", "KB"):
        assert fast[name].analysis.stable
        assert not fast[name].run.oscillates
