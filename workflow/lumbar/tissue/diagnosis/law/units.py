"""Dimensions of expressions: whether an equation adds only what can be added, and the unit of what it gives."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce

from lumbar.base.errors import InputError
from lumbar.tissue.models.expression import (
    COMPARISONS,
    Expression,
    Number,
    Operation,
    Symbol,
    expanded,
    written,
)
from lumbar.tissue.models.parameter import Parameter

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
        """Read a unit in terms of ``{x}`` and ``{y}``; what follows a stroke divides.

        Raises
        ------
        InputError
            If a factor is not known.
        """
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


def dimensions_of(parameters: tuple[Parameter, ...]) -> dict[str, Dimension]:
    """Dimensions of parameters by symbol."""
    return {item.symbol: Dimension.of(item.unit) for item in parameters}


def dimension(expression: Expression, known: Mapping[str, Dimension]) -> Dimension | None:
    """Dimension of an expression; None of a bare 0, which has any.

    Parameters
    ----------
    known : mapping of str to Dimension
        Of every symbol in it.

    Raises
    ------
    InputError
        Where unlike things are added or compared, or a function is given what has a unit.

    Examples
    --------
    >>> from lumbar.tissue.models.parsing import parse
    >>> dimension(parse("k*z + b*v"), {**OF_SIGNALS, "k": FORCE / POSITION, "b": FORCE / SPEED}).unit
    '{y}'
    """
    return _of(expanded(expression), known)


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
        case Operation("**", (base, exponent)):
            return _of_power(expression, _of(base, known), exponent, known)
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
                    f"{written(expression)}: {written(operands[0])} has a unit; divide by a scale"
                )
            return ONE
        case Operation(name, operands) if name not in COMPARISONS:
            return _alike(expression, operands, known)
    raise InputError(f"{written(expression)} has no dimension")


def _of_power(power: Expression, base: Dimension | None, exponent: Expression, known) -> Dimension:
    if isinstance(exponent, Number):
        return (base or ONE) ** exponent.value
    if (base or ONE) != ONE or (_of(exponent, known) or ONE) != ONE:
        raise InputError(f"{written(power)}: base and exponent must be numbers without a unit")
    return ONE


def _alike(whole: Expression, operands, known: Mapping[str, Dimension]) -> Dimension | None:
    """The dimension that all operands have."""

    def same(left: Dimension | None, right: Dimension | None) -> Dimension | None:
        if left is None or right is None or left == right:
            return left or right
        raise InputError(f"{written(whole)}: {left.unit} and {right.unit} do not go together")

    return reduce(same, (_of(operand, known) for operand in operands))
