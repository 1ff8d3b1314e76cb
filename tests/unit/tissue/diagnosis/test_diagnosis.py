"""Diagnosis of blind experiments, tissues and pendulums, and of known records; labels are read by assertions only."""

import json
from functools import cache

import numpy as np
import pytest
from diagnosing import diagnose, diagnose_few
from fine_tissue import FINE, branch, experiment, sampled, sines
from periodic_records import multisine, noise, record
from scipy.signal import lfilter

import lumbar
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Status
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of
from refusing import has_tokens


@pytest.fixture(scope="module")
def case(shared):
    """Return a function that diagnoses a blind experiment, without its labels."""
    return cache(lambda name: diagnose(lumbar.read(shared / "hidden_effects" / name)))


@pytest.fixture(scope="module")
def blind(shared, case):
    """Diagnoses of all blind experiments."""
    return {folder.name: case(folder.name) for folder in sorted((shared / "hidden_effects").glob("case_*"))}


@pytest.fixture(scope="module")
def labels(shared):
    return json.loads((shared / "hidden_effects" / "labels.json").read_text(encoding="utf-8"))


def test_blind_experiment_has_its_effect(case, labels):
    assert list(case("case_03").selected) == labels["case_03"]["effects"]
    assert case("case_03").status == "named"


@pytest.mark.statistical
def test_all_blind_experiments_have_their_effects(blind, labels):
    """One effect is named, both of two are found; what explains everything leaves noise."""
    for name, label in labels.items():
        result, hidden = blind[name], label["effects"]
        assert set(result.selected) == set(hidden), name
        assert len(hidden) > 1 or result.status == ("named" if hidden else "adequate"), name
        assert (result.refined_status, result.complete, result.further) == ("adequate", True, None), name
        assert result.experiment.floor.rms == pytest.approx(label["noise_rms_N"], rel=0.1)
        assert not hidden or result.ranking[0].p_value <= 0.01, name
    assert {len(label["effects"]) for label in labels.values()} == {0, 1, 2}
    ratio = [blind[name].model.test_rms / label["noise_rms_N"] for name, label in labels.items()]
    assert np.median(ratio) <= 1.05 and max(ratio) <= 1.25


def test_json_has_contract_keys(case):
    content = case("case_03").to_json()
    assert content["schema"] == "lumbar.diagnosis/1"
    keys = "schema base train unit verdict complete selected tied_with noise_floor_rms explainable_share_removed ranking ladder"
    assert set(keys.split()) <= set(content)
    first = content["ranking"][0]
    assert {"effects", "train_rms", "test_rms", "p_value", "parameters"} <= set(first)
    assert {"value", "low", "high", "unit"} <= set(first["parameters"]["coulomb_force"])
    assert [rung["effects"] for rung in content["ladder"]] == [[], ["coulomb_friction"]]
    assert content["ladder"][1]["test_rms"] < content["ladder"][0]["test_rms"]


def test_result_lists_steps_and_deciding_step(case):
    result = case("case_03")
    assert [item["step"] for item in result.to_json()["steps"]] == [item.step for item in result.steps]
    steps = (
        "repair sensor faults, estimate the noise floor, check the motion, check direction and signs, "
        "leave out effects that two levels cannot show, choose the base"
    )
    assert [item.step for item in result.steps][:6] == steps.split(", ")
    assert result.decided_by.step == "find ties" and result.decided_by.status == result.status == "named"


def test_exchanged_channels_with_a_sensor_fault_are_reported_and_saved(shared, tmp_path):
    records = lumbar.read(shared / "hidden_effects" / "case_03")
    exchanged = [item.with_values(input=item["output"], output=item["input"]) for item in records]
    diagnosis = lumbar.diagnose(exchanged)
    assert diagnosis.result.orientation.kind == "direction" and not diagnosis.selected
    assert diagnosis.result.decided_by.step == "check direction and signs"
    lines = diagnosis.explain()
    assert [line.split(":")[0] for line in lines] == [item.step for item in diagnosis.result.steps]
    assert [line.endswith("[decided: unexplained]") for line in lines].count(True) == 1
    diagnosis.save(tmp_path, pictures=False)
    assert {item.name for item in tmp_path.iterdir()} >= {"diagnosis.json", "diagnosis.html", "refined.json"}


def test_second_effect_is_named_as_further(shared):
    """The search may take one effect; the catalogue holds the other one, and it must not be denied."""
    records = lumbar.read(shared / "hidden_effects" / "case_13")
    one_of_two = diagnose_few(records, "KB", most_effects=1)
    assert (one_of_two.status, one_of_two.selected) == ("named", ("hardening_stiffness",))
    assert (one_of_two.refined_status, one_of_two.complete) == ("named", False)
    assert one_of_two.further.effects == ("hardening_stiffness", "coulomb_friction")
    assert one_of_two.to_json()["further"] == "coulomb_friction"


