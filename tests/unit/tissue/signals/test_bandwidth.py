"""Spectra against closed forms: rules and intervals of a bandwidth, Welch's estimate, noise, peaks of a motion."""

import re

import numpy as np
import pytest
import yaml
from scipy.integrate import cumulative_trapezoid
from scipy.signal import csd
from scipy.stats import t

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.settings.tissue import BandwidthSettings, WelchSettings
from lumbar.settings.twin import SyntheticSurgeonSettings, TwinSettings
from lumbar.tissue.signals.excitation import band_limited_noise
from lumbar.tissue.signals.multisine import schroeder_phases
from lumbar.tissue.signals.spectrum import (
    Kinematics,
    check_machine_limits,
    level_frequency,
    motion_psd,
    occupied_band,
    peak_kinematics,
    power_share_frequency,
    spectral_edge,
)
from lumbar.tissue.signals.surgeon_motion import (
    MotionSpectra,
    motion_bandwidths,
    motion_spectra,
    spectra_table,
)
from lumbar.twin.surgeon_recordings import surgeon_trial

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
    for level, expected in (
        (-20, 4 + 0.1 * np.sqrt(2 * np.log(5))),
        (-10, 1 + 0.1 * np.sqrt(2 * np.log(10))),
    ):
        assert level_frequency(FREQUENCY, psd, level, 50) == pytest.approx(expected, abs=1e-3)
    # Before a stop band without power it is the last line with power.
    psd = np.where(FREQUENCY <= 4.0, 2.0, 0.0)
    assert level_frequency(FREQUENCY, psd, -20, 50) == pytest.approx(4.0, abs=0.01)


def test_power_outside_analysis_band_does_not_count():
    psd = np.where(FREQUENCY <= 2.0, 1.0, 0.0)
    with_tremor = psd + 5 * np.exp(-0.5 * ((FREQUENCY - 10) / 0.5) ** 2)
    with_tremor[0] = 1e6
    for rule, setting in ((power_share_frequency, 0.95), (level_frequency, -20)):
        assert rule(FREQUENCY, with_tremor, setting, 6) == pytest.approx(
            rule(FREQUENCY, psd, setting, 6), abs=1e-3
        )
        assert rule(FREQUENCY, with_tremor, setting, 50) > 9


@pytest.mark.parametrize("maximum", [0.005, 51.0, -1.0, float("nan")])
def test_analysis_band_outside_spectrum_is_rejected(maximum):
    with pytest.raises(InputError, match=rf"{maximum:g} Hz.*0\.01 .*50 Hz.*surgeon\.bandwidth\.maximum_Hz"):
        power_share_frequency(FREQUENCY, np.ones_like(FREQUENCY), 0.95, maximum)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_invalid_spectra_are_rejected(bad):
    psd = np.ones_like(FREQUENCY)
    psd[7] = bad
    with pytest.raises(InputError, match=r"spectrum.*\bfinite\b"):
        level_frequency(FREQUENCY, psd, -20, 6)
    with pytest.raises(InputError, match=r"spectrum.*\bpower\b"):
        power_share_frequency(FREQUENCY, np.zeros_like(FREQUENCY), 0.95, 6)


def test_summation_moves_the_share_by_less_than_two_lines(project):
    """The pooled velocity of the twin's surgeons by other sums than that of `power_share_frequency`."""
    section = yaml.safe_load((project / "config" / "twin.yaml").read_text(encoding="utf-8"))["twin"][
        "surgeon"
    ]
    surgeons, seed = SyntheticSurgeonSettings.model_validate(section), TwinSettings().seed
    names = [(f"{surgeon}_trial_{number}", surgeon) for surgeon in surgeons.surgeons for number in (1, 2, 3)]
    depths = [surgeon_trial(*name, surgeons, seed)["z_mm"].to_numpy() for name in names]
    lines, psds = zip(
        *(motion_psd(depth, 100.0, WelchSettings(), "velocity") for depth in depths), strict=True
    )
    frequency, psd = lines[0], np.mean(psds, axis=0)
    assert power_share_frequency(frequency, psd, 0.95, 6.0) == pytest.approx(2.474, abs=0.002)
    frequency, psd = frequency[frequency <= 6], psd[frequency <= 6]
    shares = [np.cumsum(psd), np.cumsum(psd) - psd[0], cumulative_trapezoid(psd, frequency, initial=0)]
    by_other_sums = [np.interp(0.95 * share[-1], share, frequency) for share in shares]
    assert by_other_sums == pytest.approx([2.42, 2.42, 2.47], abs=0.01)
    reached = np.searchsorted(shares[0], 0.95 * shares[0][-1])
    assert frequency[[reached - 1, reached]] == pytest.approx([2.344, 2.441], abs=0.001)


