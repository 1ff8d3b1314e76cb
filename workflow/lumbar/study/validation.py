"""A configuration against the settings that there are: every wrong key and value of all files at once."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from lumbar.base.errors import Problems, did_you_mean
from lumbar.base.yaml_file import YamlFile, way_of
from lumbar.settings.key import Each
from lumbar.settings.layout import AXIS_ROLES, SIDES
from lumbar.settings.plain import members_of, name_of, plain, types_of

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
        return allowed_words(self.kind, {**self.facts, "unit": self.unit})


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
    sections = [member for member in members_of(kind) if is_dataclass(member)]
    return sections[0] if len(sections) == 1 else None


def _below(kind: Any, part: Any) -> KeyType | None:
    for member in members_of(kind):
        origin, arguments = get_origin(member), get_args(member)
        if is_dataclass(member) and part in (known := keys_of(member)):
            return known[part]
        if origin is dict:
            return KeyType(arguments[1], {})
        if origin is tuple and isinstance(part, int):
            entry = arguments[0] if arguments[-1] is Ellipsis else arguments[min(part, len(arguments) - 1)]
            return KeyType(entry, {})
    return None


def allowed_words(kind: Any, limits: Mapping[str, Any] | None = None) -> str:
    """Say what a type allows.

    Examples
    --------
    >>> allowed_words(float | None, {"gt": 0})
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
        return allowed_words(arguments[0], {**limits, **own})
    if origin in (Union, UnionType):
        *first, last = [allowed_words(member, limits) for member in arguments]
        return f"{', '.join(first)}, or {last}"
    if origin is Literal:
        return ", ".join(map(str, arguments))
    if origin is tuple:
        unit = {"unit": limits.get("unit", "")}
        few = limits.get("min_length", 0)
        if arguments[-1] is Ellipsis:
            return (f"list of at least {few}: " if few > 1 else "list of ") + allowed_words(
                arguments[0], unit
            )
        return f"list of {len(arguments)}: {allowed_words(arguments[0], unit)}"
    if origin is dict:
        return f"names, each with {allowed_words(arguments[1])}"
    if is_dataclass(kind):
        return "{" + ", ".join(keys_of(kind)) + "}"
    if kind is str and limits.get("min_length"):
        return "text, not empty"
    signs = ", ".join(f"{sign} {limits[name]:g}" for name, sign in _SIGNS.items() if name in limits)
    unit = limits.get("unit", "") if kind in (int, float) else ""
    return " ".join(filter(None, [_WORDS[kind], signs if kind in (int, float) else "", unit]))


Kind = TypeVar("Kind")
FILL_IN = "FILL_IN"
"""What stands in place of a value that only a person knows (``lumbar new-study``)."""
_LONGEST_VALUE = 60
_ANY = object()


def overlay(base: dict, upper: dict) -> dict:
    """Merge as Snakemake does: mappings merge, lists and scalars replace."""
    merged = dict(base)
    for key, value in upper.items():
        below = merged.get(key)
        both = isinstance(below, dict) and isinstance(value, dict)
        merged[key] = overlay(below, value) if both else value
    return merged


class Origins:
    """File and line that a key of a merged configuration comes from, for what is wrong with it; the last file lies on top.

    `merged` is the configuration, if it may hold more than its files: what no file holds was given on the command line.
    """

    def __init__(self, problems: Problems, files: Sequence[YamlFile] = (), merged: dict | None = None):
        self.problems, self.files, self.merged = problems, files, merged

    def add(self, key: str | tuple, found: str, allowed: str) -> None:
        """Note a problem at a key, by its name or the way to it, as of `place`."""
        way = way_of(key) if isinstance(key, str) else key
        self.problems.add(self.place(way), found, allowed)

    def place(self, way: tuple, value: Any = _ANY) -> str:
        """Name file, line and key of a place, as far as the files hold it; else ``--config``, if it was given there.

        Parameters
        ----------
        way : tuple
            Keys and numbers of entries.
        value : object, optional
            What stands there, by default what the merged configuration has: a file that says otherwise is not where it
            comes from.
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
        return name


def _is_merged(way: tuple, value: Any) -> bool:
    """Whether a value is merged key by key from all files: a mapping that is in no list."""
    return isinstance(value, dict) and not any(isinstance(part, int) for part in way)


def _at(content: Any, way: tuple) -> Any:
    for part in way:
        content = content[part]
    return content


@cache
def _adapter(kind: type):
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def validate(content: dict, kind: type[Kind], origins: Origins) -> Kind | None:
    """Return a configuration as settings, with the defaults of all that it leaves out; None if there are problems.

    Parameters
    ----------
    content : dict
        As the files hold it.
    kind : type
        Class of `lumbar.settings`.
    origins : Origins
        Takes every wrong key and value, with file, line, what was found and what is allowed.
    """
    from pydantic import ValidationError

    unfilled = _unfilled(content)
    for way in unfilled:
        origins.add(way, f"{FILL_IN}: still to be filled in", _rule(key_at(kind, way)))
    merged = overlay(_beside(content, _defaults(kind)), content)
    try:
        checked = _adapter(kind).validate_json(json.dumps(merged, default=_as_plain), strict=True)
        return None if unfilled else checked
    except ValidationError as error:
        said: dict[tuple, tuple[str, str]] = dict.fromkeys(unfilled, ("", ""))
        for item in error.errors(include_url=False):
            way, found, allowed_words = _explained(kind, merged, item)
            said.setdefault(way, (found, allowed_words))
        places = {way: origins.place(way, _value(merged, way, _ANY)) for way in said}
        for way, (found, allowed_words) in said.items():
            if any(place[: len(way)] == way for place in unfilled):
                continue
            origins.problems.add(places[way], found, allowed_words)
    return None


def _unfilled(content: Any, way: tuple = ()) -> list[tuple]:
    """Ways to the values that a person has yet to fill in."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        return [found for key, value in items for found in _unfilled(value, (*way, key))]
    return [way] if content == FILL_IN else []


