"""Faults of sensors and clocks, zeros and noisy accelerations: reported with their size and repaired."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from diagnosing import diagnose_few
from fine_tissue import branch, experiment
from periodic_records import record as recorded
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

import lumbar
from case_tables import cases
from lumbar.records.importing.clock import even_clock
from sensor_records import clean_records, tissue_record


def repair(record):
    """Return the findings on a record's sensors, and the repaired record."""
    prepared = lumbar.refine([record], [], base="LE").experiment
    return prepared.faults, prepared.records[0]


def kinds(record) -> list[str]:
    return [finding.kind for finding in repair(record)[0]]


@pytest.mark.statistical
def test_valid_records_have_no_faults_and_are_unchanged():
    kinds_of_faults = Counter()
    for record in clean_records(100, seed=7):
        faults, same = repair(record)
        kinds_of_faults.update(finding.kind for finding in faults)
        assert faults or same is record
    assert not kinds_of_faults


@pytest.mark.parametrize("effect", ["none", "hardening", "coulomb"])
@pytest.mark.parametrize(("kind", "fault", "size", "reported", "value"), cases(__file__, "rough"))
def test_noise_of_position_is_reported_with_size(kind, fault, size, reported, value, effect):
    (fault,) = repair(tissue_record(kind, effect, fault=fault, size=size, seed=3))[0]
    assert fault.kind == reported
    assert fault.value == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("size", [2e-5, -1.5e-4])
def test_skew_of_two_clocks_is_removed(size):
    record = tissue_record("multisine", "hardening", fault="skew", size=size, seconds=100.0, seed=2)
    (fault,), even = repair(record)
    assert fault.kind == "clock_skew"
    assert fault.value == pytest.approx(-1e6 * size, abs=1.0)
    # Repaired, the force repeats with the position: its last period is its second one except for noise.
    period = round(10.0 / record.sampling_time)
    valid = tissue_record("multisine", "hardening", seconds=100.0, seed=2)
    before, after, noise = (
        np.std(item["output"][-period:] - item["output"][period : 2 * period])
        for item in (record, even, valid)
    )
    assert after < 1.05 * noise < before


@pytest.mark.parametrize("effect", ["softening", "thinning", "drift", "disturbance"])
def test_changing_tissue_is_not_skew(effect):
    assert kinds(tissue_record("multisine", effect, seconds=60.0, seed=4)) == []


def test_lost_rows_are_inserted_at_their_places():
    valid = tissue_record("multisine", "hardening", seconds=40.0, seed=5)
    lost = [400, 1203, 1204, 2900]
    rest = np.setdiff1d(np.arange(len(valid)), lost)
    short = replace(valid, time=valid.time[: len(rest)]).with_values(
        input=valid["input"][rest], output=valid["output"][rest]
    )
    (fault,), whole = repair(short)
    assert (fault.kind, fault.value) == ("dropped_samples", 4)
    assert whole.filled == tuple(lost)
    np.testing.assert_allclose(whole.time, valid.time, atol=1e-9)
    np.testing.assert_array_equal(whole["output"][rest], valid["output"][rest])
    assert np.abs(whole["input"] - valid["input"]).max() < 0.01 * np.ptp(valid["input"])


@pytest.mark.parametrize("role", ["input", "output"])
def test_stuck_samples_are_counted_and_interpolated(role):
    valid = tissue_record("multisine", "coulomb", seconds=40.0, seed=6)
    values, starts = valid[role].copy(), np.arange(101, 3900, 211)
    for start in starts:
        values[start + 1 : start + 3] = values[start]
    record = valid.with_values(**{role: values})
    (fault,), after = repair(record)
    assert (fault.kind, fault.value) == ("held_samples", 2 * len(starts))
    assert set(after.filled) == {*(starts + 1), *(starts + 2)}
    untouched = np.setdiff1d(np.arange(len(record)), after.filled)
    np.testing.assert_array_equal(after[role][untouched], valid[role][untouched])
    at = np.array(after.filled)
    assert np.std(after[role][at] - valid[role][at]) < 0.3 * np.std(values[at] - valid[role][at])


def test_rests_crests_and_flat_tops_are_not_stuck_samples():
    time = np.arange(4000) / 100.0
    stairs = np.cumsum(np.where((time * 2) % 1 < 0.7, 0.01, 0.0))  # rests for 15 samples
    crest = np.sin(2 * np.pi * (time - 0.005))  # two equal samples at every crest
    for position in (stairs, crest, np.clip(crest, -0.5, 0.5)):
        force = lfilter([0.1], [1, -0.9], position) + 0.01 * np.random.default_rng(1).standard_normal(4000)
        assert not {"held_samples", "dropped_samples"} & set(kinds(recorded(position, force)))