TO_20_HZ = np.arange(0, 20.01, 0.1)
INTERVAL = BandwidthSettings(power_share=0.95, level_dB=-20, maximum_Hz=8, confidence=0.95, resamples=400)


def spectra_of(rows, surgeons):
    names = tuple(f"trial_{index}" for index in range(len(rows)))
    return MotionSpectra(names, tuple(surgeons), TO_20_HZ, {"position": rows, "velocity": rows})


def flat_spectra(widths, surgeons, power=None):
    """Trials with a density that is flat up to each width (Hz), by default of power 1."""
    densities = np.divide([1.0] * len(widths) if power is None else power, widths)
    return spectra_of(densities[:, None] * np.less_equal.outer(TO_20_HZ, widths).T, surgeons)


def share(result):
    return result["velocity"]["power_share"]


def test_surgeons_have_equal_weight_and_every_trial_a_bandwidth():
    spectra = flat_spectra([2, 2, 2, 4], ["a", "a", "a", "b"])
    # Densities 1/2 up to 2 Hz and 1/4 up to 4 Hz, mean of both: 0.95 = 3/4 + (f - 2)/8.
    assert share(motion_bandwidths(spectra, INTERVAL, 1))["value_Hz"] == pytest.approx(3.6, abs=0.06)
    result = motion_bandwidths(flat_spectra([2, 3], ["a", "b"]), INTERVAL, 1)
    values = [trial["velocity"]["power_share"] for trial in result["trials"]]
    assert values == pytest.approx([1.9, 2.85], abs=0.06)


def test_interval_covers_value_and_grows_with_confidence():
    spectra = flat_spectra([2.0, 2.2, 2.4, 2.6, 3.0, 3.2], "aabbcc")
    entry = share(motion_bandwidths(spectra, INTERVAL, 1))
    narrow = share(motion_bandwidths(spectra, INTERVAL.model_copy(update={"confidence": 0.6}), 1))
    assert entry["low_Hz"] < narrow["low_Hz"] < entry["value_Hz"] < narrow["high_Hz"] < entry["high_Hz"]


def test_interval_of_similar_surgeons_has_width_of_t():
    """Logarithms of the bandwidth with a spread of 3 % over 16 surgeons: mean ± t·s/√n."""
    logs = np.log(4) + 0.03 * np.random.default_rng(4).standard_normal(16)
    # Gaussian densities that are 20 dB below their peak at these frequencies.
    widths = np.exp(logs)[:, None] / np.sqrt(2 * np.log(100))
    spectra = spectra_of(np.exp(-0.5 * (TO_20_HZ / widths) ** 2), [f"s{index}" for index in range(16)])
    settings = INTERVAL.model_copy(update={"resamples": 2000})
    entry = motion_bandwidths(spectra, settings, 1)["velocity"]["level"]
    expected = t.ppf(0.975, 15) * logs.std() / 4
    assert np.log(entry["high_Hz"] / entry["low_Hz"]) / 2 == pytest.approx(expected, rel=0.25)


def test_trials_of_one_surgeon_are_not_independent():
    """Four surgeons with three equal trials: the interval must be as wide as if each had one trial."""

    def width(widths, surgeons):
        entry = share(motion_bandwidths(flat_spectra(widths, surgeons), INTERVAL, 1))
        return entry["high_Hz"] - entry["low_Hz"]

    widths = [2, 2.5, 3, 3.5]
    three = width(np.repeat(widths, 3), "aaabbbcccddd")
    assert three == pytest.approx(width(widths, "abcd"), rel=0.2)
    assert width(np.repeat(widths, 3), "abcdefghijkl") < 0.75 * three


