"""Bandwidth rules against spectra whose bandwidth is known in closed form."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.settings.signals import WelchSettings
from lumbar.tissue.signals.spectrum import level_frequency, position_psd, power_share_frequency

FREQUENCY = np.arange(0, 50.0001, 0.01)


def test_flat_spectrum_has_its_power_share_at_that_share_of_its_width():
    psd = np.where(FREQUENCY <= 4.0, 2.0, 0.0)
    assert power_share_frequency(FREQUENCY, psd, 0.95, 50) == pytest.approx(0.95 * 4, abs=0.01)
    assert power_share_frequency(FREQUENCY, psd, 0.5, 50) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("maximum", [3.0, 10.0, 50.0])
def test_first_order_spectrum_follows_the_arc_tangent(maximum):
    corner = 0.8
    psd = 1 / (1 + (FREQUENCY / corner) ** 2)
    expected = corner * np.tan(0.95 * np.arctan(maximum / corner))
    assert power_share_frequency(FREQUENCY, psd, 0.95, maximum) == pytest.approx(expected, rel=0.005)


def test_level_of_a_gaussian_spectrum():
    width = 1.3
    psd = np.exp(-0.5 * (FREQUENCY / width) ** 2)
    expected = width * np.sqrt(2 * np.log(100))
    assert level_frequency(FREQUENCY, psd, -20, 50) == pytest.approx(expected, abs=1e-3)
    coarse = FREQUENCY[::30]
    assert level_frequency(coarse, psd[::30], -20, 40) == pytest.approx(expected, abs=0.06)


def test_level_takes_the_last_crossing():
    psd = np.exp(-0.5 * ((FREQUENCY - 1) / 0.1) ** 2) + 0.05 * np.exp(-0.5 * ((FREQUENCY - 4) / 0.1) ** 2)
    expected = 4 + 0.1 * np.sqrt(2 * np.log(5))
    assert level_frequency(FREQUENCY, psd, -20, 50) == pytest.approx(expected, abs=1e-3)
    assert level_frequency(FREQUENCY, psd, -10, 50) == pytest.approx(
        1 + 0.1 * np.sqrt(2 * np.log(10)), abs=1e-3
    )


def test_level_that_is_not_reached_has_no_answer():
    psd = np.ones_like(FREQUENCY)
    assert level_frequency(FREQUENCY, psd, -20, 6) is None


def test_level_before_a_stop_band_of_no_power_is_the_last_line_with_power():
    psd = np.where(FREQUENCY <= 4.0, 2.0, 0.0)
    assert level_frequency(FREQUENCY, psd, -20, 50) == pytest.approx(4.0, abs=0.01)


def test_power_beyond_the_analysis_band_and_at_zero_does_not_count():
    psd = np.where(FREQUENCY <= 2.0, 1.0, 0.0)
    with_tremor = psd + 5 * np.exp(-0.5 * ((FREQUENCY - 10) / 0.5) ** 2)
    with_tremor[0] = 1e6
    for rule, setting in ((power_share_frequency, 0.95), (level_frequency, -20)):
        assert rule(FREQUENCY, with_tremor, setting, 6) == pytest.approx(
            rule(FREQUENCY, psd, setting, 6), abs=1e-3
        )
        assert rule(FREQUENCY, with_tremor, setting, 50) > 9


def test_tone_through_welch_has_its_bandwidth_within_two_lines():
    time = np.arange(6000) / 100
    frequency, psd = position_psd(np.sin(2 * np.pi * 2.5 * time), 100.0, WelchSettings(10.24))
    spacing = frequency[1]
    assert power_share_frequency(frequency, psd, 0.95, 6) == pytest.approx(2.5, abs=2 * spacing)
    assert level_frequency(frequency, psd, -20, 6) == pytest.approx(2.5, abs=2 * spacing)


def test_band_limited_noise_through_welch():
    """White noise with all Fourier lines above 3 Hz removed: 95 % of its power lies below 2.85 Hz."""
    spectrum = np.fft.rfft(np.random.default_rng(5).standard_normal(100_000))
    spectrum[np.fft.rfftfreq(100_000, 0.01) > 3] = 0
    frequency, psd = position_psd(np.fft.irfft(spectrum), 100.0, WelchSettings(10.24))
    assert power_share_frequency(frequency, psd, 0.95, 6) == pytest.approx(2.85, rel=0.02)
    assert level_frequency(frequency, psd, -20, 6) == pytest.approx(3.0, abs=2 * frequency[1])


@pytest.mark.parametrize("maximum", [0.005, 51.0, -1.0, float("nan")])
def test_analysis_band_outside_the_spectrum_is_refused(maximum):
    with pytest.raises(InputError, match="maximum_Hz"):
        power_share_frequency(FREQUENCY, np.ones_like(FREQUENCY), 0.95, maximum)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_spectra_that_are_none_are_refused(bad):
    psd = np.ones_like(FREQUENCY)
    psd[7] = bad
    with pytest.raises(InputError, match="not finite"):
        level_frequency(FREQUENCY, psd, -20, 6)
    with pytest.raises(InputError, match="no power"):
        power_share_frequency(FREQUENCY, np.zeros_like(FREQUENCY), 0.95, 6)
