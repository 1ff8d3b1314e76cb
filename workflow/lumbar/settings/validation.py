"""Check of a configuration: every wrong key and value of all files in one error."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_jsonable_python

from lumbar.base.errors import Problems, did_you_mean
from lumbar.base.yaml_file import YamlFile, way_of
from lumbar.settings.layout import AXIS_ROLES, SIDES
from lumbar.settings.section import Section

FILL_IN = "FILL_IN"
"""Placeholder of a value that only the user knows (``lumbar new-study``)."""
MAX_SHOWN_CHARACTERS = 60
_ANY = object()
_TYPES = {"string": "text", "number": "number", "integer": "whole number"}
_TYPES |= {"boolean": "true or false", "null": "null"}
_LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}

Kind = TypeVar("Kind", bound=Section)
Data = TypeVar("Data")


@cache
def adapter_of(kind: type[Data]) -> TypeAdapter[Data]:
    """Return Pydantic's adapter of a class; it is built once."""
    return TypeAdapter(kind)


@dataclass(frozen=True)
class Key:
    """A section, a key or an entry of a list, by its JSON schema."""

    schema: Mapping[str, Any]
    definitions: Mapping[str, Any]
    """Schemas that others refer to, by name."""
    unit: str = ""

    @classmethod
    def of(cls, kind: type) -> "Key":
        """Return a whole section, or another class that Pydantic validates, as a key."""
        schema = adapter_of(kind).json_schema()
        return cls(schema, schema.get("$defs", {}))

    @property
    def types(self) -> list["Key"]:
        """Types that the value may have, each without references to other schemas."""
        if "$ref" in self.schema:
            return [Key(self.definitions[self.schema["$ref"].rpartition("/")[2]], self.definitions)]
        members = self.schema.get("anyOf")
        if members is None:
            return [self]
        return [kind for member in members for kind in Key(member, self.definitions, self.unit).types]

    @property
    def keys(self) -> dict[str, "Key"]:
        """Keys of the sections that the value may be."""
        return {
            name: Key(schema, self.definitions, schema.get("unit", ""))
            for kind in self.types
            for name, schema in kind.schema.get("properties", {}).items()
        }

    @property
    def meaning(self) -> str:
        """Description; that of its section if the key has no other."""
        described = self if "description" in self.schema else self.types[0]
        return " ".join(described.schema.get("description", "").split())

    @property
    def allowed(self) -> str:
        """Type and limits for a message.

        Examples
        --------
        >>> Key({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "null"}]}, {}, "Hz").allowed
        'number > 0 Hz, or null'
        """
        *first, last = [kind._allowed_type() for kind in self.types]
        return f"{', '.join(first)}, or {last}" if first else last

    def _allowed_type(self) -> str:
        schema = self.schema
        if values := schema.get("enum", [schema["const"]] if "const" in schema else []):
            return ", ".join(map(str, values))
        if "properties" in schema:
            return "{" + ", ".join(schema["properties"]) + "}"
        if schema["type"] in ("array", "object"):
            entry = self.at(0).allowed
            if schema["type"] == "object":
                return f"names, each with {entry}"
            if "prefixItems" in schema:
                return f"list of {schema['minItems']}: {entry}"
            fewest = schema.get("minItems", 0)
            return f"list of at least {fewest}: {entry}" if fewest > 1 else f"list of {entry}"
        if schema["type"] == "string":
            return "text, not empty" if schema.get("minLength") else "text"
        limits = ", ".join(f"{sign} {schema[name]:g}" for name, sign in _LIMITS.items() if name in schema)
        unit = self.unit if schema["type"] in ("number", "integer") else ""
        return " ".join(filter(None, [_TYPES[schema["type"]], limits, unit]))

    def at(self, *path: Any) -> "Key | None":
        """Return the key to which a path leads, e.g. ``("records", 0, "file")``, if there is one."""
        if not path:
            return self
        part, *rest = path
        below = self.keys.get(part)
        for kind in self.types if below is None else ():
            schema = kind.schema
            if schema.get("type") == "object" and "properties" not in schema:
                named = schema.get("additionalProperties") or next(iter(schema["patternProperties"].values()))
                below = Key(named, self.definitions)
            elif schema.get("type") == "array" and isinstance(part, int):
                entries = schema.get("prefixItems") or [schema["items"]]
                below = Key(entries[min(part, len(entries) - 1)], self.definitions, kind.unit)
        return None if below is None else below.at(*rest)

    @property
    def rule(self) -> str:
        """What is allowed and what the key means, for a message."""
        return f"allowed: {self.allowed}" + (f" ({self.meaning.rstrip('.')})" if self.meaning else "")


