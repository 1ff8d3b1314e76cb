"""All effects by name and system, and user-defined effects and bases from separate files or a file of models."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from lumbar.base.errors import InputError, Problems, did_you_mean
from lumbar.base.yaml_file import YamlFile, parse_key_path, read_yaml, shipped_yaml
from lumbar.settings.tissue import is_data, system_of
from lumbar.tissue.effects.notation import BaseEntry, EffectOfForms, EffectOfOneForm, HookedEffect, read_entry
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_entry import OWN_BASES

CHANNELS = {
    "box_held": "box_held",
    "length": "length_m",
    "pivot_acceleration_x": "pivot_acceleration_x_m_s2",
    "pivot_acceleration_z": "pivot_acceleration_z_m_s2",
}
"""Column name of each additional channel for effects on a pendulum, by role. box_held: share of the box that the hands carry, 0
to 1; length: from the pivot to the centre of mass; pivot acceleration: x horizontal, positive in the direction of the mass's
motion with a growing angle, z upward."""


class Catalogue(Mapping[str, Effect]):
    """Effects by name, from a folder of this package; the file of an effect is read at its first use."""

    def __init__(self, folder: str, names: str):
        self._folder = Path(__file__).parent / folder
        self._effects: dict[str, Effect | None] = dict.fromkeys(names.split())

    def __getitem__(self, name: str) -> Effect:
        effect = self._effects[name]
        if effect is None:
            file = YamlFile(f"{name}.yaml", shipped_yaml(self._folder / f"{name}.yaml"))
            # Equations of shipped files are checked by the tests.
            entry = read_entry(file, HookedEffect, Problems(f"effect {file.path}"))
            effect = entry.effect([form.form(form.name) for form in entry.forms], file)
            self._effects[name] = effect
        return effect

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)


TISSUE = Catalogue(
    "tissue",
    """hardening_stiffness strain_softening quadratic_stiffness coulomb_friction hysteresis contact_loss
    depth_dependent_damping viscous_damping quadratic_damping inertia second_relaxation relaxation_spectrum delay saturation
    drift softening periodic_disturbance backlash""",
)
"""The tissue catalogue, in the order in which reports list it."""

PENDULUM = Catalogue(
    "pendulum", "hand_load passive_stiffness coulomb_friction variable_length moving_pivot drag"
)
"""The catalogue of the pendulum of Eq. 4.1.

The input is the angle from the vertical, the output the moment that the subject exerts at the pivot. Effects on mass, length
and pivot have forms that use additional measured channels (`CHANNELS`) and forms that need the angle only."""

MOTION_SENSOR = Catalogue("motion_sensor", "absolute_value saturation")
"""Effects of the motion's sensor, if the force is the input: ``F`` of their equations is the true motion."""

CATALOGUES: dict[str, Mapping[str, Effect]] = {"tissue": TISSUE, "pendulum": PENDULUM}
"""Catalogue of effects by system (the field `system` of a base)."""


def usable_effects(
    catalogue: Mapping[str, Effect], available: Collection[str], scale: Callable[[str], float]
) -> tuple[dict[str, Effect], list[tuple[Form, tuple[str, ...]]]]:
    """Return the effects that can be tried on records with these channels, and the forms that cannot.

    Parameters
    ----------
    catalogue : mapping of str to Effect
        Effects by name.
    available : collection of str
        Roles of the channels of every record.
    scale : callable
        Function from a kind of quantity to its size in the records, which sets the constants of forms.

    Returns
    -------
    effects : dict of str to Effect
        Effects with the forms that can be tried.
    missing : list of tuple
        Forms that cannot be tried, each with the missing channels.
    """
    missing = []
    for effect in catalogue.values():
        for form in effect.forms:
            if absent := tuple(role for role in form.channels if role not in available):
                missing.append((form, absent))
    return filter_forms(catalogue, lambda form: set(form.channels) <= set(available), scale), missing


