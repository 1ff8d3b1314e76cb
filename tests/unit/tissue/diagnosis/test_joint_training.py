"""A model fitted to several records together: each begins anew, none is favoured."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_records import STEP, noise, record

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import prepare
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
    parts = [
        FitData(
            name, Motion(np.arange(400) * STEP, moved(3)[:400], STEP), np.zeros(400), np.array([1.0, -0.5])
        )
        for name in ("first", "second")
    ]
    joint = JointData.of(parts)
    signal = np.arange(800.0)
    assert joint.name == "first+second"
    assert joint.size == 700
    np.testing.assert_array_equal(joint.trim(signal), np.concatenate([signal[50:400], signal[450:]]))
    np.testing.assert_array_equal(
        joint.whiten(signal),
        np.concatenate([parts[0].whiten(signal[:400]), parts[1].whiten(signal[400:])]),
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
    assert (found.verdict, found.selected) == ("named", ("softening",))
    assert found.to_json()["train"] == "a+b"
    assert [item.name for item in found.experiment.tests] == ["c"]
    assert found.model.test_rms == pytest.approx(0.05, rel=0.1)


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


def test_the_noises_colour_is_left_out_where_the_error_is_a_models():
    """An error far above the noise is fitted as it is; one at the noise is whitened."""
    from periodic_records import noisy_record

    from lumbar.tissue.diagnosis.selection.diagnose import diagnose as diagnosed

    texture = lambda time, force: 3.0 * np.sin(7.0 * force)  # noqa: E731, nothing of the catalogue
    settings = DiagnosisSettings(base="KB", most_effects=1)
    far = diagnosed([noisy_record(6, 0.02, 1, 0.9, extra=texture)], settings)
    near = diagnosed([noisy_record(6, 0.3, 1, 0.9)], settings)
    assert far.model.train_rms > 3 * far.experiment.floor.rms
    assert len(far.experiment.training.whitening) == 1
    assert near.model.train_rms < 1.2 * near.experiment.floor.rms
    assert len(near.experiment.training.whitening) > 1
