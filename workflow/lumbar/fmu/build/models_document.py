"""The form that models.json must have before anything is made of it."""

from __future__ import annotations

from lumbar.errors import Problems

SCHEMA = "lumbar.models/1"
REFINED = "lumbar.refined/1"
_NUMBER, _NUMBERS, _ARRAY = (
    {"type": ["number", "null"]},
    {"type": "array", "items": {"type": "number"}},
    {"type": "array"},
)
_TEXT = {"type": ["string", "null"]}
_SIGNAL = {
    "type": "object",
    "required": ["quantity", "unit"],
    "properties": {
        "quantity": {"type": "string", "minLength": 1},
        "unit": {"type": "string", "minLength": 1},
    },
}
_EFFECT = {
    "type": "object",
    "required": ["effect", "form"],
    "properties": {
        "effect": {"type": "string"},
        "form": {"type": "string"},
        "amplitudes": _ARRAY,
        "shapes": _ARRAY,
    },
}
_PHYSICAL = {
    "type": "object",
    "required": ["value", "unit"],
    "properties": {"value": {"type": "number"}, "unit": {"type": "string"}, "low": _NUMBER, "high": _NUMBER},
}
_TRANSFER_FUNCTION = {
    "required": ["numerator", "denominator"],
    "properties": {"numerator": _NUMBERS, "denominator": _NUMBERS, "base": {"type": "null"}},
}
_WITH_EFFECTS = {
    "required": ["base"],
    "properties": {
        "base": {"type": "string"},
        "amplitudes": _ARRAY,
        "shapes": _ARRAY,
        "effects": {"type": "array", "items": _EFFECT},
    },
}
_MODEL = {
    "type": "object",
    "required": ["name"],
    "properties": {
        "name": {"type": "string"},
        "trained_on": _TEXT,
        "estimator": _TEXT,
        "sampling_time_s": _NUMBER,
        "input": _SIGNAL,
        "output": _SIGNAL,
        "input_offset": _NUMBER,
        "output_offset": _NUMBER,
        "alpha": _NUMBER,
        "vaf_percent": _NUMBER,
        "physical": {"type": ["object", "null"], "additionalProperties": _PHYSICAL},
    },
    # By whether there is a base, so that a message is about the kind of model that was meant.
    "if": {"required": ["base"], "properties": {"base": {"type": "string"}}},
    "then": _WITH_EFFECTS,
    "else": _TRANSFER_FUNCTION,
}
_DOCUMENT = {
    "type": "object",
    "required": ["sampling_time_s", "input", "output", "models"],
    "properties": {
        "sampling_time_s": {"type": "number"},
        "input": _SIGNAL,
        "output": _SIGNAL,
        "models": {"type": "array", "items": _MODEL},
    },
}


def from_refined(content):
    """Return refined.json, the rungs of an error ladder, in the form of models.json; anything else as it is.

    Parameters
    ----------
    content : object
        As read from JSON.
    """
    if not isinstance(content, dict) or content.get("schema") != REFINED:
        return content
    signals = {
        role: {"quantity": content[f"{role}_quantity"], "unit": content[f"{role}_unit"]}
        for role in ("input", "output")
    }
    models = [
        {
            **model,
            "estimator": "output_error",
            "physical": {
                f"{item['effect']}.{item['name']}" if item["effect"] else item["name"]: {
                    key: item[key] for key in ("value", "unit", "low", "high")
                }
                for item in model["parameters"]
            },
        }
        for model in content["models"]
    ]
    return {
        "schema": SCHEMA,
        "sampling_time_s": content["sampling_time_s"],
        **signals,
        "models": models,
        "data": content["data"],
    }


def check_document(content) -> None:
    """Check the form of models.json; what its numbers mean is checked where a model is made of them.

    Parameters
    ----------
    content : object
        As read from JSON.

    Raises
    ------
    InputError
        With the place of everything that is missing or of the wrong type.
    """
    from jsonschema import Draft202012Validator

    problems = Problems("models.json")
    if isinstance(content, dict) and content.get("schema") != SCHEMA:
        problems.add("schema", repr(content.get("schema")), f"{SCHEMA!r} or {REFINED!r} is needed")
        problems.raise_if_any()
    errors = Draft202012Validator(_DOCUMENT).iter_errors(content)
    for error in sorted(errors, key=lambda item: list(map(str, item.absolute_path))):
        place = list(error.absolute_path)
        if place[:1] == ["models"] and len(place) > 1 and isinstance(content["models"][place[1]], dict):
            place[1] = content["models"][place[1]].get("name", place[1])
        problems.add(".".join(map(str, place)) or "top level", error.message)
    problems.raise_if_any()