def test_one_surgeon_resamples_trials_and_one_trial_has_no_interval():
    one = motion_bandwidths(flat_spectra([2, 3], "aa"), INTERVAL, 1)
    assert one["interval"]["resampled"] == "trials"
    assert share(one)["low_Hz"] < share(one)["high_Hz"]
    single = motion_bandwidths(flat_spectra([2], "a"), INTERVAL, 1)
    assert single["interval"]["resampled"] is None
    assert share(single)["low_Hz"] is None
    assert share(single)["value_Hz"] == pytest.approx(1.9, abs=0.06)


def test_level_that_is_not_reached_has_no_value_or_open_interval():
    spectra = flat_spectra([2, 2, 9], "abc")  # the third does not fall within the band of 8 Hz
    entry = motion_bandwidths(spectra, INTERVAL, 1)["velocity"]["level"]
    assert entry == {"value_Hz": None, "low_Hz": None, "high_Hz": None}
    # The mean falls 20 dB before 8 Hz; a mean of mostly the last surgeon does not.
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


def test_table_of_spectra_has_mean():
    spectra = motion_spectra([trial("one"), trial("other")], ["a", "b"], WelchSettings(segment_s=10.24))
    table = spectra_table(spectra)
    assert len(table) == 2 * 3 * len(spectra.frequency)
    wide = table[table.quantity == "velocity"].pivot(index="frequency_Hz", columns="record", values="psd")
    np.testing.assert_allclose(wide["pooled"], (wide["one"] + wide["other"]) / 2)


@pytest.mark.parametrize(
    ("records", "tokens"),
    [
        ([trial("one"), trial("one")], "surgeon.records: .*'one'"),
        (
            [trial("one"), trial("short", seconds=5)],
            r"short\.csv: .*\b500 .*\b5 s\b.*10\.24 s.*\b1024\b.*surgeon\.welch\.segment_s",
        ),
        ([trial("one"), trial("slow", rate=30.0)], r"slow\.csv: .*\b30 Hz.*one .*100 Hz.*surgeon\.rate_Hz"),
        ([trial("metres", unit="m")], r"metres\.csv: position .*'m'.*\bmm\b.*surgeon\.layout"),
    ],
)
def test_trials_that_cannot_be_pooled_are_rejected(records, tokens):
    with pytest.raises(InputError, match=tokens):
        motion_spectra(records, ["a"] * len(records), WelchSettings(segment_s=10.24))


SAMPLES = 4000
LOW, HIGH = (np.sin(2 * np.pi * line * np.arange(SAMPLES) / SAMPLES) for line in (40, 200))


@pytest.mark.parametrize(
    ("share", "line"), [(0.1, 39), (0.5, 40), (0.75, 41), (0.82, 199), (0.9, 200), (0.99, 201)]
)
def test_hann_window_spreads_line_over_three(share, line):
    """By 1/6, 2/3, 1/6; 0.8 of the signal's power is in the lower line and 0.2 in the higher one."""
    assert spectral_edge(2 * LOW + HIGH, share) == line / SAMPLES


def test_drift_has_low_spectral_edge():
    drift = np.linspace(-1.0, 1.0, SAMPLES)
    assert spectral_edge(drift, 0.9999) <= 6 / SAMPLES
    assert spectral_edge(np.ones(SAMPLES), 0.5) == 1 / SAMPLES


def test_occupied_band_of_motion():
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
    assert power(*motion_psd(sine, rate, WELCH)) == pytest.approx(amplitude**2 / 2, rel=0.01)
    expected = (2 * np.pi * frequency * amplitude) ** 2 / 2
    assert power(*motion_psd(sine, rate, WELCH, "velocity")) == pytest.approx(expected, rel=0.02)


def test_steady_advance_does_not_leak_into_velocity_spectrum():
    """The recording is differenced first, because (2πf)² times the position's density would be far off."""
    rate = 100.0
    time = np.arange(6000) / rate
    slow = np.random.default_rng(3).standard_normal(6000) * 0.001 + 50 * time
    frequency, psd = motion_psd(slow, rate, WELCH, "velocity")
    band = (frequency > 1) & (frequency < 6)
    white = 2 * 0.001**2 / rate * (2 * np.pi * frequency[band]) ** 2
    assert np.mean(psd[band] / white) == pytest.approx(1, abs=0.2)
    _, position = motion_psd(slow, rate, WELCH)
    assert np.mean((2 * np.pi * frequency[band]) ** 2 * position[band] / white) > 10


