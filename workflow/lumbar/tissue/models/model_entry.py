"""A fitted model as plain data and back, with everything that is wrong with the data said at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Literal

from pydantic import Field

from lumbar.base.errors import Problems
from lumbar.settings.section import Positive, Section, Unique
from lumbar.settings.validation import Origins, adapter_of, check_types
from lumbar.tissue.models.bases import BASES, Base
from lumbar.tissue.models.form import Effect, Form
from lumbar.tissue.models.model_data import FittedParameter, ModelData, MotionRange
from lumbar.tissue.models.structure import ForwardStructure, Structure
from lumbar.tissue.models.tissue_models import MODELS
from lumbar.tissue.models.transfer_function import TransferFunction

MAX_COEFFICIENTS = 33
"""Of a numerator or denominator: twice what an FMU holds, and far more than the search tries."""

OWN_BASES = "bases"
"""Where catalogues by system hold the bases of users' own that a file of models carries."""
Catalogues = Mapping[str, Mapping[str, Effect | Base]]


Coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=MAX_COEFFICIENTS)]


class _Added(Section):
    """An effect as it is written."""

    effect: str
    form: str
    constants: dict[str, float] | None = None


class _Space(Section):
    """A base along several axes, as it is written."""

    axes: Unique[Literal["x", "y", "z"]] = Field(min_length=2)
    symmetry: str
    frames: tuple[tuple[float, ...], ...]
    depth: float | None = None
    reach: float | None = None


class _Written(Section):
    """A structure as it is written: the coefficients of a discrete model, or the effects of a continuous one."""

    numerator: Coefficients | None = None
    denominator: Coefficients | None = None
    effects: tuple[_Added, ...] | None = None
    forward: bool | None = None
    """Whether the model goes from force to motion."""
    space: _Space | None = None


@dataclass(frozen=True)
class _Entry(ModelData):
    """A model as it is written: its fields are the schema of the file."""

    structure: _Written  # type: ignore[assignment]  # the structure's names and numbers
    sampling_time: Positive
    __pydantic_config__ = {"extra": "forbid", "allow_inf_nan": False}  # noqa: RUF012


def entry_of(model: ModelData) -> dict:
    """Return a model as plain data: its fields, with the structure as coefficients or as names of effects and forms."""
    structure = model.structure
    if isinstance(structure, TransferFunction):
        written = _Written(numerator=structure.numerator, denominator=structure.denominator)
    else:
        space, spatial = None, structure.base.spatial
        if spatial is not None:
            depth, reach = (getattr(spatial, name, None) for name in ("depth", "reach"))  # of a plane
            axes, frames = spatial.axes, spatial.frames
            space = _Space(axes=axes, symmetry=str(spatial.symmetry), frames=frames, depth=depth, reach=reach)
        forward = isinstance(structure, ForwardStructure) or None
        written = _Written(effects=tuple(map(_added, structure.forms)), forward=forward, space=space)
    plain = adapter_of(_Entry).dump_python(_Entry(**{**_fields(model), "structure": written}), mode="json")
    plain["structure"] = written.model_dump(mode="json", exclude_none=True)
    for name in ("zeros", "rests"):  # of one axis the ports' offsets
        if not plain[name]:
            del plain[name]
    return plain


def _added(form: Form) -> _Added:
    given = {item.symbol: item.value for item in form.constants if item.given}
    return _Added(effect=form.effect, form=form.name, constants=given or None)


def _fields(model: ModelData) -> dict:
    return {item.name: getattr(model, item.name) for item in fields(model)}


def checked_entry(entry: object, catalogues: Catalogues, problems: Problems) -> dict | None:
    """Return the fields of the model of an entry, or None where something was added to `problems`."""
    plain = check_types(entry, _Entry, Origins(problems))
    if plain is None:
        return None
    before = len(problems.entries)
    structure: TransferFunction | Structure | None
    if plain.structure.effects is None:
        structure = _transfer_function(plain.structure, problems)
    else:
        structure = _structure(plain.base, plain.structure, catalogues, problems)
        if structure is not None and plain.structure.space is not None:
            structure = _in_space(structure, plain.structure.space, problems)
    if structure is not None:
        _check_parameters(plain.parameters, structure, plain.base, problems)
    _check_range(plain.valid_for, problems)
    if len(problems.entries) > before:
        return None
    return {**_fields(plain), "structure": structure}


def _transfer_function(written: _Written, problems: Problems) -> TransferFunction | None:
    if not (written.numerator and written.denominator):
        problems.add("structure", "no coefficients", "it needs numerator and denominator, or effects")
    elif written.denominator[0] != 1:
        found = f"{written.denominator[0]:g}"
        problems.add(
            "structure.denominator.0", found, "1 is needed; 0 is improper: it needs future positions"
        )
    else:
        return TransferFunction(written.numerator, written.denominator)
    return None


