"""Chirp against scipy's, and its instantaneous frequency against the band asked for."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.signals.waveforms import linear_chirp


@pytest.mark.parametrize(("duration", "lowest", "highest"), [(10, 0.0, 5.0), (10, 0.5, 5.0), (60, 0.1, 20.0)])
def test_chirp_is_scipys_linear_chirp(duration, lowest, highest):
    from scipy.signal import chirp

    time = np.arange(duration * 100) / 100
    expected = chirp(time, f0=lowest, t1=duration, f1=highest, method="linear", phi=-90)
    np.testing.assert_allclose(linear_chirp(duration, lowest, highest, 100.0), expected, atol=1e-9)


def test_sweep_ends_at_the_band_and_not_at_twice_the_band():
    from scipy.signal import hilbert

    rate = 1000.0
    analytic = hilbert(linear_chirp(20, 1.0, 5.0, rate))
    frequency = np.diff(np.unwrap(np.angle(analytic))) * rate / (2 * np.pi)
    time = (np.arange(len(frequency)) + 0.5) / rate
    inside = (time > 2) & (time < 18)
    np.testing.assert_allclose(frequency[inside], 1 + 4 * time[inside] / 20, atol=0.1)


def test_chirp_starts_at_zero():
    assert linear_chirp(10, 0.0, 5.0, 100.0)[0] == 0


@pytest.mark.parametrize(("lowest", "highest"), [(5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (0.0, 50.0)])
def test_frequencies_out_of_order_are_refused(lowest, highest):
    with pytest.raises(InputError, match="needed: "):
        linear_chirp(10, lowest, highest, 100.0)
