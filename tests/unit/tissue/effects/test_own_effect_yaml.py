"""An effect of a user's own in a few lines of YAML: from equation to diagnosis, page and FMU; and what is refused."""

import json
import re

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import entry_of_effects
from periodic_records import multisine, noise, record, relaxing_force
from runtime_models import SETTINGS, held_to_its_simulation, models_json, selected

from case_tables import cases
from lumbar.base.errors import InputError
from lumbar.publishing.pages.diagnosis_page import evidence_sections
from lumbar.tissue.diagnosis.evidence.evidence import gather_evidence
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.effects.catalogue import (
    catalogue_with,
    catalogues_with,
    read_base,
)
from lumbar.tissue.models.fitted_model import models_document, read_models
from lumbar.tissue.models.motion import Motion
from refusing import refusal
from study_settings import changed

RIBS = """
name: ribs
mechanism: The tip runs over ribs at even distances.
equation: A*sin(2*pi*z/p) + B*cos(2*pi*z/p)
parameters:
  A: {name: sine_of_ribs, unit: "{y}", sign: any}
  B: {name: cosine_of_ribs, unit: "{y}", sign: any}
  p: {name: rib_distance, unit: "{x}", start: [0.3, 3.0], scale: position, points: 8}
"""
"""No effect of the catalogue looks like it."""
DAHL = """
name: own_friction
mechanism: Friction that builds up with the distance.
equation: "Fc*r"
state: {r: "v/d*(1 - r*sign(v))"}
parameters:
  Fc: {name: coulomb_force, unit: "{y}"}
  d: {name: distance, unit: "{x}", start: [0.01, 1.0], scale: position}
"""
SENSOR = """
name: own_sensor
mechanism: The sensor is not linear.
place: output
equation: F + F**3/F_n**2
parameters:
  F_n: {name: nonlinearity, unit: "{y}", start: [3, 30], scale: force, reach: [0.5, 2]}
"""


def written(folder, text: str, name: str = "own.yaml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def ribbed(tmp_path_factory):
    """Diagnosis of a tissue with ribs of 1.7 mm, with the catalogue and the effect's own file."""
    catalogue = catalogue_with([written(tmp_path_factory.mktemp("own"), RIBS)])
    tests = []
    for seed, periods in ((1, 8), (2, 3)):
        z = 0.5 * multisine(periods, 500, range(1, 25), seed)
        force = relaxing_force(z) + 0.2 * np.sin(2 * np.pi * z / 1.7) + 0.02 * noise(len(z), seed + 2)
        tests.append(record(z, force, f"record {seed}"))
    settings = DiagnosisSettings(catalogue=catalogue, most_effects=2)
    return diagnose(tests, settings), tests, settings


def test_user_defined_effect_is_named_with_its_numbers(ribbed):
    diagnosis, _, settings = ribbed
    assert diagnosis.status == "named"
    assert diagnosis.selected == ("ribs",)
    fit = diagnosis.model.fit
    assert fit.nonlinear[-1] == pytest.approx(1.7, rel=0.01)
    assert fit.linear[-2:] == pytest.approx([0.2, 0.0], abs=0.01)
    sections = evidence_sections(diagnosis, gather_evidence(diagnosis, settings, 1), settings.catalogue, {})
    assert "ribs" in "".join(sections["Parameters"])


def test_example_in_yaml_equals_example_in_python(project):
    folder = project / "examples" / "own_effect"
    twins = [
        catalogue_with([folder / f"hertzian_contact.{kind}"])["hertzian_contact"] for kind in ("py", "yaml")
    ]
    assert twins[0] == twins[1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    cases(__file__, "lacking"),
)  # fmt: skip
def test_problem_in_effect_file_names_key_and_line(old, new, words, tmp_path):
    assert old in RIBS
    path = written(tmp_path, RIBS.replace(old, new))
    with pytest.raises(InputError, match=re.compile(rf"{re.escape(str(path))}.*(?:{words})", re.DOTALL)):
        catalogue_with([path])


def test_user_file_may_use_flags_of_catalogue(tmp_path):
    text = RIBS.replace(
        "equation:", "linear: true\nunrepeated: true\ngeneral: true\nessential: [sine_of_ribs]\nequation:"
    )
    text = text.replace("points: 8", "lines: 0.7, follows_record: true, decisive: true")
    effect = catalogue_with([written(tmp_path, text)])["ribs"]
    form, distance = effect.forms[0], effect.forms[0].nonlinear[0]
    assert (effect.linear, effect.unrepeated, effect.accumulates) == (True, True, False)
    assert (form.general, form.essential) == (True, ("sine_of_ribs",))
    assert (distance.lines, distance.follows_record, distance.decisive) == (0.7, True, True)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "name: missing"),
        (b"- a\n- b\n", "no mapping"),
        (b"x" * 2_000_000, "2000000 bytes; at most 1000000"),
        (b"name: \xff\xfe", r"own\.yaml, line 1: byte 0xff is not UTF-8"),
        (None, r"own\.yaml: no such file"),
    ],
    ids=["empty", "list", "large", "bytes", "absent"],
)
def test_other_files_are_refused(content, words, tmp_path):
    if content is not None:
        (tmp_path / "own.yaml").write_bytes(content)
    with pytest.raises(InputError, match=words):
        catalogue_with([tmp_path / "own.yaml"])