def filter_forms(
    catalogue: Mapping[str, Effect], is_usable: Callable[[Form], bool], scale: Callable[[str], float]
) -> dict[str, Effect]:
    """Return effects with their usable forms only; `scale` returns the size of a quantity for constants."""
    effects = {}
    for name, effect in catalogue.items():
        forms = []
        for form in filter(is_usable, effect.forms):
            sizes = {item.symbol: item.value * scale(item.scale) for item in form.constants if item.scale}
            forms.append(form.with_constants(sizes))
        if forms:
            effects[name] = effect.with_forms(forms)
    return effects


def catalogue_with(
    files: Collection[str | Path], base: str = "KB", gravity_m_s2: float | None = None
) -> dict[str, Effect]:
    """Return the catalogue of a base, followed by user-defined effects.

    Parameters
    ----------
    files : collection of path
        Files of the effects.
    base : str
        Name of the base.
    gravity_m_s2 : float, optional
        Gravity on a pendulum; by default the catalogue's value. Tissues have no gravity.

    Raises
    ------
    InputError
        In the cases of `load_effects`, and if gravity on a pendulum is not above 0: without weight no record distinguishes a
        mass from its distance.
    """
    catalogue = dict(CATALOGUES[system_of(base)])
    if system_of(base) == "pendulum" and gravity_m_s2 is not None:
        if not 0 < gravity_m_s2 < math.inf:
            raise InputError(f"gravity_m_s2 is {gravity_m_s2:g}: the effects on a pendulum need m/s² above 0")
        constants = {"g": float(gravity_m_s2)}
        for name, effect in catalogue.items():
            catalogue[name] = effect.with_forms(form.with_constants(constants) for form in effect.forms)
    for file in files:
        catalogue.update(load_effects(Path(file), catalogue))
    return catalogue


def catalogues_with(files: Collection[str | Path], content: object = None) -> dict[str, dict[str, Effect]]:
    """Return the catalogue of every system, with effects of a user's files and of the content of a file of models."""
    catalogues = {base.system: catalogue_with(files, base.name) for base in BASES.values()}
    effects = {key: {**read_model_effects(content, known), **known} for key, known in catalogues.items()}
    return {**effects, OWN_BASES: read_model_bases(content)}


def choose(names: list[str], catalogue: Mapping[str, Effect]) -> list[Effect]:
    """Return effects by name."""
    unknown = [name for name in names if name not in catalogue]
    if unknown:
        meant = did_you_mean(unknown[0], catalogue)
        raise InputError(f"unknown effect {', '.join(unknown)}{meant}; known are {', '.join(catalogue)}")
    return [catalogue[name] for name in names]


def read_base(file: str | Path) -> Base:
    """Read a user-defined base: equation, states and parameters in the notation of effects.

    Raises
    ------
    InputError
        If the file cannot be read or has an invalid equation. The message lists all problems.
    """
    path = Path(file)
    problems = Problems(f"base {path.name}")
    content = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    return _read_base(content, problems)


def load_effects(path: Path, taken: Collection[str] = ()) -> dict[str, Effect]:
    """Read a user's effects.

    Parameters
    ----------
    path : pathlib.Path
        One effect in YAML, or Python code, which is executed; every module-level `Effect` counts. `lumbar.study.load_study`
        rejects Python in untrusted studies.
    taken : collection of str
        Names that are not allowed for an effect in YAML; an effect in Python may replace another one.

    Raises
    ------
    InputError
        If the file cannot be read or imported, defines no effect, or has an invalid equation. The message lists all problems.
    """
    if not is_data(str(path)):
        return _import_effects(path)
    problems = Problems(f"effect {path.name}")
    file = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    effect = _read_effect(file, problems, taken)
    return {effect.name: effect}


def read_model_bases(content: object) -> dict[str, Base]:
    """Return the user-defined bases in a file of models, as read from JSON, after the checks of base files."""
    return _read_definitions(content, "bases", _read_base)


