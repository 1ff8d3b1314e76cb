"""Records fitted together: several in the training, and the runs of one session."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fine_tissue import FINE, branch, sampled, sines
from periodic_records import STEP, noise, noisy_record, record

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import add_session_history, prepare
from lumbar.tissue.diagnosis.fitting.uncertainty import project_out, tangent_basis
from lumbar.tissue.diagnosis.law.validation import alternate
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.structure import Structure, forces_of

WORN = next(form for form in TISSUE["softening"].forms if form.name == "path")
CLIPPED = next(form for form in TISSUE["saturation"].forms if form.name == "sharp")


def moved(seed: int, seconds: float = 20.0) -> np.ndarray:
    """A motion that does not repeat, of a few mm."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, STEP)
    frequency, phase = random.uniform(0.1, 4.0, 30), random.uniform(0, 2 * np.pi, 30)
    return np.cos(2 * np.pi * np.outer(time, frequency) + phase).sum(axis=1)


def softening_record(name: str, seed: int, seconds: float = 20.0):
    """Spring that wears with the path travelled from each record's start, and noise."""
    position = moved(seed, seconds)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    force = (0.8 - 0.3 * (1 - np.exp(-path / 300.0))) * position
    return record(position, force + 0.05 * noise(len(position), seed), name)


def test_every_record_begins_anew():
    """Path, memory and output limits of one record know nothing of the other."""
    motions = [Motion(np.arange(900) * STEP, moved(seed)[:900], STEP) for seed in (1, 2)]
    structure = Structure(BASES["KB"], (WORN, CLIPPED))
    numbers = np.array([0.8, 1.0, -0.3]), np.array([0.1, 200.0, 3.0])
    together = structure.simulate(JoinedMotions(tuple(motions)), *numbers)
    np.testing.assert_array_equal(
        together, np.concatenate([structure.simulate(motion, *numbers) for motion in motions])
    )
    columns = forces_of(WORN, JoinedMotions(tuple(motions)), np.array([200.0]))
    assert columns.shape == (1800, 1)
    assert columns[900, 0] == forces_of(WORN, motions[1], np.array([200.0]))[0, 0]


def test_the_start_of_every_record_is_left_out():
    motion, whitening = Motion(np.arange(400) * STEP, moved(3)[:400], STEP), np.array([1.0, -0.5])
    parts = [FitData(name, motion, np.zeros(400), whitening, 50) for name in ("first", "second")]
    joint = JointData.join(parts)
    signal = np.arange(800.0)
    assert joint.name == "first+second"
    assert joint.size == 700
    np.testing.assert_array_equal(joint.trim(signal), np.concatenate([signal[50:400], signal[450:]]))
    np.testing.assert_array_equal(
        joint.whiten(signal), np.concatenate([parts[0].whiten(signal[:400]), parts[1].whiten(signal[400:])])
    )
    early, later = joint.split(0.5)
    assert (len(early.force), early.size, later.size) == (400, 300, 400)


def test_the_fit_is_that_of_least_squares_over_all_records():
    """Without nonlinear parameters the joint fit is ordinary least squares of the stacked records and a constant."""
    records = [softening_record("a", 4), softening_record("b", 5, 30.0)]
    training = prepare([*records, softening_record("c", 6)], ["a", "b"]).training
    found = fit_base(Structure(BASES["KV"]), training)
    rows, force = [], []
    for item in records:
        velocity = Motion.of(item).velocity
        rows.append(np.column_stack([item["input"], velocity, np.ones(len(item))])[50:])
        force.append(item["output"][50:])
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(force), rcond=None)[0]
    np.testing.assert_allclose([*found.linear, found.zero], expected, rtol=1e-6)
    worn = add(found, WORN, training)
    assert worn.linear[0] == pytest.approx(0.8, abs=0.01)
    assert worn.linear[2] == pytest.approx(0.3, abs=0.02)


def test_a_diagnosis_on_two_records_names_them_and_tests_on_the_others():
    records = [softening_record(name, seed) for name, seed in (("a", 7), ("b", 8), ("c", 9))]
    found = diagnose(records, DiagnosisSettings(base="LE", train=["a", "b"]))
    assert (found.status, found.selected) == ("named", ("softening",))
    assert found.to_json()["train"] == "a+b"
    assert [item.name for item in found.experiment.tests] == ["c"]
    assert found.model.test_rms == pytest.approx(0.05, rel=0.1)


