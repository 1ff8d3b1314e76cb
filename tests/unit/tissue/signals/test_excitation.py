"""Excitation signals: shapes, band, limits of the machine, files and properties."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import chirp

import lumbar
from study_settings import changed

SETTINGS = lumbar.StudySettings().signals
SMALL = {"value_mm": 0.01}


def designed(band=5.0, seed=1, **changes):
    return lumbar.design_signals(band, settings=changed(SETTINGS, **changes), seed=seed)


def signals(*args, **changes):
    return {signal.name: signal for signal in designed(*args, **changes).excitation.signals}


def multisine(band=5.0, seed=1, **options):
    return designed(band, seed, multisine=options, amplitude=SMALL).excitation.multisine


def band_of(folder, value):
    """Band that follows from a file of bandwidths."""
    entry = {"value_Hz": value, "low_Hz": None, "high_Hz": None}
    rules = {"power_share": entry, "level": entry}
    (folder / "bandwidth.json").write_text(json.dumps({"position": rules, "velocity": rules}))
    return lumbar.design_signals(folder / "bandwidth.json").band_Hz


@pytest.mark.parametrize(
    ("bandwidth", "band"), [(2.5, 5.0), (2.38, 5.0), (2.62, 5.0), (2.3, 4.5), (0.7, 1.5)]
)
def test_band_is_rounded_multiple_of_bandwidth(tmp_path, bandwidth, band):
    assert band_of(tmp_path, bandwidth) == pytest.approx(band)


@pytest.mark.parametrize(
    ("bandwidth", "tokens"),
    [(None, r"signals\.bandwidth: .*'power_share'"), (0.01, r"\b0 Hz"), (30.0, r"\b60 Hz")],
)
def test_impossible_band_is_rejected(tmp_path, bandwidth, tokens):
    with pytest.raises(lumbar.InputError, match=tokens):
        band_of(tmp_path, bandwidth)


def test_default_signals_are_those_of_thesis():
    default = signals()
    lengths = {name: len(signal.position) for name, signal in default.items()}
    assert lengths == {"multisine": 10_000, "noise": 1000, "chirp": 1000}
    time, k = np.arange(10_000) / 100, np.arange(1, 51)
    phases = -np.pi * k * (k - 1) / 50
    sum_of_cosines = (2.0 / 5.0) * np.cos(2 * np.pi * np.outer(time, k / 10) + phases).sum(axis=1)
    np.testing.assert_allclose(default["multisine"].position, sum_of_cosines, atol=1e-9)
    np.testing.assert_allclose(default["multisine"].time, time)


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_amplitude_is_required_rms_or_peak(value):
    for signal in signals(amplitude={"measure": "rms", "value_mm": value}).values():
        assert np.sqrt(np.mean(signal.steady**2)) == pytest.approx(value)
    design = designed(amplitude={"measure": "peak", "value_mm": value})
    for signal in design.excitation.signals:
        assert 0.98 * value < np.abs(signal.position).max() <= value * (1 + 1e-9)
    assert design.table.frame["peak_displacement_mm"].to_numpy() == pytest.approx(value, rel=1e-3)


def test_power_is_in_band():
    share = {name: signal.band_power_share(5.0) for name, signal in signals().items()}
    assert share["multisine"] == pytest.approx(1)
    assert signals()["multisine"].band_power_share(2.5) == pytest.approx(0.5)
    assert 0.95 < share["noise"] < 1 and 0.95 < share["chirp"] < 1


@pytest.mark.parametrize("samples", [1000, 1001])
def test_line_amplitudes_obey_parseval(samples):
    values = np.random.default_rng(1).standard_normal(samples)
    signal = replace(signals()["noise"], position=values, window=(0.0, samples / 100))
    _, amplitude = signal.line_amplitudes()
    power = np.sum(amplitude**2) / 2
    if samples % 2 == 0:  # the line at half the rate is a cosine sampled at its peaks: its power is A²
        power += amplitude[-1] ** 2 / 2
    assert power == pytest.approx(np.var(values))


def test_ramp_starts_and_ends_at_rest_and_keeps_later_periods():
    plain, ramped = signals(), signals(ramp_s=1.0)
    for name, signal in ramped.items():
        assert signal.position[0] == 0
        assert abs(signal.position[1] - signal.position[0]) < 0.01
        np.testing.assert_array_equal(signal.position[100:900], plain[name].position[100:900])
    assert ramped["noise"].position[-1] == ramped["chirp"].position[-1] == 0
    np.testing.assert_array_equal(ramped["multisine"].position[100:], plain["multisine"].position[100:])


@pytest.mark.parametrize(
    ("band", "change", "tokens"),
    [
        (5.0, {"ramp_s": 6}, r"signals\.ramp_s .*\b6 s\b.*\bnoise .*10 s"),
        (
            5.0,
            {"machine": {"velocity_mm_s": 50}},
            r"multisine: .*\n.*noise: .*\n.*chirp: .*velocity .*8\d\.\d+ mm/s.*50 mm/s.*signals\.machine",
        ),
        (49.0, {"noise": {"filter_order": 2}}, r"49 Hz.*61\.0\d+ Hz.*50 Hz.*signals\.rate_Hz"),
        (5.0, {"chirp": {"lowest_Hz": 5.0}}, r"\b5 to 5 Hz.*signals\.chirp\.lowest_Hz"),
        (5.0, {"chirp": {"lowest_Hz": 6.0}}, r"\b6 to 5 Hz.*signals\.chirp\.lowest_Hz"),
        (50.0, {}, r"\bband .*\b50 Hz.*\b0 .*50 Hz"),
        (0.05, {}, r"10 s .*0\.05 Hz.*signals\.multisine\.period_s"),
        (
            5.0,
            {"multisine": {"period_s": 1.0, "grid": "odd"}},
            r"\bodd\b.*\b1 s\b.*\b3\b.*\b5 Hz.*\b8\b.*signals\.multisine\.detection_group",
        ),
        (
            5.0,
            {"multisine": {"period_s": 10.005}},
            r"signals\.multisine\.period_s .*10\.005 s.*1000\.5\b.*100 Hz",
        ),
    ],
)
def test_impossible_signals_are_rejected(band, change, tokens):
    with pytest.raises(lumbar.InputError, match=tokens):
        designed(band, **change)


def test_machine_file_repeats_signal_to_nanometre():
    design = designed()
    text = dict(design.files())["noise.csv"].to_csv(index=False)
    assert text.startswith("time_s,position_mm\n0.0,")
    read = pd.read_csv(io.StringIO(text))
    np.testing.assert_allclose(read.position_mm, design.excitation.signals[1].position, atol=5.1e-7)
    assert np.diff(read.time_s) == pytest.approx(0.01, abs=1e-12)


def test_description_rebuilds_multisine():
    design = designed(multisine={"grid": "odd", "phases": "clipped", "amplitude_exponent": -0.5})
    content = dict(design.files())["multisine.json"]
    time = np.arange(1000) / 100
    lines = zip(content["amplitude_mm"], content["frequency_Hz"], content["phase_rad"], strict=True)
    rebuilt = sum(a * np.cos(2 * np.pi * f * time + p) for a, f, p in lines)
    np.testing.assert_allclose(design.excitation.signals[0].position[:1000], rebuilt, atol=1e-9)
    even, odd = (np.array(content["detection_lines"][name]) for name in ("even", "odd"))
    assert not (even % 2).any() and (odd % 2).all()
    assert not set(content["lines"]) & {*even, *odd}


def test_properties_of_default_signals():
    table = designed().table
    frame = table.frame.set_index("signal")
    assert any("2 mm" in note and "order 8" in note for note in table.notes)
    assert frame.loc["multisine", "crest_factor"] == pytest.approx(1.72, abs=0.005)
    speed = frame.loc["chirp", "peak_displacement_mm"] * 2 * np.pi * 5
    assert frame.loc["chirp", "peak_velocity_mm_s"] == pytest.approx(speed, rel=0.02)
    assert frame.loc["multisine", "start_jump_mm"] == frame.loc["chirp", "start_jump_mm"] == 0
    assert (frame.rms_mm - 2).abs().max() < 1e-12


@pytest.mark.parametrize(("duration", "lowest", "highest"), [(10, 0.0, 5.0), (10, 0.5, 5.0), (60, 0.1, 20.0)])
def test_chirp_is_linear_chirp_of_scipy(duration, lowest, highest):
    time = np.arange(duration * 100) / 100
    expected = chirp(time, f0=lowest, t1=duration, f1=highest, method="linear", phi=-90)
    options = {"duration_s": duration, "lowest_Hz": lowest}
    position = signals(highest, chirp=options, amplitude=SMALL)["chirp"].position
    scale = 0.01 / np.sqrt(np.mean(expected**2))
    np.testing.assert_allclose(position / scale, expected, atol=1e-9)


def test_crest_factors_of_fifty_flat_lines():
    """Zero phases: peak 50 A over RMS 5 A. Schroeder's 1.72 and the clipped 1.40 are measured elsewhere."""
    crest = {rule: multisine(phases=rule).crest_factor for rule in ("zero", "schroeder", "clipped")}
    assert crest["zero"] == pytest.approx(10)
    assert crest["schroeder"] == pytest.approx(1.72, abs=0.005)
    assert 1.37 < crest["clipped"] <= 1.45  # the best known is 1.37