def _structure(base: str, written: _Written, catalogues: Catalogues, problems: Problems) -> Structure | None:
    before = len(problems.entries)
    own = {name: item for name, item in catalogues.get(OWN_BASES, {}).items() if isinstance(item, Base)}
    bases = {**own, **BASES}
    if base not in bases:
        problems.add("base", repr(base), f"bases are {', '.join(bases)}")
        return None
    effects = catalogues.get(bases[base].system, {})
    if written.space is not None:
        from lumbar.tissue.models.space import force_sensor_effects

        read = [item.in_space(written.space.axes)[0] for item in effects.values() if isinstance(item, Effect)]
        effects = {item.name: item for item in read if item} | force_sensor_effects(written.space.axes)
    catalogue = {name: item for name, item in effects.items() if isinstance(item, Effect)}
    forms: list[Form] = []
    for item in written.effects or ():
        form = _form(item, catalogue, problems)
        if form is not None and form.effect in [earlier.effect for earlier in forms]:
            problems.add("structure.effects", f"{form.effect} is there twice", "once is allowed")
        elif form is not None:
            forms.append(form)
    kind = ForwardStructure if written.forward else Structure
    return None if len(problems.entries) > before else kind(bases[base], tuple(forms))


def _in_space(structure: Structure, space: _Space, problems: Problems) -> Structure | None:
    """The structure along several axes."""
    from lumbar.tissue.models.space import PlaneContact, SpatialBase, Symmetry, is_rotation

    size, base, place = len(space.axes), structure.base, "structure.space"
    plane = space.depth is not None and space.reach is not None
    wanted = len(base.linear) if space.symmetry == Symmetry.FULL else 1
    if space.symmetry not in [*Symmetry] and not (plane and base.contact):
        problems.add(
            f"{place}.symmetry", space.symmetry, f"there are {', '.join(Symmetry)}, and a plane of a contact"
        )
    elif len(space.frames) != wanted or any(len(frame) != size**2 for frame in space.frames):
        problems.add(f"{place}.frames", str(len(space.frames)), f"{wanted} of {size**2} numbers are needed")
    elif not all(is_rotation(frame, size) for frame in space.frames):
        problems.add(f"{place}.frames", str(space.frames), "rotation matrices are needed, row by row")
    elif plane:
        ends = float(space.depth or 0), float(space.reach or 0)
        contact = PlaneContact(base, space.axes, space.frames, *ends)
        return Structure(contact.structural, structure.forms)
    else:
        symmetric = SpatialBase(base, Symmetry(space.symmetry), space.axes, space.frames, free=False)
        return Structure(symmetric.structural, structure.forms)
    return None


def _form(item: _Added, catalogue: Mapping[str, Effect], problems: Problems) -> Form | None:
    effect = catalogue.get(item.effect)
    if effect is None:
        allowed = f"there are {', '.join(catalogue)}; effects of your own are carried or come from improvement.effect_files"
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


def _check_range(covered: MotionRange | None, problems: Problems) -> None:
    """A motion has a lower and an upper end."""
    if covered is None:
        return
    for low, high in (("lowest", "highest"), ("lowest_Hz", "highest_Hz")):
        if not getattr(covered, low) <= getattr(covered, high):
            found = f"{getattr(covered, low):g} above {high} {getattr(covered, high):g}"
            problems.add(f"valid_for.{low}", found, "it must not be")
    if covered.speed < 0:
        problems.add("valid_for.speed", f"{covered.speed:g}", "0 or more is needed")


def _check_parameters(
    parameters: tuple[FittedParameter, ...], structure, base: str, problems: Problems
) -> None:
    """A continuous model needs exactly its parameters; a discrete one may have those of its base. Elements may be beside."""
    parts = (structure.base, *structure.forms) if isinstance(structure, Structure) else ()
    needed = {key: positive for part in parts for key, positive in _keys(part)}
    spatial = structure.base.spatial if parts else None
    angles = spatial.turning if spatial is not None else ()
    optional = {item.name for item in MODELS[base].elements} if base in MODELS else set()
    optional |= {item.name for item in angles}
    if not parts and base in BASES:
        optional |= {key for key, _ in _keys(BASES[base])}
    found = [item.key for item in parameters]
    allowed = f"there are {', '.join([*needed, *sorted(optional)]) or 'none'}"
    for key in dict.fromkeys(found):
        if key not in needed and key not in optional:
            problems.add(f"parameters.{key}", "unknown parameter", allowed)
        elif found.count(key) > 1:
            problems.add(f"parameters.{key}", "it is there twice", "once is allowed")
    for key in needed:
        if key not in found:
            problems.add(f"parameters.{key}", "missing", "every parameter of base and effects is needed")
    for item in parameters:
        if needed.get(item.key) and not item.value > 0:
            problems.add(f"parameters.{item.key}", f"{item.value:g}", "a number above 0 is needed")


def _keys(part) -> Iterator[tuple[str, bool]]:
    """Key of every parameter of a base or form, and whether it must be positive."""
    owner = f"{part.effect}." if isinstance(part, Form) else ""
    yield from ((owner + item.name, False) for item in part.linear)
    yield from ((owner + item.name, not item.signed) for item in part.nonlinear)
