"""A base of a user's own, with several states: from equations to fit, diagnosis, refined model and FMU; and what is refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX
from periodic_records import multisine, noise, record
from runtime_models import SETTINGS, held_to_its_simulation
from scipy.signal import StateSpace, lsim

import lumbar
from lumbar.base.errors import InputError
from lumbar.records.record import Channel
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.tissue.effects.catalogue import catalogues_with, read_base
from lumbar.tissue.fmu.build.export_model import export_models, find_models
from lumbar.tissue.models.fitted_model import read_models
from study_settings import changed

DRIVE = """
name: two_masses
mechanism: A motor turns a load through a shaft that twists.
equation: g*load
state:
  motor: z - b*motor - k*twist
  load: r*k*twist
  twist: motor - load
parameters:
  g: {name: gain, unit: "{y}/({x} s)"}
  b: {name: motor_drag, unit: 1/s, start: [0.3, 30], scale: one, points: 3}
  k: {name: twist_stiffness, unit: 1/s^2, start: [10, 1000], scale: one, points: 3}
  r: {name: mass_ratio, unit: "1", start: [0.2, 5], scale: one, points: 3}
"""
TRUE = {"gain": 2.0, "motor_drag": 4.0, "twist_stiffness": 300.0, "mass_ratio": 0.5}
ONE_EFFECT = StudySettings(improvement=ImprovementSettings(most_effects=1, propose_law=False))


def speed_of_load(torque: np.ndarray, rate_Hz: float = 100.0) -> np.ndarray:
    """By SciPy's matrix exponential, the torque in straight lines between samples."""
    gain, drag, stiffness, ratio = TRUE.values()
    state = [[-drag, 0, -stiffness], [0, 0, ratio * stiffness], [1, -1, 0]]
    drive = StateSpace(state, [[1], [0], [0]], [[0, gain, 0]], [[0]])
    _, found, _ = lsim(drive, torque, np.arange(len(torque)) / rate_Hz)
    return found


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    path = tmp_path_factory.mktemp("base") / "two_masses.yaml"
    path.write_text(DRIVE, encoding="utf-8")
    return path


def records(sensor=lambda speed: speed):
    """Torque to what the load's tachometer reads, three periods and two."""
    made = []
    for name, periods, seed in (("long", 3, 1), ("other", 2, 2)):
        torque = multisine(periods, 400, range(1, 40), seed)
        speed = speed_of_load(torque)
        made.append(record(torque, sensor(speed) + 0.002 * noise(len(torque), seed + 5), name))
    return made


@pytest.fixture(scope="module")
def refined(base):
    return lumbar.refine(records(), [], base=str(base))


def test_parameters_of_user_defined_base_are_recovered(refined, base):
    found = refined.model
    for name, value in TRUE.items():
        parameter = found[name]
        assert parameter.low < value < parameter.high
        assert parameter.value == pytest.approx(value, rel=0.02)
    assert "y = g*load, dmotor/dt = z - b*motor - k*twist" in str(found)


@pytest.mark.nightly
def test_missing_effect_is_named_with_user_defined_base(base):
    largest = 0.6 * np.abs(speed_of_load(multisine(3, 400, range(1, 40), 1))).max()
    found = lumbar.diagnose(
        records(lambda speed: largest * np.tanh(speed / largest)), base=str(base), settings=ONE_EFFECT
    )
    assert found.selected == ("saturation",)


def test_models_file_contains_user_defined_base(refined, tmp_path):
    refined.save(tmp_path)
    content = json.loads((tmp_path / "refined.json").read_text("utf-8"))
    assert list(content["bases"]) == ["two_masses"]
    (model,) = lumbar.load_models(tmp_path / "refined.json")
    assert model == refined.model
    np.testing.assert_array_equal(model.simulate(records()[1]), refined.model.simulate(records()[1]))
    content["bases"]["two_masses"]["state"]["twist"] = "motor - lode"
    with pytest.raises(InputError, match=r"bases\.two_masses: .*state\.twist.*unknown symbol lode"):
        catalogues_with([], content)


@ON_LINUX
def test_user_defined_base_becomes_fmu(refined, zig_cache, tmp_path):
    refined.save(tmp_path / "model")
    content = json.loads((tmp_path / "model" / "refined.json").read_text("utf-8"))
    chosen = changed(
        SETTINGS, models=["two_masses"], trained_on="long", estimator="output_error", moving_average_ms=0
    )
    (model,) = export_models(find_models(read_models(content, catalogues_with([], content)), chosen), chosen)
    held_to_its_simulation(model, tmp_path, zig_cache)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("name: two_masses", "name: KB", "name: .*letters a to z"),
        ("name: two_masses", "name: pendulum", "name: 'pendulum' is taken"),
        ("equation:", "place: output\nequation:", "place: unknown key; allowed: name, mechanism"),
        ("r*k*twist", "g*r*k*twist", "state.load: g is linear"),
        ("g*load", "g*load + 1", "equation: .*linear"),
        ("  g: {", "  h: {name: of_none, unit: s}\n  g: {", "h is declared and never used"),
    ],
)
def test_problems_of_base_file_are_reported(old, new, words, tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(DRIVE.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.compile(f"base own.yaml.*{words}", re.DOTALL)):
        read_base(path)


def test_forward_fit_takes_load_as_input(refined, base):
    """Of files that have the motion first: nothing is turned round, the load is the input."""
    turned = []
    for item in records():
        channels = {
            "input": Channel(item["output"], "position", "mm"),
            "output": Channel(item["input"], "force", "N"),
        }
        turned.append(replace(item, channels=channels))
    forward = StudySettings(improvement=ImprovementSettings(forward=True))
    found = lumbar.refine(turned, [], base=str(base), settings=forward).model
    assert (found.input.quantity, found.output.quantity) == ("force", "position")
    for name in TRUE:
        assert found[name].value == pytest.approx(refined.model[name].value, rel=1e-9)


def test_settings_find_base_file_and_report_problems(base):
    study = base.with_name("study.yaml")
    study.write_text("improvement: {base: two_masses.yaml}", encoding="utf-8")
    assert lumbar.load_settings(study).improvement.base == str(base)
    study.write_text("improvement: {base: none.yaml}", encoding="utf-8")
    with pytest.raises(InputError, match=r"improvement\.base.*none\.yaml"):
        lumbar.load_settings(study)
    study.write_text("improvement: {base: KX}", encoding="utf-8")
    with pytest.raises(InputError, match=r'improvement\.base: found "KX"; allowed: auto, LE'):
        lumbar.load_settings(study)


def test_the_example_is_sound(project):
    tanks = read_base(project / "examples" / "own_base" / "two_tanks.yaml")
    assert dict(tanks.form.start) == {"upper": "upper_0", "lower": "lower_0"}
