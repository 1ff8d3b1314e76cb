"""Period and noise floor of experiments against simulations in which both are known."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, noisy_record, record, relaxing_force
from scipy.signal import lfilter
from scipy.stats import chi2

import lumbar
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor

REPEATED, SECONDS = multisine(4, seed=3), np.arange(4000) * STEP


def floor_of(*records, period=None, train=None):
    """Noise floor of the first training record that repeats."""
    records = [replace(item, period=period) for item in records]
    return lumbar.refine(records, [], base="LE", train=train).experiment.floor


@pytest.mark.parametrize(
    ("position", "period"),
    [
        pytest.param(REPEATED, 5.0, id="exact"),
        pytest.param(np.round(REPEATED, 5), 5.0, id="rounded"),
        pytest.param(REPEATED + 0.005 * np.std(REPEATED) * noise(2000, 1), 5.0, id="noisy"),
        pytest.param(REPEATED[:-501], 5.0, id="a sample lost at the end"),
        pytest.param(np.sin(np.pi * SECONDS[:2000]), 2.0, id="the shortest"),
        pytest.param(
            np.sin(2 * np.pi * SECONDS) + 0.01 * np.sin(0.2 * np.pi * SECONDS), 10.0, id="faint and slow"
        ),
    ],
)
def test_period_is_detected(position, period):
    assert floor_of(record(position, position)).period == pytest.approx(period)


def test_period_of_sine_without_whole_number_of_samples():
    position = np.sin(2 * np.pi * 0.3 * SECONDS[:3000])
    period = floor_of(record(position, position)).period
    assert period == pytest.approx(round(period * 0.3) / 0.3, abs=STEP)


@pytest.mark.parametrize("periods", [1.5, 1.9])
def test_fewer_than_two_periods_have_no_floor(periods):
    position = multisine(3, seed=5)[: int(periods * 500)]
    assert floor_of(record(position, position)) is None


@pytest.mark.parametrize("periods", [2.0, 2.5, 2.9])
@pytest.mark.parametrize("pole", [0.85, 0.95])
def test_two_periods_have_floor(periods, pole):
    position = multisine(3, seed=5)[: int(periods * 500)] + 4.0
    force = lfilter([1.5, pole - 2 + 0.45], [1.0, -pole], position)  # begins with a long transient
    floor = floor_of(record(position, force + 0.1 * noise(len(position), 3)))
    assert floor.halves and floor.period == pytest.approx(5.0)
    assert floor.low < 0.1 < floor.high and floor.structured == ()


@pytest.mark.parametrize("lasting", [lambda time: 2 * np.exp(-time / 6), lambda time: 0.05 * time])
def test_two_periods_with_long_transient_or_drift_have_no_floor(lasting):
    position = multisine(2, seed=5)
    force = 1.5 * position + lasting(STEP * np.arange(len(position))) + 0.02 * noise(len(position), 3)
    assert floor_of(record(position, force)) is None


def test_two_periods_are_used_only_if_no_record_has_more():
    short, long = (multisine(periods, seed=periods) for periods in (2, 4))
    records = [
        record(position, 1.5 * position + size * noise(len(position), 3), name)
        for position, size, name in ((short, 0.2, "short"), (long, 0.1, "long"))
    ]
    assert floor_of(*records, train=["short"]).halves
    assert not floor_of(*records, train=["short", "long"]).halves


@pytest.mark.parametrize(
    "position",
    [
        pytest.param(np.sin(2 * np.pi * (0.1 * SECONDS + 0.1 * SECONDS**2))[:2000], id="chirp"),
        pytest.param(noise(2000, 4, 0.95), id="noise"),
        pytest.param(SECONDS[:2000], id="ramp"),
        pytest.param(np.floor(SECONDS[:2000] / 3), id="steps"),
    ],
)
def test_input_without_period_has_no_floor(position):
    assert floor_of(record(position, SECONDS[:2000])) is None


def test_floor_without_structure_is_spread_over_periods():
    test = noisy_record(periods=10, sigma=0.3, seed=1)
    used = test["output"].reshape(10, 500)[1:]
    expected = np.sqrt(np.sum((used - used.mean(axis=0)) ** 2) / (8 * 500))
    floor = floor_of(test)
    assert floor.structured == () and floor.structured_rms == 0.0
    assert floor.rms == pytest.approx(expected, rel=1e-12)
    assert floor.periods == 9 and floor.period == pytest.approx(5.0)
    low, high = (expected * np.sqrt(4000 / chi2.ppf(q, 4000)) for q in (0.975, 0.025))
    assert floor.low == pytest.approx(low, rel=0.01)
    assert floor.high == pytest.approx(high, rel=0.01)


@pytest.mark.statistical
@pytest.mark.parametrize(("pole", "periods"), [(0.0, 10), (0.0, 3), (0.9, 10), (0.98, 10), (0.5, 30)])
def test_intervals_cover_noise_without_false_structure(pole, periods):
    sigma, trials = 0.3, 100
    floors = [floor_of(noisy_record(periods, sigma, seed, pole), period=5.0) for seed in range(trials)]
    assert np.mean([floor.low <= sigma <= floor.high for floor in floors]) >= 0.88
    assert np.mean([floor.rms for floor in floors]) == pytest.approx(sigma, rel=0.015 if pole < 0.9 else 0.06)
    assert sum(bool(floor.structured) for floor in floors) <= 5


DISTURBANCES = {
    "drift": lambda time, _: 0.02 * time,
    "drift, settling": lambda time, _: 2.0 * np.exp(-time / 12),
    "amplitude change": lambda time, force: -0.06 * force * (1 - np.exp(-time / 15)),
    "off-grid line": lambda time, _: 1.0 * np.sin(2 * np.pi * 1.2345 * time),
    "off-grid line, slow": lambda time, _: 1.0 * np.sin(2 * np.pi * 0.07 * time),
    "off-grid line at 0.837 Hz with harmonics": lambda time, _: (
        0.5 * np.tanh(5 * np.sin(2 * np.pi * 0.837 * time))
    ),
    "other change: period 5 differs": lambda time, _: 2.0 * ((time > 22) & (time < 23)),
}


@pytest.mark.parametrize("strength", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("kind", DISTURBANCES)
def test_disturbance_is_described_and_subtracted(kind, strength):
    def extra(time, force):
        return strength * DISTURBANCES[kind](time, force)

    test = noisy_record(10, 0.3, 7, extra=extra)
    floor = floor_of(test)
    assert len(floor.structured) == 1
    assert floor.structured[0][0].startswith(kind.split(", ")[0])
    assert floor.rms == pytest.approx(0.3, rel=0.03)
    clean = extra(test.time, relaxing_force(test["input"])).reshape(10, 500)[1:]
    expected = np.sqrt(np.mean((clean - clean.mean(axis=0)) ** 2))
    assert floor.structured_rms == pytest.approx(expected, rel=0.1)
    assert floor.structured[0][1] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("periods", [3, 4, 5])
@pytest.mark.parametrize("kind", ["drift", "off-grid line"])
def test_disturbance_is_subtracted_from_few_periods(periods, kind):
    floor = floor_of(noisy_record(periods, 0.3, 2, extra=lambda t, f: 5 * DISTURBANCES[kind](t, f)))
    assert floor.structured[0][0].startswith(kind)
    assert floor.rms == pytest.approx(0.3, rel=0.08)


def test_several_disturbances_are_separated():
    lines = lambda time: np.sin(2 * np.pi * 0.3137 * time) + 0.8 * np.sin(2 * np.pi * 31.37 * time)  # noqa: E731
    floor = floor_of(noisy_record(10, 0.3, 11, pole=0.9, extra=lambda time, _: 0.05 * time + lines(time)))
    assert sorted(text.split()[0] for text, _ in floor.structured) == ["drift:", "off-grid", "off-grid"]
    assert floor.rms == pytest.approx(0.3, rel=0.1)


def test_line_between_lines_of_input_has_frequency_and_amplitude():
    floor = floor_of(noisy_record(10, 0.1, 3, extra=lambda t, _: 0.5 * np.sin(2 * np.pi * 2.2871 * t + 1)))
    assert re.search(r"line.*\b2\.287 Hz\b.*\b0\.50", floor.structured[0][0])
    repeated = floor_of(noisy_record(10, 0.1, 3, extra=lambda t, _: 0.5 * np.sin(2 * np.pi * 2.2 * t)))
    assert repeated.structured == ()
    assert repeated.rms == pytest.approx(0.1, rel=0.03)


def test_response_to_deviations_of_input_is_not_noise():
    position = multisine(10, seed=1)
    moved = position + 0.01 * np.std(position) * noise(len(position), 2, 0.8)
    floor = floor_of(record(moved, relaxing_force(moved) + 0.01 * noise(len(position), 3)))
    assert floor.rms == pytest.approx(0.01, rel=0.15)


def test_noise_of_position_sensor_does_not_change_floor():
    position = multisine(10, seed=1)
    measured = position + 0.005 * np.std(position) * noise(len(position), 2)
    floor = floor_of(record(measured, relaxing_force(position) + 0.3 * noise(len(position), 3)))
    assert floor.rms == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_spectrum_has_variance_and_colour_of_noise(pole):
    floors = [floor_of(noisy_record(10, 0.3, seed, pole), period=5.0) for seed in range(20)]
    frequency, density = floors[0].spectrum[0], np.mean([floor.spectrum[1] for floor in floors], axis=0)
    variance = np.mean([floor.rms**2 for floor in floors])
    assert np.sum(density) * frequency[1] == pytest.approx(variance, rel=0.01)
    angle = 2 * np.pi * frequency * STEP
    process = 2 * STEP * 0.09 * (1 - pole**2) / np.abs(1 - pole * np.exp(-1j * angle)) ** 2
    for band in ((0.5, 1.5), (3, 5), (10, 20), (30, 45)):
        inside = (frequency > band[0]) & (frequency < band[1])
        assert density[inside].mean() == pytest.approx(process[inside].mean(), rel=0.1)
        smooth = np.mean([floor.density(frequency[inside]) for floor in floors])
        assert smooth == pytest.approx(process[inside].mean(), rel=0.15)


def test_whitening_changes_only_coloured_noise():
    floor = floor_of(noisy_record(10, 0.3, 1, 0.9), period=5.0)
    whitened = np.convolve(0.3 * noise(50_000, 77, 0.9), floor.whitening, mode="valid")
    assert np.std(whitened) == pytest.approx(0.3, rel=0.1)
    assert np.corrcoef(whitened[1:], whitened[:-1])[0, 1] == pytest.approx(0, abs=0.05)
    assert floor_of(noisy_record(10, 0.3, 1), period=5.0).whitening == pytest.approx([1.0])
    for seed in range(4):  # two periods show strong colour
        floor = floor_of(noisy_record(3, 0.3, seed, 0.97, samples=1000), period=10.0)
        whitened = np.convolve(noise(50_000, 77, 0.97), floor.whitening, mode="valid")
        assert np.corrcoef(whitened[1:], whitened[:-1])[0, 1] == pytest.approx(0, abs=0.1)


def test_error_of_few_samples_exceeds_largest_ratio_rarely():
    """RMS of short intervals of the same noise exceeds the floor by more than the ratio in about 1 of 1000."""
    for pole, most in ((0.0, 1.1), (0.97, 2.0)):
        floor = floor_of(noisy_record(10, 0.3, 3, pole, samples=1000), period=10.0)
        ratio = floor.largest_ratio(1000)
        intervals = 0.3 * noise(2_000_000, 5, pole).reshape(-1, 1000)
        exceeding = np.mean(np.sqrt(np.mean(intervals**2, axis=1)) > ratio * floor.rms)
        assert 1 < ratio < most
        assert exceeding < 0.01


@pytest.mark.nightly
def test_strong_square_wave_is_subtracted():
    """Its sinusoid spreads over the lowest lines of every period's spectrum and must not count as noise there."""
    square = lambda time, force: 6.0 * np.sign(np.sin(2 * np.pi * 0.74048 * time + 5.2))  # noqa: E731
    floor = floor_of(noisy_record(10, 0.3, 2, samples=1000, extra=square), period=10.0)
    assert floor.structured_rms == pytest.approx(6.0, rel=0.1)
    # Beyond the harmonics that are fitted the wave's edges remain.
    assert floor.rms < 2 * 0.3


