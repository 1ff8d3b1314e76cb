"""A user-defined base with several states: fit, diagnosis, refined model and FMU, and errors of its file."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from c_programs import ON_LINUX
from periodic_records import multisine, noise, record
from runtime_models import SETTINGS, check_simulation, selected
from scipy.signal import StateSpace, lsim

import lumbar
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
ONE_EFFECT = lumbar.StudySettings(improvement={"most_effects": 1, "propose_law": False})


def speed_of_load(torque: np.ndarray, rate_Hz: float = 100.0) -> np.ndarray:
    """Simulate by SciPy's matrix exponential, with straight lines of the torque between samples."""
    gain, drag, stiffness, ratio = TRUE.values()
    state = [[-drag, 0, -stiffness], [0, 0, ratio * stiffness], [1, -1, 0]]
    drive = StateSpace(state, [[1], [0], [0]], [[0, gain, 0]], [[0]])
    return lsim(drive, torque, np.arange(len(torque)) / rate_Hz)[1]


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    path = tmp_path_factory.mktemp("base") / "two_masses.yaml"
    path.write_text(DRIVE, encoding="utf-8")
    return path


def records(sensor=lambda speed: speed):
    """Return records from torque to the load's tachometer, of three periods and of two."""
    items = []
    for name, periods, seed in (("long", 3, 1), ("other", 2, 2)):
        torque = multisine(periods, 400, range(1, 40), seed)
        speed = speed_of_load(torque)
        items.append(record(torque, sensor(speed) + 0.002 * noise(len(torque), seed + 5), name))
    return items


@pytest.fixture(scope="module")
def refined(base):
    return lumbar.refine(records(), [], base=str(base))


def test_parameters_of_user_defined_base_are_recovered(refined, base):
    for name, value in TRUE.items():
        parameter = refined.model[name]
        assert parameter.low < value < parameter.high
        assert parameter.value == pytest.approx(value, rel=0.02)
    assert "y = g*load, dmotor/dt = z - b*motor - k*twist" in str(refined.model)


@pytest.mark.nightly
def test_missing_effect_is_named_with_user_defined_base(base):
    largest = 0.6 * np.abs(speed_of_load(multisine(3, 400, range(1, 40), 1))).max()
    saturated = records(lambda speed: largest * np.tanh(speed / largest))
    diagnosis = lumbar.diagnose(saturated, base=str(base), settings=ONE_EFFECT)
    assert diagnosis.selected == ("saturation",)


def test_models_file_contains_user_defined_base(refined, tmp_path):
    refined.save(tmp_path)
    content = json.loads((tmp_path / "refined.json").read_text("utf-8"))
    assert list(content["bases"]) == ["two_masses"]
    (model,) = lumbar.load_models(tmp_path / "refined.json")
    assert model == refined.model
    np.testing.assert_array_equal(model.simulate(records()[1]), refined.model.simulate(records()[1]))
    content["bases"]["two_masses"]["state"]["twist"] = "motor - lode"
    (tmp_path / "changed.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=r"bases\.two_masses: state\.twist: .*\blode\b.*\btwist\b"):
        lumbar.load_models(tmp_path / "changed.json")


@ON_LINUX
def test_user_defined_base_becomes_fmu(refined, zig_cache, tmp_path):
    refined.save(tmp_path / "model")
    content = json.loads((tmp_path / "model" / "refined.json").read_text("utf-8"))
    chosen = changed(
        SETTINGS, models=["two_masses"], trained_on="long", estimator="output_error", moving_average_ms=0
    )
    (model,) = selected(content, chosen)
    check_simulation(model, tmp_path, zig_cache)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("name: two_masses", "name: KB", r"own.yaml, line 2: name: .*\"KB\""),
        ("name: two_masses", "name: pendulum", "own.yaml, line 2: name: .*'pendulum'"),
        ("equation:", "place: output\nequation:", "own.yaml, line 4: place: .*name, mechanism, source"),
        ("r*k*twist", "g*r*k*twist", r"own.yaml, line 7: state.load: .*\bg\b"),
        ("g*load", "g*load + 1", r"own.yaml, line 4: equation: .*\b1\b.*\blinear"),
        ("  g: {", "  h: {name: of_none, unit: s}\n  g: {", r"own.yaml, line 9: parameters: .*\bh\b"),
    ],
)
def test_problems_of_base_file_are_reported(old, new, message, tmp_path):
    (tmp_path / "own.yaml").write_text(DRIVE.replace(old, new), encoding="utf-8")
    (tmp_path / "study.yaml").write_text("improvement: {base: own.yaml}", encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=re.compile(f"base own.yaml.*{message}", re.DOTALL)):
        lumbar.load_settings(tmp_path / "study.yaml")


def test_forward_fit_takes_load_as_input(refined, base):
    """In files with the motion first, the load is the input and nothing is exchanged."""
    motion_first = []
    for item in records():
        channels = {
            "input": lumbar.Channel(item["output"], "position", "mm"),
            "output": lumbar.Channel(item["input"], "force", "N"),
        }
        motion_first.append(replace(item, channels=channels))
    forward = lumbar.StudySettings(improvement={"forward": True})
    model = lumbar.refine(motion_first, [], base=str(base), settings=forward).model
    assert (model.input.quantity, model.output.quantity) == ("force", "position")
    for name in TRUE:
        assert model[name].value == pytest.approx(refined.model[name].value, rel=1e-9)


@pytest.mark.parametrize(
    ("base_key", "message"),
    [
        ("none.yaml", r"improvement\.base.*none\.yaml"),
        ("KX", r'line 1: improvement\.base: .*"KX".*auto, LE'),
    ],
)
def test_settings_find_base_file_and_report_wrong_bases(base, base_key, message):
    study = base.with_name("study.yaml")
    study.write_text("improvement: {base: two_masses.yaml}", encoding="utf-8")
    assert lumbar.load_settings(study).improvement.base == str(base)
    study.write_text(f"improvement: {{base: {base_key}}}", encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=message):
        lumbar.load_settings(study)
