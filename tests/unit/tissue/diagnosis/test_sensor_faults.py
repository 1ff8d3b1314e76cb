"""Sensors that stick, repeat, drift, stand off zero or measure acceleration roughly: found, said and mended."""

import tracemalloc
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from fine_tissue import branch, experiment
from periodic_records import record as recorded
from scipy.signal import lfilter

from case_tables import cases
from lumbar.records.columns import read_record
from lumbar.records.record import Record
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.fitting.uncertainty import zero_interval
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.refine import fitted_model
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair, sensor_faults
from lumbar.tissue.models.motion import Motion
from sensor_records import clean_records, tissue_record

EFFECTS = ("none", "hardening", "coulomb")


def kinds(record: Record) -> list[str]:
    return [finding.kind for finding in sensor_faults(record)]


@pytest.mark.statistical
def test_sound_records_are_not_accused_and_come_back_as_they_are():
    accused = Counter()
    for record in clean_records(100, seed=7):
        found = sensor_faults(record)
        accused.update(finding.kind for finding in found)
        if not found:
            assert repair([record])[0][0] is record
    assert not accused


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize(
    ("kind", "fault", "size", "told", "value"),
    cases(__file__, "rough"),
)
def test_a_rough_position_is_told_with_its_size(kind, fault, size, told, value, effect):
    found = sensor_faults(tissue_record(kind, effect, fault=fault, size=size, seed=3))
    assert [finding.kind for finding in found] == [told]
    assert found[0].value == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("size", [2e-5, -1.5e-4])
def test_the_skew_of_two_clocks(size):
    record = tissue_record("multisine", "hardening", fault="skew", size=size, seconds=100.0, seed=2)
    (found,) = sensor_faults(record)
    assert found.kind == "clock_skew"
    assert found.value == pytest.approx(-1e6 * size, abs=1.0)
    even = repair([record])[0][0]
    # Repaired, the force repeats with the position again: its last period is its second one but for noise.
    period = round(10.0 / record.sampling_time)
    before, after = (
        np.std(item["output"][-period:] - item["output"][period : 2 * period]) for item in (record, even)
    )
    sound = tissue_record("multisine", "hardening", seconds=100.0, seed=2)
    usual = np.std(sound["output"][-period:] - sound["output"][period : 2 * period])
    assert after < 1.05 * usual < before


@pytest.mark.parametrize("effect", ["softening", "thinning", "drift", "disturbance"])
def test_a_tissue_that_changes_is_no_skew(effect):
    assert kinds(tissue_record("multisine", effect, seconds=60.0, seed=4)) == []


def test_lost_rows_are_put_back_where_they_were():
    sound = tissue_record("multisine", "hardening", seconds=40.0, seed=5)
    lost = [400, 1203, 1204, 2900]
    kept = np.setdiff1d(np.arange(len(sound)), lost)
    short = replace(sound, time=sound.time[: len(kept)]).with_values(
        input=sound["input"][kept], output=sound["output"][kept]
    )
    (found,) = sensor_faults(short)
    assert (found.kind, found.value) == ("dropped_samples", 4)
    whole = repair([short])[0][0]
    assert whole.filled == tuple(lost)
    np.testing.assert_allclose(whole.time, sound.time, atol=1e-9)
    np.testing.assert_array_equal(whole["output"][kept], sound["output"][kept])
    assert np.abs(whole["input"] - sound["input"]).max() < 0.01 * np.ptp(sound["input"])


@pytest.mark.parametrize("role", ["input", "output"])
def test_held_samples_are_counted_and_filled_in(role):
    sound = tissue_record("multisine", "coulomb", seconds=40.0, seed=6)
    values, starts = sound[role].copy(), np.arange(101, 3900, 211)
    for start in starts:
        values[start + 1 : start + 3] = values[start]
    record = sound.with_values(**{role: values})
    (found,) = sensor_faults(record)
    assert (found.kind, found.value) == ("held_samples", 2 * len(starts))
    after = repair([record])[0][0]
    assert set(after.filled) == {*(starts + 1), *(starts + 2)}
    untouched = np.setdiff1d(np.arange(len(record)), after.filled)
    np.testing.assert_array_equal(after[role][untouched], sound[role][untouched])
    at = np.array(after.filled)
    assert np.std(after[role][at] - sound[role][at]) < 0.3 * np.std(values[at] - sound[role][at])


def test_rests_crests_and_flat_tops_are_no_held_samples():
    time = np.arange(4000) / 100.0
    stairs = np.cumsum(np.where((time * 2) % 1 < 0.7, 0.01, 0.0))  # moves, rests for 15 samples, moves on
    crest = np.sin(2 * np.pi * (time - 0.005))  # two equal samples at every crest
    for position in (stairs, crest, np.clip(crest, -0.5, 0.5)):
        force = lfilter([0.1], [1, -0.9], position) + 0.01 * np.random.default_rng(1).standard_normal(4000)
        assert not {"held_samples", "dropped_samples"} & set(kinds(recorded(position, force)))