@pytest.mark.parametrize(
    ("period", "message"), [(3.0, r"\b3 s\b.*\d %"), (0.01, r"\bperiod of 0\.01 s\b.*samples")]
)
def test_impossible_period_is_rejected(period, message):
    with pytest.raises(lumbar.InputError, match=message):
        floor_of(noisy_record(4, 0.1, 1), period=period)


def test_floors_of_hidden_effects(shared):
    """Compare floors with the known noise: all experiments with drift, softening or a line, and every fourth other one."""
    labels = json.loads((shared / "hidden_effects" / "labels.json").read_text())
    kinds = {"drift": "drift", "softening": "amplitude change", "periodic_disturbance": "off-grid line"}
    ratios = []
    for number, (case, label) in enumerate(labels.items()):
        if number % 4 and not kinds.keys() & set(label["effects"]):
            continue
        floor = floor_of(lumbar.read(shared / "hidden_effects" / case)["multisine"])
        ratios.append(floor.rms / label["noise_rms_N"])
        expected = [kinds[effect] for effect in label["effects"] if effect in kinds]
        assert [text.split(":")[0].split(" at ")[0] for text, _ in floor.structured] == expected, case
    assert np.abs(np.array(ratios) - 1).max() < 0.03
    assert len(ratios) >= 12


