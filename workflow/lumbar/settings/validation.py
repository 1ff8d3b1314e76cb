"""Check of a configuration: every wrong key and value of all files in one error."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_jsonable_python

from lumbar.base.errors import Problems, did_you_mean
from lumbar.base.yaml_file import YamlFile, parse_key_path
from lumbar.settings.axes import SIDES
from lumbar.settings.layout import AXIS_ROLES
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
def adapter_of(kind: Any) -> TypeAdapter:
    """Return Pydantic's adapter of a class; it is built once.

    Parameters
    ----------
    kind : type
        Class that Pydantic validates.
    """
    return TypeAdapter(kind)


@dataclass(frozen=True)
class Key:
    """A section, a key or an entry of a list, by its JSON schema."""

    schema: Mapping[str, Any]
    definitions: Mapping[str, Any]
    """Schemas that others refer to, by name."""
    unit: str = ""

    @classmethod
    @cache
    def from_class(cls, kind: Any) -> "Key":
        """Return a whole section as a key.

        Parameters
        ----------
        kind : type
            Section, or another class that Pydantic validates.
        """
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
            inner = self.find(0)
            entry = inner.allowed if inner else "any value"
            if schema["type"] == "object":
                return f"names, each with {entry}"
            if "prefixItems" in schema:
                return f"list of {schema['minItems']}: {entry}"
            fewest = schema.get("minItems", 0)
            if "maxItems" in schema:
                return f"list of {fewest} to {schema['maxItems']}: {entry}"
            return f"list of at least {fewest}: {entry}" if fewest > 1 else f"list of {entry}"
        if schema["type"] == "string":
            return "text, not empty" if schema.get("minLength") else "text"
        limits = ", ".join(f"{sign} {schema[name]:g}" for name, sign in _LIMITS.items() if name in schema)
        unit = self.unit if schema["type"] in ("number", "integer") else ""
        return " ".join(filter(None, [_TYPES[schema["type"]], limits, unit]))

    def find(self, *path: Any) -> "Key | None":
        """Return the key at a path, if there is one.

        Parameters
        ----------
        *path : str or int
            Keys and numbers of entries, e.g. ``"records", 0, "file"``.
        """
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
        return None if below is None else below.find(*rest)

    @property
    def rule(self) -> str:
        """Allowed values and meaning of the key, for a message."""
        return f"allowed: {self.allowed}" + (f" ({self.meaning.rstrip('.')})" if self.meaning else "")


def overlay(base: dict, upper: dict) -> dict:
    """Merge two configurations as Snakemake does: mappings merge, lists and scalars replace.

    Parameters
    ----------
    base : dict
        Configuration below.
    upper : dict
        Configuration whose values win.

    Returns
    -------
    dict
        A new mapping.
    """
    merged = dict(base)
    for key, value in upper.items():
        below = merged.get(key)
        if isinstance(below, dict) and isinstance(value, dict):
            value = overlay(below, value)
        merged[key] = value
    return merged


class Origins:
    """Origin of each key of a merged configuration, file and line, for problems; later files replace earlier ones.

    `merged` is the configuration, if it may have more than its files: a value in no file was given on the command line.
    """

    def __init__(self, problems: Problems, files: Sequence[YamlFile] = (), merged: dict | None = None):
        self.problems, self.files, self.merged = problems, files, merged

    def add(self, key: str | tuple, fault: str, allowed: str) -> None:
        """Add a problem at a key.

        Parameters
        ----------
        key : str or tuple
            Name of the key, e.g. ``"tissue.rate_Hz"``, or the path to it.
        fault : str
            What is wrong there.
        allowed : str
            What is allowed.
        """
        path = parse_key_path(key) if isinstance(key, str) else key
        self.problems.add(self.place(path), fault, allowed)

    def place(self, path: tuple, value: Any = _ANY) -> str:
        """Return file, line and key of a place, as far as a file has it; else ``--config``, if it was given there.

        Parameters
        ----------
        path : tuple
            Keys and numbers of entries.
        value : object, optional
            Value at the place, by default that of the merged configuration. A file with another value is not its origin.
        """
        name = ".".join(map(str, path)) or "top level"
        for end in range(len(path), 0, -1):
            part = path[:end]
            if value is _ANY or end < len(path):
                value = _ANY if self.merged is None else _value(self.merged, part, _ANY)
            with_key = [file for file in self.files if part in file.lines]
            for file in reversed(with_key):
                # A mapping outside of lists is merged key by key from all files.
                merged = isinstance(value, dict) and not any(isinstance(key, int) for key in part)
                if value is _ANY or merged or _get_item(file.content, part) == value:
                    return f"{file.path}, line {file.lines[part]}: {name}"
            given = self.files and self.merged is not None and _value(self.merged, part, _ANY) is not _ANY
            if given or with_key:
                return f"--config: {name}"
        return f"{self.files[0].path}: {name}" if len(self.files) == 1 and self.merged is None else name


def _get_item(content: Any, path: tuple) -> Any:
    for part in path:
        content = content[part]
    return content


def _value(content: Any, path: tuple, absent: Any) -> Any:
    try:
        return _get_item(content, path)
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
    unfilled = _unfilled_paths(content)
    for path in unfilled:
        key = Key.from_class(kind).find(*path)
        origins.add(path, f"{FILL_IN}: still to be filled in", key.rule if key else "")
    merged = overlay(_remove_other_axes(defaults_of(kind), content), content)
    checked = check_types(merged, kind, origins, unfilled)
    return None if unfilled else checked


def check_types(content: Any, kind: type[Data], origins: Origins, known: Sequence[tuple] = ()) -> Data | None:
    """Return plain data as an object of a class that Pydantic validates; None if there are problems.

    Parameters
    ----------
    content : dict or list
        Plain data.
    kind : type
        Class that Pydantic validates.
    origins : Origins
        Collects every wrong key and value.
    known : sequence of tuple
        Paths to values that are not reported again.
    """
    try:
        adapter: TypeAdapter[Data] = adapter_of(kind)  # type: ignore[arg-type]
        return adapter.validate_json(json.dumps(content, default=_to_plain), strict=True)
    except ValidationError as error:
        whole = Key.from_class(kind)  # type: ignore[arg-type]
        faults: dict[tuple, Any] = {}
        for item in error.errors(include_url=False):
            fault = _explain(whole, content, item)
            faults.setdefault(fault.path, fault)
    for path, fault in faults.items():
        # A list with wrong entries is too short without them: its entries are reported.
        reported = (*known, *(other for other in faults if fault.too_short and other != path))
        if not any(other[: len(path)] == path for other in reported):
            origins.problems.add(origins.place(path, _value(content, path, _ANY)), fault.found, fault.allowed)
    return None


def _to_plain(value: Any) -> Any:
    """Return a number of NumPy as Python's, anything else that no file can hold as its text, which is an error."""
    return value.item() if hasattr(value, "item") else str(value)


