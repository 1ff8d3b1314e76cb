"""The base model that the data ask for: true springs and dashpots are told by their own names, with no effect beside."""

from __future__ import annotations

import pytest
from fine_tissue import branch, experiment

from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.diagnosis.fitting.preparation import prepare
from lumbar.diagnosis.selection.base_choice import choose_base
from lumbar.diagnosis.selection.diagnose import diagnose
from lumbar.errors import InputError

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
    with pytest.raises(InputError, match="'KX'; known are auto, LE, Maxwell, KV, KB, LE-contact"):
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
