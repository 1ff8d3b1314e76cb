"""The catalogue: all in its YAML files, complete, described, and each form what its equation says."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.stability import PendulumSettings
from lumbar.tissue.effects import catalogue
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.effects.hooks import HOOKS
from lumbar.tissue.effects.notation import load_effects, shipped_effect
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import Motion

FORMS = [form for effect in TISSUE.values() for form in effect.forms]


@pytest.fixture(scope="module")
def motion():
    time = np.arange(1200) * 0.01
    return Motion(time, 3 * np.sin(2 * np.pi * 0.7 * time) + np.cos(2 * np.pi * 2.3 * time), 0.01)


def middle(form):
    return np.array([np.sqrt(shape.low * shape.high) for shape in form.nonlinear])


@pytest.mark.parametrize("system", CATALOGUES)
def test_every_effect_is_described(system):
    for name, effect in CATALOGUES[system].items():
        assert effect.mechanism.endswith(".") and effect.source and effect.experiment, name
        assert len({form.name for form in effect.forms}) == len(effect.forms)
        for form in effect.forms:
            assert form.equation and form.effect == name
            parameters = [*form.linear, *form.nonlinear]
            assert len({item.name for item in parameters}) == len(parameters)
            assert all(item.unit for item in parameters)


EQUATIONS = {
    "hardening_stiffness/cubic": lambda z, v, a, t, s: [z**3],
    "hardening_stiffness/exponential": lambda z, v, a, t, s: [np.sign(z) * (np.exp(np.abs(z) / s[0]) - 1)],
    "quadratic_stiffness/quadratic": lambda z, v, a, t, s: [z * z],
    "coulomb_friction/coulomb": lambda z, v, a, t, s: [np.tanh(v / s[0])],
    "depth_dependent_damping/bilinear": lambda z, v, a, t, s: [z * v, v],
    "quadratic_damping/quadratic": lambda z, v, a, t, s: [np.sign(v) * v**2],
    "hardening_stiffness/power": lambda z, v, a, t, s: [z * np.abs(z) ** (s[0] - 1)],
    "quadratic_stiffness/rounded": lambda z, v, a, t, s: [np.sqrt(z**2 + s[0] ** 2) - s[0]],
    "quadratic_stiffness/deep": lambda z, v, a, t, s: [np.where(z > s[0], z - s[0], 0)],
    "quadratic_stiffness/shallow": lambda z, v, a, t, s: [np.where(z < -s[0], z + s[0], 0)],
    "depth_dependent_damping/hunt_crossley": lambda z, v, a, t, s: [np.where(z > 0, z, 0) ** s[0] * v, v],
    "inertia/mass": lambda z, v, a, t, s: [a],
    "drift/power": lambda z, v, a, t, s: [t ** s[0]],
    "drift/settling": lambda z, v, a, t, s: [1 - np.exp(-t / s[0])],
    "periodic_disturbance/sine": lambda z, v, a, t, s: [
        np.sin(2 * np.pi * s[0] * t),
        np.cos(2 * np.pi * s[0] * t),
    ],
}


@pytest.mark.parametrize("key", EQUATIONS)
def test_columns_against_the_equation_with_exact_derivatives(key, motion):
    form = next(form for form in FORMS if form.key == key)
    slow, fast, time = 2 * np.pi * 0.7, 2 * np.pi * 2.3, motion.time
    velocity = 3 * slow * np.cos(slow * time) - fast * np.sin(fast * time)
    acceleration = -3 * slow**2 * np.sin(slow * time) - fast**2 * np.cos(fast * time)
    expected = EQUATIONS[key](motion.position, velocity, acceleration, time, middle(form))
    for found, wanted in zip(form.columns(motion, middle(form)), expected, strict=True):
        assert np.abs(found - wanted)[10:-10].max() < 2e-3 * np.abs(wanted).max()


def test_output_forms_limit_the_force(motion):
    force = 10 * motion.position
    limits = {form.key: form for form in FORMS if form.place is Place.OUTPUT}
    lost = limits["contact_loss/sharp"].output_transform(force, motion, np.array([4.0]))
    assert lost.min() == -4.0
    assert np.array_equal(lost[force > -4], force[force > -4])
    clipped = limits["saturation/sharp"].output_transform(force, motion, np.array([6.0]))
    assert (clipped.min(), clipped.max()) == (-6.0, 6.0)
    soft = limits["contact_loss/soft"].output_transform(force, motion, np.array([4.0, 1e-3]))
    assert np.allclose(soft, lost, atol=1e-2)


def test_a_rounded_limit_tends_to_the_sharp_one_and_does_not_overflow(motion):
    force = np.concatenate([10 * motion.position, [1e30, -1e30]])
    forms = {form.key: form.output_transform for form in FORMS if form.place is Place.OUTPUT}
    rounded = forms["saturation/rounded"](force, motion, np.array([6.0, 400.0]))
    assert np.allclose(rounded, np.clip(force, -6, 6), atol=0.02)
    expected = force[:-2] / (1 + np.abs(force[:-2] / 6.0) ** 5) ** 0.2
    assert np.allclose(forms["saturation/rounded"](force, motion, np.array([6.0, 5.0]))[:-2], expected)


def test_iwans_elements_slide_one_after_the_other():
    """Pushed from rest, stiffness falls by one element's share whenever it begins to slide."""
    position = np.linspace(0, 4, 401)
    form = next(form for form in FORMS if form.key == "hysteresis/iwan")
    columns = form.columns(Motion(0.01 * np.arange(401), position, 0.01), np.array([2.0]))
    for distance, column in zip((2.0, 1.0, 0.5, 0.25), columns, strict=True):
        assert np.allclose(column, np.minimum(position / distance, 1.0))