def _as_plain(value: Any) -> Any:
    """Number of NumPy as Python's; anything else that no file can hold as its text, which is refused."""
    return value.item() if hasattr(value, "item") else str(value)


def _defaults(kind: type) -> dict:
    """Every default of a section; nothing for one that has required keys."""
    try:
        return plain(kind())
    except TypeError:
        return {}


def _beside(content: Any, defaults: dict) -> dict:
    """Defaults without the roles of one axis in a layout that names those of several."""
    kept = {
        role: item for role, item in defaults.items() if role not in SIDES or AXIS_ROLES.isdisjoint(content)
    }
    within = [
        name for name, item in kept.items() if isinstance(item, dict) and isinstance(content.get(name), dict)
    ]
    return {**kept, **{name: _beside(content[name], kept[name]) for name in within}}


def _value(content: Any, way: tuple, absent: Any) -> Any:
    try:
        return _at(content, way)
    except (KeyError, IndexError, TypeError):
        return absent


def _explained(kind: type, content: dict, error: dict) -> tuple[tuple, str, str]:
    """Return where an error of Pydantic lies, what was found there, and what is allowed."""
    way, value = [], content
    for part in error["loc"]:
        known = range(len(value)) if isinstance(value, list) else value if isinstance(value, dict) else ()
        if part not in known:
            break
        way.append(part)
        value = value[part]
    where = tuple(way)
    if error["type"] == "unexpected_keyword_argument":
        return where, *_unknown_key(key_at(kind, where[:-1]), where[-1])
    if error["type"] in ("missing", "missing_argument") and len(error["loc"]) == len(way) + 1:
        where = (*where, error["loc"][-1])
        return where, "missing", _rule(key_at(kind, where))
    if error["loc"][-1] == "[key]":
        return where, f"{where[-1]!r} is no name", _rule(key_at(kind, where[:-1]))
    if error["type"] == "value_error":
        return where, str(error["ctx"]["error"]), _rule(key_at(kind, where))
    return (
        where,
        f"found {_shown(value)}{_meant(value, key_at(kind, where))}",
        _rule(key_at(kind, where)) + _number_hint(value, key_at(kind, where)),
    )


def _meant(value: Any, key: KeyType | None) -> str:
    """Of a word that stands for one of few: the one that it is like."""
    words = (
        [word for each in members_of(key.kind) if get_origin(each) is Literal for word in get_args(each)]
        if key
        else []
    )
    return (
        did_you_mean(value, filter(lambda word: isinstance(word, str), words))
        if isinstance(value, str)
        else ""
    )


def _unknown_key(section: KeyType | None, name: str) -> tuple[str, str]:
    known = list(keys_of(section_of(section.kind))) if section and section_of(section.kind) else []
    return f"unknown key{did_you_mean(name, known)}", f"allowed: {', '.join(known)}"


def _rule(key: KeyType | None) -> str:
    if key is None:
        return ""
    return f"allowed: {key.allowed}" + (f" ({key.meaning.rstrip('.')})" if key.meaning else "")


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"


def _number_hint(value: Any, key: KeyType | None) -> str:
    """Tell how to write a number that YAML took for text."""
    if key is None or not isinstance(value, str) or "number" not in key.allowed:
        return ""
    try:
        float(value)
    except ValueError:
        return ""
    return "; write numbers without quotes, powers of ten as 1.0e+6"
