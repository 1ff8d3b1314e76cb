"""The notation of effects and bases: one in a YAML file, as equations, the catalogue's own and a user's alike.

``docs/tissue/own_effect.md`` says what a file holds. Files of the catalogue may name `lumbar.tissue.effects.hooks` besides, which
are code; a user's cannot.
"""

import re
import sys
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from lumbar.base.errors import InputError, Problems
from lumbar.base.yaml_file import YamlFile, way_of
from lumbar.tissue.models.expression import parse
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.parameter import SCALES, Constant, LinearParameter, NonlinearParameter

NAME = re.compile(r"[a-z][a-z0-9_]*")
NAME_RULE = "letters a to z, digits and _, a letter first"
_SIGNS = {"positive": 1, "negative": -1, "any": 0}
_EFFECT_FLAGS = ("accumulates", "unrepeated", "linear", "rate_independent", "rival")
_EFFECT_KEYS = ("name", "mechanism", "source", "experiment", "sensors", *_EFFECT_FLAGS, "forms")
_FORM_KEYS = ("equation", "state", "parameters", "constants", "place", "general", "one_axis", "essential")
BASE_KEYS = ("name", "mechanism", "source", "equation", "state", "parameters", "constants")
_HOOK_KEYS = ("solution", "by_hand", "latex", "starts", "contradiction")
"""Of the catalogue's files alone; ``latex`` stands in place of the equation of a form that is written by hand."""
_STATE_KEYS = ("rate", "start")
_LINEAR_KEYS = ("name", "unit", "latex", "sign")
_NONLINEAR_FLAGS = ("follows_record", "decisive")
_NONLINEAR_KEYS = ("name", "unit", "latex", "start", "scale", "points", "reach", "lines", *_NONLINEAR_FLAGS)


def _key(place: str, key: str) -> str:
    """A key in a part of the file, as messages name it."""
    return f"{place}.{key}".strip(".")


