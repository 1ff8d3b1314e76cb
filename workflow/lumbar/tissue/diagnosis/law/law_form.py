"""The form that is a sum of terms: its equation, the units of its coefficients, and its states solved term by term."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.law.terms import Term
from lumbar.tissue.effects.hooks import modulation_starts
from lumbar.tissue.models.expression import (
    COMPARISONS,
    Expression,
    Number,
    Operation,
    Symbol,
    expand_sums,
    parse,
    symbols,
    to_text,
)
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.parameter import LinearParameter, NonlinearParameter
from lumbar.tissue.models.state_equation import StateEquation

_DIMENSIONLESS_FUNCTIONS = {
    "exp", "expm1", "tanh", "sinh", "sin", "cos", "arctan", "softplus", "smoothstep",
}  # fmt: skip
_FACTOR = re.compile(r"(\{x\}|\{y\}|s|Hz|1|rad)(?:\^(-?\d+(?:\.\d+)?))?")


@dataclass(frozen=True)
class Dimension:
    """Exponents of the input's unit, of the output's and of the second.

    Examples
    --------
    >>> Dimension.of("{y} s/{x}^2").unit
    '{y} s/{x}^2'
    """

    x: float = 0.0
    y: float = 0.0
    s: float = 0.0

    @classmethod
    def of(cls, unit: str) -> Dimension:
        """Read a unit in terms of ``{x}`` and ``{y}``; what follows a stroke divides."""
        found = cls()
        for place, part in enumerate(unit.split("/")):
            for factor in part.split():
                read = _FACTOR.fullmatch(factor)
                if read is None:
                    raise InputError(
                        f"unit {unit!r}: {factor!r} is not known; there are {{x}}, {{y}}, s, Hz, rad, 1"
                    )
                exponent = float(read[2] or 1) * (-1 if place else 1) * (-1 if read[1] == "Hz" else 1)
                found = found * cls(**{_AXIS[read[1]]: exponent}) if read[1] in _AXIS else found
        return found

    @property
    def unit(self) -> str:
        """The unit in terms of ``{x}`` and ``{y}``."""
        parts = [("{y}", self.y), ("s", self.s), ("{x}", self.x)]
        above = " ".join(_raised(name, size) for name, size in parts if size > 0) or "1"
        return "/".join([above, *(_raised(name, -size) for name, size in reversed(parts) if size < 0)])

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(self.x + other.x, self.y + other.y, self.s + other.s)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, exponent: float) -> Dimension:
        return Dimension(self.x * exponent, self.y * exponent, self.s * exponent)


_AXIS = {"{x}": "x", "{y}": "y", "s": "s", "Hz": "s"}
ONE, POSITION, FORCE, TIME = Dimension(), Dimension(x=1), Dimension(y=1), Dimension(s=1)
SPEED = POSITION / TIME
OF_SIGNALS = {
    "z": POSITION,
    "v": SPEED,
    "a": SPEED / TIME,
    "dz": POSITION,
    "s": POSITION,
    "t": TIME,
    "F": FORCE,
    "pi": ONE,
}
"""Dimensions of the signals that an equation of a tissue knows."""


def _raised(name: str, size: float) -> str:
    return name if size == 1 else f"{name}^{size:g}"


def dimension(expression: Expression, known: Mapping[str, Dimension]) -> Dimension | None:
    """Dimension of an expression, by those of every symbol in it; None of a bare 0, which has any.

    Raises
    ------
    InputError
        Where unlike things are added or compared, or a function is given what has a unit.

    Examples
    --------
    >>> from lumbar.tissue.models.expression import parse
    >>> dimension(parse("k*z + b*v"), {**OF_SIGNALS, "k": FORCE / POSITION, "b": FORCE / SPEED}).unit
    '{y}'
    """
    return _of(expand_sums(expression), known)


def _of(expression: Expression, known: Mapping[str, Dimension]) -> Dimension | None:
    match expression:
        case Number(value):
            return None if value == 0 else ONE
        case Symbol(name):
            return known[name]
        case Operation("*", (left, right)):
            return (_of(left, known) or ONE) * (_of(right, known) or ONE)
        case Operation("/", (above, below)):
            return (_of(above, known) or ONE) / (_of(below, known) or ONE)
        case Operation("**", (base, Number(exponent))):
            return (_of(base, known) or ONE) ** exponent
        case Operation("**", operands):
            if any((_of(operand, known) or ONE) != ONE for operand in operands):
                raise InputError(f"{to_text(expression)}: base and exponent must be numbers without a unit")
            return ONE
        case Operation("neg" | "abs", (operand,)):
            return _of(operand, known)
        case Operation("sign", _):
            return ONE
        case Operation("sqrt", (operand,)):
            return (_of(operand, known) or ONE) ** 0.5
        case Operation("where", (condition, yes, no)):
            _alike(condition, condition.operands, known)
            return _alike(expression, (yes, no), known)
        case Operation(name, operands) if name in _DIMENSIONLESS_FUNCTIONS:
            if (_of(operands[0], known) or ONE) != ONE:
                raise InputError(
                    f"{to_text(expression)}: {to_text(operands[0])} has a unit; divide by a scale"
                )
            return ONE
        case Operation(name, operands) if name not in COMPARISONS:
            return _alike(expression, operands, known)
    raise InputError(f"{to_text(expression)} has no dimension")


def _alike(whole: Expression, operands, known: Mapping[str, Dimension]) -> Dimension | None:
    """The dimension that all operands have."""

    def same(left: Dimension | None, right: Dimension | None) -> Dimension | None:
        if left is None or right is None or left == right:
            return left or right
        raise InputError(f"{to_text(whole)}: {left.unit} and {right.unit} do not go together")

    return reduce(same, (_of(operand, known) for operand in operands))


_KINDS = {"{y}": ("F", "force"), "{y}/{x}": ("k", "stiffness"), "{y} s/{x}": ("b", "damping")}


def dimensions_in(term: Term) -> dict[str, Dimension]:
    """Dimensions of all symbols of a term; those of states follow from their rates of change."""
    known = {
        **OF_SIGNALS,
        **{item.symbol: Dimension.of(item.unit) for item in (*term.nonlinear, *term.constants)},
    }
    return {**known, **{name: _STATE_DIMENSIONS[name[0]] for name, _ in term.state}}


_STATE_DIMENSIONS = {
    "q": Dimension(x=1), "u": Dimension(x=1), "m": Dimension(x=1), "r": Dimension(), "l": Dimension(), "b": Dimension(),
}  # fmt: skip
"""By the first letter of a state's symbol."""


