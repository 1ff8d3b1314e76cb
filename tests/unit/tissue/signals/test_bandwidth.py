"""Bandwidth: rules and intervals against spectra whose bandwidth is known in closed form, edges, and Welch's estimate."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.settings.signals import BandwidthSettings, WelchSettings
from lumbar.tissue.signals.spectrum import (
    level_frequency,
    occupied_band,
    position_psd,
    power_share_frequency,
    spectral_edge,
    velocity_psd,
)
from lumbar.tissue.signals.surgeon_motion import (
    MotionSpectra,
    motion_bandwidths,
    motion_spectra,
    spectra_table,
)

FREQUENCY = np.arange(0, 50.0001, 0.01)


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


@pytest.mark.parametrize("maximum", [0.005, 51.0, -1.0, float("nan")])
def test_analysis_band_outside_the_spectrum_is_refused(maximum):
    with pytest.raises(InputError, match="maximum_Hz"):
        power_share_frequency(FREQUENCY, np.ones_like(FREQUENCY), 0.95, maximum)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_invalid_spectra_are_rejected(bad):
    psd = np.ones_like(FREQUENCY)
    psd[7] = bad
    with pytest.raises(InputError, match="not finite"):
        level_frequency(FREQUENCY, psd, -20, 6)
    with pytest.raises(InputError, match="no power"):
        power_share_frequency(FREQUENCY, np.zeros_like(FREQUENCY), 0.95, 6)


TO_20_HZ = np.arange(0, 20.01, 0.1)
INTERVAL = BandwidthSettings(power_share=0.95, level_dB=-20, maximum_Hz=8, confidence=0.95, resamples=400)


def flat_spectra(widths, surgeons, power=None):
    """Trials whose density is flat up to each width (hertz), of power 1 each where no other is given."""
    densities = np.divide([1.0] * len(widths) if power is None else power, widths)
    rows = densities[:, None] * np.less_equal.outer(TO_20_HZ, widths).T
    names = tuple(f"trial_{index}" for index in range(len(widths)))
    return MotionSpectra(names, tuple(surgeons), TO_20_HZ, {"position": rows, "velocity": rows})


def level_spectra(levels, surgeons):
    """Trials of Gaussian density that is 20 dB under its peak at each level (hertz)."""
    widths = np.array(levels)[:, None] / np.sqrt(2 * np.log(100))
    rows = np.exp(-0.5 * (TO_20_HZ / widths) ** 2)
    names = tuple(f"trial_{index}" for index in range(len(levels)))
    return MotionSpectra(names, tuple(surgeons), TO_20_HZ, {"position": rows, "velocity": rows})


def share(result):
    return result["velocity"]["power_share"]


def test_surgeons_have_equal_weight():
    spectra = flat_spectra([2, 2, 2, 4], ["a", "a", "a", "b"])
    # Densities 1/2 up to 2 Hz and 1/4 up to 4 Hz, mean of both: 0.95 = 3/4 + (f - 2)/8.
    assert share(motion_bandwidths(spectra, INTERVAL, 1))["value_Hz"] == pytest.approx(3.6, abs=0.06)


def test_every_trial_has_its_own_bandwidth():
    result = motion_bandwidths(flat_spectra([2, 3], ["a", "b"]), INTERVAL, 1)
    values = [trial["velocity"]["power_share"] for trial in result["trials"]]
    assert values == pytest.approx([1.9, 2.85], abs=0.06)


def test_interval_holds_the_value_and_grows_with_confidence():
    spectra = flat_spectra([2.0, 2.2, 2.4, 2.6, 3.0, 3.2], "aabbcc")
    entry = share(motion_bandwidths(spectra, INTERVAL, 1))
    narrow = share(motion_bandwidths(spectra, INTERVAL.model_copy(update={"confidence": 0.6}), 1))
    assert entry["low_Hz"] < narrow["low_Hz"] < entry["value_Hz"] < narrow["high_Hz"] < entry["high_Hz"]


def test_like_surgeons_have_a_narrow_interval_of_the_right_width():
    """Logarithms of the bandwidth with a spread of 3 % over 16 surgeons: mean ± t·s/√n."""
    from scipy.stats import t

    logs = np.log(4) + 0.03 * np.random.default_rng(4).standard_normal(16)
    names = [f"s{index}" for index in range(16)]
    spectra = level_spectra(np.exp(logs), names)
    entry = motion_bandwidths(spectra, INTERVAL.model_copy(update={"resamples": 2000}), 1)["velocity"][
        "level"
    ]
    expected = t.ppf(0.975, 15) * logs.std() / 4
    assert np.log(entry["high_Hz"] / entry["low_Hz"]) / 2 == pytest.approx(expected, rel=0.25)


def test_trials_of_one_surgeon_are_not_independent():
    """Four surgeons of three like trials: the interval must be as wide as if each had one trial."""
    one = share(motion_bandwidths(flat_spectra([2, 2.5, 3, 3.5], "abcd"), INTERVAL, 1))
    widths = [2] * 3 + [2.5] * 3 + [3] * 3 + [3.5] * 3
    three = share(motion_bandwidths(flat_spectra(widths, "aaabbbcccddd"), INTERVAL, 1))
    apart = share(motion_bandwidths(flat_spectra(widths, "abcdefghijkl"), INTERVAL, 1))

    def width(entry):
        return entry["high_Hz"] - entry["low_Hz"]

    assert width(three) == pytest.approx(width(one), rel=0.2)
    assert width(apart) < 0.75 * width(three)


def test_one_surgeon_resamples_trials_and_one_trial_has_no_interval():
    alone = motion_bandwidths(flat_spectra([2, 3], "aa"), INTERVAL, 1)
    assert alone["interval"]["resampled"] == "trials"
    assert share(alone)["low_Hz"] < share(alone)["high_Hz"]
    single = motion_bandwidths(flat_spectra([2], "a"), INTERVAL, 1)
    assert single["interval"]["resampled"] is None
    assert share(single)["low_Hz"] is None
    assert share(single)["value_Hz"] == pytest.approx(1.9, abs=0.06)


def test_a_level_that_is_not_reached_has_neither_value_nor_interval():
    spectra = flat_spectra([2, 2, 9], "abc")  # the third does not fall within the band of 8 Hz
    entry = motion_bandwidths(spectra, INTERVAL, 1)["velocity"]["level"]
    assert entry == {"value_Hz": None, "low_Hz": None, "high_Hz": None}


def test_a_level_that_some_resamples_do_not_reach_has_an_open_end():
    # The mean falls 20 dB before 8 Hz, a mean of the last surgeon alone or in the majority does not.
    spectra = flat_spectra([2, 2, 2, 2, 2, 9], "abcdef", power=[1, 1, 1, 1, 1, 0.22])
    entry = motion_bandwidths(spectra, INTERVAL, 1)["velocity"]["level"]
    assert entry["value_Hz"] == pytest.approx(2, abs=0.1)
    assert entry["low_Hz"] <= entry["value_Hz"]
    assert entry["high_Hz"] is None


def trial(name, rate=100.0, seconds=30, unit="mm"):
    values = np.random.default_rng(len(name)).standard_normal(round(rate * seconds)).cumsum()
    return Record(
        name, np.arange(len(values)) / rate, {"position": Channel(values, "position", unit)}, f"{name}.csv"
    )


def test_table_of_spectra_is_tidy_and_holds_the_mean():
    spectra = motion_spectra([trial("one"), trial("other")], ["a", "b"], WelchSettings(segment_s=10.24))
    table = spectra_table(spectra)
    assert len(table) == 2 * 3 * len(spectra.frequency)
    wide = table[table.quantity == "velocity"].pivot(index="frequency_Hz", columns="record", values="psd")
    np.testing.assert_allclose(wide["pooled"], (wide["one"] + wide["other"]) / 2)


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([trial("one"), trial("one")], "stands twice"),
        ([trial("one"), trial("short", seconds=5)], r"short\.csv: .*500 samples \(5 s\)"),
        ([trial("one"), trial("slow", rate=30.0)], r"slow\.csv: sampled at 30 Hz.*rate_Hz"),
        ([trial("metres", unit="m")], r"metres\.csv: position is in 'm'"),
    ],
)
def test_trials_that_cannot_be_pooled_are_named(records, words):
    with pytest.raises(InputError, match=words):
        motion_spectra(records, ["a"] * len(records), WelchSettings(segment_s=10.24))


SAMPLES = 4000
LOW, HIGH = (np.sin(2 * np.pi * line * np.arange(SAMPLES) / SAMPLES) for line in (40, 200))


@pytest.mark.parametrize(
    ("share", "line"), [(0.1, 39), (0.5, 40), (0.75, 41), (0.82, 199), (0.9, 200), (0.99, 201)]
)
def test_a_hann_window_spreads_a_line_over_three(share, line):
    """By 1/6, 2/3, 1/6; of the signal's power 0.8 is in the lower line and 0.2 in the higher one."""
    assert spectral_edge(2 * LOW + HIGH, share) == line / SAMPLES


