"""Differences of two forces in units of what a hand can tell: pairs of which the thresholds themselves say the answer."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from scipy.stats import norm

from lumbar.base.errors import InputError
from lumbar.records.importing.raw_table import find_unit
from lumbar.settings.perception import PerceptionSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.study.load_study import load_settings
from lumbar.tissue.perception.felt import (
    Difference,
    force_difference,
    noise_in_bands,
    split_bands,
    turning_points,
)
from lumbar.tissue.perception.thresholds import NEWTONS, Hands, thresholds_table

RATE = 1000.0
TIME = np.arange(0, 20, 1 / RATE)
POSITION = 5 * np.sin(2 * np.pi * 0.7 * TIME)
FORCE = 4 + 0.4 * POSITION
HANDS = Hands.of()


def felt(difference, reference=FORCE, hands=HANDS, **more):
    return Difference(reference, difference, POSITION, 1 / RATE, hands, **more).felt


@pytest.mark.parametrize("gain", [0.05, 0.1, 0.2])
def test_a_gain_is_felt_as_its_share_of_the_weber_fraction(gain):
    found = felt(gain * FORCE)
    for value, weber in zip(found.jnd, (0.07, 0.13, 0.043), strict=True):
        assert value == pytest.approx(gain / weber, rel=0.01)
    assert found.told_apart_percent.value == pytest.approx(100 * norm.cdf(gain / 0.07 / np.sqrt(2)), abs=0.5)
    assert found.time_percent.value == (100 if gain > 0.08 else 0)
    assert found.fast.value < 0.01 * found.slow.value


def test_small_forces_are_told_by_the_floor():
    weak = 0.01 * FORCE
    assert felt(np.full(TIME.size, 0.08), weak).jnd.value == pytest.approx(0.08 / 0.04, rel=0.01)
    assert {unit: find_unit(unit).factor for unit in NEWTONS} == pytest.approx(NEWTONS)
    scaled = force_difference(1e3 * weak, 1e3 * (weak + 0.08), "mN", POSITION, 1 / RATE, HANDS)
    assert scaled.felt.jnd.value == pytest.approx(2, rel=0.01)
    assert force_difference(weak, weak, "mm", POSITION, 1 / RATE, HANDS) is None


@pytest.mark.parametrize(("frequency", "part", "threshold"), [(8, "slow", None), (200, "fast", 0.013)])
def test_hum_is_told_by_the_sense_of_its_frequency(frequency, part, threshold):
    found = felt(0.1 * np.sin(2 * np.pi * frequency * TIME))
    steady = np.full(TIME.size, 4.0)
    alone = felt(0.1 * np.sin(2 * np.pi * frequency * TIME), steady)
    expected = 0.1 / np.sqrt(2) / (threshold or 0.07 * 4)
    assert getattr(alone, part).value == pytest.approx(expected, rel=0.02)
    assert getattr(found, part).value > 5 * getattr(found, "fast" if part == "slow" else "slow").value
    assert (
        felt(0.1 * np.sin(2 * np.pi * 480 * TIME)).jnd.value
        < 0.2 * felt(0.1 * np.sin(2 * np.pi * 200 * TIME)).jnd.value
    )


def test_friction_and_delay_of_known_size():
    velocity = np.gradient(POSITION)
    friction = felt(0.3 * np.sign(velocity))
    threshold = np.sqrt(np.mean(np.maximum(0.07 * np.abs(FORCE), 0.04) ** -2.0))
    # A step's fast part is the other sense's.
    assert friction.slow.value == pytest.approx(0.3 * threshold, rel=0.2)
    assert friction.told_apart_percent.low > 80
    heavy, omega = 40 + 0.4 * POSITION, 2 * np.pi * 0.7
    late = felt(40 + 2 * np.sin(omega * (TIME - 0.015)) - heavy, heavy)
    assert late.jnd.value == pytest.approx(0.015 * omega * 2 / np.sqrt(2) / (0.07 * 40), rel=0.01)


def test_noise_of_a_sensor_is_not_felt():
    noise = 0.1 * np.random.default_rng(1).standard_normal(TIME.size)
    lines = np.fft.rfftfreq(TIME.size, 1 / RATE)
    known = noise_in_bands(lines, np.full(lines.size, 2 * 0.1**2 / RATE))
    assert felt(noise).jnd.value > 5
    assert felt(noise, noise=known).jnd.value < 0.3
    assert felt(0.1 * FORCE + noise, noise=known).jnd.value == pytest.approx(
        felt(0.1 * FORCE).jnd.value, rel=0.05
    )


def test_an_interval_holds_its_value_where_single_hands_feel_nothing():
    # Beside the weak force there is less than the noise, which the keenest hand, its floor low, weighs most.
    loud = np.clip(np.sin(2 * np.pi * TIME / 20), 0.0, None)
    hum = 0.6 * loud * np.sin(2 * np.pi * 5 * TIME)
    met = Difference(0.02 + 6 * loud, hum, POSITION, 1 / RATE, HANDS, noise=(0.001, 0.0))
    assert met.felt.slow.low == 0 < met.felt.slow.value
    for name in ("jnd", "slow", "fast", "time_percent", "told_apart_percent"):
        found = getattr(met.felt, name)
        assert found.low <= found.value <= found.high, name


def test_bands_are_those_of_a_butterworth_filter_without_its_phase():
    signal = np.random.default_rng(2).standard_normal(TIME.size)
    slow, fast = split_bands(signal, 1 / RATE)
    other = sosfiltfilt(
        butter(4, 20, fs=RATE, output="sos"), signal
    )  # twice: the same power as order 8 once, nearly
    assert np.corrcoef(slow, other)[0, 1] > 0.99
    bounds = noise_in_bands(np.linspace(0, 500, 5001), np.full(5001, 2 / RATE))
    assert [np.mean(slow**2), np.mean(fast**2)] == pytest.approx(bounds, rel=0.1)
    # Power between frequencies adds up to the whole.
    whole = Difference(FORCE, signal, POSITION, 1 / RATE, HANDS)
    parts = [whole.jnd_between(low, low + 100).value for low in range(0, 500, 100)]
    threshold = whole.jnd_between(0, 501).value
    assert np.sqrt(np.sum(np.square(parts))) == pytest.approx(threshold)


def test_strokes_end_where_the_motion_turns_not_where_it_trembles():
    trembling = POSITION + 0.02 * np.random.default_rng(3).standard_normal(TIME.size)
    turns = turning_points(trembling, 0.5)
    assert len(turns) == 28
    assert np.abs(np.abs(POSITION[turns]) - 5).max() < 0.05


def test_thresholds_of_a_study_stand_before_those_of_the_literature(tmp_path):
    dull = Hands.of(PerceptionSettings(force_weber=(0.1, 0.14, 0.2)))
    assert felt(0.14 * FORCE, hands=dull).jnd.value == pytest.approx(1, rel=0.01)
    assert dull.usual.vibration_weber == HANDS.usual.vibration_weber
    (tmp_path / "own.yaml").write_text("perception: {force_weber: [0.1, 0.05, 0.2], window_s: [0.1, 0.2]}\n")
    with pytest.raises(
        InputError,
        match=r"own.yaml, line 1: perception.force_weber: 0.1, 0.05, 0.2 do not ascend; allowed: list of 3",
    ) as raised:
        load_settings(tmp_path / "own.yaml")
    assert "perception.window_s" in str(raised.value)
    assert StudySettings().perception.force_weber is None


def test_every_threshold_has_a_source():
    frame = thresholds_table().frame
    assert {"force_weber", "force_floor_N", "vibration_weber", "vibration_floor_N", "window_s"} <= set(
        frame["key"]
    )
    assert frame["source"].str.len().min() > 10