def distinct(terms: tuple[Term, ...], shared: bool = False) -> tuple[Term, ...]:
    """Rename symbols that several terms use with different meanings.

    With `shared`, parameters that mean the same, and states that follow the same equation, may be one.
    """
    used: dict[str, str] = {}
    found = []
    for term in terms:
        own = {item.symbol: item.name for item in term.nonlinear} | dict(term.state)
        names = {}
        for symbol, meaning in own.items():
            names[symbol], number = symbol, 2
            while names[symbol] in used and not (shared and used[names[symbol]] == meaning):
                names[symbol] = (
                    f"{symbol}{number}" if "_" in symbol or symbol == "q" else f"{symbol}_{number}"
                )
                number += 1
        used |= {names[symbol]: meaning for symbol, meaning in own.items()}
        found.append(term.rename({old: new for old, new in names.items() if old != new}))
    return tuple(found)


def symbols_of(terms: tuple[Term, ...], shared: bool = False) -> list[str]:
    """Symbols of the nonlinear parameters of `distinct` terms, each once."""
    return list(dict.fromkeys(item.symbol for term in distinct(terms, shared) for item in term.nonlinear))


def form_of(
    terms: tuple[Term, ...], effect: str = "", signs: tuple[int, ...] | None = None, shared: bool = False
) -> Form:
    """One form that is the sum of terms; a term at the output stands alone.

    Parameters
    ----------
    effect : str
        Name of the effect; default those of the terms, because motions remember forces by name.
    signs : tuple of int, optional
        Of the linear parameters; default any.
    shared : bool
        As for `distinct`.
    """
    effect = effect or "+".join(term.name for term in terms) + shared * " shared"
    terms = distinct(terms, shared)
    parts = [(part, term) for term in terms for part in term.parts]
    at_output = terms[0].place is Place.OUTPUT
    linear, summands = [], []
    for index, (part, term) in enumerate(parts if not at_output else []):
        tree = parse(part)
        # Unit of what the part is multiplied by to give a force; raises if the part is dimensionally invalid.
        unit = (FORCE / (dimension(tree, dimensions_in(term)) or ONE)).unit
        letter, word = _KINDS.get(unit, ("c", "coefficient"))
        number = "" if len(parts) == 1 else f"_{index + 1}"
        sign = 0 if signs is None else signs[index]
        linear.append(LinearParameter(word + number, unit, sign, symbol=f"{letter}{number or '_1'}"))
        factor = f"({part})" if isinstance(tree, Operation) and tree.name in ("+", "-") else part
        summands.append(linear[-1].symbol if part == "1" else f"{linear[-1].symbol}*{factor}")
    equation = parts[0][0] if at_output else " + ".join(summands)
    nonlinear = _uniquely_named(
        list({item.symbol: item for term in terms for item in term.nonlinear}.values())
    )
    constants = tuple(dict.fromkeys(item for term in terms for item in term.constants))
    return Form(
        name="equation",
        equation=equation,
        place=terms[0].place,
        linear=tuple(linear),
        nonlinear=nonlinear,
        state=tuple(dict.fromkeys(entry for term in terms for entry in term.state)),
        constants=constants,
        starts=_gain_starts(terms[0]) if terms[0].name == "gain_cycle" else None,
        solution=_solution(terms, nonlinear) if any(term.state for term in terms) else None,
        effect=effect,
    )