@pytest.mark.parametrize(
    "options", [{"grid": "odd"}, {"amplitude_exponent": -0.5}, {"amplitude_exponent": 1.0, "grid": "odd"}]
)
def test_clipping_keeps_amplitudes_and_lowers_crest_factor(options):
    schroeder, clipped = multisine(seed=3, **options), multisine(seed=3, **options, phases="clipped")
    np.testing.assert_array_equal(clipped.amplitudes, schroeder.amplitudes)
    assert clipped.crest_factor < min(schroeder.crest_factor, 1.65)
    spectrum = 2 / 1000 * np.abs(np.fft.rfft(clipped.sampled(100.0, 1)))
    np.testing.assert_allclose(spectrum[clipped.lines], clipped.amplitudes, rtol=1e-9)
    assert np.delete(spectrum, clipped.lines).max() < 1e-12


def test_odd_grid_leaves_one_line_out_of_every_group():
    odd = {"grid": "odd", "detection_group": 4}
    design = multisine(seed=7, **odd)
    left_out = design.detection_odd
    np.testing.assert_array_equal(design.detection_even, np.arange(2, 51, 2))
    np.testing.assert_array_equal(np.union1d(design.lines, left_out), np.arange(1, 51, 2))
    assert len(np.intersect1d(design.lines, left_out)) == 0
    groups = np.arange(1, 49, 2).reshape(6, 4)
    assert [np.isin(group, left_out).sum() for group in groups] == [1] * 6
    np.testing.assert_array_equal(left_out, multisine(seed=7, **odd).detection_odd)
    assert len({tuple(multisine(seed=seed, **odd).detection_odd) for seed in range(20)}) > 15


def test_band_just_below_line_by_rounding_includes_it():
    assert len(multisine(0.1 * 3).lines) == 3
    assert len(multisine(0.7 - 1e-12).lines) == 7
