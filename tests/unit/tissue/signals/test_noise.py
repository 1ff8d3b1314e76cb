"""Band-limited noise: distribution, spectrum and repeatability."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.signals.waveforms import band_limited_noise


def test_noise_is_gaussian_with_mean_zero_and_unit_rms():
    noise = band_limited_noise(4000.0, 5.0, 100.0, 8, 1)
    assert len(noise) == 400_000
    assert abs(noise.mean()) < 1e-12
    assert np.mean(noise**2) == pytest.approx(1)
    # Skewness and excess kurtosis of some 40,000 independent values.
    assert abs(np.mean(noise**3)) < 0.06
    assert abs(np.mean(noise**4) - 3) < 0.12


@pytest.mark.parametrize("order", [2, 4, 8])
def test_density_is_halved_at_the_end_of_the_band(order):
    from scipy.signal import csd

    noise = band_limited_noise(8000.0, 5.0, 100.0, order, 2)
    frequency, density = csd(noise, noise, 100.0, nperseg=2000)
    passed = density[(frequency > 0.2) & (frequency < 1.5)].real.mean()
    edge = density[np.abs(frequency - 5) < 0.03].real.mean()
    assert edge / passed == pytest.approx(0.5, abs=0.06)
    # Far above the corner two passes of this order fall by (corner/f)^(4·order).
    corner = 5.0 / (np.sqrt(2) - 1) ** (1 / (2 * order))
    warped = np.tan(np.pi * 10 / 100) / np.tan(np.pi * corner / 100)
    at_ten = density[np.abs(frequency - 10) < 0.03].real.mean()
    assert at_ten / passed == pytest.approx((1 / (1 + warped ** (2 * order))) ** 2, rel=0.3)


@pytest.mark.statistical
def test_ends_are_like_the_middle():
    rows = np.array([band_limited_noise(10.0, 5.0, 100.0, 8, seed) for seed in range(150)])
    power = np.mean(rows**2, axis=0)
    assert np.mean(power[:20]) == pytest.approx(1, abs=0.2)
    assert np.mean(power[-20:]) == pytest.approx(1, abs=0.2)


def test_same_seed_same_noise():
    first, again, other = (band_limited_noise(10.0, 5.0, 100.0, 8, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.5


def test_band_too_wide_for_the_rate_is_refused():
    with pytest.raises(InputError, match=r"raise signals\.rate_Hz"):
        band_limited_noise(10.0, 49.0, 100.0, 2, 1)
