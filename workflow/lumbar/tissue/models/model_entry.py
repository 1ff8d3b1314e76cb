"""A fitted model as plain data and back; one message reports all faults of the data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from lumbar.base.errors import Problems
from lumbar.settings.section import Positive, Section, Unique
from lumbar.settings.validation import Origins, adapter_of, check_types
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_data import FittedParameter, ModelData
from lumbar.tissue.models.structure import ForceBetween, ForwardStructure, Structure
from lumbar.tissue.models.tissue_models import MODELS
from lumbar.tissue.models.transfer_function import TransferFunction

OWN_BASES = "bases"
"""Key of a file's user-defined bases in `Catalogues`."""
Catalogues = Mapping[str, Mapping[str, Any]]
"""Effects by name for every system, and the user-defined bases by `OWN_BASES`."""
Coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=33)]
"""Coefficients of a numerator or denominator: at most twice the limit of an FMU."""


class _Effect(Section):
    """An effect in a file."""

    effect: str
    form: str
    constants: dict[str, float] | None = None


class _Space(Section):
    """A base along several axes in a file."""

    axes: Unique[Literal["x", "y", "z"]] = Field(min_length=2)
    symmetry: str
    frames: tuple[tuple[float, ...], ...]
    depth: float | None = None
    reach: float | None = None


class _Structure(Section):
    """A structure in a file: the coefficients of a discrete model, or the effects of a continuous one."""

    numerator: Coefficients | None = None
    denominator: Coefficients | None = None
    effects: tuple[_Effect, ...] | None = None
    forward: bool | None = None
    """True if the input is the force and the output the motion."""
    force_between: ForceBetween | None = None
    space: _Space | None = None


@dataclass(frozen=True)
class _Entry(ModelData):
    """A model in a file; the fields define the file's schema."""

    structure: _Structure  # type: ignore[assignment]  # the structure's names and numbers
    sampling_time: Positive
    __pydantic_config__ = {"extra": "forbid", "allow_inf_nan": False}  # noqa: RUF012


def entry_of(model: ModelData) -> dict:
    """Return the fields of a model as plain data; its structure becomes coefficients, or names of effects and forms.

    Parameters
    ----------
    model : ModelData
        Any model.
    """
    structure = model.structure
    if isinstance(structure, TransferFunction):
        written = _Structure(numerator=structure.numerator, denominator=structure.denominator)
    else:
        space, spatial = None, structure.base.spatial
        if spatial is not None:
            depth, reach = (getattr(spatial, name, None) for name in ("depth", "reach"))  # of a plane
            axes, frames = spatial.axes, spatial.frames
            space = _Space(axes=axes, symmetry=str(spatial.symmetry), frames=frames, depth=depth, reach=reach)
        effects = []
        for form in structure.forms:
            constants = {item.symbol: item.value for item in form.constants if item.given}
            effects.append(_Effect(effect=form.effect, form=form.name, constants=constants or None))
        written = _Structure(effects=tuple(effects), space=space)
        if isinstance(structure, ForwardStructure):
            changes = {"forward": True, "force_between": structure.force_between}
            written = written.model_copy(update=changes)
    plain = adapter_of(_Entry).dump_python(_Entry(**{**_fields(model), "structure": written}), mode="json")
    plain["structure"] = written.model_dump(mode="json", exclude_none=True)
    for name in ("zeros", "rests"):  # along one axis the ports have offsets instead
        if not plain[name]:
            del plain[name]
    return plain


def _fields(model: ModelData) -> dict:
    return {item.name: getattr(model, item.name) for item in fields(model)}


def checked_entry(entry: object, catalogues: Catalogues, problems: Problems) -> dict | None:
    """Return the fields of the model of an entry, or None if something was added to `problems`.

    Parameters
    ----------
    entry : object
        Result of `entry_of`, as read from JSON.
    catalogues : mapping
        Effects by name for every system.
    problems : Problems
        List to which every missing, unknown or invalid field is added.
    """
    plain = check_types(entry, _Entry, Origins(problems))
    if plain is None:
        return None
    before, written = len(problems.entries), plain.structure
    structure: TransferFunction | Structure | None = None
    if written.effects is not None:
        structure = _structure(plain.base, written, catalogues, problems)
        if structure is not None and written.space is not None:
            structure = _spatial_structure(structure, written.space, problems)
    elif not (written.numerator and written.denominator):
        problems.add("structure", "no coefficients", "it needs numerator and denominator, or effects")
    elif written.denominator[0] != 1:
        allowed = "1 is needed; 0 is improper: it needs future positions"
        problems.add("structure.denominator.0", f"{written.denominator[0]:g}", allowed)
    else:
        structure = TransferFunction(written.numerator, written.denominator)
    if structure is not None:
        _check_parameters(plain.parameters, structure, plain.base, problems)
    covered = plain.valid_for
    for low, high in (("lowest", "highest"), ("lowest_Hz", "highest_Hz")) if covered else ():
        if not getattr(covered, low) <= getattr(covered, high):
            order = f"{getattr(covered, low):g} above {high} {getattr(covered, high):g}"
            problems.add(f"valid_for.{low}", order, "it must not be")
    if covered and covered.speed < 0:
        problems.add("valid_for.speed", f"{covered.speed:g}", "0 or more is needed")
    return None if len(problems.entries) > before else {**_fields(plain), "structure": structure}