def test_drift_has_low_spectral_edge():
    drift = np.linspace(-1.0, 1.0, SAMPLES)
    assert spectral_edge(drift, 0.9999) <= 6 / SAMPLES
    assert spectral_edge(np.ones(SAMPLES), 0.5) == 1 / SAMPLES


def test_the_band_of_a_motion():
    time = np.arange(SAMPLES) / 100
    position = 3.0 + np.cos(2 * np.pi * 0.5 * time) + 0.2 * np.cos(2 * np.pi * 4.0 * time)
    assert occupied_band(position, 0.01) == pytest.approx((0.5, 4.0))
    assert occupied_band(position - 0.15 * np.cos(2 * np.pi * 4.0 * time), 0.01) == pytest.approx((0.5, 0.5))


WELCH = WelchSettings()


def power(frequency, psd):
    return psd.sum() * frequency[1]


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
@pytest.mark.parametrize("frequency", [0.8, 2.5, 9.7])
def test_power_of_a_sinusoid_in_position_and_velocity(rate, frequency):
    amplitude = 3.0
    time = np.arange(round(80 * rate)) / rate
    sine = amplitude * np.sin(2 * np.pi * frequency * time + 0.3)
    assert power(*position_psd(sine, rate, WELCH)) == pytest.approx(amplitude**2 / 2, rel=0.01)
    expected = (2 * np.pi * frequency * amplitude) ** 2 / 2
    assert power(*velocity_psd(sine, rate, WELCH)) == pytest.approx(expected, rel=0.02)