def _unfilled_paths(content: Any, path: tuple = ()) -> list[tuple]:
    """Return the paths to the values that the user has yet to fill in."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        return [unfilled for key, value in items for unfilled in _unfilled_paths(value, (*path, key))]
    return [path] if content == FILL_IN else []


def defaults_of(section: type[Section]) -> dict[str, Any]:
    """Return the defaults of the keys of a section that have one, as plain data.

    Parameters
    ----------
    section : type
        Class of a section.
    """
    return to_jsonable_python(
        {
            item.alias or name: item.get_default(call_default_factory=True)
            for name, item in section.model_fields.items()
            if not item.is_required()
        }
    )


def _remove_other_axes(defaults: dict, content: Any) -> dict:
    """Remove the roles of one axis from the defaults of a layout that names those of several."""
    remaining = {
        role: item for role, item in defaults.items() if role not in SIDES or AXIS_ROLES.isdisjoint(content)
    }
    for name, item in remaining.items():
        if isinstance(item, dict) and isinstance(content.get(name), dict):
            remaining[name] = _remove_other_axes(item, content[name])
    return remaining


@dataclass(frozen=True)
class _Fault:
    """One fault of a configuration."""

    path: tuple
    found: str
    allowed: str
    too_short: bool = False


def _explain(whole: Key, content: Any, error: Mapping[str, Any]) -> _Fault:
    """Return an error of Pydantic as a fault: the path to it, the value or what is wrong with it, and what is allowed."""
    kind, place = error["type"], tuple(error["loc"])
    path, value = _find_value(content, place)
    if kind in ("extra_forbidden", "unexpected_keyword_argument") and path == place:
        section = whole.find(*path[:-1])
        known = section.keys if section else {}
        return _Fault(path, f"unknown key{did_you_mean(path[-1], known)}", f"allowed: {', '.join(known)}")
    if place and place[-1] == "[key]":
        names = whole.find(*path[:-1])
        return _Fault(path, f"{path[-1]!r} is not a valid name", names.rule if names else "")
    if kind == "missing" and (*path, place[-1]) == place:
        path, fault = place, "missing"
    elif kind == "value_error":
        fault = str(error["ctx"]["error"])
    elif kind == "too_long" and isinstance(value, list):
        fault = f"found {len(value)} entries"
    else:
        fault = f"found {_abbreviate(value)}"
        fault += ", which is not finite" if kind == "finite_number" else ""
    key = whole.find(*path)
    if key is None:
        return _Fault(path, fault, "")
    hint = ""
    if isinstance(value, str) and fault.startswith("found"):
        fault += did_you_mean(value, [word for each in key.types for word in each.schema.get("enum", ())])
        hint = _number_hint(value, key)
    return _Fault(path, fault, key.rule + hint, kind == "too_short")


def _find_value(content: Any, place: tuple) -> tuple[tuple, Any]:
    """Return the path of an error as far as the content has it, and the value there.

    The rest of the place is the name of a missing key, or of one of several types.
    """
    path: tuple = ()
    for part in place:
        known = range(len(content)) if isinstance(content, list) else content
        if not isinstance(content, list | dict) or part not in known:
            break
        path, content = (*path, part), content[part]
    return path, content


def _abbreviate(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}…"


def _number_hint(value: str, key: Key) -> str:
    """Return how to write a number that YAML read as text."""
    if "number" not in key.allowed:
        return ""
    try:
        float(value)
    except ValueError:
        return ""
    return "; write numbers without quotes, powers of ten as 1.0e+6"
