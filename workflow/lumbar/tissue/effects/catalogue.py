"""All effects by name and system, and effects a user adds in a file of their own."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from lumbar.base.errors import InputError, did_you_mean
from lumbar.settings.improvement import system_of
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_entry import OWN_BASES

CHANNELS = {
    "box_held": "box_held",
    "length": "length_m",
    "pivot_acceleration_x": "pivot_acceleration_x_m_s2",
    "pivot_acceleration_z": "pivot_acceleration_z_m_s2",
}
"""Column of each channel that effects on a pendulum know beside the angle. box_held: share of the box that the hands carry,
0 to 1; length: from the pivot to the centre of mass; pivot acceleration: x horizontal, positive where a growing angle moves
the mass to, z upward."""


class Catalogue(Mapping[str, Effect]):
    """Effects of a folder beside this file by name; each is read when it is first asked for."""

    def __init__(self, folder: str, names: str):
        self._folder = Path(__file__).parent / folder
        self._effects: dict[str, Effect | None] = dict.fromkeys(names.split())

    def __getitem__(self, name: str) -> Effect:
        found = self._effects[name]
        if found is None:
            from lumbar.tissue.effects.notation import shipped_effect

            found = self._effects[name] = shipped_effect(self._folder / f"{name}.yaml")
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
    usable = with_forms_that(catalogue, lambda form: not missing(form), scale)
    return usable, [(form, missing(form)) for form in every if missing(form)]


def with_forms_that(
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
    if files:
        from lumbar.tissue.effects.notation import load_effects
    for file in files:
        catalogue.update(load_effects(Path(file), catalogue))
    return catalogue


def catalogues_with(files: Collection[str | Path], content: object = None) -> dict[str, dict[str, Effect]]:
    """Return the catalogue of every system with the effects of a user's files and those that a file of models carries."""
    from lumbar.tissue.effects.notation import carried_bases, carried_effects

    bases = {base.system: base.name for base in BASES.values()}
    catalogues = {system: catalogue_with(files, base) for system, base in bases.items()}
    found = {system: {**carried_effects(content, known), **known} for system, known in catalogues.items()}
    return {**found, OWN_BASES: carried_bases(content)}


def read_base(file: str | Path) -> Base:
    """Read a base of a user's own; errors as of `lumbar.tissue.effects.notation.load_base`."""
    from lumbar.tissue.effects.notation import load_base

    return load_base(Path(file))


def choose(names: list[str], catalogue: Mapping[str, Effect]) -> list[Effect]:
    """Return effects by name."""
    unknown = [name for name in names if name not in catalogue]
    if unknown:
        meant = did_you_mean(unknown[0], catalogue)
        raise InputError(f"unknown effect {', '.join(unknown)}{meant}; known are {', '.join(catalogue)}")
    return [catalogue[name] for name in names]