def _structure(
    base: str, written: _Structure, catalogues: Catalogues, problems: Problems
) -> Structure | None:
    before = len(problems.entries)
    bases = {**catalogues.get(OWN_BASES, {}), **BASES}
    if base not in bases:
        problems.add("base", repr(base), f"bases are {', '.join(bases)}")
        return None
    catalogue = catalogues.get(bases[base].system, {})
    if written.space is not None:
        from lumbar.tissue.models.space import force_sensor_effects

        read = [item.to_space(written.space.axes)[0] for item in catalogue.values()]
        sensor_effects = force_sensor_effects(written.space.axes)
        catalogue = {item.name: item for item in read if item} | sensor_effects
    forms: list[Form] = []
    for item in written.effects or ():
        form = _form(item, catalogue, problems)
        if form is not None and form.effect in [earlier.effect for earlier in forms]:
            problems.add("structure.effects", f"{form.effect} is repeated", "once is allowed")
        elif form is not None:
            forms.append(form)
    if len(problems.entries) > before:
        return None
    if written.forward:
        return ForwardStructure(bases[base], tuple(forms), written.force_between or "smooth")
    return Structure(bases[base], tuple(forms))


def _spatial_structure(structure: Structure, space: _Space, problems: Problems) -> Structure | None:
    """Return the structure along several axes."""
    from lumbar.tissue.models.space import PlaneContact, SpatialBase, Symmetry

    size, base, place = len(space.axes), structure.base, "structure.space"
    has_plane = space.depth is not None and space.reach is not None
    needed = len(base.linear) if space.symmetry == Symmetry.FULL else 1
    if space.symmetry not in [*Symmetry] and not (has_plane and base.contact):
        allowed = f"there are {', '.join(Symmetry)}, and a plane of a contact"
        problems.add(f"{place}.symmetry", space.symmetry, allowed)
    elif len(space.frames) != needed or any(len(frame) != size**2 for frame in space.frames):
        problems.add(f"{place}.frames", str(len(space.frames)), f"{needed} of {size**2} numbers are needed")
    elif not all(
        np.allclose(matrix @ matrix.T, np.eye(size), atol=1e-9) and np.linalg.det(matrix) > 0
        for matrix in (np.array(frame, float).reshape(size, size) for frame in space.frames)
    ):
        problems.add(f"{place}.frames", str(space.frames), "rotation matrices are needed, row by row")
    else:
        spatial: PlaneContact | SpatialBase
        if has_plane:
            plane = float(space.depth or 0), float(space.reach or 0)
            spatial = PlaneContact(base, space.axes, space.frames, *plane)
        else:
            spatial = SpatialBase(base, Symmetry(space.symmetry), space.axes, space.frames, free=False)
        return Structure(spatial.structural, structure.forms)
    return None


def _form(item: _Effect, catalogue: Mapping[str, Effect], problems: Problems) -> Form | None:
    effect = catalogue.get(item.effect)
    if effect is None:
        allowed = (
            f"there are {', '.join(catalogue)}; improvement.effect_files or the file itself may define more"
        )
        problems.add("structure.effects", f"unknown effect {item.effect!r}", allowed)
        return None
    form = next((form for form in effect.forms if form.name == item.form), None)
    if form is None:
        allowed = f"its forms are {', '.join(form.name for form in effect.forms)}"
        problems.add(f"structure.effects.{effect.name}", f"unknown form {item.form!r}", allowed)
        return None
    known = [constant.symbol for constant in form.constants]
    for symbol in item.constants or {}:
        if symbol not in known:
            allowed = f"constants of {form.key} are {', '.join(known) or 'none'}"
            problems.add(f"structure.effects.{effect.name}", f"unknown constant {symbol!r}", allowed)
    return form.with_constants(item.constants or {})


def _check_parameters(
    parameters: Sequence[FittedParameter], structure, base: str, problems: Problems
) -> None:
    """Check that a continuous model has exactly its parameters and a discrete model only its base's; elements are optional."""
    parts = (structure.base, *structure.forms) if isinstance(structure, Structure) else ()
    needed = {key: positive for part in parts for key, positive in _keys(part)}
    optional = {item.name for item in MODELS[base].elements} if base in MODELS else set()
    if parts and structure.base.spatial is not None:
        optional |= {item.name for item in structure.base.spatial.turning}
    if not parts and base in BASES:
        optional |= {key for key, _ in _keys(BASES[base])}
    keys = Counter(item.key for item in parameters)
    allowed = f"there are {', '.join([*needed, *sorted(optional)]) or 'none'}"
    for key, count in keys.items():
        if key not in needed and key not in optional:
            problems.add(f"parameters.{key}", "unknown parameter", allowed)
        elif count > 1:
            problems.add(f"parameters.{key}", "it is repeated", "once is allowed")
    for key in needed:
        if key not in keys:
            problems.add(f"parameters.{key}", "missing", "every parameter of base and effects is needed")
    for item in parameters:
        if needed.get(item.key) and not item.value > 0:
            problems.add(f"parameters.{item.key}", f"{item.value:g}", "a number above 0 is needed")


def _keys(part) -> Iterator[tuple[str, bool]]:
    """Yield the key of every parameter of a base or form, and True if the parameter must be positive."""
    owner = f"{part.effect}." if isinstance(part, Form) else ""
    yield from ((owner + item.name, False) for item in part.linear)
    yield from ((owner + item.name, not item.signed) for item in part.nonlinear)