@pytest.mark.parametrize("seed", range(4))
def test_values_repeated_by_rounding_and_resampling_are_not_stuck(seed):
    random = np.random.default_rng(seed)
    time = np.cumsum(random.integers(84, 93, 2600)) / 1000
    position = 8 * np.abs((time / 20) % 1 - 0.5)
    force = np.round(0.5 * position + 0.01 * random.standard_normal(2600), 4)
    uneven = replace(recorded(position, force), time=time)
    assert "held_samples" not in kinds(even_clock(uneven)[0])


def test_missing_rows_are_interpolated_and_reported(tmp_path):
    valid = tissue_record("multisine", "none", seconds=20.0, seed=8)
    samples = zip(valid.time, valid["input"], valid["output"], strict=True)
    rows = [f"{t:.6f},{x:.7g},{f:.7g}" for t, x, f in samples]
    del rows[500:503], rows[900]
    (tmp_path / "gaps.csv").write_text("\n".join(["time_s,position_mm,force_N", *rows]) + "\n")
    record = lumbar.read(tmp_path / "gaps.csv")["gaps"]
    assert record.filled == (500, 501, 502, 903)
    assert len(record) == len(valid)
    (fault,) = repair(record)[0]
    assert (fault.kind, fault.value) == ("gap", 4)
    assert record.between(5.01, 100.0).filled == (0, 1, 402)


@pytest.mark.parametrize(("fault", "size"), [("noise", 0.02), ("steps", 0.05), ("jitter", 1e-3)])
def test_repaired_position_is_closer_to_true_motion(fault, size):
    valid = tissue_record("multisine", "coulomb", seconds=50.0, seed=9)
    record = tissue_record("multisine", "coulomb", seconds=50.0, seed=9, fault=fault, size=size)
    after = repair(record)[1]
    before, left = (np.std(item["input"] - valid["input"]) for item in (record, after))
    assert left < 0.5 * before
    ends = np.r_[0:20, len(valid) - 20 : len(valid)]
    assert np.std((after["input"] - valid["input"])[ends]) < 1.5 * before


def test_jitter_of_both_channels_is_subtracted_from_force():
    valid, record = (
        tissue_record("multisine", "hardening", seconds=50.0, seed=10, fault=fault, size=1e-3, quiet=1e-3)
        for fault in ("", "shared_jitter")
    )
    before, left = (np.std(item["output"] - valid["output"]) for item in (record, repair(record)[1]))
    assert left < 0.65 * before


def test_motion_beyond_band_is_not_sensor_noise():
    time = np.arange(4000) / 100.0
    rng = np.random.default_rng(11)
    moved = np.sin(2 * np.pi * 0.7 * time) + np.sin(2 * np.pi * 1.9 * time + 1)
    moved += 0.01 * rng.standard_normal(len(time))
    force = 0.4 * moved + 1e-3 * rng.standard_normal(len(time))
    assert kinds(recorded(moved, force)) == []
    # Half motion, half noise: undecided.
    assert kinds(recorded(moved + 0.01 * rng.standard_normal(len(time)), force)) == []


def with_force(record, at: dict[int, float]):
    force = record["output"].copy()
    force[list(at)] = list(at.values())
    return record.with_values(output=force)


def test_outliers_of_force_are_reported_and_replaced():
    valid = tissue_record("hand", "coulomb", seed=3)
    size = 2 * np.ptp(valid["output"])
    (fault,), after = repair(with_force(valid, {400: size, 900: -3 * size}))
    assert (fault.kind, fault.value, fault.record) == ("wild_samples", 2, valid.name)
    force = after["output"]
    assert force[400] == pytest.approx((valid["output"][399] + valid["output"][401]) / 2)
    untouched = np.setdiff1d(np.arange(len(force)), [400, 900])
    assert np.array_equal(force[untouched], valid["output"][untouched])


def test_jumps_and_frequent_peaks_of_force_are_not_outliers():
    valid = tissue_record("hand", "none", seed=3)
    size = 2 * np.ptp(valid["output"])
    struck = with_force(valid, dict.fromkeys(range(100, len(valid), 100), size))
    blow = with_force(valid, {400: size, 401: 0.7 * size, 402: 0.3 * size})
    step = valid.with_values(output=valid["output"] + size * (np.arange(len(valid)) > 700))
    for record in (struck, blow, step):
        assert "wild_samples" not in kinds(record)


def relaxing(time, position, speed, step):
    return 1.2 * position + 0.8 * branch(position, 0.3, step)


def hardening(time, position, speed, step):
    return relaxing(time, position, speed, step) + 0.03 * position**3


def diagnosed(records):
    settings = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(propose_law=False))
    return lumbar.diagnose(records, settings=settings)


def force_offsets(result) -> list:
    return [(item.record, item.value) for item in result.findings if item.kind == "force_offset"]