@pytest.mark.parametrize(
    ("equation", "state", "where"),
    [
        (
            "A*sign(v)*sqrt(abs(v))",
            "{}",
            "line 4: equation: form equation: the derivative by v is not finite",
        ),
        ("A/v", "{}", "line 4: equation: form equation: the value is not finite"),
        ("A*sqrt(z**2)", "{}", "line 4: equation: form equation: the derivative by z is not finite"),
        (
            "A*r",
            '{r: "sqrt(abs(v)) - r"}',
            "line 5: state.r: form equation: the derivative by v is not finite",
        ),
    ],
)
def test_an_equation_has_finite_value_and_slope_at_rest(equation, state, where, tmp_path):
    text = f"""
name: own
mechanism: It has no slope at rest.
equation: {equation}
state: {state}
parameters: {{A: {{name: size, unit: "{{y}}"}}}}
"""
    message = refusal(catalogue_with, [written(tmp_path, text)])
    assert f"{where} at z = 0, v = 0; write tanh(v/vs) for sign(v), sqrt(v**2 + e**2)" in message


@pytest.mark.parametrize(
    "equation",
    ["A*tanh(v/p)", "A*sqrt(v**2 + p)*z", "A*abs(v)*v*p", "A*sign(v)*p", "A*p**z", "A*sign(v)*abs(v)**p"],
)
def test_a_kink_a_rounded_root_or_a_fitted_power_below_1_is_allowed(equation, tmp_path):
    text = f"""
name: own
mechanism: M.
equation: {equation}
parameters:
  A: {{name: size, unit: "{{y}}"}}
  p: {{name: power, unit: "1", start: [0.4, 0.6], scale: one}}
"""
    assert "own" in catalogue_with([written(tmp_path, text)])


def test_the_same_name_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="'ribs' is taken"):
        catalogue_with([written(tmp_path, RIBS), written(tmp_path, RIBS, "again.yaml")])


def test_the_pages_examples_are_read(project, tmp_path):
    page = (project / "docs" / "tissue" / "own_effect.md").read_text(encoding="utf-8")
    effect, base = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert catalogue_with([written(tmp_path, effect)])["own_friction"].forms[0].state
    assert len(read_base(written(tmp_path, base)).form.state) == 3


CREEP = """
name: own_creep
mechanism: A spring behind a dashpot that follows the tool.
equation: k*(z - q)
state: {q: {rate: "(z - q)/tau", start: z}}
parameters:
  k: {name: stiffness, unit: "{y}/{x}"}
  tau: {name: creep_time, unit: s, start: [0.05, 0.5], scale: time}
"""
"""A Maxwell branch by its dashpot's position, which is at rest where the tool is first."""
FOLLOWED = """
name: own_chain
mechanism: Two branches in a row.
equation: k*(z - q)
state:
  q: {rate: "(p - q)/tau", start: z}
  p: {rate: "(z - p)/(tau*(1 + p**2))", start: "z*exp(-tau)"}
parameters:
  k: {name: stiffness, unit: "{y}/{x}"}
  tau: {name: creep_time, unit: s, start: [0.05, 0.5], scale: time}
"""
"""Two states, one of which is not linear."""
LADDER = """
name: own_ladder
mechanism: Six branches in a row, as many states as a form may have.
equation: k*(z - r_0)
state:
  r_0: "(r_1 - r_0)/tau"
  r_1: "(r_0 + r_2 - 2*r_1)/tau"
  r_2: "(r_1 + r_3 - 2*r_2)/tau"
  r_3: "(r_2 + r_4 - 2*r_3)/tau"
  r_4: "(r_3 + r_5 - 2*r_4)/tau"
  r_5: "(r_4 + z - 2*r_5)/tau"
parameters:
  k: {name: stiffness, unit: "{y}/{x}"}
  tau: {name: creep_time, unit: s, start: [0.05, 0.5], scale: time}
"""