def test_floor_of_exactly_repeated_force_is_resolution_of_digits():
    position = multisine(6)
    force = np.round(np.tile(relaxing_force(position)[-500:], 6), 2)
    floor = floor_of(record(position, force))
    assert floor.exact and floor.structured == ()
    assert floor.rms == pytest.approx(0.01 / np.sqrt(12))
    assert len(floor.whitening) == 1


def drops(size: float):
    """Drop the force at random levels of the rising response; it recovers within 0.3 s."""

    def drop_samples(_, force):
        random, dropped = np.random.default_rng(8), 0.0
        level, change = 0.0, np.zeros(len(force))
        for k, value in enumerate(force):
            if value <= 0:
                dropped, level = 0.0, random.uniform(0.1, 1.0) * np.std(force)
            elif value > level:
                dropped, level = dropped + size, value + random.exponential(0.5) * np.std(force)
            dropped *= np.exp(-STEP / 0.3)
            change[k] = -dropped
        return change

    return drop_samples


@pytest.mark.parametrize("pole", [0.0, 0.6])
def test_drops_at_same_phases_are_bursts(pole):
    floor = floor_of(noisy_record(10, 0.3, 4, pole, samples=1000, extra=drops(1.5)))
    assert floor.rms == pytest.approx(0.3, rel=0.15)
    text, rms = floor.structured[0]
    assert text.startswith("bursts") and rms == pytest.approx(0.67, rel=0.1)
    assert floor.structured_rms == floor.certain_structure_rms > rms


