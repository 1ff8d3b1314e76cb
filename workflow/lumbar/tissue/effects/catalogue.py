"""All effects by name and system; effects and bases that a user adds in files, or that a file of models carries."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from lumbar.base.errors import InputError, Problems, did_you_mean
from lumbar.base.yaml_file import YamlFile, parse_key_path, read_yaml, shipped_yaml
from lumbar.settings.improvement import is_data, system_of
from lumbar.tissue.effects.hooks import HOOKS
from lumbar.tissue.effects.notation import (
    NAME,
    NAME_RULE,
    BaseEntry,
    EffectOfForms,
    EffectOfOneForm,
    forms_of,
    read_entry,
    shipped_effect,
)
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_entry import OWN_BASES

CHANNELS = {
    "box_held": "box_held",
    "length": "length_m",
    "pivot_acceleration_x": "pivot_acceleration_x_m_s2",
    "pivot_acceleration_z": "pivot_acceleration_z_m_s2",
}
"""Column of each further channel that effects on a pendulum need. box_held: share of the box that the hands carry,
0 to 1; length: from the pivot to the centre of mass; pivot acceleration: x horizontal, positive where a growing angle moves
the mass to, z upward."""


class Catalogue(Mapping[str, Effect]):
    """Effects by name, from a folder of this package; each is read when it is first used."""

    def __init__(self, folder: str, names: str):
        self._folder = Path(__file__).parent / folder
        self._effects: dict[str, Effect | None] = dict.fromkeys(names.split())

    def __getitem__(self, name: str) -> Effect:
        found = self._effects[name]
        if found is None:
            file = YamlFile(f"{name}.yaml", shipped_yaml(self._folder / f"{name}.yaml"))
            found = shipped_effect(file, HOOKS)
            self._effects[name] = found
        return found

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

The input is the angle from the vertical, the output the moment that the person exerts at the pivot. Effects on mass, length and
pivot have forms that take what was measured beside the angle (`CHANNELS`) and forms that need the angle alone."""

MOTION_SENSOR = Catalogue("motion_sensor", "absolute_value saturation")
"""Effects of the motion's sensor, where the force is the input: ``F`` of their equations is what the sensor should give."""

CATALOGUES: dict[str, Mapping[str, Effect]] = {"tissue": TISSUE, "pendulum": PENDULUM}
"""Catalogue of every system that a base is a model of."""


def usable_effects(
    catalogue: Mapping[str, Effect], available: Collection[str], scale: Callable[[str], float]
) -> tuple[dict[str, Effect], list[tuple[Form, tuple[str, ...]]]]:
    """Part of a catalogue that records with these channels allow, and what they do not.

    `available` are the roles of the channels of every record, `scale` the sizes of their quantities by kind, which constants
    of forms follow. Returns effects with the forms that can be tried, and the forms that cannot, each with the channels that
    are missing.
    """

    def missing(form: Form) -> tuple[str, ...]:
        return tuple(role for role in form.channels if role not in available)

    every = [form for effect in catalogue.values() for form in effect.forms]
    usable = filter_forms(catalogue, lambda form: not missing(form), scale)
    return usable, [(form, missing(form)) for form in every if missing(form)]


def filter_forms(
    catalogue: Mapping[str, Effect], holds: Callable[[Form], bool], scale: Callable[[str], float]
) -> dict[str, Effect]:
    """Effects with those of their forms of which something holds, their constants as large as quantities are by `scale`."""
    found = {}
    for name, effect in catalogue.items():
        forms = []
        for form in filter(holds, effect.forms):
            sizes = {item.symbol: item.value * scale(item.scale) for item in form.constants if item.scale}
            forms.append(form.with_constants(sizes))
        if forms:
            found[name] = replace(effect, forms=tuple(forms))
    return found


def catalogue_with(
    files: Collection[str | Path], base: str = "KB", gravity_m_s2: float | None = None
) -> dict[str, Effect]:
    """Return the catalogue of a base with the effects of a user's files, which come last.

    Gravity acts on a pendulum, in the effects that move masses, and on no tissue; its default is that of the files.

    Raises
    ------
    InputError
        As `load_effects`, and if gravity on a pendulum is not above 0: without weight no record distinguishes a mass from its
        distance.
    """
    catalogue = dict(CATALOGUES[system_of(base)])
    if system_of(base) == "pendulum" and gravity_m_s2 is not None:
        if not 0 < gravity_m_s2 < math.inf:
            raise InputError(f"gravity_m_s2 is {gravity_m_s2:g}: the effects on a pendulum need m/s² above 0")
        constants = {"g": float(gravity_m_s2)}
        for name, effect in catalogue.items():
            forms = tuple(form.with_constants(constants) for form in effect.forms)
            catalogue[name] = replace(effect, forms=forms)
    for file in files:
        catalogue.update(load_effects(Path(file), catalogue))
    return catalogue