def test_linear_detrending_subtracts_ramp():
    rate = 100.0
    ramp = 5.0 * np.arange(6000) / rate
    linear = power(*motion_psd(ramp, rate, WelchSettings(segment_s=10.24, detrend="linear")))
    assert linear < 1e-12 < power(*motion_psd(ramp, rate, WELCH))


@pytest.mark.parametrize(
    ("quantity", "samples", "segment_s", "tokens"),
    [
        ("position", 500, 10.24, r"500 samples \(5 s\).*10\.24 s needs 1024"),
        ("velocity", 1024, 10.24, r"\b1024 .*10\.24 s.*\b1025\b.*surgeon\.welch\.segment_s"),
        ("position", 500, 0.05, r"0\.05 s .*\b5 .*100 Hz.*\b8\b"),
    ],
)
def test_segment_longer_than_recording_is_rejected(quantity, samples, segment_s, tokens):
    motion_psd(np.sin(np.arange(1024) / 7), 100.0, WELCH)
    with pytest.raises(InputError, match=tokens):
        motion_psd(np.arange(float(samples)), 100.0, WelchSettings(segment_s=segment_s), quantity)


def test_noise_is_gaussian_with_mean_zero_and_unit_rms():
    noise = band_limited_noise(4000.0, 5.0, 100.0, 8, 1)
    assert len(noise) == 400_000
    assert abs(noise.mean()) < 1e-12
    assert np.mean(noise**2) == pytest.approx(1)
    # Skewness and excess kurtosis of some 40,000 independent values.
    assert abs(np.mean(noise**3)) < 0.06
    assert abs(np.mean(noise**4) - 3) < 0.12


@pytest.mark.parametrize("order", [2, 4, 8])
def test_noise_density_is_halved_at_end_of_band(order):
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
def test_ends_of_noise_have_power_of_middle():
    rows = np.array([band_limited_noise(10.0, 5.0, 100.0, 8, seed) for seed in range(150)])
    power = np.mean(rows**2, axis=0)
    assert np.mean(power[:20]) == pytest.approx(1, abs=0.2)
    assert np.mean(power[-20:]) == pytest.approx(1, abs=0.2)


def test_schroeder_phases_of_any_spectrum_are_double_sum():
    amplitudes = np.arange(1, 13) ** -0.5
    share = amplitudes**2 / np.sum(amplitudes**2)
    double_sum = [-2 * np.pi * sum((k - n) * share[n] for n in range(k)) for k in range(12)]
    np.testing.assert_allclose(schroeder_phases(amplitudes), double_sum, atol=1e-12)


@pytest.mark.parametrize("frequency", [0.3, 2.5, 5.0])
@pytest.mark.parametrize("phase", [0.0, 0.2, 1.1])
def test_peaks_of_sine_between_its_samples(frequency, phase):
    omega = 2 * np.pi * frequency
    motion = peak_kinematics(3 * np.cos(omega * np.arange(2000) / 100 + phase), 100.0)
    assert motion.displacement == pytest.approx(3, rel=1e-3)
    assert motion.velocity == pytest.approx(3 * omega, rel=1e-3)
    assert motion.acceleration == pytest.approx(3 * omega**2, rel=3e-3)


@pytest.mark.parametrize("excess", [1.0001, 1.37, 7.3, 12345.6])
def test_suggested_amplitude_fits_machine(excess):
    limits = Kinematics(30, 1000, 20000)
    with pytest.raises(InputError) as error:
        check_machine_limits({"noise": Kinematics(30 * excess, 0, 0)}, limits)
    factor = float(re.search(r"signals\.amplitude\.value_mm .*?([0-9.]+)", str(error.value))[1])
    assert 0.99 / excess <= factor <= 1 / excess
    check_machine_limits({"noise": Kinematics(30 * excess * factor, 0, 0)}, limits)
