"""Settings as plain data, as YAML, JSON and the parameters of a job hold them, and back."""

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from itertools import repeat
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

Kind = TypeVar("Kind")


def name_of(item: Field) -> str:
    """Return a key's name in a configuration: Python's, unless that is a word Python keeps to itself."""
    return item.metadata.get("alias", item.name)


def plain(settings: Any) -> Any:
    """Return settings as nested dicts and lists, every default written out."""
    if is_dataclass(settings):
        return {name_of(item): plain(getattr(settings, item.name)) for item in fields(settings)}
    if isinstance(settings, Mapping):
        return {name: plain(value) for name, value in settings.items()}
    return [plain(value) for value in settings] if isinstance(settings, list | tuple) else settings


def part(settings: Any, *keys: str) -> dict[str, Any]:
    """Return some keys of settings as `plain` does all: what a job needs of them. ``a.b`` is the key b of the section a.

    Examples
    --------
    >>> from lumbar.settings.stability import StabilitySettings
    >>> part(StabilitySettings(), "goal_level", "pendulum.mass", "pendulum.time")
    {'goal_level': 1.0, 'pendulum': {'mass': 'with_box', 'time': 'real'}}
    """
    values = {name_of(item): getattr(settings, item.name) for item in fields(settings)}
    inner: dict[str, list[str]] = {}
    for key in keys:
        first, _, rest = key.partition(".")
        inner.setdefault(first, []).append(rest)
    return {
        name: plain(values[name]) if "" in rest or values[name] is None else part(values[name], *rest)
        for name, rest in inner.items()
    }


class NotPassed:
    """Stands for a key that a job was not given: reading it is an error, so that no default slips into a result."""

    def __init__(self, key: str):
        self.key = key

    def _refuse(self, *_):
        raise TypeError(f"the rule does not pass {self.key}: name it among the keys that its job needs")

    def __getattr__(self, name: str):
        if name.startswith("__"):  # asked for by copying and pickling
            raise AttributeError(name)
        self._refuse()

    __bool__ = __len__ = __iter__ = __getitem__ = __contains__ = __call__ = _refuse
    __float__ = __int__ = __index__ = __str__ = __eq__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __hash__ = object.__hash__


def from_plain(kind: type[Kind], content: Any, complete: bool = True) -> Kind:
    """Return plain data that were validated before as the settings they are.

    Parameters
    ----------
    kind : type
        Class of `lumbar.settings`.
    content : dict
        As of `plain` or `part`; keys may be left out.
    complete : bool
        Whether what is left out has its default; else it is `NotPassed`, as in a job.

    Examples
    --------
    >>> from lumbar.settings.stability import StabilitySettings
    >>> from_plain(StabilitySettings, {"pendulum": {"mass": "without_box"}}).pendulum.mass
    'without_box'
    """
    return _typed(kind, content, complete)


@cache
def types_of(kind: type) -> dict[str, Any]:
    """Type of every field of a section, with its limits (``Annotated``)."""
    return get_type_hints(kind, include_extras=True)


def _typed(kind: Any, content: Any, complete: bool) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _typed(arguments[0], content, complete)
    if origin in (Union, UnionType):
        return _typed(_member(members_of(kind), content), content, complete)
    if isinstance(kind, type) and is_dataclass(kind):
        types = types_of(kind)
        given = {item.name: name_of(item) for item in fields(kind) if name_of(item) in content}
        values = {name: _typed(types[name], content[key], complete) for name, key in given.items()}
        if not complete:
            rest = [item for item in fields(kind) if item.name not in given]
            values |= {item.name: NotPassed(f"{kind.__name__}.{name_of(item)}") for item in rest}
        return kind(**values)
    if origin is tuple:
        entries = repeat(arguments[0]) if arguments[-1] is Ellipsis else arguments
        return tuple(_typed(entry, value, complete) for entry, value in zip(entries, content, strict=False))
    if origin is dict:
        return {name: _typed(arguments[1], value, complete) for name, value in content.items()}
    return float(content) if kind is float else content


def members_of(kind: Any) -> list:
    """Members of a union, or the type itself, without ``Annotated``."""
    if get_origin(kind) is Annotated:
        return members_of(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [inner for member in get_args(kind) for inner in members_of(member)]
    return [kind]


def _member(kinds: list, content: Any) -> Any:
    """Return the one of some types that the content is of."""
    if isinstance(content, Mapping):
        return next(kind for kind in kinds if is_dataclass(kind) and _fills(kind, content))
    if isinstance(content, list | tuple):
        return next(kind for kind in kinds if get_origin(kind) is tuple)
    if type(content) in kinds and not is_dataclass(content):
        return type(content)
    return float if float in kinds else NoneType


def _fills(kind: Any, content: Mapping) -> bool:
    names = {name_of(item) for item in fields(kind)}
    needed = {
        name_of(item) for item in fields(kind) if item.default is MISSING and item.default_factory is MISSING
    }
    return needed <= set(content) <= names
