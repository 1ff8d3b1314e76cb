"""Cleaning of recordings, the same wherever one is used; low-pass filter and derivatives against closed forms."""

import numpy as np
import pytest
from scipy.signal import sosfilt, sosfiltfilt, sosfreqz

from lumbar.base.errors import InputError
from lumbar.lifting.movement.cleaning import (
    derivative,
    dual_pass_sections,
    extension_frames,
    filter_markers,
    frames_of_cutoff,
    low_pass,
)
from lumbar.records.markers import MarkerRecording
from refusing import has_tokens, refusal


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_both_passes_attenuate_by_3_db_at_the_cut_off(rate, order):
    _, response = sosfreqz(dual_pass_sections(6.0, rate, order), worN=[0.0, 6.0], fs=rate)
    np.testing.assert_allclose(np.abs(response) ** 2, [1, np.sqrt(0.5)], rtol=1e-9)


@pytest.mark.parametrize(("frequency", "gain"), [(1.0, None), (6.0, np.sqrt(0.5)), (12.0, None)])
def test_sine_keeps_its_phase(frequency, gain):
    rate, time = 100.0, np.arange(1000) / 100
    phase = np.exp(2j * np.pi * frequency * time)
    filtered = low_pass(phase.real, rate) + 1j * low_pass(phase.imag, rate)
    ratio = (filtered / phase)[200:-200]
    # Closed form: bilinear transform of the Butterworth magnitude.
    warped = np.tan(np.pi * np.array([frequency, 6.0]) / rate)
    expected = gain or 1 / (1 + (np.sqrt(2) - 1) * (warped[0] / warped[1]) ** 4)
    np.testing.assert_allclose(ratio, expected, atol=1e-6)


def _transient(rate, order):
    """Largest deviation of the step response from 1 that is left after the extension."""
    frames = extension_frames(6.0, rate, order)
    step = sosfilt(dual_pass_sections(6.0, rate, order), np.ones(frames + 5000))
    return np.abs(step[frames:] - 1).max()


@pytest.mark.parametrize("rate", [13.0, 15.0, 20.0, 30.0, 50.0, 60.0, 100.0, 250.0, 1000.0])
@pytest.mark.parametrize("order", [1, 3, 4, 5, 6, 7, 8])
def test_extension_leaves_no_larger_transient_than_at_order_2(rate, order):
    assert _transient(rate, order) <= _transient(rate, 2)


@pytest.mark.parametrize("order", range(1, 9))
def test_a_longer_extension_changes_nothing(order):
    rate, frames = 100.0, 2000
    values = np.random.default_rng(order).normal(size=frames).cumsum()
    sections = dual_pass_sections(6.0, rate, order)
    longest = sosfiltfilt(sections, values, padtype="odd", padlen=frames - 1)
    np.testing.assert_allclose(low_pass(values, rate, 6.0, order), longest, atol=1e-6 * np.ptp(values))


def test_extension_of_order_2_is_three_periods():
    rate = 100.0
    values = np.random.default_rng(0).normal(size=(300, 3)).cumsum(axis=0)
    sections = dual_pass_sections(6.0, rate)
    expected = sosfiltfilt(sections, values, axis=0, padtype="odd", padlen=3 * 17)
    np.testing.assert_array_equal(low_pass(values, rate), expected)


def test_intervals_are_filtered_separately():
    generator = np.random.default_rng(1)
    values = np.cumsum(generator.normal(size=(200, 3)), axis=0)
    holes = values.copy()
    holes[70:75, 1] = np.nan
    filtered = low_pass(holes, 100.0)
    np.testing.assert_array_equal(filtered[:70], low_pass(values[:70], 100.0))
    np.testing.assert_array_equal(filtered[75:], low_pass(values[75:], 100.0))
    assert np.isnan(filtered[70:75]).all()


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 50.0, 80.0, np.nan])
def test_cut_off_must_fit_the_rate(cutoff):
    with pytest.raises(InputError, match=rf"filter\.cutoff_Hz .*{cutoff:g}.*\b50 Hz"):
        low_pass(np.zeros(100), 100.0, cutoff)


def test_too_short_interval_is_reported():
    values = np.zeros((100, 3))
    values[40] = values[40 + frames_of_cutoff(6.0, 100.0) + 1] = np.nan
    recording = MarkerRecording("lift", np.arange(100) / 100, 100.0, {"C7": values, "L5": np.zeros((100, 3))})
    message = refusal(filter_markers, recording)
    assert has_tokens(message, "C7: …42 to 58…17") and "L5" not in message


def test_derivatives_of_a_parabola_are_exact_to_the_ends():
    time = np.arange(30) / 50
    values = np.stack([3 * time**2 - time, 1 - time**2], axis=1)
    expected = np.stack([6 * time - 1, -2 * time], axis=1)
    np.testing.assert_allclose(derivative(values, 50.0), expected, atol=1e-10)
    np.testing.assert_allclose(derivative(values, 50.0, 2), np.tile([6, -2], (30, 1)), atol=1e-8)


def test_intervals_are_differentiated_separately():
    values = np.arange(20.0) ** 2
    values[9] = np.nan
    result = derivative(values, 1.0)
    assert np.flatnonzero(np.isnan(result)).tolist() == [9]
    np.testing.assert_allclose(result[:9], 2 * np.arange(9.0))
    values[12] = np.nan
    with pytest.raises(InputError, match="frames 11 to 12: 2 frames"):
        derivative(values, 1.0)
