"""What could have been seen in records: effects put into records of which everything is known."""

import filecmp
import json

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from column_files import write_records
from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.doctor.effect_sizes import Kind, judge_effect
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
    return examine(records, truth.verdict, EFFECTS, blind, effects=names)


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


def test_records_that_are_refused_say_why():
    found = judge_effect("clipped", "saturation", (), "KB")
    assert (found.kind, found.message) == (Kind.REFUSED, "clipped")


def test_the_further_record_is_better_than_the_one_at_hand(examined):
    further = examined.further
    assert all(far > 1.5 * own > 0 for _, far, own in further.answers)
    assert further.excitation.words in further.sentence


@pytest.fixture(scope="module")
def folder(records, tmp_path_factory):
    return write_records(tmp_path_factory.mktemp("doctor"), records, "%.9g")


def test_the_command_prints_and_writes_what_the_verb_does(run, folder, tmp_path):
    chosen = ("--base", "KB", "--effects", "hardening_stiffness")
    out = run.done(
        "doctor", folder, *chosen, "--output", tmp_path / "one", "--excitation", tmp_path / "play.csv"
    )
    assert "hardening stiffness" in out
    found = lumbar.doctor(lumbar.read(folder), base="KB", effects=["hardening_stiffness"])
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
    flipped = [item.with_values(output=-item["output"]) for item in records]
    with pytest.raises(InputError, match="nothing can be put into these records: The sign of the force"):
        lumbar.doctor(flipped, base="KB")