def catalogues_with(files: Collection[str | Path], content: object = None) -> dict[str, dict[str, Effect]]:
    """Return the catalogue of every system with the effects of a user's files and those that a file of models carries."""
    bases = {base.system: base.name for base in BASES.values()}
    catalogues = {system: catalogue_with(files, base) for system, base in bases.items()}
    found = {system: {**carried_effects(content, known), **known} for system, known in catalogues.items()}
    return {**found, OWN_BASES: carried_bases(content)}


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
        If the file cannot be read or has an equation that cannot be used: all problems at once.
    """
    path = Path(file)
    problems = Problems(f"base {path.name}")
    content = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    return _checked_base(content, problems)


def load_effects(path: Path, taken: Collection[str] = ()) -> dict[str, Effect]:
    """Read a user's effects.

    Parameters
    ----------
    path : pathlib.Path
        One effect in YAML, or Python, which is run: every module-level `Effect` counts. `lumbar.study.load_study` lets none
        pass that a stranger's study names.
    taken : collection of str
        Names that an effect in YAML may not have. One in Python may replace another.

    Raises
    ------
    InputError
        If the file cannot be read or imported, defines no effect, or has an equation that cannot be used: all problems at
        once.
    """
    if not is_data(str(path)):
        return _from_python(path)
    problems = Problems(f"effect {path.name}")
    file = read_yaml(path, problems, anchors=False)
    problems.raise_if_any()
    effect = _checked_effect(file, problems, taken)
    return {effect.name: effect}


def carried_bases(content: Any) -> dict[str, Base]:
    """Return the user-defined bases in a file of models, as read from JSON; each is checked like its file."""
    return _carried(content, "bases", lambda name, file, problems: _checked_base(file, problems))


def carried_effects(content: Any, known: Mapping[str, Effect]) -> dict[str, Effect]:
    """Return the user-defined effects in a file of models; each is checked like its file.

    Parameters
    ----------
    content : object
        Of the file, as read from JSON.
    known : mapping
        Effects by name: one of a user's file may be there too if it is the same.

    Raises
    ------
    InputError
        An effect that is not sound, has the name of another, or is not the one of the user's file: all problems at once.
    """

    def checked(name: str, file: YamlFile, problems: Problems) -> Effect:
        effect = _checked_effect(file, problems)
        if name in known and known[name].forms != effect.forms:
            allowed = "leave the effect's file out, or fit the model anew with it"
            problems.add(f"effects.{name}", "not the effect that has this name already", allowed)
        return effect

    return _carried(content, "effects", checked)


_Part = TypeVar("_Part")


def _carried(
    content: Any, kind: str, checked: Callable[[str, YamlFile, Problems], _Part]
) -> dict[str, _Part]:
    """Return the bases or effects that a file of models contains as data, by name."""
    given = content.get(kind, {}) if isinstance(content, dict) else {}
    problems = Problems("models.json")
    if not isinstance(given, dict):
        problems.add(kind, repr(given), "a name each: what its file says")
        given = {}
    found = {}
    for name, entry in given.items():
        place = f"{kind}.{name}"
        if not isinstance(entry, dict) or entry.get("name") != name:
            problems.add(place, repr(entry), f"what its file holds is needed, name: {name} …")
            continue
        with suppress(InputError):  # reported together with those of the others
            found[name] = checked(name, YamlFile(place, entry), problems)
    problems.raise_if_any()
    return found


def check_name(name: str, taken: Collection[str] = ()) -> None:
    """Raise if a name is not allowed for a user-defined effect."""
    if not NAME.fullmatch(name):
        raise InputError(f"effect {name!r}: {NAME_RULE}")
    if name in taken:
        raise InputError(f"effect {name!r} is taken by an effect of the catalogue; choose another name")


def _from_python(path: Path) -> dict[str, Effect]:
    import importlib.util

    specification = importlib.util.spec_from_file_location(f"lumbar_user_effects_{path.stem}", path)
    if specification is None or not path.is_file():
        raise InputError(f"{path}: not a Python file with effects (improvement.effect_files)")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: cannot be imported ({type(error).__name__}: {error})") from error
    found = {item.name: item for item in vars(module).values() if isinstance(item, Effect)}
    if not found:
        raise InputError(f"{path}: defines no Effect; assign one to a module-level name")
    problems = Problems(str(path))
    for form in (form for effect in found.values() for form in effect.forms):
        for where, said in form.problems():
            problems.add(f"{form.key}, {where}", said)
    problems.raise_if_any()
    return found


def _checked_effect(file: YamlFile, problems: Problems, taken: Collection[str] = ()) -> Effect:
    """Return a user-defined effect; its equations are evaluated on a standard motion."""
    kind = EffectOfForms if "forms" in file.content else EffectOfOneForm
    entry = read_entry(file, kind, problems, taken)
    forms = dict(forms_of(entry))
    for place, form in forms.items():
        _check_equation(form, place, file, problems)
    problems.raise_if_any()
    return replace(entry.effect(forms.values(), file), definition=file.content)


def _check_equation(form: Form, place: str, file: YamlFile, problems: Problems) -> None:
    """Add what keeps an equation from being used, first its symbols, then its values on a standard motion."""
    from lumbar.tissue.effects.signature import numerical_problems

    found = form.problems()
    for key, problem in found:
        problems.add(file.place(parse_key_path(place + ("parameters" if key == "symbol" else key))), problem)
    for problem, allowed in () if found else numerical_problems(form):
        problems.add(file.place(parse_key_path(f"{place}equation")), problem, allowed)


def _checked_base(file: YamlFile, problems: Problems) -> Base:
    """Return a user-defined base: the equation of a response, without the keys of how an effect is added."""
    entry = read_entry(file, BaseEntry, problems, BASES)
    form = entry.form(entry.name, effect="base")
    _check_equation(form, "", file, problems)
    problems.raise_if_any()
    if form.channels:
        signals = ", ".join(form.channels)
        problems.add(
            file.place(("equation",)),
            f"it knows {signals}",
            "a base knows the input, its rates, path and time",
        )
    if not form.linear:
        problems.add(file.place(("parameters",)), "none is linear", "the response needs a factor, y = c*q")
    problems.raise_if_any()
    return Base(form, definition=file.content)
