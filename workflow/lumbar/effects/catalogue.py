"""All effects by name, and effects a user adds in a file of their own."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path

from lumbar.effects import channel, elapsed, friction, rate, stiffness
from lumbar.effects.effect import Effect
from lumbar.errors import InputError

TISSUE = {
    effect.name: effect
    for effect in (
        *stiffness.EFFECTS[:2],
        *friction.EFFECTS,
        channel.CONTACT_LOSS,
        *rate.EFFECTS,
        stiffness.SECOND_RELAXATION,
        channel.DELAY,
        channel.SATURATION,
        elapsed.DRIFT,
        stiffness.SOFTENING,
        elapsed.PERIODIC_DISTURBANCE,
        channel.BACKLASH,
    )
}
"""The tissue catalogue, in the order in which reports list it."""


def load_effects(path: Path) -> dict[str, Effect]:
    """Read effects from a user's Python file: every module-level `Effect` counts.

    The file is code the user names in their own configuration; data files never reach this function.

    Raises
    ------
    InputError
        If the file cannot be imported or defines no effect.
    """
    specification = importlib.util.spec_from_file_location(f"lumbar_user_effects_{path.stem}", path)
    if specification is None or not path.is_file():
        raise InputError(f"{path}: not a Python file with effects")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: cannot be imported ({type(error).__name__}: {error})") from error
    found = {item.name: item for item in vars(module).values() if isinstance(item, Effect)}
    if not found:
        raise InputError(f"{path}: defines no Effect; assign one to a module-level name")
    return found


def catalogue_with(files: Iterable[str | Path]) -> dict[str, Effect]:
    """Return the tissue catalogue with the effects of a user's files, which come last and may replace others.

    Raises
    ------
    InputError
        As `load_effects`.
    """
    catalogue = dict(TISSUE)
    for file in files:
        catalogue.update(load_effects(Path(file)))
    return catalogue


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
