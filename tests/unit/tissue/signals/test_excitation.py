"""The designed set of signals: band, scaling, ramps, limits, files and properties."""

import io

import numpy as np
import pandas as pd
import pytest

from lumbar.base.errors import InputError
from lumbar.settings.signals import SignalsSettings
from lumbar.tissue.signals.excitation import (
    design_excitation,
    excited_band,
    machine_file,
    multisine_description,
    signal_properties,
)
from lumbar.tissue.signals.motion_range import peak_kinematics
from study_settings import changed


@pytest.fixture
def settings():
    return SignalsSettings()


def bandwidths(value):
    entry = {"value_Hz": value, "low_Hz": None, "high_Hz": None}
    return {"position": {"level": entry}, "velocity": {"power_share": entry, "level": entry}}


def by_name(excitation):
    return {signal.name: signal for signal in excitation.signals}


@pytest.mark.parametrize(
    ("bandwidth", "band"), [(2.5, 5.0), (2.38, 5.0), (2.62, 5.0), (2.3, 4.5), (0.7, 1.5)]
)
def test_band_is_the_factor_times_the_bandwidth_rounded(settings, bandwidth, band):
    assert excited_band(bandwidths(bandwidth), settings) == pytest.approx(band)


@pytest.mark.parametrize(
    ("bandwidth", "words"), [(None, "no bandwidth"), (0.01, "is 0 Hz"), (30.0, "is 60 Hz")]
)
def test_band_that_cannot_be_excited_is_refused(settings, bandwidth, words):
    with pytest.raises(InputError, match=words):
        excited_band(bandwidths(bandwidth), settings)


def test_default_signals_are_those_of_the_thesis(settings):
    signals = by_name(design_excitation(5.0, settings, 1))
    assert {name: len(signal.position) for name, signal in signals.items()} == {
        "multisine": 10_000,
        "noise": 1000,
        "chirp": 1000,
    }
    time, k = np.arange(10_000) / 100, np.arange(1, 51)
    phases = -np.pi * k * (k - 1) / 50
    sum_of_cosines = (2.0 / 5.0) * np.cos(2 * np.pi * np.outer(time, k / 10) + phases).sum(axis=1)
    np.testing.assert_allclose(signals["multisine"].position, sum_of_cosines, atol=1e-9)
    np.testing.assert_allclose(signals["multisine"].time, time)


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_amplitude_is_the_rms_or_the_peak_asked_for(settings, value):
    settings = changed(settings, amplitude={"measure": "rms", "value_mm": value})
    for signal in design_excitation(5.0, settings, 1).signals:
        assert np.sqrt(np.mean(signal.steady**2)) == pytest.approx(value)
    settings = changed(settings, amplitude={"measure": "peak"})
    for signal in design_excitation(5.0, settings, 1).signals:
        assert 0.98 * value < np.abs(signal.position).max() <= value * (1 + 1e-9)
        assert peak_kinematics(signal.position, signal.rate).displacement == pytest.approx(value, rel=1e-3)


def test_power_lies_in_the_band(settings):
    signals = by_name(design_excitation(5.0, settings, 1))
    assert signals["multisine"].band_power_share(5.0) == pytest.approx(1)
    assert signals["multisine"].band_power_share(2.5) == pytest.approx(0.5)
    assert 0.95 < signals["noise"].band_power_share(5.0) < 1
    assert 0.95 < signals["chirp"].band_power_share(5.0) < 1


@pytest.mark.parametrize("samples", [1000, 1001])
def test_line_amplitudes_obey_parseval(settings, samples):
    from lumbar.tissue.signals.excitation import Signal

    values = np.random.default_rng(1).standard_normal(samples)
    signal = Signal("noise", values, 100.0, (0.0, samples / 100))
    _, amplitude = signal.line_amplitudes()
    power = np.sum(amplitude**2) / 2
    if samples % 2 == 0:  # the line at half the rate is a cosine sampled at its peaks: its power is A²
        power += amplitude[-1] ** 2 / 2
    assert power == pytest.approx(np.var(values))