@pytest.mark.parametrize(
    ("tissue", "effects", "zero"),
    [(relaxing, (), 0.1), (hardening, ("hardening_stiffness",), 0.5)],
    ids=["linear", "hardening"],
)
def test_zero_of_force_is_fitted_and_no_effect(tissue, effects, zero):
    diagnosis = diagnosed(experiment(tissue, zeros=(zero, zero)))
    assert (diagnosis.result.status, diagnosis.selected) == ("named" if effects else "adequate", effects)
    assert diagnosis.model.output.offset == pytest.approx(zero, abs=0.005)
    offsets = [value for _, value in force_offsets(diagnosis.result)]
    assert offsets == ([pytest.approx(zero, abs=0.005)] if zero == 0.5 else [])


def test_every_record_may_have_its_own_zero():
    result = diagnose_few(experiment(hardening, zeros=(0.3, -0.2)))
    assert (result.status, result.selected) == ("named", ("hardening_stiffness",))
    assert force_offsets(result) == [
        ("multisine", pytest.approx(0.3, abs=0.005)),
        ("other", pytest.approx(-0.2, abs=0.005)),
    ]
    assert result.model.test_rms == pytest.approx(0.01, rel=0.1)


def test_zero_of_position_with_friction_is_not_drift():
    """The position is read 3 mm off: spring stiffness times that is a constant in the force."""

    def rubbing(time, position, speed, step):
        return relaxing(time, position, speed, step) + 0.45 * np.tanh(speed / 0.4) + 1.2 * 3.0

    result = diagnose_few(experiment(rubbing))
    assert (result.status, result.selected) == ("named", ("coulomb_friction",))
    assert result.model.fit.zero == pytest.approx(3.6, abs=0.01)


@pytest.mark.nightly
def test_far_origin_of_position_is_reported_and_written_into_model():
    far = [item.with_values(input=item["input"] + 1000.0) for item in experiment(hardening)]
    diagnosis = diagnosed(far)
    assert (diagnosis.result.status, diagnosis.selected) == ("named", ("hardening_stiffness",))
    assert diagnosis.result.model.test_rms == pytest.approx(0.01, rel=0.1)
    assert [item.kind for item in diagnosis.result.findings] == ["position_offset"]
    assert diagnosis.model.input.offset == pytest.approx(1000.0, abs=1.0)
    np.testing.assert_allclose(diagnosis.model.simulate(far[0])[50:], far[0]["output"][50:], atol=0.06)
    near = [item.with_values(input=item["input"] + 3.0) for item in experiment(hardening)]
    assert diagnosed(near).result.experiment.surface == 0.0


STEP, MASS, DAMPING = 1e-3, 0.09, 0.2
TIME = np.arange(20_000) * STEP
LINES = 0.4 * np.arange(1, 40, 2)


def moved_mass(noise: float, mass: float = MASS, stiffness: float = 0.0):
    """Mass and damper under a sum of sines, with closed-form derivatives, and noise (mm) of the encoder."""
    random = np.random.default_rng(3)
    phase = random.uniform(0, 2 * np.pi, len(LINES))
    angle = 2 * np.pi * LINES * TIME[:, None] + phase
    rate, size = 2 * np.pi * LINES, 20 / (1 + LINES**2)
    position, speed = (size * np.sin(angle)).sum(axis=1), (size * rate * np.cos(angle)).sum(axis=1)
    force = stiffness * position + DAMPING * speed - mass * (size * rate**2 * np.sin(angle)).sum(axis=1)
    force += random.normal(0, 0.01 * np.std(force), len(force))
    measured = position + noise * random.standard_normal(len(TIME))
    return recorded(measured, force, step=TIME[1])


def regressed_mass(record) -> float:
    """Mass by least squares on the derivatives of a quintic spline."""
    spline = make_interp_spline(record.time, record["input"], k=5)
    derivatives = [spline(record.time, order) for order in range(3)]
    columns = np.column_stack([np.ones(len(record)), *derivatives])[500:-500]
    return float(np.linalg.lstsq(columns, record["output"][500:-500], rcond=None)[0][3])


def test_repaired_position_gives_true_mass():
    noisy = moved_mass(noise=2e-4)
    assert regressed_mass(noisy) < 0.97 * MASS
    faults, after = repair(noisy)
    assert faults
    assert regressed_mass(after) == pytest.approx(MASS, rel=0.005)


@pytest.mark.parametrize(
    "record",
    [moved_mass(noise=0.0), moved_mass(noise=2e-4, mass=0.0, stiffness=0.5)],
    ids=["without noise", "without mass"],
)
def test_acceleration_without_noise_or_mass_is_no_fault(record):
    assert "rough_acceleration" not in kinds(record)