def test_zeros_that_moved_are_taken_up_record_by_record():
    """Evidence and law stand on what no refit takes up, and neither does a constant that is added to one record."""
    records = [softening_record(name, seed, 8.0) for name, seed in (("a", 7), ("b", 8), ("c", 9))]
    shifted = [
        one.with_values(output=one["output"] + step) for one, step in zip(records, (5, -3, 1), strict=True)
    ]
    found = []
    for own in (records, shifted):
        experiment = prepare(own, ["a", "b"]).allow_own_zeros()
        fit = fit_base(Structure(BASES["KV"]), experiment.training)
        together = [experiment.training, *experiment.tests]
        basis = tangent_basis(fit, together)
        assert basis.shape[1] == 2 + 3  # stiffness and damping, and the zero of each record
        assert np.abs(project_out(basis, np.repeat([5.0, -3.0, 1.0], 760))).max() < 1e-9
        found.append(np.concatenate([fit.errors(item) for item in together]))
        choosing = alternate(experiment)[0]
        assert np.mean(fit.errors(choosing.tests[0])) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(*found, atol=1e-6)


def test_where_all_records_are_fitted_the_end_of_each_is_held_back():
    records = [softening_record("a", 10), softening_record("b", 11)]
    experiment = prepare(records, ["a", "b"])
    assert [len(item.force) for item in experiment.training.parts] == [1400, 1400]
    assert [item.name for item in experiment.tests] == ["a", "b"]


def test_records_that_are_fitted_together_are_sampled_alike():
    other = softening_record("b", 12)
    other = type(other)("b", other.time * 2, other.channels)
    with pytest.raises(InputError, match=r"b: sampled every 0\.02 s, a every 0\.01 s"):
        prepare([softening_record("a", 13), other], ["a", "b"])
    with pytest.raises(InputError, match="no record 'd'; there are a, b"):
        prepare([softening_record("a", 13), softening_record("b", 14)], ["a", "d"])


@pytest.mark.nightly
def test_the_noises_colour_is_left_out_where_the_error_is_a_models():
    """An error far above the noise is fitted as it is; one at the noise is whitened."""
    texture = lambda time, force: 3.0 * np.sin(7.0 * force)  # noqa: E731, nothing of the catalogue
    settings = DiagnosisSettings(base="KB", most_effects=1)
    far = diagnose([noisy_record(6, 0.02, 1, 0.9, extra=texture)], settings)
    near = diagnose([noisy_record(6, 0.3, 1, 0.9)], settings)
    assert far.model.train_rms > 3 * far.experiment.floor.rms
    assert len(far.experiment.training.whitening) == 1
    assert near.model.train_rms < 1.2 * near.experiment.floor.rms
    assert len(near.experiment.training.whitening) > 1


NOISE = 0.005
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
def diagnosed(kind: str):
    """Diagnosis of the three records."""
    return lumbar.diagnose(
        session(kind),
        base="KB",
        settings=StudySettings(improvement=ImprovementSettings(session=True, propose_law=False)),
    )


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("softening", {"stiffness_lost": 0.3, "time_constant": 15.0}),
        ("hysteresis", {"friction_limit": 0.5, "presliding_distance": 2.0}),
    ],
)
def test_what_a_tissue_remembers_goes_on_in_the_next_record_of_a_session(effect, parameters):
    verdict = diagnosed(effect).result
    assert (verdict.selected, verdict.status, verdict.refined_status) == ((effect,), "named", "adequate")
    assert verdict.model.test_rms < 1.05 * NOISE
    fitted = {item.name: item for item in diagnosed(effect).model.parameters}
    for name, value in parameters.items():
        assert fitted[name].low < value < fitted[name].high


def test_a_session_with_nothing_hidden_is_adequate():
    verdict = diagnosed("nothing").result
    assert verdict.status == "adequate"
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
    whole, begins = add_session_history(records)["three"]
    assert begins == len(records[0]) + len(records[1])
    position, _ = one_run()
    np.testing.assert_array_equal(whole["input"], position[::FINE])
    prepared = prepare(list(records), session=True)
    third = next(item for item in prepared.tests if item.name == "three")
    np.testing.assert_array_equal(third.drop_history(third.force), records[2]["output"])
    assert third.size == len(records[2]) - round(0.5 / STEP)


def test_a_pause_that_the_clocks_tell_of_is_filled_in():
    first, second, third = session("nothing")
    later = [first, replace(second, time=second.time + 7), replace(third, time=third.time + 7)]
    whole, begins = add_session_history(later)["three"]
    assert begins == len(first) + len(second) + round(7 / STEP)
    between = whole["input"][len(first) : len(first) + round(7 / STEP)]
    low, high = sorted((first["input"][-1], second["input"][0]))
    assert low <= between.min() and between.max() <= high


def test_records_of_one_session_are_sampled_alike_and_follow_one_another():
    first, second, third = session("nothing")
    slower = replace(third, time=2 * third.time)
    with pytest.raises(InputError, match="records of one session need one sampling time"):
        add_session_history([first, second, slower])
    with pytest.raises(InputError, match="leave session out"):
        add_session_history([first, second, replace(third, time=third.time + 1e5)])
