"""Expressions evaluated by NumPy, in the order in which they are written."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from lumbar.tissue.models.expression import Expression, Number, Operation, Symbol, whole_power

Functions = Mapping[str, Callable]


def _smoothstep(x):
    share = np.clip(x, 0.0, 1.0)
    return share**2 * (3 - 2 * share)


_ALIKE = (
    "abs",
    "sign",
    "sqrt",
    "exp",
    "expm1",
    "tanh",
    "sinh",
    "sin",
    "cos",
    "arctan",
    "hypot",
    "clip",
    "where",
)
"""Operations that NumPy calls so too."""
NUMPY: dict[str, Callable] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,  # of two plain numbers too, where Python would raise
    "**": np.power,
    "neg": operator.neg,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    **{name: getattr(np, name) for name in _ALIKE},
    "softplus": partial(np.logaddexp, 0.0),
    "smoothstep": _smoothstep,
    "min": np.minimum,
    "max": np.maximum,
}
"""NumPy's functions by the names of the operations."""


def _exp(x: float) -> float:
    return math.exp(x) if x < _LARGEST else math.inf


_LARGEST = 700.0
"""Exponent of the largest number."""
MATH: dict[str, Callable] = {
    **{name: NUMPY[name] for name in ("+", "-", "*", "neg", "<", "<=", ">", ">=")},
    "/": lambda x, y: x / y if y else math.nan if x == 0 else math.copysign(math.inf, x),
    "**": math.pow,
    "abs": abs,
    "sign": lambda x: float(x > 0) - float(x < 0),
    "sqrt": math.sqrt,
    "exp": _exp,
    "expm1": lambda x: math.expm1(x) if x < _LARGEST else math.inf,
    "tanh": math.tanh,
    "sinh": lambda x: math.sinh(x) if abs(x) < _LARGEST else math.copysign(math.inf, x),
    "sin": math.sin,
    "cos": math.cos,
    "arctan": math.atan,
    "softplus": lambda x: max(x, 0.0) + math.log1p(math.exp(-abs(x))),
    "smoothstep": lambda x: float(_smoothstep(x)),
    "min": min,
    "max": max,
    "hypot": math.hypot,
    "clip": lambda x, low, high: min(max(x, low), high),
    "where": lambda condition, x, y: x if condition else y,
}
"""The same for plain numbers, one at a time."""


class Evaluator:
    """Several expressions as one list of operations; what they have in common is computed once.

    Expressions are without ``sum``; `functions` are what computes each operation, by its name.

    Examples
    --------
    >>> from lumbar.tissue.models.expression import parse
    >>> Evaluator([parse("z**3"), parse("2*z")])({"z": np.array([1.0, 2.0])})
    [array([1., 8.]), array([2., 4.])]
    """

    def __init__(self, expressions: Sequence[Expression], functions: Functions = NUMPY):
        self._functions = functions
        self._places: dict[Expression, int] = {}
        self._known: list = []
        self._symbols: list[tuple[str, int]] = []
        self._operations: list[tuple[Callable, int, int | None, tuple[int, ...], int]] = []
        self._results = [self._place(expression) for expression in expressions]

    def _place(self, expression: Expression) -> int:
        """Where the value of an expression will stand."""
        if expression in self._places:
            return self._places[expression]
        value: float | None = None
        step: tuple[Callable, list[int]] | None = None
        match expression:
            case Number(value):
                pass
            case Symbol("pi"):
                value = np.pi
            case Operation():
                function, given = self._computed(expression)
                operands = [self._place(operand) for operand in given]
                known = [self._known[operand] for operand in operands]
                if any(item is None for item in known):
                    step = function, operands
                else:  # numbers alone: 2π
                    value = function(*known)
        place = self._places[expression] = len(self._known)
        self._known.append(value)
        if isinstance(expression, Symbol) and value is None:
            self._symbols.append((expression.name, place))
        if step:
            function, (first, *others) = step
            second = others[0] if others else None
            self._operations.append((function, first, second, tuple(others[1:]), place))
        return place

    def _computed(self, expression: Operation) -> tuple[Callable, tuple[Expression, ...]]:
        """Function and its operands; small whole powers are products."""
        if expression.name == "**" and (exponent := whole_power(expression.operands[1])):
            return partial(_product, self._functions["*"], exponent), expression.operands[:1]
        return self._functions[expression.name], expression.operands

    def __call__(self, values: Mapping[str, np.ndarray | float]) -> list[np.ndarray | float]:
        """Return the expressions' values for those of the symbols, one per expression."""
        found = self._known.copy()
        for name, place in self._symbols:
            found[place] = values[name]
        # Spelt out by the number of operands: short records spend as long here as in NumPy.
        for function, first, second, others, place in self._operations:
            if second is None:
                found[place] = function(found[first])
            elif not others:
                found[place] = function(found[first], found[second])
            else:
                found[place] = function(found[first], found[second], *[found[other] for other in others])
        return [found[place] for place in self._results]


def _product(multiply: Callable, exponent: int, base):
    found = base
    for _ in range(exponent - 1):
        found = multiply(found, base)
    return found
