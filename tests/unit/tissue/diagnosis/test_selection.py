"""Which base, which effects in which order, and whether the thresholds are those that null experiments give."""

from types import SimpleNamespace

import numpy as np
import pytest
from fine_tissue import FINE, branch, experiment

from lumbar.tissue.diagnosis.evidence.discrimination import Separation, separation_sentence
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, by_score, evaluate
from lumbar.tissue.diagnosis.selection.diagnose import base_beside, choose_base, diagnose
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.selection.verdict import distinguishing_digits
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.structure import Structure

TISSUES = {
    "LE": lambda time, position, speed, step: 1.2 * position,
    "KV": lambda time, position, speed, step: 1.2 * position + 0.05 * speed,
    "Maxwell": lambda time, position, speed, step: 1.2 * branch(position, 0.3, step),
    "KB": lambda time, position, speed, step: 1.2 * position + 0.8 * branch(position, 0.3, step),
}


@pytest.mark.parametrize("name", TISSUES)
def test_a_tissue_without_effects_has_its_own_base_and_lacks_nothing(name):
    found = diagnose(experiment(TISSUES[name]))
    assert found.base.fit.structure.base.name == name
    assert (found.verdict, found.selected, found.complete) == ("adequate", (), True)
    assert found.base.fit.linear[0] == pytest.approx(1.2, rel=0.01)


def test_a_base_that_is_named_is_taken_whatever_the_data_ask_for():
    found = diagnose(experiment(TISSUES["KV"]), DiagnosisSettings(base="LE", most_effects=1))
    assert found.base.fit.structure.base.name == "LE"
    assert found.selected == ("viscous_damping",)


@pytest.mark.parametrize("relaxation", [0.001, 0.004])
def test_a_fast_relaxation_is_found_where_the_sampling_shows_it(relaxation):
    """At 5 kHz a relaxation time of 1 ms is five samples; it must not rest on a bound of 8 ms."""

    def fast(time, position, speed, step):
        return 1.2 * position + 0.8 * branch(position, relaxation, step)

    prepared = prepare(experiment(fast, step=2e-4, fastest=200.0, seconds=(8, 4)))
    _, base = choose_base(prepared, "auto", {})
    assert base.fit.structure.base.name == "KB"
    assert base.fit.nonlinear[0] == pytest.approx(relaxation, rel=0.01)
    assert base.fit.linear == pytest.approx([1.2, 0.8], rel=0.01)
    assert base.test_rms == pytest.approx(0.01, rel=0.05)


MASS, DAMPING, LAG = 0.02, 0.2, 0.012


def moved_mass(ripple: float) -> tuple[Experiment, Candidate]:
    """A mass on a spring and a dashpot that lags, with a ripple of the position; fitted with a dashpot that does not."""

    def force(time, position, speed, step):
        carried = MASS * np.gradient(speed, step / FINE) + 1.2 * position
        return carried + (DAMPING / LAG) * branch(position, LAG, step) + ripple * np.sin(4 * position)

    prepared = prepare(experiment(force))
    bare = fit_base(Structure(BASES["KV"]), prepared.training)
    return prepared, evaluate(add(bare, TISSUE["inertia"].forms[0], prepared.training), prepared)


def test_a_branch_takes_the_place_of_a_dashpot_where_it_explains_what_is_left():
    prepared, model = moved_mass(ripple=0.0)
    assert base_beside(model, prepared) == "KB"


def test_a_branch_that_explains_little_of_what_is_left_does_not_take_the_place_of_a_dashpot():
    """Its likelihood is larger, but a ripple is left by both: a dashpot knows the mass of slow motion, m − bτ."""
    prepared, model = moved_mass(ripple=0.3)
    bare = fit_base(Structure(BASES["KB"]), prepared.training)
    beside = evaluate(add(bare, TISSUE["inertia"].forms[0], prepared.training), prepared)
    assert beside.score < model.score - TIED
    assert base_beside(model, prepared) is None
    assert model.fit.linear[2] == pytest.approx(MASS - DAMPING * LAG, rel=0.1)


def test_errors_that_fall_read_as_falling():
    assert distinguishing_digits([1.42, 1.404, 1.398, 1.3951], 2) == ["1.42", "1.404", "1.398", "1.395"]
    assert distinguishing_digits([0.23, 0.0099], 4) == ["0.23", "0.0099"]
    assert distinguishing_digits([1.4, 1.4, 1.4 + 1e-12], 2) == ["1.4", "1.4", "1.4"]


def candidate(score, *effects):
    return SimpleNamespace(score=score, effects=effects)


@pytest.mark.parametrize("sign", [-1, 1])
def test_scores_equal_to_rounding_are_ordered_by_name(sign):
    scores = (-1000.0 + sign * 1e-5, -1000.0, -1000.5)
    found = by_score([candidate(score, name) for score, name in zip(scores, "bac", strict=True)])
    assert [item.effects[0] for item in found] == ["c", "a", "b"]


@pytest.mark.parametrize("distance", [9.3, 9.7])
def test_an_excitation_worse_than_the_record_at_hand_is_not_proposed(distance):
    excitation = SimpleNamespace(words="a chirp", within=True)
    found = Separation(excitation, distance, 0.1, 9.6, ("drift",), 42)
    training = SimpleNamespace(name="multisine")
    diagnosis = SimpleNamespace(
        selected=("hysteresis",), experiment=SimpleNamespace(output_unit="N", training=training)
    )
    sentence = separation_sentence(found, diagnosis)
    assert found.improves == (distance > 9.6)
    assert ("record a chirp" in sentence) == found.improves
    assert ("records at hand separate hysteresis from drift better" in sentence) != found.improves
