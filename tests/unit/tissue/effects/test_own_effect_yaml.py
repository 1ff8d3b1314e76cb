"""A user-defined effect in a few lines of YAML: diagnosis, file of models, and errors of its file."""

import json
import re

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from case_tables import cases

RIBS = """
name: ribs
mechanism: The tip runs over ribs at even distances.
equation: A*sin(2*pi*z/p) + B*cos(2*pi*z/p)
parameters:
  A: {name: sine_of_ribs, unit: "{y}", sign: any}
  B: {name: cosine_of_ribs, unit: "{y}", sign: any}
  p: {name: rib_distance, unit: "{x}", start: [0.3, 3.0], scale: position, points: 8}
"""
"""No effect of the catalogue is similar."""
DAHL = """
name: own_friction
mechanism: Friction that builds up with the distance.
equation: "Fc*r"
state: {r: "v/d*(1 - r*sign(v))"}
parameters:
  Fc: {name: coulomb_force, unit: "{y}"}
  d: {name: distance, unit: "{x}", start: [0.01, 1.0], scale: position}
"""
CREEP = """
name: own_creep
mechanism: A spring behind a dashpot that follows the tool.
equation: k*(z - q)
state: {q: {rate: "(z - q)/tau", start: z}}
parameters:
  k: {name: stiffness, unit: "{y}/{x}"}
  tau: {name: creep_time, unit: s, start: [0.05, 0.5], scale: time}
"""
"""A Maxwell branch by the position of its dashpot, which starts at that of the tool."""


def load_effects(folder, *contents: str | bytes):
    """Load a study with these effect files, own_0.yaml and so on, and a few effects per diagnosis."""
    names = [f"own_{number}.yaml" for number in range(len(contents))]
    for name, content in zip(names, contents, strict=True):
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    study = folder / "study.yaml"
    study.write_text(
        f"improvement: {{effect_files: [{', '.join(names)}], most_effects: 2}}", encoding="utf-8"
    )
    return lumbar.load_settings(study)


def assert_rejected(folder, content, message):
    path = re.escape(str(folder / "own_0.yaml"))
    with pytest.raises(lumbar.InputError, match=re.compile(rf"{path}.*(?:{message})", re.DOTALL)):
        load_effects(folder, content)


def test_user_defined_effect_is_named_with_its_parameters(tmp_path):
    records = []
    for seed, periods in ((1, 8), (2, 3)):
        z = 0.5 * multisine(periods, 500, range(1, 25), seed)
        force = relaxing_force(z) + 0.2 * np.sin(2 * np.pi * z / 1.7) + 0.02 * noise(len(z), seed + 2)
        records.append(record(z, force, f"record {seed}"))
    diagnosis = lumbar.diagnose(records, settings=load_effects(tmp_path, RIBS))
    assert (diagnosis.result.status, diagnosis.selected) == ("named", ("ribs",))
    assert diagnosis.model["ribs.rib_distance"].value == pytest.approx(1.7, rel=0.01)
    assert diagnosis.model["ribs.sine_of_ribs"].value == pytest.approx(0.2, abs=0.01)
    assert diagnosis.model["ribs.cosine_of_ribs"].value == pytest.approx(0.0, abs=0.01)
    assert "ribs" in diagnosis.to_html()


@pytest.mark.parametrize(("old", "new", "message"), cases(__file__, "lacking"))
def test_problem_in_effect_file_names_key_and_line(old, new, message, tmp_path):
    assert old in RIBS
    assert_rejected(tmp_path, RIBS.replace(old, new), message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "name: missing"),
        (b"- a\n- b\n", "key: value"),
        (b"x" * 2_000_000, "2000000 .*1000000"),
        (b"name: \xff\xfe", "line 1: .*0xff.*UTF-8"),
    ],
    ids=["empty", "list", "large", "bytes"],
)
def test_file_that_is_not_an_effect_is_rejected(content, message, tmp_path):
    assert_rejected(tmp_path, content, message)