def test_refine_rejects_unknown_and_useless_effects():
    records = springs({"a": 0.6, "b": 0.6})
    with pytest.raises(lumbar.InputError, match=r"effect glue\b.*\bcoulomb_friction\b"):
        lumbar.refine(records, ["glue"])
    with pytest.raises(lumbar.NumericalError, match=r"^delay: .*\bLE\b.* \d"):
        lumbar.refine(records, ["delay"], base="LE")


def springs(stiffness: dict[str, np.ndarray | float]) -> list:
    made = []
    for seed, (name, value) in enumerate(stiffness.items()):
        position = multisine(4, 500, range(1, 8), seed)
        made.append(record(position, value * position + 0.01 * noise(len(position), seed + 5), name))
    return made


def findings_of(records, kind: str, **settings):
    result = diagnose_few(records, "LE", "a", most_effects=1, **settings)
    return [item for item in result.findings if item.kind == kind]


def test_model_that_misses_unseen_records_is_fitted_to_them():
    (finding,) = findings_of(springs({"a": 0.8, "b": 0.9, "c": 0.9}), "trained_otherwise")
    spread = float(np.std(multisine(4, 500, range(1, 8), 0)))
    assert finding.value == pytest.approx(0.1 * spread, rel=0.05)
    assert finding.unit == "N"


@pytest.mark.parametrize(("stiffness", "motion"), [(0.8, 1.0), (2.0, 0.02)])
def test_model_is_not_fitted_to_predicted_records_or_small_motions(stiffness, motion):
    records = springs({"a": 0.8, "b": stiffness})
    small = records[1].with_values(input=motion * records[1]["input"], output=motion * records[1]["output"])
    assert not findings_of([records[0], small], "trained_otherwise")


