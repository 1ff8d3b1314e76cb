"""Records that are fitted together, and records of one session, which begin in the state at the end of the one before."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosing import diagnose_few
from fine_tissue import FINE, branch, sampled, sines
from periodic_records import STEP, noisy_record, softening_record

import lumbar


def test_diagnosis_on_two_records_is_tested_on_others():
    records = [softening_record(name, seed) for name, seed in (("a", 7), ("b", 8), ("c", 9))]
    result = diagnose_few(records, "LE", ["a", "b"])
    assert (result.status, result.selected) == ("named", ("softening",))
    assert result.to_json()["train"] == "a+b"
    assert [item.name for item in result.experiment.tests] == ["c"]
    assert result.model.test_rms == pytest.approx(0.05, rel=0.1)


def test_end_of_each_record_is_test_if_all_are_fitted():
    records = [softening_record("a", 10), softening_record("b", 11)]
    experiment = lumbar.refine(records, [], base="LE", train=["a", "b"]).experiment
    assert [len(item.force) for item in experiment.training.parts] == [1400, 1400]
    assert [item.name for item in experiment.tests] == ["a", "b"]


def test_fitted_records_need_one_sampling_time():
    first, second = softening_record("a", 13), softening_record("b", 12)
    slower = replace(second, time=2 * second.time)
    with pytest.raises(lumbar.InputError, match=r"^b: .*\b0\.02 s, a .*\b0\.01 s\b"):
        lumbar.refine([first, slower], [], base="LE", train=["a", "b"])
    with pytest.raises(lumbar.InputError, match=r"'d'.* a, b$"):
        lumbar.refine([first, second], [], base="LE", train=["a", "d"])


@pytest.mark.nightly
def test_only_errors_of_the_size_of_noise_are_whitened():
    texture = lambda time, force: 3.0 * np.sin(7.0 * force)  # noqa: E731, not in the catalogue
    settings = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(most_effects=1, propose_law=False))
    large, small = (
        lumbar.diagnose([noisy_record(6, sigma, 1, 0.9, extra=extra)], base="KB", settings=settings).result
        for sigma, extra in ((0.02, texture), (0.3, None))
    )
    assert large.model.train_rms > 3 * large.experiment.floor.rms
    assert len(large.experiment.training.whitening) == 1
    assert small.model.train_rms < 1.2 * small.experiment.floor.rms
    assert len(small.experiment.training.whitening) > 1


NOISE = 0.005
TOGETHER = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(session=True, propose_law=False))
DURATIONS, SLOWEST = (24, 12, 12), (0.25, 0.261, 0.283)
"""Seconds of the records, and the lowest frequencies (Hz) of their motions."""


def one_run() -> tuple[np.ndarray, list[int]]:
    """Position of the whole session in fine steps, which blends from one motion into the next within a second; cuts."""
    position, cuts = np.zeros(0), []
    for seed, (duration, slowest) in enumerate(zip(DURATIONS, SLOWEST, strict=True)):
        motion = sines(seed, duration, STEP, 3.0, slowest)[1]
        if seed:
            share = np.arange(1, FINE / STEP + 1) * STEP / FINE
            weight = share**3 * (10 - 15 * share + 6 * share**2)
            end = DURATIONS[seed - 1]
            before = sines(seed - 1, end + 1, STEP, 3.0, SLOWEST[seed - 1])[1][-len(share) :]
            motion[: len(share)] = (1 - weight) * before + weight * motion[: len(share)]
            cuts.append(len(position) // FINE)
        position = np.concatenate([position, motion])
    return position, cuts


@cache
def session(kind: str) -> tuple[lumbar.Record, ...]:
    """Three records cut from one run on a tissue of 0.8 and 0.6 N/mm that relaxes in 0.2 s."""
    position, cuts = one_run()
    time = np.arange(len(position)) * STEP / FINE
    force = 0.8 * position + 0.6 * branch(position, 0.2, STEP)
    if kind == "softening":
        force += 0.3 * np.expm1(-time / 15) * position
    elif kind == "hysteresis":
        force += 0.5 * (position - slider(position, 2.0)) / 2.0
    whole = sampled("whole", STEP, position, force, NOISE, 0)
    ends = [0, *cuts, len(whole)]
    return tuple(
        replace(whole.between(STEP * begin, STEP * end), name=name)
        for name, begin, end in zip(("one", "two", "three"), ends, ends[1:], strict=False)
    )


def slider(position: np.ndarray, distance: float) -> np.ndarray:
    """Position of the slider of a Jenkins element at every step."""
    place, places = float(position[0]), []
    for now in position.tolist():
        place = min(max(place, now - distance), now + distance)
        places.append(place)
    return np.array(places)


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("softening", {"stiffness_lost": 0.3, "time_constant": 15.0}),
        pytest.param(
            "hysteresis", {"friction_limit": 0.5, "presliding_distance": 2.0}, marks=pytest.mark.statistical
        ),
    ],
)
def test_state_of_tissue_continues_in_next_record(effect, parameters):
    diagnosis = lumbar.diagnose(session(effect), base="KB", settings=TOGETHER)
    result = diagnosis.result
    assert (result.selected, result.status, result.refined_status) == ((effect,), "named", "adequate")
    assert result.model.test_rms < 1.05 * NOISE
    fitted = {item.name: item for item in diagnosis.model.parameters}
    for name, value in parameters.items():
        assert fitted[name].low < value < fitted[name].high


def test_session_without_hidden_effect_is_adequate():
    result = diagnose_few(session("nothing"), "KB", session=True)
    assert result.status == "adequate"
    assert result.base.test_rms < 1.05 * NOISE


@pytest.mark.parametrize(("effect", "train"), [("hysteresis", "three"), ("softening", ["one", "three"])])
def test_session_may_be_fitted_to_last_or_several_records(effect, train):
    refined = lumbar.refine(session(effect), [effect], base="KB", train=train, settings=TOGETHER)
    assert refined.path[-1].test_rms < 1.1 * NOISE


def test_compare_and_refine_continue_state_too():
    records = session("softening")
    refined = lumbar.refine(records, ["softening"], base="KB", settings=TOGETHER)
    for compared in (refined.compare(), lumbar.compare(records, refined.model, settings=TOGETHER)):
        assert all(item.comparison.rms.value < 1.05 * NOISE for item in compared)
    separate = lumbar.compare(records, refined.model)
    assert separate["three"].comparison.rms.value > 10 * NOISE


def last_of(records):
    """Data of the last record in a session."""
    experiment = lumbar.refine(records, [], base="LE", train="one", settings=TOGETHER).experiment
    return next(item for item in experiment.tests if item.name == "three")


def test_history_of_record_is_all_records_before():
    records = session("nothing")
    third = last_of(records)
    assert third.begins == len(records[0]) + len(records[1])
    np.testing.assert_array_equal(third.motion.position, one_run()[0][::FINE])
    np.testing.assert_array_equal(third.drop_history(third.force), records[2]["output"])
    assert third.size == len(records[2]) - round(0.5 / STEP)


def test_pause_of_clocks_is_filled_in():
    first, second, third = session("nothing")
    later = [first, replace(second, time=second.time + 7), replace(third, time=third.time + 7)]
    whole = last_of(later)
    assert whole.begins == len(first) + len(second) + round(7 / STEP)
    between = whole.motion.position[len(first) : len(first) + round(7 / STEP)]
    low, high = sorted((first["input"][-1], second["input"][0]))
    assert low <= between.min() and between.max() <= high


def test_session_needs_one_sampling_time_and_short_pauses():
    first, second, third = session("nothing")
    with pytest.raises(lumbar.InputError, match=r"\b0\.0\d* s.* session\b.*tissue\.rate_Hz"):
        last_of([first, second, replace(third, time=2 * third.time)])
    with pytest.raises(lumbar.InputError, match=r"^\w+: .*\d s\b.*\bsession\b"):
        last_of([first, second, replace(third, time=third.time + 1e5)])