def test_steady_advance_does_not_leak_into_the_velocity_spectrum():
    """Why the recording is differenced first: (2πf)² times the position's density would be far off."""
    rate = 100.0
    time = np.arange(6000) / rate
    slow = np.random.default_rng(3).standard_normal(6000) * 0.001 + 50 * time
    frequency, psd = velocity_psd(slow, rate, WELCH)
    band = (frequency > 1) & (frequency < 6)
    white = 2 * 0.001**2 / rate * (2 * np.pi * frequency[band]) ** 2
    assert np.mean(psd[band] / white) == pytest.approx(1, abs=0.2)
    _, position = position_psd(slow, rate, WELCH)
    assert np.mean((2 * np.pi * frequency[band]) ** 2 * position[band] / white) > 10


def test_linear_detrending_takes_a_ramp_off_the_position():
    rate = 100.0
    ramp = 5.0 * np.arange(6000) / rate
    linear = power(*position_psd(ramp, rate, WelchSettings(segment_s=10.24, detrend="linear")))
    assert linear < 1e-12 < power(*position_psd(ramp, rate, WELCH))


@pytest.mark.parametrize(
    ("density", "samples", "segment_s", "words"),
    [
        (position_psd, 500, 10.24, r"500 samples \(5 s\).*10\.24 s needs 1024"),
        (velocity_psd, 1024, 10.24, "1024 samples .* needs 1025"),
        (position_psd, 500, 0.05, "5 samples"),
    ],
)
def test_segments_that_do_not_fit_are_refused_with_both_lengths(density, samples, segment_s, words):
    position_psd(np.sin(np.arange(1024) / 7), 100.0, WELCH)
    with pytest.raises(InputError, match=words):
        density(np.arange(float(samples)), 100.0, WelchSettings(segment_s=segment_s))