@pytest.mark.nightly
def test_falling_stiffness_suggests_session():
    worn = np.repeat(0.9 * 0.99 ** np.arange(8), 500)
    (finding,) = findings_of(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness")
    assert finding.value == pytest.approx(0.9 * 0.99**7, rel=0.01) and finding.unit == "N/mm"
    rest = springs({"a": worn[:2000], "b": worn[:2000]})
    assert not findings_of(rest, "falling_stiffness")
    assert not findings_of(springs({"a": worn[:2000], "b": worn[2000:]}), "falling_stiffness", session=True)


TISSUES = {
    "LE": lambda time, position, speed, step: 1.2 * position,
    "KV": lambda time, position, speed, step: 1.2 * position + 0.05 * speed,
    "Maxwell": lambda time, position, speed, step: 1.2 * branch(position, 0.3, step),
    "KB": lambda time, position, speed, step: 1.2 * position + 0.8 * branch(position, 0.3, step),
}


@pytest.mark.parametrize("name", TISSUES)
def test_tissue_without_effects_is_adequate_with_its_base(name):
    result = diagnose(experiment(TISSUES[name]))
    assert result.base.fit.structure.base.name == name
    assert (result.status, result.selected, result.complete) == ("adequate", (), True)
    assert result.base.fit.linear[0] == pytest.approx(1.2, rel=0.01)


def test_given_base_is_used():
    result = diagnose(experiment(TISSUES["KV"]), "LE", most_effects=1)
    assert result.base.fit.structure.base.name == "LE"
    assert result.selected == ("viscous_damping",)


@pytest.mark.statistical
def test_relaxation_spectrum_does_not_move_zeros():
    """Slow and fast strokes of a material that relaxes over decades of time: a free zero for each would hide what is missing."""

    def stroked(name: str, rate: float, shift: float = 0.0):
        time = 0.01 * np.arange(round(40 / rate / 0.01))
        position = 10 * (1 - np.abs(2 * ((time * rate / 20) % 1) - 1))
        force = 0.1 * position + shift + 0.005 * noise(len(time), len(name))
        for decay in np.exp(-0.01 / np.geomspace(0.1, 30, 8)):
            force = force + 0.05 * lfilter([decay, -decay], [1, -decay], position)
        return record(position, force, name)

    for shift in (0.0, 1.0):
        records = [stroked("slow", 1.0), stroked("middle", 3.0, shift), stroked("fast", 5.0, -shift)]
        answer = diagnose(records, train="slow")
        assert "hysteresis" not in answer.selected
        assert ("force_offset" in [item.kind for item in answer.findings if item.record == "fast"]) == bool(
            shift
        )


@pytest.mark.nightly
def test_late_position_is_named_as_viscous_damping():
    """For a spring k with a position p that is read τ late, the force is k p + kτ dp/dt: a viscosity of kτ."""
    stiffness, late, samples, records = 0.8, 0.004, 500, []
    for name, seed in (("multisine", 0), ("other", 3)):
        true = multisine(8, samples, lines=np.arange(1, 4), seed=seed)
        angle = 2j * np.pi * np.fft.rfftfreq(len(true), 0.01)
        read = np.fft.irfft(np.fft.rfft(true) * np.exp(-angle * late), len(true))
        records.append(record(read, stiffness * true + 0.005 * noise(len(true), seed + 20), name))
    result = diagnose(records, "LE", "multisine")
    assert result.selected == ("viscous_damping",)
    (viscosity,) = (item for item in result.ranking[0].estimates if item.effect == "viscous_damping")
    assert viscosity.low < stiffness * late < viscosity.high


def single_shots(force, sigma: float = 0.01, seconds: float = 18.0) -> list:
    """Two records, in neither of which anything repeats; `force` from time, position, speed and the record's number."""
    made = []
    for seed, name in enumerate(("first", "second")):
        time, position, speed = sines(seed, seconds, 0.02, 4.0, 0.0417 + 0.003 * seed)
        made.append(sampled(name, 0.02, position, force(time, position, speed, seed), sigma, seed))
    return made


@pytest.mark.parametrize("pole", [0.0, 0.9], ids=["white", "coloured"])
def test_model_that_explains_little_is_unexplained(pole):
    def foreign(time, position, speed, seed):
        return 0.02 * position + np.repeat(noise(len(time) // FINE, seed + 40, pole), FINE)

    result = diagnose_few(single_shots(foreign), "KB")
    explained = 1 - (result.base.test_rms / np.std(result.experiment.tests[0].force)) ** 2
    assert explained < 0.06
    assert result.experiment.floor is None
    assert (result.status, result.selected) == ("unexplained", ())
    assert result.complete is None


def test_right_model_without_noise_floor_is_adequate():
    def relaxing(time, position, speed, seed):
        return 1.2 * position + 0.8 * branch(position, 0.3, 0.02)

    result = diagnose(single_shots(relaxing))
    assert result.experiment.floor is None
    assert (result.status, result.selected) == ("adequate", ())


def test_small_second_effect_is_found():
    """Inertia leaves the base 300 times the noise, dry friction 8 times: a share of the base's error would hide it."""
    made = []
    for seed, (name, slowest, seconds) in enumerate((("multisine", 0.25, 16), ("other", 0.261, 8))):
        time, position, speed = sines(seed, seconds, 0.01, 12.0, slowest)
        force = 1.2 * position + 0.02 * speed + 0.09 * np.tanh(speed / 2)
        force = force + 1.4e-3 * np.gradient(speed, time)
        made.append(sampled(name, 0.01, position, force, 0.01, seed))
    result = diagnose(made)
    assert result.base.test_rms > 100 * 0.01
    assert set(result.selected) == {"inertia", "coulomb_friction"}
    assert result.complete
    assert result.model.test_rms == pytest.approx(0.01, rel=0.1)


def test_held_back_part_of_record_continues_path():
    """A spring wears with the path; a path that restarted would have it whole again."""
    _time, position, _ = sines(5, 40.0, 0.02, 3.0, 0.0417)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    force = (1.5 - 0.5 * (1 - np.exp(-path / 150.0))) * position
    result = diagnose([sampled("only", 0.02, position, force, 0.02, 5)])
    (held_back,) = result.experiment.tests
    assert len(result.experiment.training.force) == 1400
    assert held_back.force.size >= 600
    assert (result.status, result.selected) == ("named", ("softening",))
    assert result.model.test_rms == pytest.approx(0.02, rel=0.1)
    wear = {item.name: item for item in result.ranking[0].estimates}
    assert {"stiffness_lost", "share_lost"} & set(wear)  # of a spring alone they are the same
    assert wear["path_constant"].low < 150.0 < wear["path_constant"].high


def test_one_record_does_not_claim_that_nothing_is_missing():
    _time, position, _ = sines(6, 30.0, 0.02, 3.0, 0.0417)
    force = 1.2 * position + 0.8 * branch(position, 0.3, 0.02)
    diagnosis = lumbar.diagnose([sampled("only", 0.02, position, force, 0.02, 6)])
    assert (diagnosis.status, diagnosis.result.experiment.is_split) == ("adequate", True)
    assert has_tokens(diagnosis.headline, "last part of the record")
    texts = " ".join([*diagnosis.sentences, *diagnosis.explain(), diagnosis.to_html()])
    assert "unseen records" not in texts
    assert "Nothing is missing" not in texts


@pytest.mark.parametrize(
    ("status", "after", "verdict"),
    [
        ("named", "unexplained", "named, incomplete"),
        ("named", "adequate", "named"),
        ("tied", "unexplained", "tied"),
    ],
)
def test_named_effects_that_leave_more_are_incomplete(status, after, verdict):
    assert DiagnosisResult(status=Status(status), refined_status=Status(after)).verdict == verdict


STRENGTHS = (4.0, 8.0, 16.0)


@cache
def diagnosed(effect, seed, strength=8.0, columns=True, periodic=True):
    experiment = make_pendulum_experiment(effect, seed, strength, columns, periodic)
    return experiment, diagnose(records_of(experiment.records), "pendulum")


@pytest.mark.parametrize(
    ("effect", "seed", "strength"),
    [
        pytest.param(
            effect,
            seed,
            strength,
            marks=pytest.mark.statistical if number % len(STRENGTHS) == seed else pytest.mark.acceptance,
        )
        for number, effect in enumerate(EFFECTS)
        for seed, strength in enumerate(STRENGTHS)
    ],
)
def test_pendulum_effect_is_named(effect, seed, strength):
    experiment, diagnosis = diagnosed(effect, seed, strength)
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))
    assert diagnosis.model.test_rms < 1.25 * experiment.noise_rms
    floor = diagnosis.experiment.floor
    if effect in ("hand_load", "variable_length", "moving_pivot"):
        # The angle repeats; box, length and pivot do not, and what differs between periods is theirs.
        assert floor is None
        assert diagnosis.complete is None
    else:
        assert diagnosis.complete
        assert floor.rms == pytest.approx(experiment.noise_rms, rel=0.1)


@pytest.mark.parametrize("effect", ["hand_load", "variable_length", "moving_pivot"])
def test_pendulum_effect_is_named_from_angle_only(effect):
    _, diagnosis = diagnosed(effect, 0, columns=False)
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))
    missing = {role for form, roles in diagnosis.not_tried if form.effect == effect for role in roles}
    assert missing