def test_an_effect_of_the_users_own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        "from lumbar.tissue.models.form import LinearParameter, Effect, Form, Place\n"
        "STEP = Effect('step', 'A step at zero.', (Form('step', 'F1*where(z > 0, 1, 0)', Place.PARALLEL,\n"
        "    (LinearParameter('step_force', '{y}', symbol='F1'),)),), 'me')\n",
        encoding="utf-8",
    )
    assert list(load_effects(path)) == ["step"]
    path.write_text(path.read_text().replace("F1*where", "F_2*where"), encoding="utf-8")
    with pytest.raises(
        InputError,
        match=r"own.py: 1 problem\n  - step/step, equation: unknown symbol F_2; known are .* F1 and the",
    ):
        load_effects(path)
    path.write_text("x = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match="defines no Effect"):
        load_effects(path)
    path.write_text("import nothing_of_this_name\n", encoding="utf-8")
    with pytest.raises(InputError, match="ModuleNotFoundError"):
        load_effects(path)
    with pytest.raises(InputError, match="not a Python file"):
        load_effects(tmp_path / "absent.py")


@pytest.mark.parametrize(("system", "name"), [("tissue", "effects"), ("pendulum", "pendulum_effects")])
def test_the_pages_of_the_catalogues_say_what_the_definitions_say(project, system, name):
    from generate.effects_reference import effects_page

    page = project / "docs" / "tissue" / f"{name}.md"
    text = page.read_text(encoding="utf-8")
    assert text == effects_page(system), "run make docs"
    for effect, definition in CATALOGUES[system].items():
        picture = f"images/{name}/{effect}.svg"
        shown = any(not form.channels for form in definition.forms)
        assert (picture in text) == shown
        assert (page.parent / picture).is_file() == shown


FOLDER = Path(catalogue.__file__).parent
FILES = sorted(FOLDER.glob("*/*.yaml"))


def test_every_file_of_the_catalogue_is_in_it():
    for name in ("tissue", "pendulum", "motion_sensor"):
        effects = getattr(catalogue, name.upper())
        files = {path.stem: path for path in (FOLDER / name).glob("*.yaml")}
        assert set(effects) == files.keys()
        assert all(effect.name == key for key, effect in effects.items())


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_the_catalogues_files_are_read_as_a_users(path):
    """Strictly, with each key once and every equation tried; only hooks are not for them."""
    problems = Problems("catalogue")
    strict = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    assert strict.content == yaml.safe_load(path.read_text(encoding="utf-8"))
    for form in shipped_effect(path).forms:
        form.check()
    if hooked := sorted(HOOKS.keys() & {key for form in strict.content["forms"] for key in form}):
        with pytest.raises(InputError, match=f"{hooked[0]}: unknown key"):
            load_effects(path)
    else:
        assert load_effects(path)[path.stem] == shipped_effect(path)


def test_hooks_are_named_and_used():
    named = {key: set() for key in HOOKS}
    for path in FILES:
        for form in yaml.safe_load(path.read_text(encoding="utf-8"))["forms"]:
            for key in HOOKS.keys() & form.keys():
                named[key].add(form[key])
    assert named == {key: set(known) for key, known in HOOKS.items()}


def test_masses_weigh_what_the_settings_say():
    constants = [
        item for effect in catalogue.PENDULUM.values() for form in effect.forms for item in form.constants
    ]
    assert {item.value for item in constants if item.symbol == "g"} == {PendulumSettings().gravity_m_s2}


def test_an_effect_is_read_when_it_is_asked_for():
    effects = catalogue.Catalogue("tissue", "drift inertia")
    assert list(effects) == ["drift", "inertia"]
    assert effects["drift"] is effects["drift"]
    assert effects._effects["inertia"] is None