@pytest.mark.parametrize(
    ("text", "effect", "number"), [(DAHL, "hysteresis", 0.3), (CREEP, "second_relaxation", 0.2)]
)
def test_a_state_in_yaml_is_the_catalogues_own(text, effect, number, tmp_path):
    """Dahl's friction, and creep at rest where the tool is first, from their equations: the closed forms, for straight lines.

    A smooth motion turns between two samples; the closed form knows, a state that is solved from sample to sample does not.
    """
    catalogue = catalogue_with([written(tmp_path, text)])
    own, built_in = catalogue[text.split()[1]].forms[0], catalogue[effect].forms[0]
    position = np.cumsum(np.random.default_rng(5).standard_normal(500)) * 0.1
    position += 2.0 if text == CREEP else -position[0]
    motion = Motion(np.arange(500) * 0.01, position, 0.01, smooth=False)
    (found,), (expected,) = (form.columns(motion, np.array([number])) for form in (own, built_in))
    assert found[0] == 0.0
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert own.text.endswith("q(0) = z") == own.latex.endswith(r"q(0) = z") == (text == CREEP)


@ON_LINUX
@pytest.mark.parametrize(
    ("text", "linear", "nonlinear"),
    [
        (RIBS, [0.2, 0.1], [1.7]),
        (DAHL, [0.6], [0.3]),
        (SENSOR, [], [20.0]),
        (CREEP, [0.6], [0.3]),
        (FOLLOWED, [0.6], [0.3]),
        (LADDER, [0.6], [0.3]),
    ],
    ids=["ribs", "dahl", "sensor", "creep", "chain", "ladder"],
)
def test_an_equation_in_yaml_becomes_an_fmu(text, linear, nonlinear, zig_cache, tmp_path):
    catalogue, name = catalogue_with([written(tmp_path, text)]), text.split()[1]
    entry = entry_of_effects("KB", {f"{name}/equation": (linear, nonlinear)}, catalogue)
    chosen = changed(SETTINGS, models=[entry["name"]], moving_average_ms=0)
    (model,) = selected(models_json(entry), chosen, catalogue)
    held_to_its_simulation(model, tmp_path, zig_cache)
    if text == CREEP:  # at rest where the tool is first
        held = model.dynamics.response(np.full(50, 3.0))
        np.testing.assert_allclose(held, held[0], rtol=1e-14)


@pytest.mark.parametrize(
    ("start", "words"),
    cases(__file__, "starts"),
)
def test_start_with_unknown_symbols_is_rejected(start, words, tmp_path):
    with pytest.raises(InputError, match=re.compile(words, re.DOTALL)):
        catalogue_with([written(tmp_path, CREEP.replace("start: z}", f"start: {start}}}"))])


def carrying(folder) -> dict:
    """Content of a file of one model with an effect of the user's own."""
    catalogue = catalogue_with([written(folder, DAHL)])
    entry = entry_of_effects("KB", {"own_friction/equation": ([0.6], [0.3])}, catalogue)
    models = read_models(models_json(entry), {"tissue": catalogue})
    return json.loads(json.dumps(models_document(models, "drawn")))


def test_models_file_contains_user_defined_effect(tmp_path):
    content = carrying(tmp_path)
    assert list(content["effects"]) == ["own_friction"]
    (model,) = read_models(content, catalogues_with([], content))
    assert models_document([model], "drawn") == content
    assert read_models(content, catalogues_with([tmp_path / "own.yaml"], content)) == [model]


def test_effect_in_models_file_is_checked(tmp_path):
    content = carrying(tmp_path)
    own = content["effects"]["own_friction"]
    for changes, words in (
        ({"equation": "Fc*r*__import__('os')"}, "effects.own_friction: equation: "),
        ({"by_hand": "play"}, "effects.own_friction: by_hand: unknown key"),
        ({"equation": "Fc*r/z"}, "effects.own_friction: equation: .* is not finite"),
        ({"name": "delay"}, "effects.own_friction: .*name: own_friction"),
        (
            {"constants": {"c": {"value": 10**400, "unit": "1"}}},
            "constants.c.value: .*which is not finite",
        ),
    ):
        changed_content = {**content, "effects": {"own_friction": {**own, **changes}}}
        with pytest.raises(InputError, match=re.compile(words, re.DOTALL)):
            catalogues_with([], changed_content)
    with pytest.raises(InputError, match=r"effects\.delay: not the effect that has this name"):
        catalogues_with([], {"effects": {"delay": {**own, "name": "delay"}}})
    with pytest.raises(InputError, match=r"effects: \['own_friction'\]"):
        catalogues_with([], {"effects": ["own_friction"]})


def test_effect_file_changed_after_fit_is_rejected(tmp_path):
    content = carrying(tmp_path)
    other = written(tmp_path, DAHL.replace("1 - r*sign(v)", "1 - 2*r*sign(v)"))
    with pytest.raises(
        InputError, match=r"own_friction: not the effect .*leave the effect's file out, or fit"
    ):
        catalogues_with([other], content)
