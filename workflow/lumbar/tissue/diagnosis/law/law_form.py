"""Form of a sum of terms: its equation, the units of its coefficients, and its states, solved term by term."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

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
    "**", "sign", "exp", "expm1", "tanh", "sinh", "sin", "cos", "arctan", "softplus", "smoothstep",
}  # fmt: skip
_FACTOR = re.compile(r"(\{x\}|\{y\}|s|Hz|1|rad)(?:\^(-?\d+(?:\.\d+)?))?")


@dataclass(frozen=True)
class Dimension:
    """Exponents of three units in a unit: unit of the input, unit of the output, second.

    Examples
    --------
    >>> Dimension.parse("{y} s/{x}^2").unit
    '{y} s/{x}^2'
    """

    x: float = 0.0
    y: float = 0.0
    s: float = 0.0

    @classmethod
    def parse(cls, unit: str) -> Dimension:
        """Read a unit in terms of ``{x}`` and ``{y}``; factors after a slash divide."""
        dimension = cls()
        for place, part in enumerate(unit.split("/")):
            for factor in part.split():
                read = _FACTOR.fullmatch(factor)
                if read is None:
                    raise InputError(
                        f"unit {unit!r}: {factor!r} is not known; there are {{x}}, {{y}}, s, Hz, rad, 1"
                    )
                exponent = float(read[2] or 1) * (-1 if place else 1) * (-1 if read[1] == "Hz" else 1)
                if read[1] in _AXIS:
                    dimension *= cls(**{_AXIS[read[1]]: exponent})
        return dimension

    @property
    def unit(self) -> str:
        """The unit in terms of ``{x}`` and ``{y}``."""
        parts = [("{y}", self.y), ("s", self.s), ("{x}", self.x)]
        powers = {name: name if abs(size) == 1 else f"{name}^{abs(size):g}" for name, size in parts}
        above = " ".join(powers[name] for name, size in parts if size > 0) or "1"
        return "/".join([above, *(powers[name] for name, size in reversed(parts) if size < 0)])

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(self.x + other.x, self.y + other.y, self.s + other.s)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, exponent: float) -> Dimension:
        return Dimension(self.x * exponent, self.y * exponent, self.s * exponent)


_AXIS = {"{x}": "x", "{y}": "y", "s": "s", "Hz": "s"}
ONE, POSITION, FORCE, TIME = Dimension(), Dimension(x=1), Dimension(y=1), Dimension(s=1)
SPEED = POSITION / TIME
OF_SIGNALS = dict.fromkeys(("z", "dz", "s"), POSITION) | {"v": SPEED, "a": SPEED / TIME}
OF_SIGNALS |= {"t": TIME, "F": FORCE, "pi": ONE}
"""Dimensions of the signals that may appear in the equation of a tissue."""


def dimension(expression: Expression, known: Mapping[str, Dimension]) -> Dimension | None:
    """Return the dimension of an expression from the dimensions of its symbols; None for the number 0, which has any dimension.

    Raises
    ------
    InputError
        If different dimensions are added or compared, or the argument of a function has a unit.

    Examples
    --------
    >>> from lumbar.tissue.models.expression import parse
    >>> dimension(parse("k*z + b*v"), {**OF_SIGNALS, "k": FORCE / POSITION, "b": FORCE / SPEED}).unit
    '{y}'
    """
    return _expanded_dimension(expand_sums(expression), known)


def _expanded_dimension(expression: Expression, known: Mapping[str, Dimension]) -> Dimension | None:
    match expression:
        case Number(value):
            return None if value == 0 else ONE
        case Symbol(name):
            return known[name]
        case Operation("*" | "/" as name, (left, right)):
            return _factor(left, known) * _factor(right, known) ** (1 if name == "*" else -1)
        case Operation("**", (base, Number(exponent))):
            return _factor(base, known) ** exponent
        case Operation("sqrt", (base,)):
            return _factor(base, known) ** 0.5
        case Operation("where", (condition, yes, no)):
            _common_dimension(condition, condition.operands, known)
            return _common_dimension(expression, (yes, no), known)
        case Operation(name, operands) if name in _DIMENSIONLESS_FUNCTIONS:
            checked = {"**": operands, "sign": ()}.get(name, operands[:1])
            if units := [to_text(operand) for operand in checked if _factor(operand, known) != ONE]:
                raise InputError(
                    f"{to_text(expression)}: {' and '.join(units)} has a unit; divide by a scale"
                )
            return ONE
        case Operation(name, operands) if name not in COMPARISONS:
            return _common_dimension(expression, operands, known)
    raise InputError(f"{to_text(expression)} has no dimension")


def _factor(expression: Expression, known: Mapping[str, Dimension]) -> Dimension:
    return _expanded_dimension(expression, known) or ONE


def _common_dimension(whole: Expression, operands, known: Mapping[str, Dimension]) -> Dimension | None:
    dimensions = [_expanded_dimension(operand, known) for operand in operands]
    different = list(dict.fromkeys(item for item in dimensions if item is not None))
    if len(different) > 1:
        units = " and ".join(item.unit for item in different)
        raise InputError(f"{to_text(whole)}: {units} do not go together")
    return different[0] if different else None


_KINDS = {"{y}": ("F", "force"), "{y}/{x}": ("k", "stiffness"), "{y} s/{x}": ("b", "damping")}


def distinct(terms: tuple[Term, ...], shared: bool = False) -> tuple[Term, ...]:
    """Rename symbols with several meanings; if `shared`, terms may share parameters of one meaning and states of one equation."""
    used: dict[str, str] = {}
    renamed = []
    for term in terms:
        meanings = {item.symbol: item.name for item in term.nonlinear} | dict(term.state)
        names = {}
        for symbol, meaning in meanings.items():
            names[symbol], number = symbol, 2
            while names[symbol] in used and not (shared and used[names[symbol]] == meaning):
                stroke = "" if "_" in symbol or symbol == "q" else "_"
                names[symbol] = f"{symbol}{stroke}{number}"
                number += 1
        used |= {names[symbol]: meaning for symbol, meaning in meanings.items()}
        renamed.append(term.rename({old: new for old, new in names.items() if old != new}))
    return tuple(renamed)


def symbols_of(terms: tuple[Term, ...], shared: bool = False) -> list[str]:
    """Return the symbols of the nonlinear parameters of `distinct` terms, without repetition."""
    return list(dict.fromkeys(item.symbol for term in distinct(terms, shared) for item in term.nonlinear))


def form_of(
    terms: tuple[Term, ...], effect: str = "", signs: tuple[int, ...] | None = None, shared: bool = False
) -> Form:
    """Return the form that is the sum of terms, or a single term at the output.

    Parameters
    ----------
    terms : tuple of Term
        Summands.
    effect : str
        Name of the effect; default the names of the terms, because motions cache forces by name.
    signs : tuple of int, optional
        Signs of the linear parameters; default any.
    shared : bool
        See `distinct`.

    Returns
    -------
    Form
    """
    effect = effect or "+".join(term.name for term in terms) + shared * " shared"
    terms = distinct(terms, shared)
    parts = [(part, term) for term in terms for part in term.parts]
    at_output = terms[0].place is Place.OUTPUT
    linear, summands = [], []
    for index, (part, term) in enumerate(parts if not at_output else []):
        tree, parameters = parse(part), (*term.nonlinear, *term.constants)
        known = OF_SIGNALS | {item.symbol: Dimension.parse(item.unit) for item in parameters}
        # The dimensions of states follow from their first letters.
        known |= {name: POSITION if name[0] in "qum" else ONE for name, _ in term.state}
        # Unit of what the part is multiplied by to give a force; raises if the part is dimensionally invalid.
        unit = (FORCE / (dimension(tree, known) or ONE)).unit
        letter, word = _KINDS.get(unit, ("c", "coefficient"))
        number = "" if len(parts) == 1 else f"_{index + 1}"
        sign = 0 if signs is None else signs[index]
        linear.append(LinearParameter(word + number, unit, sign, symbol=f"{letter}{number or '_1'}"))
        factor = f"({part})" if isinstance(tree, Operation) and tree.name in ("+", "-") else part
        summands.append(linear[-1].symbol if part == "1" else f"{linear[-1].symbol}*{factor}")
    equation = parts[0][0] if at_output else " + ".join(summands)
    nonlinear = list({item.symbol: item for term in terms for item in term.nonlinear}.values())
    names = [item.name for item in nonlinear]
    for index, item in enumerate(nonlinear):
        if names.count(item.name) > 1:
            number = names[: index + 1].count(item.name)
            nonlinear[index] = replace(item, name=f"{item.name}_{number}")
    constants = tuple(dict.fromkeys(item for term in terms for item in term.constants))
    return Form(
        name="equation",
        equation=equation,
        place=terms[0].place,
        linear=tuple(linear),
        nonlinear=tuple(nonlinear),
        state=tuple(dict.fromkeys(entry for term in terms for entry in term.state)),
        constants=constants,
        starts=_gain_starts(terms[0]) if terms[0].name == "gain_cycle" else None,
        solution=_solution(terms, nonlinear) if any(term.state for term in terms) else None,
        effect=effect,
    )


def _solution(terms: tuple[Term, ...], nonlinear: list[NonlinearParameter]):
    """Return a function that solves the states of every term.

    A term is solved again only if its parameters changed, because a fit changes one parameter at a time.
    """
    place = {item.symbol: index for index, item in enumerate(nonlinear)}
    solved = []
    for term in filter(lambda item: item.state, terms):
        equation = StateEquation({name: parse(rate) for name, rate in term.state})
        used = set().union(*map(symbols, equation.slopes.values()))
        constants = {item.symbol: item.value for item in term.constants}
        solved.append((str(term.state), equation, sorted(used & place.keys()), constants))

    def solution(motion: Motion, values: np.ndarray) -> tuple[np.ndarray, ...]:
        trajectories: dict[str, np.ndarray] = {}
        for key, equation, needed, constants in solved:
            given = {symbol: float(values[place[symbol]]) for symbol in needed}
            solve = partial(equation.trajectory, motion, {**given, **constants})
            # A largest distance so far has no parameter, and is solved step by step.
            states = (
                motion.cache.compute_at(key, np.array(list(given.values())), solve)
                if given
                else motion.cache.compute_once(key, solve)
            )
            trajectories |= states
        return tuple(trajectories.values())

    return solution


def _gain_starts(term: Term):
    """Return starting values of a gain that changes periodically, from residual and position."""
    share, _, phase = term.nonlinear

    def starts(motion, residual):
        frequencies = [float(item[0]) for item in modulation_starts(motion, residual, [motion.position])]
        return [
            np.array([size, value, angle])
            for value in frequencies
            for size in share.grid(1.0)[:1]
            for angle in phase.grid(1.0)
        ]

    return starts
