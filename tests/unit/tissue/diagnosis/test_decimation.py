"""Long and fast records are brought to what a diagnosis can afford, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from lumbar.settings.tissue import TissueSettings
from lumbar.tissue.diagnosis.fitting.decimation import ENOUGH, MOST, limit_samples


def at(rate, position, force, name="fast"):
    found = record(position, force, name)
    return replace(found, time=np.arange(len(position)) / rate)


def slow(samples, seed=0):
    """Position whose band ends at a hundredth of the rate."""
    lines = np.arange(1, samples // 100 + 1)[:40]
    return multisine(1, samples, lines * (samples // 100 // len(lines)), seed)


def test_records_that_are_few_enough_stay_the_very_same():
    given = [record(multisine(10), multisine(10)), record(slow(5000), slow(5000), "other")]
    kept, findings = limit_samples(given)
    assert findings == () and all(one is other for one, other in zip(kept, given, strict=True))


def test_a_fast_record_of_a_slow_motion_is_thinned_and_told():
    position = slow(2 * MOST)
    (lower,), (told,) = limit_samples([at(5000, position, relaxing_force(position))])
    assert told.kind == "decimated" and told.record == "fast"
    factor = round(5000 / told.value)
    assert 2 <= factor <= 2 * MOST / ENOUGH
    assert f"one sample in {factor}" in told.sentence and "of 5000 Hz" in told.sentence
    assert 1 / lower.sampling_time == pytest.approx(told.value)
    assert np.array_equal(lower["output"], relaxing_force(position)[::factor])


def test_a_lower_rate_divides_the_period():
    position = multisine(90, 2500, np.arange(1, 11))
    (lower,), (told,) = limit_samples([at(1000, position, position)])
    assert told.kind == "decimated"
    assert 2.5 / lower.sampling_time == pytest.approx(round(2.5 / lower.sampling_time))


def test_a_motion_that_needs_its_rate_keeps_it_and_only_what_is_too_long_is_cut():
    wide = noise(3 * MOST, 1)
    short = noise(2000, 2)
    (long, same), (told,) = limit_samples([at(1000, wide, wide), at(1000, short, short, "short")])
    assert told.kind == "shortened" and len(same) == 2000 and len(long) == MOST - 2000
    assert f"first {(MOST - 2000) / 1000:g} s of {3 * MOST / 1000:g} s" in told.sentence
    assert np.array_equal(long["input"], wide[: len(long)])


def test_a_large_table_is_read_as_every_small_one(tmp_path, monkeypatch):
    from lumbar.records import columns

    rows = np.column_stack([np.arange(500) * 0.01, noise(500, 1) * 1e-3, noise(500, 2) * 1e5])
    path = tmp_path / "table.csv"
    np.savetxt(path, rows, delimiter=",", header="time_s,position_mm,force_N", comments="", fmt="%.17g")
    careful = lumbar.read(path)["table"]
    monkeypatch.setattr(columns, "_LARGE", 0)
    monkeypatch.setattr(columns, "_WORTH_IT", 0)
    assert columns._read_plain_table(path, TissueSettings().layout) is not None
    fast = lumbar.read(path)["table"]
    assert all(np.array_equal(fast[role], careful[role]) for role in ("input", "output"))
    path.write_text(path.read_text().replace("\n0.01,", "\n# note\n0.01,", 1))
    assert columns._read_plain_table(path, TissueSettings().layout) is None
