"""What could have been seen in records: effects and mistakes put into records of which everything is known."""

import filecmp
import json

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from column_files import write_records
from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.doctor.effect_sizes import (
    FAULTS,
    Kind,
    fault_outcomes,
    judge_effect,
    judge_fault,
)
from lumbar.tissue.diagnosis.doctor.examination import examine
from lumbar.tissue.diagnosis.doctor.injection import Injection, Truth, phase_randomised, without_effect
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.form import Place

SIGMA = 0.02
EFFECTS = {name: TISSUE[name] for name in ("hardening_stiffness", "coulomb_friction", "delay", "saturation")}


def blind(records, most_effects):
    return diagnose(records, DiagnosisSettings("KB", catalogue=EFFECTS, most_effects=most_effects))


@pytest.fixture(scope="module")
def records():
    """A spring and a relaxing branch in noise of known size: nothing is missing from KB."""
    found = []
    for name, periods, seed in (("multisine", 5, 1), ("other", 3, 2)):
        position = 0.4 * multisine(periods, 250, range(1, 12), seed)
        force = relaxing_force(position) + SIGMA * noise(len(position), seed)
        found.append(record(position, force, name))
    return found


@pytest.fixture(scope="module")
def truth(records):
    return Truth.of(blind(records, 1), records, 0)


@pytest.fixture(scope="module")
def examined(records, truth):
    names = ("hardening_stiffness", "coulomb_friction")
    return examine(records, truth.verdict, EFFECTS, blind, effects=names, faults=False)


def test_an_effect_of_twice_the_predicted_size_is_named_and_one_of_half_is_not(examined, truth):
    """Two ways to the same number: the likelihood to first order, and blind diagnoses of simulated records."""
    for item in examined.effects:
        assert item.words == "named"
        assert item.put_in == pytest.approx(2 * item.predicted)
        assert 0.1 < item.predicted / truth.noise < 2
        weaker = blind(truth.records(item.injection.at(item.predicted / 2)), 1)
        assert judge_effect(weaker, item.form.effect, (), "KB").kind is Kind.UNSEEN
    assert examined.nothing.kind is Kind.UNSEEN


def test_the_prediction_agrees_with_the_least_squares_gain(truth):
    """Closed form: N R² of regressing the added force on what the model's own sensitivities leave of it."""
    form = TISSUE["hardening_stiffness"].forms[0]
    injection = Injection.middle(truth.fit, form, truth.training)
    data, fit = truth.training, truth.fit
    predicted = injection.predict(truth.noise * np.sqrt(30.0 / data.size))
    cubic = data.whiten(data.motion.position**3)
    step = 1e-6
    columns = [np.ones(data.size)]
    for number in range(len(fit.linear)):
        columns.append(data.whiten(fit.structure.design(data.motion, fit.nonlinear)[:, number]))
    up, down = (
        fit.structure.simulate(data.motion, fit.linear, fit.nonlinear * (1 + sign * step)) for sign in (1, -1)
    )
    columns.append(data.whiten(up - down) / step)
    design = np.column_stack(columns)
    left = cubic - design @ np.linalg.lstsq(design, cubic, rcond=None)[0]
    size = np.sqrt(np.mean(data.trim(data.motion.position**3) ** 2))
    expected = truth.noise * np.sqrt(30.0) * size / np.linalg.norm(left)
    assert predicted == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", list(EFFECTS))
def test_an_effect_has_the_strength_that_is_asked_for(truth, name):
    for form in TISSUE[name].forms[:1]:
        injection = Injection.middle(truth.fit, form, truth.training)
        rms = min(5 * SIGMA, injection.largest)
        assert injection.rms(injection.at(rms)) == pytest.approx(rms, rel=1e-4)
        assert (form.place is Place.PARALLEL) == (len(form.linear) > 0)


def test_an_effect_that_is_taken_out_leaves_the_rest_as_it_was(truth):
    first, second = (TISSUE[name].forms[0] for name in ("coulomb_friction", "hardening_stiffness"))
    with_one = Injection.middle(truth.fit, first, truth.training).at(0.1)
    with_both = Injection.middle(with_one, second, truth.training).at(0.1)
    rest, form, nonlinear = without_effect(with_both, "coulomb_friction")
    assert (rest.structure.effects, form) == (("hardening_stiffness",), first)
    assert np.array_equal(nonlinear, with_one.nonlinear[-1:])
    motion = truth.motions[0]
    friction = with_one.simulate(motion) - truth.fit.simulate(motion)
    assert np.allclose(with_both.simulate(motion) - rest.simulate(motion), friction)


def test_random_phases_keep_the_spectrum():
    signal = noise(400, 1, pole=0.8)
    found = phase_randomised(signal, 1000, np.random.default_rng(0))
    assert np.allclose(np.abs(np.fft.rfft(found[:400])), np.abs(np.fft.rfft(signal)))
    assert np.array_equal(found[400:800], found[:400])
    assert abs(np.corrcoef(found[:400], signal)[0, 1]) < 0.3