class EffectReader:
    """Reads the parts of an effect's file and notes what is wrong, with key and line."""

    def __init__(self, problems: Problems, file: YamlFile, hooks: Mapping[str, Mapping[str, Any]] = {}):
        self.problems = problems
        self.file = file
        self.hooks = hooks
        self.form_keys = (*_FORM_KEYS, *(_HOOK_KEYS if hooks else ()))

    def effect(self, taken: Collection[str] = ()) -> Effect:
        """The effect of the file, or all that is wrong with it."""
        content = self.file.content
        single = "forms" not in content
        self.keys(content, "", (*_EFFECT_KEYS, *(self.form_keys if single else ())))
        name = self.name(content, "")
        if name in taken:
            self.problem("name", f"{name!r} is taken in the catalogue", "choose another")
        texts = {
            key: self.text(content, key, key == "mechanism")
            for key in ("mechanism", "source", "experiment", "sensors")
        }
        flags = {key: self.flag(content, key) for key in _EFFECT_FLAGS}
        if single:
            given = {key: content[key] for key in self.form_keys if key in content}
            forms = [self.form({**given, "name": "equation"}, "")]
        else:
            forms = self.forms(content["forms"])
        linear = {item.name for form in forms if form for item in form.linear}
        for index, form in enumerate(forms):
            if form and (unknown := [name for name in form.essential if name not in linear]):
                place = "essential" if single else f"forms.{index}.essential"
                self.problem(place, ", ".join(unknown), f"linear parameters are {', '.join(sorted(linear))}")
        self.problems.raise_if_any()
        texts["source"] = texts["source"] or Path(self.file.path).name
        return Effect(name=name, forms=tuple(filter(None, forms)), **texts, **flags)

    def problem(self, place: str, found: str, allowed: str = "") -> None:
        """Note a problem at a key, with its line or that of the key it belongs to."""
        self.problems.add(self.file.place(way_of(place)), found, allowed)

    def mapping(self, value: Any, place: str, needed: str) -> dict:
        """The value if it is a mapping; else an empty one, and a problem."""
        if isinstance(value, dict):
            return value
        self.problem(place, repr(value), needed)
        return {}

    def keys(self, content: dict, place: str, allowed: Collection[str]) -> None:
        """Note keys that are not known."""
        for key in content:
            if key not in allowed:
                self.problem(_key(place, key), "unknown key", f"allowed are {', '.join(allowed)}")

    def text(self, content: dict, key: str, needed: bool, place: str = "") -> str:
        """A text; a problem where it is needed and absent."""
        value = content.get(key, "")
        where = _key(place, key)
        if not isinstance(value, str):
            self.problem(where, repr(value), "a text is needed; put it in quotes")
            return ""
        if needed and not value.strip():
            self.problem(where, "is missing", "a text is needed")
        return " ".join(value.split())

    def flag(self, content: dict, key: str, place: str = "") -> bool:
        """Whether something holds; not where nothing is said."""
        value = content.get(key, False)
        if not isinstance(value, bool):
            self.problem(_key(place, key), repr(value), "true or false")
        return value is True

    def name(self, content: dict, place: str) -> str:
        """A name, as results and C code call it."""
        name = self.text(content, "name", True, place)
        if name and not NAME.fullmatch(name):
            self.problem(_key(place, "name"), repr(name), NAME_RULE)
        return name

    def forms(self, content: Any) -> list[Form | None]:
        """Several forms with names of their own."""
        if not isinstance(content, list) or not content:
            self.problem("forms", repr(content), "a list of forms: name, equation, parameters …")
            return []
        forms = []
        for index, item in enumerate(content):
            place = f"forms.{index}"
            item = self.mapping(item, place, "name, equation, parameters …")
            self.keys(item, place, ("name", *self.form_keys))
            forms.append(self.form(item, place))
            self.name(item, place)
        self.once([str(item.get("name")) for item in content if isinstance(item, dict)], "forms", "form")
        return forms

    def form(self, content: dict, place: str) -> Form | None:
        """One form; None where something is wrong with it."""
        before = len(self.problems.entries)

        at = partial(_key, place)
        state = self.states(content.get("state", {}), at("state"))
        given = self.mapping(content.get("parameters", {}), at("parameters"), "symbol: {name: …, unit: …} …")
        constants = self.mapping(
            content.get("constants", {}), at("constants"), "symbol: {value: …, unit: …} …"
        )
        parameters = [self.parameter(symbol, item, at("parameters")) for symbol, item in given.items()]
        self.once([item.name for item in parameters if item], at("parameters"), "parameter")
        linear = tuple(item for item in parameters if isinstance(item, LinearParameter))
        equation = self.text(content, "latex" if self.by_hand(content) else "equation", True, place)
        rates, starts = (
            tuple((name, said[key]) for name, said in state.items() if said[key]) for key in _STATE_KEYS
        )
        arguments = {
            "place": self.place(content, at("place")),
            "constants": tuple(
                self.constant(symbol, item, at("constants")) for symbol, item in constants.items()
            ),
            "general": self.flag(content, "general", place),
            "one_axis": self.flag(content, "one_axis", place),
            "essential": self.essential(content, at("essential")),
            **self.hooked(content, place),
        }
        if len(self.problems.entries) > before:
            for key, text in (
                ("equation", equation),
                *((f"state.{name}", said) for name, said in rates + starts),
            ):
                self.readable(at(key), text)
            return None
        form = Form(
            name=str(content.get("name")),
            equation=equation,
            state=rates,
            start=starts,
            linear=linear,
            nonlinear=tuple(item for item in parameters if isinstance(item, NonlinearParameter)),
            **arguments,
        )
        if not self.hooks:
            for key, found in form.problems():
                self.problem(at("parameters" if key == "symbol" else key), found)
        return form

    def states(self, content: Any, place: str) -> dict[str, dict[str, str]]:
        """Rate of every state, and its value at the start where that is not 0."""
        found = {}
        for name, said in self.mapping(content, place, 'r: "v/d*(1 - r*sign(v))" …').items():
            where = _key(place, str(name))
            said = said if isinstance(said, dict) else {"rate": said}
            self.keys(said, where, _STATE_KEYS)
            found[str(name)] = {key: self.text(said, key, key == "rate", where) for key in _STATE_KEYS}
        return found

    def by_hand(self, content: dict) -> bool:
        """Whether a form is written by hand, which those of the catalogue alone can be."""
        return bool(self.hooks) and "by_hand" in content

    def place(self, content: dict, place: str) -> Place:
        """Where a form acts; at the input only what is written by hand."""
        where = content.get("place", "parallel")
        if where not in ("parallel", "output", *(("input",) if self.by_hand(content) else ())):
            allowed = "parallel (a force beside the tissue) or output (what is measured of F)"
            self.problem(place, repr(where), allowed)
            where = "parallel"
        return Place(where)

    def essential(self, content: dict, place: str) -> tuple[str, ...]:
        """Names of linear parameters without which the mechanism is not there."""
        value = content.get("essential", [])
        if isinstance(value, list) and all(isinstance(name, str) for name in value):
            return tuple(value)
        self.problem(place, repr(value), "a list of names of linear parameters")
        return ()

    def hooked(self, content: dict, place: str) -> dict[str, Any]:
        """What hooks add to a form of the catalogue."""
        found: dict[str, Any] = {}
        for key, known in self.hooks.items():
            if (name := content.get(key)) in known:
                found[key] = known[name]
            elif name is not None:
                self.problem(_key(place, key), repr(name), f"hooks are {', '.join(known)}")
        if "solution" in found:
            found["solution"], found["c_solution"] = found["solution"]
        if "by_hand" in found:
            found["hand_written"] = found.pop("by_hand")
        return found

    def once(self, names: list[str], place: str, kind: str) -> None:
        """Note names that are there twice."""
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.problem(place, f"{name} is there twice", f"each {kind} needs a name of its own")

    def readable(self, place: str, text: str) -> None:
        """Note an expression that cannot be read, whatever its symbols mean."""
        try:
            parse(text)
        except InputError as error:
            self.problem(place, str(error))

    def parameter(self, symbol: Any, content: Any, place: str) -> LinearParameter | NonlinearParameter | None:
        """One parameter: nonlinear if it has a range of starting values."""
        place = f"{place}.{symbol}"
        content = self.mapping(
            content, place, "name: …, unit: … and, if nonlinear, start: [low, high], scale: …"
        )
        nonlinear = "start" in content or "scale" in content
        self.keys(content, place, _NONLINEAR_KEYS if nonlinear else _LINEAR_KEYS)
        named = {
            "name": self.name(content, place),
            "unit": self.unit(content, place),
            "symbol": str(symbol),
            "latex": self.text(content, "latex", False, place),
        }
        if nonlinear:
            return self.nonlinear(named, content, place)
        sign = content.get("sign", "positive")
        if sign not in _SIGNS:
            self.problem(f"{place}.sign", repr(sign), f"allowed are {', '.join(_SIGNS)}")
        return LinearParameter(**named, sign=_SIGNS.get(sign, 0))

    def unit(self, content: dict, place: str) -> str:
        """A unit in terms of {x} and {y}."""
        unit = self.text(content, "unit", True, place)
        if re.sub(r"\{[xy]\}", "", unit).count("{") or re.sub(r"\{[xy]\}", "", unit).count("}"):
            self.problem(
                f"{place}.unit", repr(unit), "units are those of the input {x} and the output {y}, s, 1 …"
            )
        return unit

    def nonlinear(self, named: dict, content: dict, place: str) -> NonlinearParameter | None:
        """A nonlinear parameter with where its fit begins and how far it may go."""
        before = len(self.problems.entries)
        low, high = self.pair(
            content.get("start"),
            f"{place}.start",
            "two numbers above 0, the lower first",
            lambda a, b: 0 < a <= b,
        )
        reach = self.pair(
            content.get("reach", [0.1, 10.0]),
            f"{place}.reach",
            "how far below and above the fit may go, as factors, e.g. [0.1, 10]",
            lambda a, b: 0 < a <= 1 <= b,
        )
        scale, points = content.get("scale"), content.get("points", 5)
        if scale not in SCALES:
            self.problem(f"{place}.scale", repr(scale), f"allowed are {', '.join(SCALES)}")
        if isinstance(points, bool) or not isinstance(points, int) or not 1 <= points <= 20:
            self.problem(f"{place}.points", repr(points), "a whole number from 1 to 20")
        lines = content.get("lines")
        if lines is not None and not (_is_number(lines) and lines > 0):
            self.problem(f"{place}.lines", repr(lines), "a number above 0 is needed")
        flags = {key: self.flag(content, key, place) for key in _NONLINEAR_FLAGS}
        if len(self.problems.entries) > before:
            return None
        return NonlinearParameter(
            **named, scale=scale, low=low, high=high, points=points, reach=reach, lines=lines, **flags
        )

    def pair(
        self, value: Any, place: str, allowed: str, holds: Callable[[float, float], bool]
    ) -> tuple[float, float]:
        """Two finite numbers of which something holds."""
        if isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)) and holds(*value):
            return float(value[0]), float(value[1])
        self.problem(place, repr(value), allowed)
        return 1.0, 1.0

    def constant(self, symbol: Any, content: Any, place: str) -> Constant:
        """A number that an equation calls by a symbol."""
        place = f"{place}.{symbol}"
        content = self.mapping(content, place, "value: …, unit: …")
        self.keys(content, place, ("value", "unit", "latex", "scale"))
        value, scale = content.get("value"), content.get("scale", "")
        if scale not in ("", *SCALES):
            self.problem(f"{place}.scale", repr(scale), f"allowed are {', '.join(SCALES)}")
        if not _is_number(value):
            self.problem(f"{place}.value", repr(value), "a finite number is needed")
            value = 1.0
        latex = self.text(content, "latex", False, place)
        return Constant(str(symbol), float(value), self.unit(content, place), latex, scale)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
