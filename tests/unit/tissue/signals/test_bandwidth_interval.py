"""Pooled bandwidths of several surgeons and their bootstrap intervals, on spectra of known bandwidth."""

from dataclasses import replace

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.settings.signals import BandwidthSettings, WelchSettings
from lumbar.tissue.signals.surgeon_motion import (
    MotionSpectra,
    motion_bandwidths,
    motion_spectra,
    spectra_table,
)

FREQUENCY = np.arange(0, 20.01, 0.1)
SETTINGS = BandwidthSettings(power_share=0.95, level_dB=-20, maximum_Hz=8, confidence=0.95, resamples=400)


def flat_spectra(widths, surgeons, power=None):
    """Trials whose density is flat up to each width (hertz), of power 1 each where no other is given."""
    densities = np.divide([1.0] * len(widths) if power is None else power, widths)
    rows = densities[:, None] * np.less_equal.outer(FREQUENCY, widths).T
    names = tuple(f"trial_{index}" for index in range(len(widths)))
    return MotionSpectra(names, tuple(surgeons), FREQUENCY, {"position": rows, "velocity": rows})


def level_spectra(levels, surgeons):
    """Trials of Gaussian density that is 20 dB under its peak at each level (hertz)."""
    widths = np.array(levels)[:, None] / np.sqrt(2 * np.log(100))
    rows = np.exp(-0.5 * (FREQUENCY / widths) ** 2)
    names = tuple(f"trial_{index}" for index in range(len(levels)))
    return MotionSpectra(names, tuple(surgeons), FREQUENCY, {"position": rows, "velocity": rows})


def share(result):
    return result["velocity"]["power_share"]


def test_surgeons_count_alike_however_many_trials_each_has():
    spectra = flat_spectra([2, 2, 2, 4], ["a", "a", "a", "b"])
    # Densities 1/2 up to 2 Hz and 1/4 up to 4 Hz, mean of both: 0.95 = 3/4 + (f - 2)/8.
    assert share(motion_bandwidths(spectra, SETTINGS, 1))["value_Hz"] == pytest.approx(3.6, abs=0.06)


def test_every_trial_has_its_own_bandwidth():
    result = motion_bandwidths(flat_spectra([2, 3], ["a", "b"]), SETTINGS, 1)
    values = [trial["velocity"]["power_share"] for trial in result["trials"]]
    assert values == pytest.approx([1.9, 2.85], abs=0.06)


def test_interval_holds_the_value_and_grows_with_confidence():
    spectra = flat_spectra([2.0, 2.2, 2.4, 2.6, 3.0, 3.2], "aabbcc")
    entry = share(motion_bandwidths(spectra, SETTINGS, 1))
    narrow = share(motion_bandwidths(spectra, replace(SETTINGS, confidence=0.6), 1))
    assert entry["low_Hz"] < narrow["low_Hz"] < entry["value_Hz"] < narrow["high_Hz"] < entry["high_Hz"]


def test_like_surgeons_have_a_narrow_interval_of_the_right_width():
    """Logarithms of the bandwidth with a spread of 3 % over 16 surgeons: mean ± t·s/√n."""
    from scipy.stats import t

    logs = np.log(4) + 0.03 * np.random.default_rng(4).standard_normal(16)
    names = [f"s{index}" for index in range(16)]
    spectra = level_spectra(np.exp(logs), names)
    entry = motion_bandwidths(spectra, replace(SETTINGS, resamples=2000), 1)["velocity"]["level"]
    expected = t.ppf(0.975, 15) * logs.std() / 4
    assert np.log(entry["high_Hz"] / entry["low_Hz"]) / 2 == pytest.approx(expected, rel=0.25)


def test_trials_of_one_surgeon_are_no_independent_evidence():
    """Four surgeons of three like trials: the interval must be as wide as if each had one trial."""
    one = share(motion_bandwidths(flat_spectra([2, 2.5, 3, 3.5], "abcd"), SETTINGS, 1))
    widths = [2] * 3 + [2.5] * 3 + [3] * 3 + [3.5] * 3
    three = share(motion_bandwidths(flat_spectra(widths, "aaabbbcccddd"), SETTINGS, 1))
    apart = share(motion_bandwidths(flat_spectra(widths, "abcdefghijkl"), SETTINGS, 1))

    def width(entry):
        return entry["high_Hz"] - entry["low_Hz"]

    assert width(three) == pytest.approx(width(one), rel=0.2)
    assert width(apart) < 0.75 * width(three)


