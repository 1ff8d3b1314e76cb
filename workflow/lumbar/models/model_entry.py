"""A fitted model as plain data and back, with everything that is wrong with the data said at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, asdict, fields

from lumbar.errors import Problems
from lumbar.models.bases import BASES
from lumbar.models.fitted_model import FittedModel, FittedParameter, Port, Scores
from lumbar.models.form import Effect, Form
from lumbar.models.structure import Structure
from lumbar.models.tissue_models import MODELS
from lumbar.models.transfer_function import TransferFunction

Catalogues = Mapping[str, Mapping[str, Effect]]


def entry_of(model: FittedModel) -> dict:
    """Return a model as plain data: its fields, with the structure as coefficients or as names of effects and forms."""
    structure = model.structure
    if model.discrete:
        written = {"numerator": list(structure.numerator), "denominator": list(structure.denominator)}
    else:
        written = {"effects": [{"effect": form.effect, "form": form.name} for form in structure.forms]}
    plain = {item.name: getattr(model, item.name) for item in fields(model)}
    plain |= {
        "structure": written,
        "input": _plain(model.input),
        "output": _plain(model.output),
        "parameters": [_plain(item) for item in model.parameters],
        "scores": _plain(model.scores),
    }
    return plain


def _plain(item: FittedParameter | Port | Scores) -> dict:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(item).items()}


def read_entry(entry: dict, catalogues: Catalogues) -> FittedModel:
    """Return the model of an entry; see `FittedModel.from_json`."""
    name = entry.get("name") if isinstance(entry, dict) else None
    problems = Problems(f"model {name!r}")
    model = checked_entry(entry, catalogues, problems)
    problems.raise_if_any()
    return model


def checked_entry(entry: dict, catalogues: Catalogues, problems: Problems) -> FittedModel | None:
    """Return the model of an entry, or None where something was added to `problems`."""
    before = len(problems.entries)
    for place, message in _shape(entry):
        problems.add(place, message)
    if len(problems.entries) > before:
        return None
    plain = {
        **entry,
        "input": Port(**entry["input"]),
        "output": Port(**entry["output"]),
        "parameters": tuple(FittedParameter(**item) for item in entry.get("parameters", [])),
        "scores": Scores(**{key: _tuple(value) for key, value in entry.get("scores", {}).items()}),
    }
    written = entry["structure"]
    if "effects" in written:
        structure = _structure(entry.get("base", ""), written["effects"], catalogues, problems)
    else:
        structure = _transfer_function(written, problems)
    if not entry["sampling_time"] > 0:
        problems.add("sampling_time", f"{entry['sampling_time']}", "seconds above 0 are needed")
    if structure is not None:
        _check_parameters(plain["parameters"], structure, entry.get("base", ""), problems)
    return None if len(problems.entries) > before else FittedModel(**{**plain, "structure": structure})


def _tuple(value):
    return tuple(value) if isinstance(value, list) else value


def _transfer_function(written: dict, problems: Problems) -> TransferFunction | None:
    if written["denominator"][0] != 1:
        found = f"{written['denominator'][0]:g}"
        problems.add(
            "structure.denominator.0", found, "1 is needed; 0 is improper: it needs future positions"
        )
        return None
    return TransferFunction(tuple(written["numerator"]), tuple(written["denominator"]))


def _structure(
    base: str, effects: list[dict], catalogues: Catalogues, problems: Problems
) -> Structure | None:
    before = len(problems.entries)
    if base not in BASES:
        problems.add("base", repr(base), f"bases are {', '.join(BASES)}")
        return None
    catalogue = catalogues.get(BASES[base].system, {})
    forms: list[Form] = []
    for item in effects:
        form = _form(item, catalogue, problems)
        if form is not None and form.effect in [earlier.effect for earlier in forms]:
            problems.add("structure.effects", f"{form.effect} is there twice", "once is allowed")
        elif form is not None:
            forms.append(form)
    return None if len(problems.entries) > before else Structure(BASES[base], tuple(forms))


def _form(item: dict, catalogue: Mapping[str, Effect], problems: Problems) -> Form | None:
    effect = catalogue.get(item["effect"])
    if effect is None:
        allowed = f"there are {', '.join(catalogue)}; effects of your own come from improvement.effect_files"
        problems.add("structure.effects", f"unknown effect {item['effect']!r}", allowed)
        return None
    form = next((form for form in effect.forms if form.name == item["form"]), None)
    if form is None:
        allowed = f"its forms are {', '.join(form.name for form in effect.forms)}"
        problems.add(f"structure.effects.{effect.name}", f"unknown form {item['form']!r}", allowed)
    return form


def _check_parameters(
    parameters: tuple[FittedParameter, ...], structure, base: str, problems: Problems
) -> None:
    """A continuous model needs exactly its parameters; a discrete one may have those of its base. Elements may be beside."""
    parts = (structure.base, *structure.forms) if isinstance(structure, Structure) else ()
    needed = {key: positive for part in parts for key, positive in _keys(part)}
    optional = {item.name for item in MODELS[base].elements} if base in MODELS else set()
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
    yield from ((owner + item.name, True) for item in part.nonlinear)


def _shape(entry) -> Iterator[tuple[str, str]]:
    """Place and message of everything that is missing, unknown, of the wrong type or not finite."""
    from jsonschema import Draft202012Validator

    errors = Draft202012Validator(_object(FittedModel)).iter_errors(entry)
    for error in sorted(errors, key=lambda item: list(map(str, item.absolute_path))):
        known = ", ".join(error.schema["properties"]) if error.validator == "additionalProperties" else ""
        place = ".".join(map(str, error.absolute_path)) or "entry"
        yield place, f"{error.message}; known are {known}" if known else error.message
    yield from _not_finite(entry, "")


def _not_finite(value, place: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield place.removeprefix("."), f"{value}; a finite number is needed"
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _not_finite(item, f"{place}.{key}")


def _object(kind: type) -> dict:
    """JSON schema of a dataclass: its fields, those without a default required."""
    items = fields(kind)
    required = [item.name for item in items if item.default is item.default_factory is MISSING]
    return {
        "type": "object",
        "additionalProperties": False,
        "required": required,
        "properties": {item.name: _type(item.type) for item in items},
    }


_NUMBERS = {"type": "array", "minItems": 1, "items": {"type": "number"}}
_STRUCTURE = {
    "type": "object",
    # By whether there are effects, so that a message is about the kind of model that was meant.
    "if": {"required": ["effects"]},
    "then": {
        "additionalProperties": False,
        "properties": {
            "effects": {
                "type": "array",
                "items": {
                    "type": "object",
                    "additionalProperties": False,
                    "required": ["effect", "form"],
                    "properties": {"effect": {"type": "string"}, "form": {"type": "string"}},
                },
            }
        },
    },
    "else": {
        "additionalProperties": False,
        "required": ["numerator", "denominator"],
        "properties": {"numerator": _NUMBERS, "denominator": _NUMBERS},
    },
}
_PLAIN = {"str": "string", "float": "number", "int": "integer", "bool": "boolean", "None": "null"}
_CLASSES = {item.__name__: item for item in (FittedParameter, Port, Scores)}


def _type(annotation: str) -> dict:
    """JSON schema of a field by its annotation."""
    if annotation == "TransferFunction | Structure":
        return _STRUCTURE
    if annotation.startswith("tuple["):
        return {"type": "array", "items": _type(annotation.removeprefix("tuple[").removesuffix(", ...]"))}
    if annotation in _CLASSES:
        return _object(_CLASSES[annotation])
    return {"type": [_PLAIN[part] for part in annotation.split(" | ")]}
