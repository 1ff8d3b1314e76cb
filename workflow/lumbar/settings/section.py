"""A section of a configuration: one field gives type, default, limits, unit and meaning of a key.

>>> from lumbar.settings.tissue import WelchSettings
>>> WelchSettings(overlap=0.75).model_dump(mode="json")
{'segment_s': 10.24, 'overlap': 0.75, 'window': 'hann', 'detrend': 'constant'}
"""

import ast
import inspect
import sys
from collections.abc import Iterable
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from lumbar.base.files import is_device

SEED = 2023
UNITS = {
    **{unit: unit for unit in ("s", "ms", "Hz", "m", "mm", "kg", "N", "rad", "dB")},
    "um": "µm",
    "deg": "°",
    "percent": "%",
    "1_s": "1/s",
    "per_kg": "1/kg",
    "m_s": "m/s",
    "mm_s": "mm/s",
    "rad_s": "rad/s",
    "m_s2": "m/s²",
    "mm_s2": "mm/s²",
    "N_m": "N·m",
    "N_s": "N·s",
    "N_s_m": "N·s/m",
    "N_per_mm": "N/mm",
    "N_per_mm3": "N/mm³",
}
"""Unit of a key by the last words of its name."""

Value = TypeVar("Value")


def _describe_keys(schema: dict[str, Any], section: type["Section"]) -> None:
    """Add unit and meaning of every key to the JSON schema of a section."""
    for name, item in section.model_fields.items():
        key = schema["properties"][item.alias or name]
        if unit := unit_of(name):
            key.setdefault("unit", unit)
        for kind in section.mro():
            if issubclass(kind, Section) and name in kind.__annotations__:
                if meaning := _docstrings(kind.__module__)[kind.__name__].get(name):
                    key["description"] = meaning
                break


class Section(BaseModel):
    """A section of a configuration: other keys and infinite numbers are errors, and no instance changes.

    The docstring below a field is the meaning of its key. The last words of its name give the unit, except if
    ``json_schema_extra={"unit": …}`` names another one.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        defer_build=True,  # most jobs need a few sections only
        serialize_by_alias=True,
        json_schema_extra=_describe_keys,
    )

    def __getattr__(self, name: str) -> Any:
        """Raise for a key that `remove_defaults` removed."""
        if name in type(self).model_fields:
            key = f"{type(self).__name__}.{name}"
            raise TypeError(f"the rule does not pass {key}: name it among the keys that its job needs")
        return super().__getattr__(name)  # type: ignore[misc]


def remove_defaults(value: Value) -> Value:
    """Remove the default of every key that was not given, in place: reading such a key raises a `TypeError`.

    A job gets only some keys of a section. None of the others may enter its result by its default.

    Parameters
    ----------
    value : Section, dict, list, tuple or plain value
        Sections in it, at any depth, lose their defaults.

    Returns
    -------
    The same object.
    """
    entries: Iterable = ()
    if isinstance(value, Section):
        for name in type(value).model_fields.keys() - value.model_fields_set:
            del vars(value)[name]
        entries = vars(value).values()
    elif isinstance(value, dict):
        entries = value.values()
    elif isinstance(value, list | tuple):
        entries = value
    for entry in entries:
        remove_defaults(entry)
    return value


def unit_of(name: str) -> str | None:
    """Return the unit that the last words of a key's name give.

    Parameters
    ----------
    name : str
        Name of a key.

    Examples
    --------
    >>> unit_of("noise_rms_mm"), unit_of("knots")
    ('mm', None)
    """
    parts = name.split("_")
    ends = ("_".join(parts[first:]) for first in range(1, len(parts)))
    return next((UNITS[end] for end in ends if end in UNITS), None)


@cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings below the fields of each class of a module.

    Pydantic could read them itself (``use_attribute_docstrings``), but at every start of every job.
    """
    return {
        item.name: {
            field.target.id: " ".join(str(text.value.value).split())
            for field, text in pairwise(item.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        }
        for item in ast.parse(inspect.getsource(sys.modules[module])).body
        if isinstance(item, ast.ClassDef)
    }


def _reject_repeated(entries: tuple) -> tuple:
    repeated = sorted({str(entry) for entry in entries if entries.count(entry) > 1})
    if repeated:
        raise ValueError(f"{', '.join(repeated)} is repeated")
    return entries


def _reject_device(name: str) -> str:
    """Raise for names of devices: such a file cannot be copied to Windows."""
    if is_device(name):
        raise ValueError(f"{name!r} is a device on Windows, where no file can be called so")
    return name


def _reject_reversed(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] >= ends[1]:
        raise ValueError(f"[{ends[0]:g}, {ends[1]:g}]: the start must be before the end")
    return ends


Entry = TypeVar("Entry")
REJECT_REPEATED = AfterValidator(_reject_repeated)
Unique = Annotated[tuple[Entry, ...], REJECT_REPEATED, Field(json_schema_extra={"uniqueItems": True})]
"""List without repeated entries."""
IN_ORDER = AfterValidator(_reject_reversed)
Interval = Annotated[tuple[float, float], IN_ORDER]
"""Start and end."""
Positive = Annotated[float, Field(gt=0)]
Word = Annotated[str, Field(min_length=1)]
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
"""Names that become folders: a letter or digit, then letters, digits, ``_`` and ``-``."""
FolderName = Annotated[str, Field(pattern=NAME), AfterValidator(_reject_device)]
RecordName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"), AfterValidator(_reject_device)]
"""Names of records, which may hold a point."""