@pytest.mark.statistical
def test_coverage_of_the_interval_over_many_surgeons():
    """Spectra of 12 surgeons from a population: the interval holds its value in about 95 % of cases."""
    rng = np.random.default_rng(8)

    def draw(count):
        centre = np.exp(np.log(2.5) + 0.25 * rng.standard_normal(count))
        return np.repeat(centre, 2) * np.exp(0.1 * rng.standard_normal(2 * count))

    population = flat_spectra(draw(4000), np.repeat(np.arange(4000).astype(str), 2).tolist())
    settings = BandwidthSettings(0.95, -20, 19, 0.95, 100)
    pooled = population.psd["velocity"].mean(axis=0)
    power = np.cumsum(pooled[1:])
    truth = FREQUENCY[1:][np.searchsorted(power, 0.95 * power[-1])]
    inside = 0
    for index in range(40):
        spectra = flat_spectra(draw(12), np.repeat(np.arange(12).astype(str), 2).tolist())
        entry = share(motion_bandwidths(spectra, settings, index))
        inside += entry["low_Hz"] <= truth <= entry["high_Hz"]
    assert inside >= 33  # 38 expected


def test_same_seed_same_interval_and_other_seed_nearly():
    spectra = flat_spectra([2, 2.2, 2.4, 2.6, 3, 3.2], "aabbcc")
    first, again, other = (motion_bandwidths(spectra, SETTINGS, seed) for seed in (1, 1, 2))
    assert first == again
    assert share(first)["low_Hz"] == pytest.approx(share(other)["low_Hz"], abs=0.15)


def test_one_surgeon_resamples_trials_and_one_trial_has_no_interval():
    alone = motion_bandwidths(flat_spectra([2, 3], "aa"), SETTINGS, 1)
    assert alone["interval"]["resampled"] == "trials"
    assert share(alone)["low_Hz"] < share(alone)["high_Hz"]
    single = motion_bandwidths(flat_spectra([2], "a"), SETTINGS, 1)
    assert single["interval"]["resampled"] is None
    assert share(single)["low_Hz"] is None
    assert share(single)["value_Hz"] == pytest.approx(1.9, abs=0.06)


def test_a_level_that_is_not_reached_has_neither_value_nor_interval():
    spectra = flat_spectra([2, 2, 9], "abc")  # the third does not fall within the band of 8 Hz
    entry = motion_bandwidths(spectra, SETTINGS, 1)["velocity"]["level"]
    assert entry == {"value_Hz": None, "low_Hz": None, "high_Hz": None}


def test_a_level_that_some_resamples_do_not_reach_has_an_open_end():
    # The mean falls 20 dB before 8 Hz, a mean of the last surgeon alone or in the majority does not.
    spectra = flat_spectra([2, 2, 2, 2, 2, 9], "abcdef", power=[1, 1, 1, 1, 1, 0.22])
    entry = motion_bandwidths(spectra, SETTINGS, 1)["velocity"]["level"]
    assert entry["value_Hz"] == pytest.approx(2, abs=0.1)
    assert entry["low_Hz"] <= entry["value_Hz"]
    assert entry["high_Hz"] is None


def trial(name, rate=100.0, seconds=30, unit="mm"):
    values = np.random.default_rng(len(name)).standard_normal(round(rate * seconds)).cumsum()
    return Record(
        name, np.arange(len(values)) / rate, {"position": Channel(values, "position", unit)}, f"{name}.csv"
    )


def test_table_of_spectra_is_tidy_and_holds_the_mean():
    spectra = motion_spectra([trial("one"), trial("other")], ["a", "b"], WelchSettings(10.24))
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
        motion_spectra(records, ["a"] * len(records), WelchSettings(10.24))