def test_rows_that_are_missing_are_filled_and_told(tmp_path):
    sound = tissue_record("multisine", "none", seconds=20.0, seed=8)
    rows = [
        f"{t:.6f},{x:.7g},{f:.7g}"
        for t, x, f in zip(sound.time, sound["input"], sound["output"], strict=True)
    ]
    del rows[500:503], rows[900]
    file = tmp_path / "gaps.csv"
    file.write_text("\n".join(["t,x,f", *rows]) + "\n")
    columns = {"time": ("t", "time", "s"), "input": ("x", "position", "mm"), "output": ("f", "force", "N")}
    layout = ColumnLayout(
        columns={
            role: ColumnSettings(column=column, quantity=quantity, unit=unit)
            for role, (column, quantity, unit) in columns.items()
        }
    )
    record = read_record(file, layout)
    assert record.filled == (500, 501, 502, 903)
    assert len(record) == len(sound)
    (found,) = sensor_faults(record)
    assert (found.kind, found.value) == ("gap", 4)
    assert record.between(5.01, 100.0).filled == (0, 1, 402)


def test_what_is_repaired_is_nearer_to_the_true_motion():
    sound = tissue_record("multisine", "coulomb", seconds=50.0, seed=9)
    for fault, size in (("noise", 0.02), ("steps", 0.05), ("jitter", 1e-3)):
        record = tissue_record("multisine", "coulomb", seconds=50.0, seed=9, fault=fault, size=size)
        after = repair([record])[0][0]
        before, left = (np.std(item["input"] - sound["input"]) for item in (record, after))
        assert left < 0.5 * before
        ends = np.r_[0:20, len(sound) - 20 : len(sound)]
        assert np.std((after["input"] - sound["input"])[ends]) < 1.5 * before


def test_a_jitter_that_both_channels_share_is_taken_off_the_force_too():
    sound, record = (
        tissue_record("multisine", "hardening", seconds=50.0, seed=10, fault=fault, size=1e-3, quiet=1e-3)
        for fault in ("", "shared_jitter")
    )
    after = repair([record])[0][0]
    before, left = (np.std(item["output"] - sound["output"]) for item in (record, after))
    assert left < 0.65 * before


def test_a_tool_that_shakes_is_no_noise_of_its_sensor():
    """The force follows what lies beyond the excitation's band."""
    time = np.arange(4000) / 100.0
    rng = np.random.default_rng(11)
    moved = (
        np.sin(2 * np.pi * 0.7 * time)
        + np.sin(2 * np.pi * 1.9 * time + 1)
        + 0.01 * rng.standard_normal(len(time))
    )
    force = 0.4 * moved + 1e-3 * rng.standard_normal(len(time))
    assert kinds(recorded(moved, force)) == []
    measured = moved + 0.01 * rng.standard_normal(len(time))
    assert kinds(recorded(measured, force)) == []  # half of it is motion: nothing sure can be said


@pytest.mark.nightly
def test_long_records_take_little_memory():
    rng = np.random.default_rng(12)
    time = np.arange(1_000_000) / 1000.0
    position = (
        np.sin(2 * np.pi * 0.37 * time)
        + 0.5 * np.sin(2 * np.pi * 1.1 * time)
        + 1e-3 * rng.standard_normal(len(time))
    )
    force = 0.4 * np.sin(2 * np.pi * 0.37 * time) + 0.01 * rng.standard_normal(len(time))
    record = recorded(position, force, step=1e-3)
    tracemalloc.start()
    found = sensor_faults(record)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [item.kind for item in found] == ["position_noise"]
    assert peak < 300e6


def with_force(record: Record, at: dict[int, float]) -> Record:
    force = record["output"].copy()
    for sample, value in at.items():
        force[sample] = value
    return record.with_values(output=force)


def test_single_samples_beyond_all_others_are_told_and_replaced():
    sound = tissue_record("hand", "coulomb", seed=3)
    size = 2 * np.ptp(sound["output"])
    wild = with_force(sound, {400: size, 900: -3 * size})
    (found,) = sensor_faults(wild)
    assert (found.kind, found.value, found.record) == ("wild_samples", 2, wild.name)
    force = repair([wild])[0][0]["output"]
    assert force[400] == pytest.approx((sound["output"][399] + sound["output"][401]) / 2)
    untouched = np.setdiff1d(np.arange(len(force)), [400, 900])
    assert np.array_equal(force[untouched], sound["output"][untouched])


def test_a_force_that_jumps_or_strikes_often_is_not_wild():
    sound = tissue_record("hand", "none", seed=3)
    size = 2 * np.ptp(sound["output"])
    struck = with_force(sound, dict.fromkeys(range(100, len(sound), 100), size))
    blow = with_force(sound, {400: size, 401: 0.7 * size, 402: 0.3 * size})
    step = sound.with_values(output=sound["output"] + size * (np.arange(len(sound)) > 700))
    for record in (struck, blow, step):
        assert "wild_samples" not in kinds(record)


def relaxing(time, position, speed, step):
    return 1.2 * position + 0.8 * branch(position, 0.3, step)


