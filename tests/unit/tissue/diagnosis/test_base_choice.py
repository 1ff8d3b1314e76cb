"""The base model that the data ask for: true springs and dashpots are told by their own names, with no effect beside."""

from __future__ import annotations

import numpy as np
import pytest
from fine_tissue import FINE, branch, experiment

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.base_choice import base_beside, choose_base
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.thresholds import TIED
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


def test_an_unknown_base_is_refused_with_those_that_there_are():
    with pytest.raises(
        InputError, match="'KX'; known are auto, LE, Maxwell, KV, KB, KV-mass, KB-mass, LE-contact"
    ):
        diagnose(experiment(TISSUES["LE"]), DiagnosisSettings(base="KX"))


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