def overlay(base: dict, upper: dict) -> dict:
    """Merge as Snakemake does: mappings merge, lists and scalars replace."""
    merged = dict(base)
    for key, value in upper.items():
        below = merged.get(key)
        both = isinstance(below, dict) and isinstance(value, dict)
        merged[key] = overlay(below, value) if both else value
    return merged


class Origins:
    """Origin of each key of a merged configuration, file and line, for problems; later files replace earlier ones.

    `merged` is the configuration, if it may have more than its files: a value in no file was given on the command line.
    """

    def __init__(self, problems: Problems, files: Sequence[YamlFile] = (), merged: dict | None = None):
        self.problems, self.files, self.merged = problems, files, merged

    def add(self, key: str | tuple, found: str, allowed: str) -> None:
        """Add a problem at a key, given by its name or the path to it."""
        way = way_of(key) if isinstance(key, str) else key
        self.problems.add(self.place(way), found, allowed)

    def place(self, way: tuple, value: Any = _ANY) -> str:
        """Return file, line and key of a place, as far as a file has it; else ``--config``, if it was given there.

        Parameters
        ----------
        way : tuple
            Keys and numbers of entries.
        value : object, optional
            Value at the place, by default that of the merged configuration. A file with another value is not its origin.
        """
        name = ".".join(map(str, way)) or "top level"
        for end in range(len(way), 0, -1):
            part = way[:end]
            if value is _ANY or end < len(way):
                value = _ANY if self.merged is None else _value(self.merged, part, _ANY)
            holding = [file for file in self.files if part in file.lines]
            for file in reversed(holding):
                if value is _ANY or _is_merged(part, value) or _at(file.content, part) == value:
                    return f"{file.path}, line {file.lines[part]}: {name}"
            given = self.files and self.merged is not None and _value(self.merged, part, _ANY) is not _ANY
            if given or holding:
                return f"--config: {name}"
        return f"{self.files[0].path}: {name}" if len(self.files) == 1 and self.merged is None else name


def _is_merged(way: tuple, value: Any) -> bool:
    """Return whether a value is merged key by key from all files: a mapping outside of lists."""
    return isinstance(value, dict) and not any(isinstance(part, int) for part in way)


def _at(content: Any, way: tuple) -> Any:
    for part in way:
        content = content[part]
    return content


def _value(content: Any, way: tuple, absent: Any) -> Any:
    try:
        return _at(content, way)
    except (KeyError, IndexError, TypeError):
        return absent


def validate(content: dict, kind: type[Kind], origins: Origins) -> Kind | None:
    """Return a configuration as settings, with defaults for missing keys; None if there are problems.

    Parameters
    ----------
    content : dict
        Content of the files.
    kind : type
        Class of `lumbar.settings`.
    origins : Origins
        Collects every wrong key and value, with file, line, value and what is allowed.
    """
    unfilled = _unfilled(content)
    whole = Key.of(kind) if unfilled else None
    for way in unfilled:
        key = whole.at(*way)
        origins.add(way, f"{FILL_IN}: still to be filled in", key.rule if key else "")
    merged = overlay(_without_other_axes(defaults_of(kind), content), content)
    checked = check_types(merged, kind, origins, unfilled)
    return None if unfilled else checked