def read_model_effects(content: object, known: Mapping[str, Effect]) -> dict[str, Effect]:
    """Return the user-defined effects in a file of models, after the checks of effect files.

    Parameters
    ----------
    content : object
        Content of the file, as read from JSON.
    known : mapping
        Known effects by name; an effect of the file may be among them if both are identical.

    Raises
    ------
    InputError
        If an effect is invalid, has the name of another, or differs from the user's file. The message lists all problems.
    """

    def read(file: YamlFile, problems: Problems) -> Effect:
        effect = _read_effect(file, problems)
        if effect.name in known and known[effect.name].forms != effect.forms:
            allowed = "leave the effect's file out, or fit the model again with it"
            problems.add(file.path, "not the effect that has this name already", allowed)
        return effect

    return _read_definitions(content, "effects", read)


_Definition = TypeVar("_Definition")


def _read_definitions(
    content: object, kind: str, read: Callable[[YamlFile, Problems], _Definition]
) -> dict[str, _Definition]:
    """Return the bases or effects (`kind`) that a file of models contains as data, by name."""
    entries = content.get(kind, {}) if isinstance(content, dict) else {}
    problems, definitions = Problems("models.json"), {}
    if not isinstance(entries, dict):
        problems.add(kind, repr(entries), "a mapping of names to the content of their files")
        entries = {}
    for name, entry in entries.items():
        place = f"{kind}.{name}"
        if not isinstance(entry, dict) or entry.get("name") != name:
            problems.add(place, repr(entry), f"the content of its file is needed, name: {name} …")
            continue
        with suppress(InputError):  # reported together with those of the others
            definitions[name] = read(YamlFile(place, entry), problems)
    problems.raise_if_any()
    return definitions


def _import_effects(path: Path) -> dict[str, Effect]:
    import importlib.util

    specification = importlib.util.spec_from_file_location(f"lumbar_user_effects_{path.stem}", path)
    if specification is None or not path.is_file():
        raise InputError(f"{path}: not a Python file with effects (improvement.effect_files)")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: cannot be imported ({type(error).__name__}: {error})") from error
    effects = {item.name: item for item in vars(module).values() if isinstance(item, Effect)}
    if not effects:
        raise InputError(f"{path}: defines no Effect; assign one to a module-level name")
    problems = Problems(str(path))
    for form in (form for effect in effects.values() for form in effect.forms):
        for place, problem in form.problems():
            problems.add(f"{form.key}, {place}", problem)
    problems.raise_if_any()
    return effects


def _read_effect(file: YamlFile, problems: Problems, taken: Collection[str] = ()) -> Effect:
    """Return a user-defined effect, after an evaluation of its equations on a standard motion."""
    if "forms" in file.content:
        entry = read_entry(file, EffectOfForms, problems, taken)
        forms = {f"forms.{index}.": item.form(item.name) for index, item in enumerate(entry.forms)}
    else:
        entry = read_entry(file, EffectOfOneForm, problems, taken)
        forms = {"": entry.form()}
    for place, form in forms.items():
        _check_equation(form, place, file, problems)
    problems.raise_if_any()
    return entry.effect(forms.values(), file, file.content)


def _check_equation(form: Form, place: str, file: YamlFile, problems: Problems) -> None:
    """Report invalid symbols of an equation; if there are none, invalid values on a standard motion."""
    from lumbar.tissue.effects.signature import numerical_problems

    wrong = form.problems()
    for key, problem in wrong:
        problems.add(file.place(parse_key_path(place + ("parameters" if key == "symbol" else key))), problem)
    for problem, allowed in () if wrong else numerical_problems(form):
        problems.add(file.place(parse_key_path(f"{place}equation")), problem, allowed)


def _read_base(file: YamlFile, problems: Problems) -> Base:
    """Return a user-defined base."""
    entry = read_entry(file, BaseEntry, problems, BASES)
    form = entry.form(entry.name, effect="base")
    _check_equation(form, "", file, problems)
    problems.raise_if_any()
    if form.channels:
        allowed = "a base knows the input, its rates, path and time"
        problems.add(file.place(("equation",)), f"it knows {', '.join(form.channels)}", allowed)
    if not form.linear:
        problems.add(file.place(("parameters",)), "none is linear", "the response needs a factor, y = c*q")
    problems.raise_if_any()
    return Base(form, definition=file.content)
