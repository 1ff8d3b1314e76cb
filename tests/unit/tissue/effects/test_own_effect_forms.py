"""Forms of user-defined effects: their keys, their states and their FMUs."""

import re

import numpy as np
import pytest
from c_programs import ON_LINUX
from effect_entries import entry_of_effects
from runtime_models import SETTINGS, check_simulation, models_json, selected
from test_own_effect_yaml import CREEP, DAHL, RIBS

from lumbar.tissue.effects.catalogue import catalogue_with, read_base
from lumbar.tissue.models.motion import Motion
from study_settings import changed

SENSOR = """
name: own_sensor
mechanism: The sensor is not linear.
place: output
equation: F + F**3/F_n**2
parameters:
  F_n: {name: nonlinearity, unit: "{y}", start: [3, 30], scale: force, reach: [0.5, 2]}
"""
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


def written(folder, text: str):
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_example_in_yaml_equals_example_in_python(project):
    folder = project / "examples" / "own_effect"
    twins = [
        catalogue_with([folder / f"hertzian_contact.{kind}"])["hertzian_contact"] for kind in ("py", "yaml")
    ]
    assert twins[0] == twins[1]


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


def test_examples_of_the_page_are_read(project, tmp_path):
    page = (project / "docs" / "tissue" / "own_effect.md").read_text(encoding="utf-8")
    effect, base = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert catalogue_with([written(tmp_path, effect)])["own_friction"].forms[0].state
    assert len(read_base(written(tmp_path, base)).form.state) == 3
    tanks = read_base(project / "examples" / "own_base" / "two_tanks.yaml")
    assert dict(tanks.form.start) == {"upper": "upper_0", "lower": "lower_0"}


@pytest.mark.parametrize(
    ("text", "effect", "number"), [(DAHL, "hysteresis", 0.3), (CREEP, "second_relaxation", 0.2)]
)
def test_state_in_yaml_equals_the_closed_form_of_the_catalogue(text, effect, number, tmp_path):
    """For straight lines between samples: unlike closed forms, solved states do not turn between two samples."""
    catalogue = catalogue_with([written(tmp_path, text)])
    own, built_in = catalogue[text.split()[1]].forms[0], catalogue[effect].forms[0]
    position = np.cumsum(np.random.default_rng(5).standard_normal(500)) * 0.1
    position += 2.0 if text == CREEP else -position[0]
    motion = Motion(np.arange(500) * 0.01, position, 0.01, smooth=False)
    (force,), (expected,) = (form.columns(motion, np.array([number])) for form in (own, built_in))
    assert force[0] == 0.0
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12)
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
def test_equation_in_yaml_becomes_an_fmu(text, linear, nonlinear, zig_cache, tmp_path):
    catalogue, name = catalogue_with([written(tmp_path, text)]), text.split()[1]
    entry = entry_of_effects("KB", {f"{name}/equation": (linear, nonlinear)}, catalogue)
    chosen = changed(SETTINGS, models=[entry["name"]], moving_average_ms=0)
    (model,) = selected(models_json(entry), chosen, catalogue)
    check_simulation(model, tmp_path, zig_cache)
    if text == CREEP:  # it starts at rest at any position
        force = model.dynamics.response(np.full(50, 3.0))
        np.testing.assert_allclose(force, force[0], rtol=1e-14)