HARMLESS = {
    "spikes": lambda time, force: (
        3.0 * noise(time.size, 5) * (np.random.default_rng(6).random(time.size) < 0.02)
    ),
    "heavy tails": lambda time, force: 0.3 * np.random.default_rng(6).standard_t(2.2, time.size),
    "noise that grows with the force": lambda time, force: 0.2 * force * noise(time.size, 5),
    "jitter": lambda time, force: 0.3 * np.gradient(force) * noise(time.size, 5),
    "drops anywhere": lambda time, force: drops(1.5)(time, noise(time.size, 5, 0.95)),
    "wandering": lambda time, force: 0.02 * np.cumsum(noise(time.size, 5)),
}


@pytest.mark.parametrize("kind", HARMLESS)
def test_short_or_random_deviations_are_not_bursts(kind):
    floor = floor_of(noisy_record(10, 0.3, 4, samples=1000, extra=HARMLESS[kind]))
    assert not any(text.startswith("bursts") for text, _ in floor.structured)


def test_noise_of_many_short_periods_is_no_structure():
    """A sine of 1 Hz at 50 Hz for a minute: more periods than samples in a period."""
    time = 0.02 * np.arange(3000)
    position, random = np.sin(2 * np.pi * time), np.random.default_rng(0)
    for _ in range(20):
        force = 1.5 * position + 0.01 * random.standard_normal(len(time))
        floor = noise_floor(record(position, force, step=0.02), 1.0)
        assert floor.changing_response_rms == 0
        assert floor.rms == pytest.approx(0.01, rel=0.06)