@pytest.mark.parametrize(
    ("equation", "state", "place"),
    [
        ("A*sign(v)*sqrt(abs(v))", "{}", r"line 4: equation: .*\bderivative\b.*\bv\b"),
        ("A/v", "{}", r"line 4: equation: .*\bvalue\b"),
        ("A*sqrt(z**2)", "{}", r"line 4: equation: .*\bderivative\b.*\bz\b"),
        ("A*r", '{r: "sqrt(abs(v)) - r"}', r"line 5: state.r: .*\bderivative\b.*\bv\b"),
    ],
)
def test_equation_without_finite_slope_at_rest_is_rejected(equation, state, place, tmp_path):
    text = f"""
name: own
mechanism: It has no slope at rest.
equation: {equation}
state: {state}
parameters: {{A: {{name: size, unit: "{{y}}"}}}}
"""
    assert_rejected(tmp_path, text, rf"{place}.*z = 0, v = 0.*tanh\(v/vs\)")


@pytest.mark.parametrize(
    "equation",
    ["A*tanh(v/p)", "A*sqrt(v**2 + p)*z", "A*abs(v)*v*p", "A*sign(v)*p", "A*p**z", "A*sign(v)*abs(v)**p"],
)
def test_kink_rounded_root_and_fitted_power_are_allowed(equation, tmp_path):
    text = f"""
name: own
mechanism: M.
equation: {equation}
parameters:
  A: {{name: size, unit: "{{y}}"}}
  p: {{name: power, unit: "1", start: [0.4, 0.6], scale: one}}
"""
    load_effects(tmp_path, text)


def test_duplicate_effect_is_rejected(tmp_path):
    with pytest.raises(lumbar.InputError, match=r"own_1\.yaml, line 2: name: .*'ribs'"):
        load_effects(tmp_path, RIBS, RIBS)


@pytest.mark.parametrize(("start", "message"), cases(__file__, "starts"))
def test_start_with_unknown_symbols_is_rejected(start, message, tmp_path):
    assert_rejected(tmp_path, CREEP.replace("start: z}", f"start: {start}}}"), message)


@pytest.fixture(scope="module")
def refined(tmp_path_factory):
    """Folder with the file of an effect and a model with it in refined.json."""
    folder = tmp_path_factory.mktemp("own")
    z = 0.5 * multisine(3, 200, range(1, 12))
    settings = load_effects(folder, DAHL)
    records = [record(z, relaxing_force(z) + 0.01 * noise(len(z), 2))]
    lumbar.refine(records, ["own_friction"], base="KB", settings=settings).save(folder)
    return folder


def test_models_file_contains_user_defined_effect(refined):
    content = json.loads((refined / "refined.json").read_text("utf-8"))
    assert list(content["effects"]) == ["own_friction"]
    models = lumbar.load_models(refined / "refined.json")
    assert models[-1].name == "KB+own_friction"
    assert lumbar.load_models(refined / "refined.json", [refined / "own_0.yaml"]) == models


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"equation": "Fc*r*__import__('os')"}, "effects.own_friction: equation: .*__import__"),
        ({"by_hand": "play"}, "effects.own_friction: by_hand: .*name, mechanism, source"),
        ({"equation": "Fc*r/z"}, "effects.own_friction: equation: .*z = 0, v = 0"),
        ({"name": "delay"}, "effects.own_friction: .*name: own_friction"),
        (
            {"constants": {"c": {"value": 10**400, "unit": "1"}}},
            "effects.own_friction: constants.c.value: .*1000000",
        ),
    ],
)
def test_effect_in_models_file_is_checked(refined, changes, message):
    content = json.loads((refined / "refined.json").read_text("utf-8"))
    content["effects"]["own_friction"] |= changes
    (refined / "changed.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=re.compile(message, re.DOTALL)):
        lumbar.load_models(refined / "changed.json")


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"delay": {"name": "delay"}}, r"effects\.delay: .*\bname\b"),
        (["own_friction"], r"effects: \['own_friction'\]"),
    ],
)
def test_models_file_with_other_effects_is_rejected(refined, effects, message):
    content = json.loads((refined / "refined.json").read_text("utf-8"))
    definition = content["effects"]["own_friction"]
    if isinstance(effects, dict):
        effects = {name: {**definition, **entry} for name, entry in effects.items()}
    (refined / "changed.json").write_text(json.dumps({**content, "effects": effects}), encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=message):
        lumbar.load_models(refined / "changed.json")


def test_effect_file_changed_after_fit_is_rejected(refined, tmp_path):
    other = tmp_path / "own.yaml"
    other.write_text(DAHL.replace("1 - r*sign(v)", "1 - 2*r*sign(v)"), encoding="utf-8")
    with pytest.raises(lumbar.InputError, match=r"effects\.own_friction: .*\bfile\b"):
        lumbar.load_models(refined / "refined.json", [other])
