"""One key of a configuration: its type, default, unit and limits; its meaning stands in the YAML file beside its module.

Settings are plain frozen dataclasses, so that a job that only takes them starts without Pydantic. The metadata of
their fields are arguments of ``pydantic.Field``: `lumbar.study` validates configurations with them, and writes the
reference pages and the JSON schema from them.
"""

import sys
from collections.abc import Callable
from dataclasses import Field, dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, TypeVar, dataclass_transform

from lumbar.base.files import is_device
from lumbar.base.yaml_file import shipped_yaml

SEED = 2023
UNITS: dict[str, str] = shipped_yaml(Path(__file__).parent / "labels" / "units.yaml")
"""Of a key's value, by the words in which the key's name ends."""

Kind = TypeVar("Kind")


def required(*, unit: str | None = None, within: str = "", **limits) -> Any:
    """Return a key that has no default; parameters as of `key`."""
    extra = {"json_schema_extra": {"unit": unit}} if unit else {}
    return field(metadata={**extra, **_ends(within), **limits})


def _ends(interval: str) -> dict[str, int | float]:
    """Limits of an interval such as ``"(0, 1]"``, by their names in Pydantic."""
    if not interval:
        return {}
    low, high = (float(end) if set(end) & set(".e") else int(end) for end in interval[1:-1].split(", "))
    return {"ge" if interval[0] == "[" else "gt": low, "le" if interval[-1] == "]" else "lt": high}


def key(*, default: Any, unit: str | None = None, within: str = "", **limits) -> Any:
    """Return a key of a section.

    Parameters
    ----------
    default : object
        What holds where a configuration says nothing. By its name type checkers know that the key may be left out.
    unit : str, optional
        Of the value; default what the key's name ends in, by `UNITS`.
    within : str
        Interval of its limits, e.g. ``"(0, 1]"``.
    **limits
        Other constraints of ``pydantic.Field``: ``ge`` or ``gt`` alone, ``pattern``, ``min_length``, …
    """
    metadata = required(unit=unit, within=within, **limits).metadata
    if isinstance(default, dict):
        return field(default_factory=lambda: dict(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def section(*, default_factory: type, **values) -> Any:
    """Return a key that holds a section of its own, by default the class with `values`; its meaning is the class's."""
    return field(
        default_factory=lambda: default_factory(**values),
        metadata={"description": (default_factory.__doc__ or "").strip()},
    )


@dataclass_transform(frozen_default=True, field_specifiers=(key, required, section))
def settings(kind: type[Kind]) -> type[Kind]:
    """Make a class a section of the configuration: frozen, no other keys, no infinite numbers.

    One or two sentences per key, for the reference and for error messages, stand under the class's name in the YAML file
    of the module's name beside it.
    """
    for name, item in vars(kind).items():
        if not isinstance(item, Field):
            continue
        facts: dict[str, Any] = {}
        if unit := _unit_in(name):
            facts["json_schema_extra"] = {"unit": unit}
        if "description" not in item.metadata:
            facts["description"] = _meanings(kind.__module__)[kind.__name__][name]
        item.metadata = MappingProxyType({**facts, **item.metadata})
    kind.__pydantic_config__ = {"extra": "forbid", "allow_inf_nan": False}  # type: ignore[attr-defined]
    return dataclass(frozen=True)(kind)


@cache
def _meanings(module: str) -> dict[str, dict[str, str]]:
    """What the keys of a module's sections mean."""
    return shipped_yaml(Path(str(sys.modules[module].__file__)).with_suffix(".yaml"))


def _unit_in(name: str) -> str | None:
    words = name.split("_")
    ends = ("_".join(words[first:]) for first in range(1, len(words)))
    return next((UNITS[end] for end in ends if end in UNITS), None)


class Each:
    """Limits of every entry of a list, for ``Annotated``: what `key` is for a whole value."""

    def __init__(self, **limits):
        self.limits = limits

    def __get_pydantic_core_schema__(self, kind, handler):
        return {**handler(kind), **self.limits}


class Checked:
    """A value that a function checks, for ``Annotated``; the rest goes into its JSON schema."""

    def __init__(self, check: Callable[[Any], Any], **schema):
        self.check, self.schema = check, schema

    def __get_pydantic_core_schema__(self, kind, handler):
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self.check, handler(kind))

    def __get_pydantic_json_schema__(self, schema, handler):
        return {**handler(schema), **self.schema}


def _each_once(entries: tuple) -> tuple:
    twice = sorted({str(entry) for entry in entries if entries.count(entry) > 1})
    if twice:
        raise ValueError(f"{', '.join(twice)} stands twice")
    return entries


def _no_device(name: str) -> str:
    """Refuse names of devices: files of that name cannot be copied to Windows."""
    if is_device(name):
        raise ValueError(f"{name!r} is a device on Windows, where no file can be called so")
    return name


UNIQUE, NO_DEVICE = Checked(_each_once, uniqueItems=True), Checked(_no_device)
Positive = Annotated[float, Each(gt=0)]
Word = Annotated[str, Each(min_length=1)]
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
"""Names that become folders: a letter or digit, then letters, digits, ``_`` and ``-``."""
FolderName = Annotated[str, Each(pattern=NAME), NO_DEVICE]
RecordName = Annotated[str, Each(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"), NO_DEVICE]
"""Names of records, which may hold a point."""