def hardening(time, position, speed, step):
    return relaxing(time, position, speed, step) + 0.03 * position**3


def said(found) -> list:
    return [(item.record, item.value) for item in found.findings if item.kind == "force_offset"]


@pytest.mark.parametrize(
    ("tissue", "effects"),
    [(relaxing, ()), (hardening, ("hardening_stiffness",))],
    ids=["linear", "hardening"],
)
@pytest.mark.parametrize("zero", [0.5, 0.1])
def test_a_zero_hides_no_effect_and_is_none(tissue, effects, zero):
    found = diagnose(experiment(tissue, zeros=(zero, zero)))
    assert found.selected == effects
    assert found.status == ("named" if effects else "adequate")
    low, high = zero_interval(found.model.fit, found.experiment.training)
    assert low < zero < high
    assert high - low < 0.01
    model = fitted_model(found.model, found.experiment)
    assert model.output.offset == pytest.approx(zero, abs=0.005)
    told = [value for _, value in said(found)]
    assert told == ([pytest.approx(zero, abs=0.005)] if zero == 0.5 else [])


def test_records_may_have_zeros_of_their_own():
    found = diagnose(experiment(hardening, zeros=(0.3, -0.2)))
    assert (found.status, found.selected) == ("named", ("hardening_stiffness",))
    assert said(found) == [
        ("multisine", pytest.approx(0.3, abs=0.005)),
        ("other", pytest.approx(-0.2, abs=0.005)),
    ]
    assert found.model.test_rms == pytest.approx(0.01, rel=0.1)


def test_a_position_zero_beside_friction_is_no_drift():
    """The position is read 3 mm aside: spring stiffness times that is a constant in the force."""

    def rubbing(time, position, speed, step):
        return relaxing(time, position, speed, step) + 0.45 * np.tanh(speed / 0.4) + 1.2 * 3.0

    found = diagnose(experiment(rubbing))
    assert (found.status, found.selected) == ("named", ("coulomb_friction",))
    assert found.model.fit.zero == pytest.approx(3.6, abs=0.01)


@pytest.mark.nightly
def test_where_a_machine_counts_from_is_nothing_that_a_tissue_does(tmp_path):
    """A robot's foot a metre away: the same tissue, said to be counted from elsewhere, and written into the model."""
    far = [item.with_values(input=item["input"] + 1000.0) for item in experiment(hardening)]
    found = diagnose(far)
    assert (found.status, found.selected) == ("named", ("hardening_stiffness",))
    assert found.model.test_rms == pytest.approx(0.01, rel=0.1)
    assert [item.kind for item in found.findings] == ["position_offset"]
    model = fitted_model(found.model, found.experiment)
    assert model.input.offset == pytest.approx(1000.0, abs=1.0)
    np.testing.assert_allclose(model.simulate(far[0])[50:], far[0]["output"][50:], atol=0.06)
    beside = [item.with_values(input=item["input"] + 3.0) for item in experiment(hardening)]
    assert diagnose(beside).experiment.surface == 0.0


STEP, MASS, DAMPING = 1e-3, 0.09, 0.2
TIME = np.arange(20_000) * STEP
LINES = 0.4 * np.arange(1, 40, 2)


def moved_mass(noise: float, mass: float = MASS, stiffness: float = 0.0) -> Record:
    """Mass and damper under a sum of sines, with closed-form derivatives, and noise (mm) of the encoder."""
    random = np.random.default_rng(3)
    phase = random.uniform(0, 2 * np.pi, len(LINES))
    angle = 2 * np.pi * LINES * TIME[:, None] + phase
    rate, size = 2 * np.pi * LINES, 20 / (1 + LINES**2)
    position, speed = (size * np.sin(angle)).sum(axis=1), (size * rate * np.cos(angle)).sum(axis=1)
    force = stiffness * position + DAMPING * speed - mass * (size * rate**2 * np.sin(angle)).sum(axis=1)
    force += random.normal(0, 0.01 * np.std(force), len(force))
    seen = position + noise * random.standard_normal(len(TIME))
    return recorded(seen, force, step=TIME[1])


def told_mass(record: Record) -> float:
    motion = Motion.of(record)
    columns = np.column_stack([np.ones(len(motion)), motion.position, motion.velocity, motion.acceleration])
    inside = slice(500, -500)
    return float(np.linalg.lstsq(columns[inside], record["output"][inside], rcond=None)[0][3])


def test_a_mass_is_as_large_as_without_the_noise():
    noisy = moved_mass(noise=2e-4)
    assert told_mass(noisy) < 0.97 * MASS
    faults = sensor_faults(noisy)
    assert faults
    assert told_mass(repair([noisy])[0][0]) == pytest.approx(MASS, rel=0.005)


@pytest.mark.parametrize(
    "record",
    [moved_mass(noise=0.0), moved_mass(noise=2e-4, mass=0.0, stiffness=0.5)],
    ids=["without noise", "without mass"],
)
def test_nothing_is_told_where_no_mass_suffers(record):
    assert "rough_acceleration" not in [item.kind for item in sensor_faults(record)]