def _solution(terms: tuple[Term, ...], nonlinear: tuple[NonlinearParameter, ...]):
    """Solve states term by term, again only if a term's parameters change: a fit changes one at a time."""
    place = {item.symbol: index for index, item in enumerate(nonlinear)}
    solved = []
    for term in filter(lambda item: item.state, terms):
        equation = StateEquation({name: parse(rate) for name, rate in term.state})
        used = set().union(*map(symbols, equation.slopes.values()))
        constants = {item.symbol: item.value for item in term.constants}
        solved.append((str(term.state), equation, sorted(used & place.keys()), constants))

    def solution(motion: Motion, values: np.ndarray) -> tuple[np.ndarray, ...]:
        found: dict[str, np.ndarray] = {}
        for key, equation, own, constants in solved:
            given = {symbol: float(values[place[symbol]]) for symbol in own}
            solve = partial(equation.trajectory, motion, {**given, **constants})
            # A largest distance so far has no parameter, and is solved step by step.
            states = (
                motion.cache.compute_at(key, np.array(list(given.values())), solve)
                if given
                else motion.cache.compute_once(key, solve)
            )
            found |= states
        return tuple(found.values())

    return solution


def _uniquely_named(parameters: list[NonlinearParameter]) -> tuple[NonlinearParameter, ...]:
    names = [item.name for item in parameters]
    return tuple(
        item
        if names.count(item.name) == 1
        else replace(item, name=f"{item.name}_{names[: index + 1].count(item.name)}")
        for index, item in enumerate(parameters)
    )


def _gain_starts(term: Term):
    """Return starting values of a gain that changes periodically, from residual and position."""
    share, _, phase = term.nonlinear

    def starts(motion, residual):
        frequencies = [float(found[0]) for found in modulation_starts(motion, residual, [motion.position])]
        return [
            np.array([size, value, angle])
            for value in frequencies
            for size in share.grid(1.0)[:1]
            for angle in phase.grid(1.0)
        ]

    return starts
