"""Where the power of signals lies whose spectrum is known in closed form."""

import numpy as np
import pytest

from lumbar.tissue.signals.spectrum import occupied_band, spectral_edge

SAMPLES = 4000
LOW, HIGH = (np.sin(2 * np.pi * line * np.arange(SAMPLES) / SAMPLES) for line in (40, 200))


@pytest.mark.parametrize(
    ("share", "line"), [(0.1, 39), (0.5, 40), (0.75, 41), (0.82, 199), (0.9, 200), (0.99, 201)]
)
def test_a_hann_window_spreads_a_line_over_three(share, line):
    """By 1/6, 2/3, 1/6; of the signal's power 0.8 is in the lower line and 0.2 in the higher one."""
    assert spectral_edge(2 * LOW + HIGH, share) == line / SAMPLES


def test_a_drift_is_no_fast_motion_and_the_edge_is_at_least_one_cycle():
    drift = np.linspace(-1.0, 1.0, SAMPLES)
    assert spectral_edge(drift, 0.9999) <= 6 / SAMPLES
    assert spectral_edge(np.ones(SAMPLES), 0.5) == 1 / SAMPLES


def test_the_band_of_a_motion():
    time = np.arange(SAMPLES) / 100
    position = 3.0 + np.cos(2 * np.pi * 0.5 * time) + 0.2 * np.cos(2 * np.pi * 4.0 * time)
    assert occupied_band(position, 0.01) == pytest.approx((0.5, 4.0))
    assert occupied_band(position - 0.15 * np.cos(2 * np.pi * 4.0 * time), 0.01) == pytest.approx((0.5, 0.5))