def test_records_that_are_refused_say_why(truth):
    assert judge_effect("clipped", "saturation", (), "KB").kind is Kind.REFUSED
    assert judge_fault("unit?", FAULTS["input_unit"], truth.verdict).message == "unit?"


def test_mistakes_are_told_or_not(records, truth):
    """By the diagnosis of today; a lag of five samples is a delay, an offset a finding."""
    for name, size, kind in (
        ("sign_flip", 1.0, Kind.TOLD),
        ("offset", 10.0, Kind.TOLD),
        ("lag", 5.0, Kind.NAMED),
    ):
        fault = FAULTS[name]
        found = judge_fault(blind(fault.put_into(records, size, 0), 1), fault, truth.verdict)
        assert found.kind is kind, name
    unchanged = judge_fault(truth.verdict, FAULTS["offset"], truth.verdict)
    assert unchanged.kind is Kind.UNSEEN


def test_a_mistake_shrinks_until_it_is_not_told(records, truth):
    def refuse_large(spoilt, _most_effects):
        moved = np.mean(spoilt[0]["output"] - records[0]["output"]) / np.ptp(records[0]["output"])
        if moved > 0.05:
            raise InputError("moved")
        return truth.verdict

    found = fault_outcomes(records, truth.verdict, FAULTS["offset"], refuse_large, 0)
    assert (list(found.outcomes), found.smallest, found.largest_missed) == ([10.0, 3.0], 10.0, 3.0)


def test_mistakes_have_the_size_that_is_said(records):
    first, second = records
    half = FAULTS["offset"].put_into(records, 50.0, 0)[0]["output"] - first["output"]
    assert np.allclose(half, 0.5 * np.ptp(first["output"]))
    late = FAULTS["lag"].put_into(records, 3.0, 0)[0]["output"]
    assert np.array_equal(late[3:], first["output"][:-3])
    inches = FAULTS["input_unit"].put_into(records, 25.4, 0)
    assert inches[0] is first
    assert np.allclose(inches[1]["input"], 25.4 * second["input"])
    steps = FAULTS["position_step"].put_into(records, 1.0, 0)[0]["input"]
    assert len(np.unique(steps)) <= 102
    noisy = FAULTS["position_noise"].put_into(records, 1.0, 0)[0]["input"] - first["input"]
    assert np.std(noisy) == pytest.approx(0.01 * np.ptp(first["input"]), rel=0.1)


def test_the_further_record_is_better_than_the_one_at_hand(examined):
    further = examined.further
    assert all(far > 1.5 * own > 0 for _, far, own in further.answers)
    assert further.excitation.words in further.sentence


@pytest.fixture(scope="module")
def folder(records, tmp_path_factory):
    return write_records(tmp_path_factory.mktemp("doctor"), records, "%.9g")


def test_the_command_prints_and_writes_what_the_verb_does(run, folder, tmp_path):
    chosen = ("--base", "KB", "--effects", "hardening_stiffness", "--no-faults")
    out = run.done(
        "doctor", folder, *chosen, "--output", tmp_path / "one", "--excitation", tmp_path / "play.csv"
    )
    assert "hardening stiffness" in out
    found = lumbar.doctor(lumbar.read(folder), base="KB", effects=["hardening_stiffness"], faults=False)
    assert str(found) == out.rstrip("\n")
    found.save(tmp_path / "two")
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == ["doctor.csv", "doctor.html", "doctor.json", "doctor.tex"]
    for name in names:
        assert filecmp.cmp(tmp_path / "one" / name, tmp_path / "two" / name, shallow=False), name
    written = json.loads((tmp_path / "one" / "doctor.json").read_text())
    assert written["effects"][0]["said"] == "named"
    assert written["effects"][0]["predicted"] == found["hardening_stiffness"].predicted
    played = np.loadtxt(tmp_path / "play.csv", delimiter=",", skiprows=1)
    assert np.allclose(
        played[:, 1], found.examination.further.excitation.motion.position, rtol=1e-4, atol=1e-4
    )
    assert "hardening_stiffness" in found._repr_html_()
    with pytest.raises(InputError, match="'drift' was not put in; put in were hardening_stiffness"):
        found["drift"]


def test_a_misspelt_effect_is_told_before_anything_is_diagnosed(records, monkeypatch):
    monkeypatch.setattr("lumbar.interface.doctor.diagnose", lambda *_, **__: pytest.fail("diagnosed"))
    with pytest.raises(InputError, match=r"effect hardning; did you mean 'hardening_stiffness'.*known are "):
        lumbar.doctor(records, effects=["hardning"])


def test_wrong_folders_and_records_are_refused(run, records, tmp_path):
    assert "nowhere" in run.refused("doctor", tmp_path / "nowhere")
    flipped = FAULTS["sign_flip"].put_into(records, 1.0, 0)
    with pytest.raises(InputError, match="nothing can be put into these records: The sign of the force"):
        lumbar.doctor(flipped, base="KB")
