"""Positions of a few commanded levels: binary and multilevel signals are excitations, not coarse or clipped sensors."""

import numpy as np
import pytest
from periodic_records import noise, record
from scipy.signal import lfilter

from lumbar.base.errors import InputError
from lumbar.records.rests import MOST_LEVELS, find_levels, find_two_levels
from lumbar.records.sampling import check_clipping
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnosis_result import Status
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.models.motion import Motion, SteppedMotion

STEP, FINE, SIGMA = 0.01, 20, 0.01
TIME = np.arange(4000) * STEP


def steps(levels: int, clock: int, seed: int, size: int = len(TIME), move: float = 0.0) -> np.ndarray:
    """Random steps between −2 and 2 mm, `FINE` values per sample; a move lasts `move` samples."""
    chosen = np.random.default_rng(seed).integers(0, levels, size // clock + 1)
    position = np.repeat(4.0 * chosen / (levels - 1) - 2, clock * FINE)[: size * FINE]
    width = max(round(move * FINE), 1)
    return np.convolve(np.pad(position, (width - 1, 0), "edge"), np.full(width, 1 / width), "valid")


def relaxing(position: np.ndarray, time_constant: float) -> np.ndarray:
    decay = np.exp(-STEP / FINE / time_constant)
    return lfilter([1.0], [1.0, -decay], np.diff(position, prepend=position[0]))


def experiment(
    force_of, levels: int, clock: int = 20, move: float = 0.0, position_noise: float = 0.0
) -> list:
    """Two records of a tissue whose exact force is `force_of` its fine position, without relaxation."""
    records = []
    for number, size in enumerate((4000, 2000)):
        fine = steps(levels, clock, number, size, move)
        force = fine + 0.8 * relaxing(fine, 0.2) + force_of(fine)
        position = fine[::FINE] + position_noise * noise(size, 10 + number)
        records.append(record(position, force[::FINE] + SIGMA * noise(size, number), "ab"[number], step=STEP))
    return records


@pytest.mark.parametrize("levels", [2, 3, 5, MOST_LEVELS])
@pytest.mark.parametrize(("move", "sigma"), [(0, 0), (1.5, 0), (0, 0.01), (8, 0)])
def test_levels_are_found(levels, move, sigma):
    position = steps(levels, 20, 1, move=move)[::FINE] + sigma * noise(len(TIME), 2)
    detected = find_levels(position)
    np.testing.assert_allclose(detected.values, np.linspace(-2, 2, levels), atol=0.01)
    assert detected.jumps == (move < 2)
    assert detected.changes == np.count_nonzero(np.diff(steps(levels, 20, 1)))


@pytest.mark.parametrize(
    "position",
    [
        pytest.param(np.sin(TIME), id="sine"),
        pytest.param(np.round(np.sin(TIME), 1), id="coarse sensor"),
        pytest.param(np.minimum(TIME, 5), id="hold"),
        pytest.param(np.abs(TIME % 4 - 2), id="triangles"),
        pytest.param(steps(MOST_LEVELS + 4, 20, 1)[::FINE], id="many levels"),
        pytest.param(np.ones(len(TIME)), id="rest"),
    ],
)
def test_other_positions_have_no_levels(position):
    assert find_levels(position) is None


def test_commanded_levels_are_not_clipped():
    position = steps(5, 20, 3)[::FINE]
    creep = 1 - np.exp(-TIME / 5)
    check_clipping(record(np.append(position, 2 - 1e-6), np.append(position, 0.0)))
    check_clipping(record(creep + 0.001 * noise(len(TIME), 1), np.clip(50 * TIME / TIME[-1], 0, 1)))


@pytest.mark.parametrize("limit", [0.3, 0.8])
def test_force_that_is_cut_off_is_clipped(limit):
    position = np.sin(2 * np.pi * 0.5 * TIME)
    with pytest.raises(InputError, match="clipped"):
        check_clipping(record(position, np.clip(position, -limit, limit)))


@pytest.mark.parametrize("levels", [2, 3, 8])
@pytest.mark.parametrize("clock", [3, 20])
def test_levels_are_no_fault_of_the_sensor(levels, clock):
    position = steps(levels, clock, 4)[::FINE]
    one = record(position, 0.8 * position + SIGMA * noise(len(TIME), 1))
    (repaired,), findings = repair([one])
    assert findings == [] and repaired is one


def test_noise_of_levels_is_removed_and_motion_is_not():
    position = steps(5, 20, 5)[::FINE]
    rough = 0.02 * noise(len(TIME), 6)
    force = 0.8 * position + SIGMA * noise(len(TIME), 7)
    (repaired,), (finding,) = repair([record(position + rough, force)])
    assert finding.kind == "position_noise" and finding.value == pytest.approx(0.02, rel=0.05)
    np.testing.assert_allclose(repaired["input"], position, atol=3e-3)
    shaken = record(position + rough, force + 0.8 * rough)
    slow = record(position + 0.02 * noise(len(TIME), 8, pole=0.5), force)
    assert repair([shaken, slow]) == ([shaken, slow], [])


def test_stepped_motion_rests_beside_a_jump():
    motion = Motion.from_record(
        record(np.repeat([0.0, 0, 1, 3, 3, 0, 0], [9, 9, 1, 9, 9, 9, 9]), np.zeros(55), step=STEP)
    )
    assert isinstance(motion, SteppedMotion)
    assert np.flatnonzero(motion.velocity).tolist() == [18] and motion.velocity[18] == pytest.approx(1 / STEP)
    assert motion.scale("speed") == pytest.approx(3 / STEP)
    np.testing.assert_allclose(motion.delayed(1.5 * STEP).position[19:22], [0.5, 2, 3])


def test_only_common_levels_are_two():
    two, other = steps(2, 20, 1)[::FINE], steps(2, 20, 2)[::FINE]
    assert find_two_levels([record(two, two), record(other, other)]).values == pytest.approx([-2, 2])
    assert find_two_levels([record(two, two), record(1.5 * other, other)]) is None
    assert find_two_levels([record(np.repeat([0.0, 1.0], 50), np.zeros(100))]) is None


@pytest.mark.parametrize(
    ("force_of", "move"),
    [
        pytest.param(lambda position: 0.0, 0.0, id="base"),
        pytest.param(lambda position: 0.0, 1.5, id="base with finite moves"),
        pytest.param(lambda position: 0.2 * position**3, 1.5, id="hardening"),
        pytest.param(lambda position: np.sign(np.gradient(position)), 1.5, id="friction"),
    ],
)
def test_two_levels_show_no_static_curve_and_no_friction(force_of, move):
    result = diagnose(experiment(force_of, 2, move=move), DiagnosisSettings())
    assert (result.status, result.selected) == (Status.ADEQUATE, ())
    (finding,) = [item for item in result.findings if item.kind == "two_levels"]
    assert "hysteresis" in finding.sentence and "relaxation" not in finding.sentence


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("force_of", "levels", "noise_mm", "named"),
    [
        pytest.param(lambda x: 0.4 * relaxing(x, 4.0), 2, 0.0, "second_relaxation", id="relaxation"),
        pytest.param(lambda x: 0.03 * x**3, 5, 0.005, "hardening_stiffness", id="hardening, noise"),
        pytest.param(lambda x: 0.3 * np.sign(np.gradient(x)), 5, 0.0, "coulomb_friction", id="friction"),
        pytest.param(lambda x: 0.0, 6, 0.01, None, id="base, noise"),
        pytest.param(lambda x: 0.0, 3, 0.0, None, id="base, three levels"),
    ],
)
def test_effects_are_named_as_from_any_signal(force_of, levels, noise_mm, named):
    result = diagnose(experiment(force_of, levels, move=1.5, position_noise=noise_mm), DiagnosisSettings())
    assert result.selected == ((named,) if named else ())
    assert result.status == (Status.NAMED if named else Status.ADEQUATE)
