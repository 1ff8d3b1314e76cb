"""Records to which no model can be fitted, and records that are too long: rejected, accepted or shortened."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from column_files import write_columns, write_records

STEP = 0.01
MAX_SAMPLES, ENOUGH_SAMPLES = 150_000, 15_000


def motion(seconds: float, seed: int = 1, lines=range(1, 41), period: float = 10.0) -> np.ndarray:
    time = np.arange(round(seconds / STEP)) * STEP
    lines = np.asarray(lines)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    wave = np.cos(2 * np.pi * np.outer(time, lines / period) + phases).sum(axis=1)
    return 3.0 * wave / np.abs(wave).max()


def force_of(position: np.ndarray, seed: int = 9) -> np.ndarray:
    return 0.8 * position + 0.02 * np.random.default_rng(seed).standard_normal(len(position))


def write(folder, **records) -> None:
    write_records(folder, [record(*signals, name) for name, signals in records.items()], "%.6f")


GOOD = motion(40.0)
OTHER = motion(12.0, 2)
NOISE = np.random.default_rng(5).standard_normal(len(GOOD))


def bad_training() -> dict[str, tuple]:
    """Training record by its fault, and words of the message."""
    force, is_bad = force_of(GOOD), np.arange(len(GOOD)) == 100
    return {
        "constant input": (np.full(len(GOOD), 1.0), force, "cannot predict b"),
        "constant output": (GOOD, np.full(len(GOOD), 2.0), "output: constant (2)"),
        "not a number": (GOOD, np.where(is_bad, np.nan, force), "line 102: output is nan"),
        "too large": (GOOD, np.where(is_bad, 1e308, force), "line 102: output is 1e+308"),
        "clipped force": (GOOD, np.clip(force, -1.5, 1.5), "output: clipped: "),
        "clipped position": (np.clip(GOOD, -1.5, 1.5), force, "input: clipped: "),
        "no motion": (5e-4 * NOISE, 0.02 * NOISE[::-1], "cannot predict b"),
        "other unit of position": (1e-3 * GOOD, force, "their units seem to differ"),
        "other unit of force": (GOOD, 1e3 * force, "their units seem to differ"),
        "only noise": (GOOD, 0.02 * NOISE, "nothing can be fitted to it"),
    }


@pytest.mark.parametrize(
    ("command", "fault"),
    [
        *(("diagnose", fault) for fault in bad_training()),
        *((command, "clipped force") for command in ("compare", "locate", "refine")),
    ],
)
def test_invalid_training_record_is_rejected(run, tmp_path, command, fault):
    position, force, words = bad_training()[fault]
    write(tmp_path / "in", a=(position, force), b=(OTHER, force_of(OTHER)))
    options = ("--add", "quadratic_stiffness") if command == "refine" else ()
    status, out, err = run(command, tmp_path / "in", "--train", "a", "--output", tmp_path / "out", *options)
    assert (status, out) == (1, "")
    assert words in err and "a.csv" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("part", [slice(None), slice(900, 2100), slice(3000, None)], ids=str)
def test_copy_of_training_record_is_rejected(run, tmp_path, part):
    force = force_of(GOOD)
    ending = slice(None) if part.start != 3000 else slice(700)
    pairs = ((GOOD, OTHER), (force, force_of(OTHER)))
    write(
        tmp_path / "in",
        a=(GOOD, force),
        b=[np.concatenate([item[part], other[ending]]) for item, other in pairs],
    )
    err = run.refused("diagnose", tmp_path / "in", "--train", "a", "--output", tmp_path / "out")
    assert re.search(r"\bb\.csv: .*\d s .*\ba\.csv\b.*\d s", err)


def test_equal_rests_and_repeated_motions_are_not_copies(run, tmp_path):
    rest = np.zeros(100)
    still = [(np.concatenate([rest, GOOD]), np.concatenate([rest, force_of(GOOD, seed)])) for seed in (9, 8)]
    write(tmp_path / "again", a=still[0], b=still[1])
    run.done("compare", tmp_path / "again", "--output", tmp_path / "out")


def test_small_motions_at_several_depths_are_accepted(run, tmp_path):
    depths = {depth: depth + 0.03 * GOOD for depth in (2, 4, 8)}
    records = {f"depth_{depth}": (position, force_of(position, depth)) for depth, position in depths.items()}
    write(tmp_path / "in", **records)
    run.done("compare", tmp_path / "in", "--output", tmp_path / "out")


def test_clipped_records_can_be_accepted(run, tmp_path):
    write(tmp_path / "in", a=(GOOD, np.clip(force_of(GOOD), -1.5, 1.5)), b=(OTHER, force_of(OTHER)))
    study = tmp_path / "study.yaml"
    study.write_text(yaml.safe_dump({"tissue": {"layout": {"clipped": "accept"}}}))
    run.done("compare", tmp_path / "in", "--output", tmp_path / "out", "--config", study)


@pytest.mark.parametrize(
    "force",
    [
        pytest.param(np.clip(0.8 * GOOD, -1.5, 1.5) + 0.02 * NOISE, id="limited by the tissue, noise on top"),
        pytest.param(np.round(0.8 * GOOD + 0.02 * NOISE, 1), id="coarse converter"),
        pytest.param(np.round(0.8 * np.sin(np.arange(4000) / 50), 2), id="sine of few digits"),
        pytest.param(0.8 * GOOD, id="without noise"),
    ],
)
def test_force_that_is_not_clipped_is_accepted(tmp_path, force):
    write(tmp_path, a=(GOOD, force))
    assert lumbar.read(tmp_path).names == ["a"]


@pytest.mark.parametrize("slows", ["jerk", "acceleration"])
@pytest.mark.parametrize("speeds", [(1.0,), (0.3, 1.0, 2.5)])
def test_position_that_comes_to_rest_is_not_clipped(tmp_path, slows, speeds):
    """Ramps of many speeds that end at 0 mm, slowed down at limited jerk or limited acceleration."""
    share = np.linspace(0, 1, 200)
    smooth = {
        "jerk": share**3 * (10 - 15 * share + 6 * share**2),
        "acceleration": np.where(share < 0.5, 2 * share**2, 1 - 2 * (1 - share) ** 2),
    }
    parts = [np.zeros(50)]
    for number in range(6):
        stroke = np.interp(np.arange(0, 1, speeds[number % len(speeds)] / 150), share, smooth[slows])
        parts += [2 * stroke, np.full(60, 2.0), 2 * stroke[::-1], np.zeros(40)]
    position = np.concatenate(parts)
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(position))
    write(tmp_path, a=(position, force_of(position) + noise))
    assert lumbar.read(tmp_path).names == ["a"]


def test_effect_that_record_does_not_excite_is_rejected():
    """On one sine a mass is a negative spring, which the base cannot be distinguished from."""
    sine = motion(40.0, lines=[10])
    other = record(motion(12.0, 4), force_of(motion(12.0, 4)), "b")
    with pytest.raises(lumbar.InputError, match=r"^a: .*\binertia\b"):
        lumbar.refine([record(sine, force_of(sine), "a"), other], ["inertia"], train="a")
    rich = [record(GOOD, force_of(GOOD), "a"), other]
    assert lumbar.refine(rich, ["inertia"], train="a").effects == ("inertia",)


def test_force_that_explodes_at_high_speed_is_not_in_other_unit():
    """Slow motion shows the unit: there the force is as in any other record."""
    time = np.arange(0, 20, STEP)
    slow = 5 * np.sin(2 * np.pi * 0.2 * time)
    fast = 5 * np.sin(2 * np.pi * (0.1 * time + 0.12 * time**2))
    records = []
    for name, position in (("slow", slow), ("fast", fast)):
        speed = np.gradient(position, STEP)
        records.append(record(position, position + 0.01 * np.sinh(speed / 10.0), name))
    assert np.std(records[1]["output"]) > 300 * np.std(records[0]["output"])
    for train in ("slow", "fast"):
        assert lumbar.refine(records, [], base="LE", train=train).experiment.training.name == train


def limited(*records, rate):
    """Findings on records that are too long, and the used records."""
    at_rate = [replace(item, time=np.arange(len(item)) / rate) for item in records]
    refined = lumbar.refine(at_rate, [], base="LE")
    return refined.findings, refined.records


def slow(samples, seed=0):
    """Position whose band ends at a hundredth of the rate."""
    lines = np.arange(1, samples // 100 + 1)[:40]
    return multisine(1, samples, lines * (samples // 100 // len(lines)), seed)


def test_fast_record_of_slow_motion_is_decimated():
    position = slow(2 * MAX_SAMPLES)
    (finding,), (lower,) = limited(record(position, relaxing_force(position), "fast"), rate=5000)
    assert finding.kind == "decimated" and finding.record == "fast"
    factor = round(5000 / finding.value)
    assert 2 <= factor <= 2 * MAX_SAMPLES / ENOUGH_SAMPLES
    assert 1 / lower.sampling_time == pytest.approx(finding.value)
    assert np.array_equal(lower["output"], relaxing_force(position)[::factor])


def test_lower_rate_divides_period():
    position = multisine(90, 2500, np.arange(1, 11))
    (finding,), (lower,) = limited(record(position, position), rate=1000)
    assert finding.kind == "decimated"
    assert 2.5 / lower.sampling_time == pytest.approx(round(2.5 / lower.sampling_time))


def test_wide_band_keeps_rate_and_only_long_record_is_cut():
    wide, short = noise(3 * MAX_SAMPLES, 1), noise(2000, 2)
    (finding,), (long, same) = limited(record(wide, wide, "long"), record(short, short, "short"), rate=1000)
    assert finding.kind == "shortened" and len(same) == 2000 and len(long) == MAX_SAMPLES - 2000
    assert finding.value == long.duration and finding.unit == "s"
    assert np.array_equal(long["input"], wide[: len(long)])


def test_large_table_is_read_like_line_by_line(tmp_path):
    path = tmp_path / "table.csv"
    position, force = noise(5000, 1) * 1e-3, noise(5000, 2) * 1e5
    write_columns(path, time_s=np.arange(5000) * 0.01, position_mm=position, force_N=force)
    in_one_pass = lumbar.read(path)["table"]
    path.write_text(path.read_text().replace("\n0.01,", "\n\n0.01,", 1))
    line_by_line = lumbar.read(path)["table"]
    for role in ("input", "output"):
        np.testing.assert_array_equal(in_one_pass[role], line_by_line[role])
