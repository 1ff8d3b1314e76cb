"""Records cut from one session: each begins in the state in which the one before it left the tissue."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fine_tissue import FINE, branch, sampled, sines

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.fitting.session import with_past

STEP, NOISE = 0.01, 0.005
TOGETHER = StudySettings(improvement=ImprovementSettings(session=True))
DURATIONS, SLOWEST = (24, 12, 12), (0.25, 0.261, 0.283)
"""Seconds of the records, and the lowest frequencies (Hz) of their motions."""


def one_run() -> tuple[np.ndarray, list[int]]:
    """Position of the whole session in fine steps, which blends from one motion into the next within a second; cuts."""
    position, cuts = np.zeros(0), []
    for seed, (duration, slowest) in enumerate(zip(DURATIONS, SLOWEST, strict=True)):
        moved = sines(seed, duration, STEP, 3.0, slowest)[1]
        if seed:
            share = np.arange(1, FINE / STEP + 1) * STEP / FINE
            weight = share**3 * (10 - 15 * share + 6 * share**2)
            end = DURATIONS[seed - 1]
            before = sines(seed - 1, end + 1, STEP, 3.0, SLOWEST[seed - 1])[1][-len(share) :]
            moved[: len(share)] = (1 - weight) * before + weight * moved[: len(share)]
            cuts.append(len(position) // FINE)
        position = np.concatenate([position, moved])
    return position, cuts


@cache
def session(kind: str) -> tuple[Record, ...]:
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
    """Where the slider of a Jenkins element is, step after step."""
    place, found = float(position[0]), []
    for now in position.tolist():
        place = min(max(place, now - distance), now + distance)
        found.append(place)
    return np.array(found)


@cache
def diagnosed(kind: str, together: bool):
    """Diagnosis of the three records."""
    return lumbar.diagnose(
        session(kind),
        base="KB",
        settings=StudySettings(improvement=ImprovementSettings(session=together, propose_law=False)),
    )


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("softening", {"stiffness_lost": 0.3, "time_constant": 15.0}),
        ("hysteresis", {"friction_limit": 0.5, "presliding_distance": 2.0}),
    ],
)
def test_what_a_tissue_remembers_goes_on_in_the_next_record_of_a_session(effect, parameters):
    verdict = diagnosed(effect, together=True).verdict
    assert (verdict.selected, verdict.verdict, verdict.verdict_after) == ((effect,), "named", "adequate")
    assert verdict.model.test_rms < 1.05 * NOISE
    fitted = {item.name: item for item in diagnosed(effect, together=True).model.parameters}
    for name, value in parameters.items():
        assert fitted[name].low < value < fitted[name].high


@pytest.mark.parametrize("effect", ["softening", "hysteresis"])
def test_taken_apart_the_same_records_are_explained_worse(effect):
    verdict = diagnosed(effect, together=False).verdict
    assert verdict.model.test_rms > 1.2 * NOISE
    assert verdict.verdict_after != "adequate" or verdict.selected != (effect,)


def test_a_session_with_nothing_hidden_is_adequate():
    verdict = diagnosed("nothing", together=True).verdict
    assert verdict.verdict == "adequate"
    assert verdict.base.test_rms < 1.05 * NOISE


@pytest.mark.parametrize(("effect", "train"), [("hysteresis", "three"), ("softening", ["one", "three"])])
def test_a_session_may_be_trained_on_its_last_record_and_on_several(effect, train):
    refined = lumbar.refine(session(effect), [effect], base="KB", train=train, settings=TOGETHER)
    assert refined.path[-1].test_rms < 1.1 * NOISE


def test_compare_and_refine_carry_the_state_on_too():
    records = session("softening")
    refined = lumbar.refine(records, ["softening"], base="KB", settings=TOGETHER)
    for compared in (refined.compare(), lumbar.compare(records, refined.model, settings=TOGETHER)):
        assert all(item.comparison.rms.value < 1.05 * NOISE for item in compared)
    apart = lumbar.compare(records, refined.model)
    assert apart["three"].comparison.rms.value > 10 * NOISE


def test_past_of_a_record_is_what_was_recorded_before():
    records = session("nothing")
    whole, begins = with_past(records)["three"]
    assert begins == len(records[0]) + len(records[1])
    position, _ = one_run()
    np.testing.assert_array_equal(whole["input"], position[::FINE])
    prepared = prepare(list(records), session=True)
    third = next(item for item in prepared.tests if item.name == "three")
    np.testing.assert_array_equal(third.own(third.force), records[2]["output"])
    assert third.size == len(records[2]) - round(0.5 / STEP)


def test_a_pause_that_the_clocks_tell_of_is_filled_in():
    first, second, third = session("nothing")
    later = [first, replace(second, time=second.time + 7), replace(third, time=third.time + 7)]
    whole, begins = with_past(later)["three"]
    assert begins == len(first) + len(second) + round(7 / STEP)
    between = whole["input"][len(first) : len(first) + round(7 / STEP)]
    low, high = sorted((first["input"][-1], second["input"][0]))
    assert low <= between.min() and between.max() <= high


def test_records_of_one_session_are_sampled_alike_and_follow_one_another():
    first, second, third = session("nothing")
    slower = replace(third, time=2 * third.time)
    with pytest.raises(InputError, match="records of one session must be sampled alike"):
        with_past([first, second, slower])
    with pytest.raises(InputError, match="leave session out"):
        with_past([first, second, replace(third, time=third.time + 1e5)])
