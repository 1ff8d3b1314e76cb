"""All effects by name and system, and effects a user adds in a file of their own."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.tissue.effects import (
    damping_and_inertia,
    friction,
    measurement_chain,
    pendulum_joint,
    pendulum_load,
    stiffness,
    time_dependent,
)
from lumbar.tissue.effects.pendulum_load import GRAVITY, under_gravity
from lumbar.tissue.models.bases import BASES, system_of
from lumbar.tissue.models.form import Effect, Form

TISSUE = {
    effect.name: effect
    for effect in (
        *stiffness.EFFECTS[:3],
        *friction.EFFECTS,
        measurement_chain.CONTACT_LOSS,
        *damping_and_inertia.EFFECTS,
        stiffness.SECOND_RELAXATION,
        measurement_chain.DELAY,
        measurement_chain.SATURATION,
        time_dependent.DRIFT,
        stiffness.SOFTENING,
        time_dependent.PERIODIC_DISTURBANCE,
        measurement_chain.BACKLASH,
    )
}
"""The tissue catalogue, in the order in which reports list it."""

PENDULUM = {
    effect.name: effect
    for effect in (
        pendulum_load.HAND_LOAD,
        *pendulum_joint.EFFECTS[:2],
        *pendulum_load.EFFECTS[1:],
        pendulum_joint.DRAG,
    )
}
"""The catalogue of the pendulum of Eq. 4.1."""

CATALOGUES = {"tissue": TISSUE, "pendulum": PENDULUM}
"""Catalogue of every system that a base is a model of."""


def catalogue_of(base: str) -> dict[str, Effect]:
    """Catalogue of the system that a base is a model of.

    Raises
    ------
    InputError
        For an unknown base.
    """
    return CATALOGUES[system_of(base)]


def without_channels(
    catalogue: dict[str, Effect], available: Collection[str]
) -> tuple[dict[str, Effect], list[tuple[Form, tuple[str, ...]]]]:
    """Part of a catalogue that records with these channels allow, and what they do not.

    Parameters
    ----------
    available : collection of str
        Roles of the channels of every record.

    Returns
    -------
    dict of str to Effect
        Effects with the forms that can be tried.
    list of (Form, tuple of str)
        Forms that cannot, each with the channels that are missing.
    """
    usable, left_out = {}, []
    for name, effect in catalogue.items():
        missing = {
            form.key: tuple(role for role in form.channels if role not in available) for form in effect.forms
        }
        left_out += [(form, missing[form.key]) for form in effect.forms if missing[form.key]]
        forms = tuple(form for form in effect.forms if not missing[form.key])
        if forms:
            usable[name] = replace(effect, forms=forms)
    return usable, left_out


def catalogue_with(
    files: Collection[str | Path], base: str = "KB", gravity_m_s2: float = GRAVITY
) -> dict[str, Effect]:
    """Return the catalogue of a base with the effects of a user's files, which come last.

    Parameters
    ----------
    files : collection of path
    gravity_m_s2 : float
        That acts on a pendulum, in the effects that move masses.

    Raises
    ------
    InputError
        As `catalogue_of`, `load_effects` and `under_gravity`.
    """
    catalogue = dict(catalogue_of(base))
    if system_of(base) == "pendulum":
        moved = {effect.name: under_gravity(effect, gravity_m_s2) for effect in pendulum_load.EFFECTS}
        catalogue |= moved
    if files:
        from lumbar.tissue.effects.own_effect import load_effects
    for file in files:
        catalogue.update(load_effects(Path(file), catalogue))
    return catalogue


def catalogues_with(files: Collection[str | Path]) -> dict[str, dict[str, Effect]]:
    """Return the catalogue of every system with the effects of a user's files, as `catalogue_with`."""
    bases = {base.system: base.name for base in BASES.values()}
    return {system: catalogue_with(files, base) for system, base in bases.items()}


def choose(names: list[str], catalogue: dict[str, Effect]) -> list[Effect]:
    """Return effects by name.

    Raises
    ------
    InputError
        For an unknown name, with the known ones.
    """
    unknown = [name for name in names if name not in catalogue]
    if unknown:
        raise InputError(f"unknown effect {', '.join(unknown)}; known are {', '.join(catalogue)}")
    return [catalogue[name] for name in names]