def check_types(content: Any, kind: type[Data], origins: Origins, known: Sequence[tuple] = ()) -> Data | None:
    """Return plain data as an object of a class that Pydantic validates; None if there are problems.

    `known` are ways to values that are not reported again.
    """
    try:
        return adapter_of(kind).validate_json(json.dumps(content, default=_as_plain), strict=True)
    except ValidationError as error:
        whole, problems, short = Key.of(kind), {}, set()
        for item in error.errors(include_url=False):
            way, found, allowed = _explain(whole, content, item)
            problems.setdefault(way, (found, allowed))
            if item["type"] == "too_short":  # also of a list without its wrong entries
                short.add(way)
    for way, (found, allowed) in problems.items():
        within = [other for other in problems if way in short and other != way]
        if not any(other[: len(way)] == way for other in (*known, *within)):
            origins.problems.add(origins.place(way, _value(content, way, _ANY)), found, allowed)
    return None


def _unfilled(content: Any, way: tuple = ()) -> list[tuple]:
    """Return the ways to the values that the user has yet to fill in."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        return [found for key, value in items for found in _unfilled(value, (*way, key))]
    return [way] if content == FILL_IN else []


def _as_plain(value: Any) -> Any:
    """Return a number of NumPy as Python's, anything else that no file can hold as its text, which is an error."""
    return value.item() if hasattr(value, "item") else str(value)


def defaults_of(section: type[Section]) -> dict[str, Any]:
    """Return the defaults of the keys of a section that have one, as plain data."""
    return to_jsonable_python(
        {
            item.alias or name: item.get_default(call_default_factory=True)
            for name, item in section.model_fields.items()
            if not item.is_required()
        }
    )


def _without_other_axes(defaults: dict, content: Any) -> dict:
    """Remove the roles of one axis from the defaults of a layout that names those of several."""
    kept = {
        role: item for role, item in defaults.items() if role not in SIDES or AXIS_ROLES.isdisjoint(content)
    }
    within = [
        name for name, item in kept.items() if isinstance(item, dict) and isinstance(content.get(name), dict)
    ]
    return {**kept, **{name: _without_other_axes(kept[name], content[name]) for name in within}}


def _explain(whole: Key, content: dict, error: Mapping[str, Any]) -> tuple[tuple, str, str]:
    """Return the way to an error of Pydantic, what was found there, and what is allowed."""
    way: tuple = ()
    value: Any = content
    for part in error["loc"]:
        known = range(len(value)) if isinstance(value, list) else value if isinstance(value, dict) else ()
        if part not in known:  # missing, or the name of a type of several
            break
        way, value = (*way, part), value[part]
    kind, last = error["type"], error["loc"][-1] if error["loc"] else ""
    if kind in ("extra_forbidden", "unexpected_keyword_argument") and way == error["loc"]:
        section = whole.at(*way[:-1])
        known = section.keys if section else {}
        return way, f"unknown key{did_you_mean(last, known)}", f"allowed: {', '.join(known)}"
    if kind == "missing" and (*way, last) == error["loc"]:
        way, found = (*way, last), "missing"
    elif last == "[key]":
        way, found = way[:-1], f"{way[-1]!r} is not a valid name"
        return (*way, error["loc"][-2]), found, whole.at(*way).rule
    elif kind == "value_error":
        found = str(error["ctx"]["error"])
    else:
        found = ""
    key = whole.at(*way)
    if found or key is None:
        return way, found or f"found {_shown(value)}", key.rule if key else ""
    choices = [word for each in key.types for word in each.schema.get("enum", ())]
    meant = did_you_mean(value, choices) if isinstance(value, str) else ""
    meant = ", which is not finite" if kind == "finite_number" else meant
    return way, f"found {_shown(value)}{meant}", key.rule + _number_hint(value, key)


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}…"


def _number_hint(value: Any, key: Key) -> str:
    """Return how to write a number that YAML read as text."""
    if not isinstance(value, str) or "number" not in key.allowed:
        return ""
    try:
        float(value)
    except ValueError:
        return ""
    return "; write numbers without quotes, powers of ten as 1.0e+6"
