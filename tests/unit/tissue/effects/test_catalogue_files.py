"""The catalogue's YAML files: all in it, in the notation that users have, read when they are asked for."""

from pathlib import Path

import pytest
import yaml

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import read_yaml
from lumbar.settings.stability import PendulumSettings
from lumbar.tissue.effects import catalogue
from lumbar.tissue.effects.hooks import HOOKS
from lumbar.tissue.effects.notation import load_effects, shipped_effect

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
