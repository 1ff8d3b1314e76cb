"""What a key of a configuration may hold, in words: for error messages and for the reference pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from lumbar.settings.key import Each
from lumbar.settings.plain import name_of, types_of

_WORDS = {str: "text", float: "number", int: "whole number", bool: "true or false", NoneType: "null"}
_SIGNS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}


@dataclass(frozen=True)
class KeyType:
    """A key or an entry of a list: its type and what is said about it."""

    kind: Any
    """As annotated."""
    facts: Mapping[str, Any]
    """``description``, limits, ``json_schema_extra``."""

    @property
    def meaning(self) -> str:
        """Its description."""
        return self.facts.get("description", "")

    @property
    def unit(self) -> str:
        """Unit of the value, or nothing."""
        return self.facts.get("json_schema_extra", {}).get("unit", "")

    @property
    def allowed(self) -> str:
        """Type and limits in words."""
        return allowed(self.kind, {**self.facts, "unit": self.unit})


def keys_of(section: type) -> dict[str, KeyType]:
    """Every key of a section by its name in a configuration."""
    types = types_of(section)
    return {name_of(item): KeyType(types[item.name], item.metadata) for item in fields(section)}


def key_at(section: type, way: tuple) -> KeyType | None:
    """Return the key to which a way leads, e.g. ``("tissue", "records", 0, "file")``, if there is one."""
    found = KeyType(section, {})
    for part in way:
        step = _below(found.kind, part)
        if step is None:
            return None
        found = step
    return found


def section_of(kind: Any) -> type | None:
    """Return the one section that a type is or may be."""
    sections = [member for member in _members(kind) if is_dataclass(member)]
    return sections[0] if len(sections) == 1 else None


def _below(kind: Any, part: Any) -> KeyType | None:
    for member in _members(kind):
        origin, arguments = get_origin(member), get_args(member)
        if is_dataclass(member) and part in (known := keys_of(member)):
            return known[part]
        if origin is dict:
            return KeyType(arguments[1], {})
        if origin is tuple and isinstance(part, int):
            entry = arguments[0] if arguments[-1] is Ellipsis else arguments[min(part, len(arguments) - 1)]
            return KeyType(entry, {})
    return None


def _members(kind: Any) -> list:
    """Members of a union, or the type itself, without ``Annotated``."""
    if get_origin(kind) is Annotated:
        return _members(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [inner for member in get_args(kind) for inner in _members(member)]
    return [kind]


def allowed(kind: Any, limits: Mapping[str, Any] | None = None) -> str:
    """Say what a type allows.

    Examples
    --------
    >>> allowed(float | None, {"gt": 0})
    'number > 0, or null'
    """
    limits = limits or {}
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        own = {
            name: value
            for each in arguments[1:]
            if isinstance(each, Each)
            for name, value in each.limits.items()
        }
        return allowed(arguments[0], {**limits, **own})
    if origin in (Union, UnionType):
        *first, last = [allowed(member, limits) for member in arguments]
        return f"{', '.join(first)}, or {last}"
    if origin is Literal:
        return ", ".join(map(str, arguments))
    if origin is tuple:
        unit = {"unit": limits.get("unit", "")}
        few = limits.get("min_length", 0)
        if arguments[-1] is Ellipsis:
            return (f"list of at least {few}: " if few > 1 else "list of ") + allowed(arguments[0], unit)
        return f"list of {len(arguments)}: {allowed(arguments[0], unit)}"
    if origin is dict:
        return f"names, each with {allowed(arguments[1])}"
    if is_dataclass(kind):
        return "{" + ", ".join(keys_of(kind)) + "}"
    if kind is str and limits.get("min_length"):
        return "text, not empty"
    signs = ", ".join(f"{sign} {limits[name]:g}" for name, sign in _SIGNS.items() if name in limits)
    unit = limits.get("unit", "") if kind in (int, float) else ""
    return " ".join(filter(None, [_WORDS[kind], signs if kind in (int, float) else "", unit]))
