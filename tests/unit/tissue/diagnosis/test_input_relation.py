"""Noise of any colour has no relation to the input; the error of a missing effect has one."""

import numpy as np
import pytest

from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.noise.input_relation import ModelError, is_related, kind_of_noise
from lumbar.tissue.diagnosis.noise.nonrepeating import OTHER, remove_structure
from lumbar.tissue.diagnosis.selection.base_choice import choose_base
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisState, run
from lumbar.tissue.diagnosis.selection.diagnosis_steps import estimate_noise_floor, repair_sensor_faults
from lumbar.tissue.diagnosis.selection.forward_selection import Selection
from lumbar.tissue.models.motion import Motion

STEP, SIZE = 0.01, 2000
TIME = STEP * np.arange(SIZE)
SLOW = np.convolve(np.random.default_rng(100).standard_normal(SIZE + 40), np.hanning(41), "valid")


def position(name: str) -> np.ndarray:
    return 3 * np.sin(2 * np.pi * 0.8 * TIME) if name == "one frequency" else SLOW


def noise(kind: str, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    white = rng.standard_normal(SIZE)
    hum = np.sin(2 * np.pi * 17.3 * TIME + rng.uniform(0, 6))
    spikes = np.where(rng.random(SIZE) < 0.003, 30 * rng.standard_normal(SIZE), 0.0)
    walk = np.cumsum(rng.standard_normal(SIZE))
    parts = {
        "hum": 2 * hum,
        "spikes": spikes,
        "wandering_zero": 0.3 * walk,
        "coloured_noise": np.roll(white, 1),
    }
    return white + parts[kind]


KINDS = ("hum", "spikes", "wandering_zero", "coloured_noise")


@pytest.mark.parametrize("motion", ["broadband", "one frequency"])
@pytest.mark.parametrize("kind", KINDS)
def test_noise_has_no_relation_to_the_input(kind, motion):
    moved = Motion(TIME, position(motion), STEP)
    assert [is_related([ModelError(noise(kind, seed), moved, 0)]) for seed in range(3)] == 3 * [False]


@pytest.mark.parametrize("kind", ["hum", "spikes", "coloured_noise"])
def test_a_function_of_the_input_below_the_noise_is_a_relation(kind):
    moved = Motion(TIME, SLOW, STEP)
    steps = np.floor(SLOW / 3)  # in no catalogue
    error = noise(kind, 1) + (steps - steps.mean()) / steps.std()
    assert is_related([ModelError(error, moved, 0)])


def test_an_error_at_the_only_frequency_of_the_input_is_a_relation():
    moved = Motion(TIME, position("one frequency"), STEP)
    assert is_related([ModelError(noise("coloured_noise", 1) + np.sin(2 * np.pi * 0.8 * TIME + 1), moved, 0)])


def test_a_short_record_cannot_tell():
    moved = Motion(TIME[:100], SLOW[:100], STEP)
    assert is_related([ModelError(noise("hum", 1)[:100], moved, 0)]) is None


@pytest.mark.parametrize("kind", KINDS)
def test_the_kind_of_noise_is_recognised(kind):
    assert kind_of_noise(noise(kind, 2), STEP)[0] == kind


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("periods", [1, 5])
def test_a_base_under_coloured_noise_is_adequate(kind, periods):
    state = judged_state(kind, periods, cubic=0.0)
    assert state == "adequate"


@pytest.mark.parametrize("kind", KINDS)
def test_a_base_that_lacks_a_spring_is_not_adequate_under_coloured_noise(kind):
    assert judged_state(kind, 1, cubic=0.02) == "unexplained"


def judged_state(kind: str, periods: int, cubic: float) -> str:
    """Return the status of the base on two records of a spring, one of them of several periods."""
    records = []
    for name, moved, seed in (("train", np.tile(SLOW, periods), 1), ("unseen", SLOW[::-1], 9)):
        force = 0.5 * moved + cubic * moved**3
        count = len(moved) // SIZE
        force = force + 0.02 * np.concatenate([noise(kind, seed + number) for number in range(count)])
        time = STEP * np.arange(len(moved))
        channels = {"input": Channel(moved, "position", "mm"), "output": Channel(force, "force", "N")}
        records.append(Record(name, time, channels))
    steps = (repair_sensor_faults, estimate_noise_floor, choose_base)
    state = run(steps, DiagnosisState(records, DiagnosisSettings()))
    selection = Selection(state.result.experiment, state.result.base, state.settings, singles=[])
    return selection.status(selection.base, [], 0.0)


def test_spikes_do_not_make_a_period_differ():
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((9, 1000)) + np.where(rng.random((9, 1000)) < 0.005, 20.0, 0.0)
    deviations = rows - rows.mean(axis=0)
    search = remove_structure(deviations, SLOW[:1000], SLOW[:1000])
    assert OTHER not in [part.kind for part in search.parts]
