"""Which base, which effects in which order, and whether the thresholds are those that null experiments give."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fine_tissue import FINE, branch, experiment

from calibration_records import CONDITIONS, KNOWN, NOISES, effect_experiment, null_records
from calibration_tables import coverage, null_lines
from lumbar.base.errors import InputError
from lumbar.publishing.figures.comparison_figures import ladder_figure
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


def test_errors_that_fall_read_as_falling():
    assert distinguishing_digits([1.42, 1.404, 1.398, 1.3951], 2) == ["1.42", "1.404", "1.398", "1.395"]
    assert distinguishing_digits([0.23, 0.0099], 4) == ["0.23", "0.0099"]


def test_equal_errors_need_no_digits():
    assert distinguishing_digits([1.4, 1.4, 1.4 + 1e-12], 2) == ["1.4", "1.4", "1.4"]


def test_the_figure_of_a_ladder_tells_its_rungs_apart():
    rungs = [
        {"label": str(number), "train_rms": error, "test_rms": error + 0.01}
        for number, error in enumerate((1.42, 1.404, 1.398))
    ]
    words = [text.get_text() for text in ladder_figure(rungs, "N", None).axes[0].texts]
    assert words[:3] == ["1.42", "1.404", "1.398"]


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


def interval(noise: str, value: float, half: float) -> dict:
    own = {"effect": "delay", "noise": noise, "owner": np.nan, "parameter": "spring_stiffness", "refused": ""}
    return {**own, "true": 1.0, "value": value, "low": value - half, "high": value + half}


def test_an_interval_holds_the_truth_or_not():
    rows = [
        interval("white", 1.1, 0.2),
        interval("AR(1)", 1.1, 0.1),  # its end is the truth
        interval("1/f", 0.9, 0.05),
        {"effect": "delay", "noise": "1/f", "refused": "the fit did not converge"},
    ]
    found = coverage(pd.DataFrame(rows)).set_index("noise")
    assert found["held"].to_dict() == {"white": 1, "coloured": 1, "all": 2}
    assert found["count"].to_dict() == {"white": 1, "coloured": 2, "all": 3}
    assert set(found["owner"]) == {""}
    assert found.loc["coloured", "bias"] == pytest.approx(1.96 * (1 - 2) / 2)  # of two the median is the mean


def test_nulls_are_counted_by_condition():
    row = {"condition": "jitter", "verdict": "adequate", "named": "", "p_value": 0.03}
    named = {**row, "verdict": "named", "named": "backlash", "p_value": 0.001}
    lines = null_lines(pd.DataFrame([row, row, row, named]))
    cells = next(line for line in lines if line.startswith("| jitter")).strip("| ").split(" | ")
    assert cells[1:] == ["4", "1: 25.0 % (4.6–69.9)", "0", "4", "1"]


@pytest.mark.parametrize("known", KNOWN, ids=lambda item: item.label)
def test_known_effects_give_every_parameter_of_the_fitted_form(known):
    truth = effect_experiment(known, "white", 0).truth
    form = known.form
    assert {name for owner, name in truth if owner} == {item.name for item in (*form.linear, *form.nonlinear)}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_position_fault_leaves_the_force_as_it_was(condition):
    """The force repeats up to its noise of 3 % at most; the position where its sensor is sound, rounds or has another clock."""
    training, unseen = null_records(condition, "KV", 0)
    assert len(training) == (6 if condition == "clock skew" else 3) * len(unseen)
    position, force = (np.split(training[name], len(training) // 1000)[1:3] for name in ("input", "output"))
    repeats = condition in (*NOISES, "quantised position", "clock skew")
    assert np.allclose(*position, atol=1e-9) is repeats
    if condition != "clock skew":
        assert np.std(force[0] - force[1]) < np.sqrt(2) * 0.06 * np.std(force[0])