@pytest.mark.parametrize("effect", ["passive_stiffness", "coulomb_friction"])
def test_pendulum_effect_is_named_without_repetition(effect):
    _, diagnosis = diagnosed(effect, 1, periodic=False)
    assert diagnosis.experiment.floor is None
    assert diagnosis.complete is None
    assert (diagnosis.status, diagnosis.selected) == ("named", (effect,))


@pytest.mark.statistical
@pytest.mark.parametrize("seed", range(2))
def test_pendulum_without_effect_is_adequate(seed):
    assert diagnosed("", seed)[1].status == "adequate"
    assert diagnosed("", seed, periodic=False)[1].status == "adequate"


def test_rounded_angle_is_not_an_effect():
    experiment = make_pendulum_experiment("drag", 5, 8.0)
    records = [item.with_values(input=np.round(item["input"], 4)) for item in records_of(experiment.records)]
    diagnosis = diagnose(records, "pendulum")
    assert diagnosis.selected == ("drag",)
    assert diagnosis.complete


@pytest.mark.parametrize(
    ("effect", "names"),
    [
        ("hand_load", {"box_mass": "box_kg", "hand_distance": "box_m"}),
        ("variable_length", {"moving_mass": "body_kg"}),
    ],
)
def test_pendulum_masses_and_distances_are_estimated(effect, names):
    experiment, diagnosis = diagnosed(effect, 2, 16.0)
    result = {item.name: item for item in diagnosis.ranking[0].estimates}
    for name, truth in names.items():
        spread = (result[name].high - result[name].low) / 2
        assert abs(result[name].value - experiment.truth[truth]) < 2 * spread
        assert spread < 0.2 * result[name].value


def test_refined_pendulum_is_read_back_from_its_file(tmp_path):
    experiment = make_pendulum_experiment("moving_pivot", 2, 12.0)
    records = records_of(experiment.records)
    refined = lumbar.refine(records, ["moving_pivot"], base="pendulum")
    base, changed = refined.path
    assert changed.test_rms < 0.2 * base.test_rms
    refined.save(tmp_path)
    model = lumbar.load_models(tmp_path / "refined.json")[1]
    assert model.name == "pendulum+moving_pivot"
    assert model == refined.model
    again = model.simulate(records[1])
    assert np.sqrt(np.mean((again - records[1]["output"])[50:] ** 2)) < 1.1 * experiment.noise_rms


def test_pendulum_has_no_sensor_zero():
    records = records_of(make_pendulum_experiment("drag", 0).records)
    pulled = [item.with_values(output=item["output"] + 30.0) for item in records]
    (model,) = lumbar.refine(records, [], base="pendulum").path
    (without_zero,) = lumbar.refine(pulled, [], base="pendulum").path
    assert (model.fit.zero, without_zero.fit.zero) == (0.0, 0.0)
    assert without_zero.train_rms > model.train_rms + 10