def test_ramp_starts_and_ends_at_rest_and_leaves_later_periods_alone(settings):
    plain = by_name(design_excitation(5.0, settings, 1))
    ramped = by_name(design_excitation(5.0, changed(settings, ramp_s=1.0), 1))
    for name, signal in ramped.items():
        assert signal.position[0] == 0
        assert abs(signal.position[1] - signal.position[0]) < 0.01
        np.testing.assert_array_equal(signal.position[100:900], plain[name].position[100:900])
    assert ramped["noise"].position[-1] == ramped["chirp"].position[-1] == 0
    np.testing.assert_array_equal(ramped["multisine"].position[100:], plain["multisine"].position[100:])


def test_a_ramp_longer_than_the_signal_is_refused(settings):
    with pytest.raises(InputError, match=r"ramp_s of 6 s is too long for the noise of 10 s"):
        design_excitation(5.0, changed(settings, ramp_s=6), 1)


def test_a_machine_that_cannot_follow_is_named(settings):
    settings = changed(settings, machine={"velocity_mm_s": 50})
    with pytest.raises(InputError, match=r"3 problems(.|\n)*chirp: peak velocity is 8.*limit is 50 mm/s"):
        design_excitation(5.0, settings, 1)


@pytest.mark.parametrize("rate", [20, 50, 1000])
def test_other_rates(settings, rate):
    settings = changed(settings, rate_Hz=rate)
    signals = by_name(design_excitation(5.0, settings, 1))
    assert len(signals["multisine"].position) == 100 * rate
    assert signals["multisine"].position[: 10 * rate] == pytest.approx(
        signals["multisine"].position[-10 * rate :]
    )


def test_band_too_wide_for_the_rate_is_refused(settings):
    settings = changed(settings, rate_Hz=10)
    with pytest.raises(InputError, match="rate_Hz of 10 is too low"):
        design_excitation(5.0, settings, 1)


def test_file_for_the_machine_repeats_the_signal_to_a_nanometre(settings):
    signal = by_name(design_excitation(5.0, settings, 1))["noise"]
    text = machine_file(signal).to_csv(index=False)
    assert text.startswith("time_s,position_mm\n0.0,")
    read = pd.read_csv(io.StringIO(text))
    np.testing.assert_allclose(read.position_mm, signal.position, atol=5.1e-7)
    assert np.diff(read.time_s) == pytest.approx(0.01, abs=1e-12)


def test_description_rebuilds_the_multisine(settings):
    multisine = {"grid": "odd", "phases": "clipped", "amplitude_exponent": -0.5}
    settings = changed(settings, multisine=multisine)
    excitation = design_excitation(5.0, settings, 1)
    content = multisine_description(excitation, settings)
    time = np.arange(1000) / 100
    rebuilt = sum(
        a * np.cos(2 * np.pi * f * time + p)
        for a, f, p in zip(
            content["amplitude_mm"], content["frequency_Hz"], content["phase_rad"], strict=True
        )
    )
    np.testing.assert_allclose(by_name(excitation)["multisine"].position[:1000], rebuilt, atol=1e-9)
    assert not set(content["lines"]) & {
        *content["detection_lines"]["even"],
        *content["detection_lines"]["odd"],
    }


def test_properties_of_the_default_signals(settings):
    frame = signal_properties(design_excitation(5.0, settings, 1), "measured").frame.set_index("signal")
    assert frame.loc["multisine", "crest_factor"] == pytest.approx(1.72, abs=0.005)
    assert frame.loc["chirp", "peak_velocity_mm_s"] == pytest.approx(
        frame.loc["chirp", "peak_displacement_mm"] * 2 * np.pi * 5, rel=0.02
    )
    assert frame.loc["multisine", "start_jump_mm"] == frame.loc["chirp", "start_jump_mm"] == 0
    assert (frame.rms_mm - 2).abs().max() < 1e-12
