"""Welch spectra against closed forms: a sinusoid, white noise, an autoregressive process, a ramp."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.settings.signals import WelchSettings
from lumbar.tissue.signals.spectrum import position_psd, velocity_psd

SETTINGS = WelchSettings()


def power(frequency, psd):
    return psd.sum() * frequency[1]


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
@pytest.mark.parametrize("frequency", [0.8, 2.5, 9.7])
def test_power_of_a_sinusoid_in_position_and_velocity(rate, frequency):
    amplitude = 3.0
    time = np.arange(round(80 * rate)) / rate
    sine = amplitude * np.sin(2 * np.pi * frequency * time + 0.3)
    assert power(*position_psd(sine, rate, SETTINGS)) == pytest.approx(amplitude**2 / 2, rel=0.01)
    expected = (2 * np.pi * frequency * amplitude) ** 2 / 2
    assert power(*velocity_psd(sine, rate, SETTINGS)) == pytest.approx(expected, rel=0.02)


def test_density_of_white_noise_is_twice_the_variance_over_the_rate():
    rate, deviation = 100.0, 0.7
    noise = deviation * np.random.default_rng(1).standard_normal(400_000)
    frequency, psd = position_psd(noise, rate, SETTINGS)
    inside = psd[(frequency > 0.5) & (frequency < 49)]
    assert inside.mean() == pytest.approx(2 * deviation**2 / rate, rel=0.01)
    assert inside.std() / inside.mean() < 0.08  # some 760 overlapping segments


def test_autoregressive_process_has_its_textbook_spectrum_in_position_and_velocity():
    from scipy.signal import lfilter

    rate, pole = 100.0, 0.9
    noise = lfilter([1], [1, -pole], np.random.default_rng(2).standard_normal(600_000))
    frequency, psd = position_psd(noise, rate, SETTINGS)
    band = (frequency > 0.3) & (frequency < 20)
    z = np.exp(2j * np.pi * frequency / rate)
    expected = 2 / rate / np.abs(1 - pole / z) ** 2
    assert np.mean(psd[band] / expected[band]) == pytest.approx(1, abs=0.01)
    assert np.std(psd[band] / expected[band]) < 0.08
    frequency, psd = velocity_psd(noise, rate, SETTINGS)
    ratio = psd[band] / ((2 * np.pi * frequency[band]) ** 2 * expected[band])
    assert np.mean(ratio) == pytest.approx(1, abs=0.01)
    assert np.std(ratio) < 0.08


def test_steady_advance_does_not_leak_into_the_velocity_spectrum():
    """Why the recording is differenced first: (2πf)² times the position's density would be far off."""
    rate = 100.0
    time = np.arange(6000) / rate
    slow = np.random.default_rng(3).standard_normal(6000) * 0.001 + 50 * time
    frequency, psd = velocity_psd(slow, rate, SETTINGS)
    band = (frequency > 1) & (frequency < 6)
    white = 2 * 0.001**2 / rate * (2 * np.pi * frequency[band]) ** 2
    assert np.mean(psd[band] / white) == pytest.approx(1, abs=0.2)
    _, position = position_psd(slow, rate, SETTINGS)
    assert np.mean((2 * np.pi * frequency[band]) ** 2 * position[band] / white) > 10


def test_linear_detrending_takes_a_ramp_off_the_position():
    rate = 100.0
    ramp = 5.0 * np.arange(6000) / rate
    linear = power(*position_psd(ramp, rate, WelchSettings(10.24, detrend="linear")))
    assert linear < 1e-12 < power(*position_psd(ramp, rate, SETTINGS))


def test_a_trial_shorter_than_a_segment_is_named_with_both_lengths():
    with pytest.raises(InputError, match=r"500 samples \(5 s\).*10\.24 s needs 1024"):
        position_psd(np.arange(500.0), 100.0, SETTINGS)


def test_velocity_needs_one_sample_more_than_a_segment():
    exact = np.sin(np.arange(1024) / 7)
    position_psd(exact, 100.0, SETTINGS)
    with pytest.raises(InputError, match=r"1024 samples .* needs 1025"):
        velocity_psd(exact, 100.0, SETTINGS)


def test_a_segment_of_a_few_samples_is_refused():
    with pytest.raises(InputError, match="5 samples"):
        position_psd(np.arange(500.0), 100.0, WelchSettings(0.05))
