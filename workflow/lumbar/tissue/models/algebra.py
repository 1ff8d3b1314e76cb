"""Values of expressions, computed by NumPy in the written order; derivatives and linear parts of expressions."""

import math
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial, reduce
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.expression import (
    ONE,
    OPERANDS,
    ZERO,
    Expression,
    Number,
    Operation,
    Symbol,
    parse,
    parts,
    substitute,
    symbols,
    to_text,
    whole_power,
)


def _smoothstep(x):
    share = np.clip(x, 0.0, 1.0)
    return share**2 * (3 - 2 * share)


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
    **{name: getattr(np, name) for name in OPERANDS if hasattr(np, name)},
    "softplus": partial(np.logaddexp, 0.0),
    "smoothstep": _smoothstep,
    "min": np.minimum,
    "max": np.maximum,
}
"""NumPy's functions by the names of the operations."""


_MAX_EXPONENT = 700.0  # of the largest number
MATH: dict[str, Callable] = {
    **{name: NUMPY[name] for name in ("+", "-", "*", "neg", "<", "<=", ">", ">=")},
    **{name: getattr(math, name) for name in ("sqrt", "tanh", "sin", "cos", "hypot")},
    "/": lambda x, y: x / y if y else math.nan if x == 0 else math.copysign(math.inf, x),
    "**": math.pow,
    "abs": abs,
    "sign": lambda x: float(x > 0) - float(x < 0),
    "exp": lambda x: math.exp(x) if x < _MAX_EXPONENT else math.inf,
    "expm1": lambda x: math.expm1(x) if x < _MAX_EXPONENT else math.inf,
    "sinh": lambda x: math.sinh(x) if abs(x) < _MAX_EXPONENT else math.copysign(math.inf, x),
    "arctan": math.atan,
    "softplus": lambda x: max(x, 0.0) + math.log1p(math.exp(-abs(x))),
    "smoothstep": lambda x: float(_smoothstep(x)),
    "min": min,
    "max": max,
    "clip": lambda x, low, high: min(max(x, low), high),
    "where": lambda condition, x, y: x if condition else y,
}
"""Functions for plain numbers, by the names of the operations."""


class Evaluator:
    """Several expressions as one list of operations; a common part is computed once.

    Parameters
    ----------
    expressions : sequence of Expression
        Expressions without ``sum``.
    functions : mapping of str to callable, optional
        Functions that compute the operations, by their names.
    """

    def __init__(self, expressions: Sequence[Expression], functions: Mapping[str, Callable] = NUMPY):
        self._functions = functions
        self._places: dict[Expression, int] = {}
        self._known: list = []
        self._symbols: list[tuple[str, int]] = []
        self._operations: list[tuple[Callable, int, int | None, tuple[int, ...], int]] = []
        self._results = [self._place(expression) for expression in expressions]

    def _place(self, expression: Expression) -> int:
        """Return the index of the value of an expression."""
        if expression in self._places:
            return self._places[expression]
        value: float | None = None
        places: list[int] = []
        match expression:
            case Number(value):
                pass
            case Symbol("pi"):
                value = np.pi
            case Operation(name, operands):
                function = self._functions[name]
                if name == "**" and (exponent := whole_power(operands[1])):
                    # Small whole powers are products.
                    function, operands = partial(_product, self._functions["*"], exponent), operands[:1]
                places = [self._place(operand) for operand in operands]
                known = [self._known[place] for place in places]
                if not any(item is None for item in known):  # only numbers, such as 2π
                    value = function(*known)
        place = self._places[expression] = len(self._known)
        self._known.append(value)
        if isinstance(expression, Symbol) and value is None:
            self._symbols.append((expression.name, place))
        elif value is None:
            second = places[1] if len(places) > 1 else None
            self._operations.append((function, places[0], second, tuple(places[2:]), place))
        return place

    def __call__(self, values: Mapping[str, np.ndarray | float]) -> list[np.ndarray | float]:
        """Return the values of the expressions.

        Parameters
        ----------
        values : mapping of str to array_like
            Values of the symbols, of shapes that broadcast together.
        """
        results = self._known.copy()
        for name, place in self._symbols:
            results[place] = values[name]
        # One branch per number of operands: for short records this loop takes as long as NumPy.
        for function, first, second, others, place in self._operations:
            if second is None:
                results[place] = function(results[first])
            elif not others:
                results[place] = function(results[first], results[second])
            else:
                results[place] = function(
                    results[first], results[second], *[results[item] for item in others]
                )
        return [results[place] for place in self._results]


def _product(multiply: Callable, exponent: int, base):
    return reduce(multiply, [base] * exponent)


def derivative(expression: Expression, symbol: str) -> Expression:
    """Return the derivative of an expression by one symbol; at a kink a one-sided derivative.

    Parameters
    ----------
    expression : Expression
        Expression without ``sum``.
    symbol : str
        Name of the symbol.

    Raises
    ------
    InputError
        If the symbol is in an exponent.
    """
    match expression:
        case Symbol(name):
            return Number(float(name == symbol))
        case Operation("where", (condition, yes, no)):
            yes, no = derivative(yes, symbol), derivative(no, symbol)
            return yes if yes == no else Operation("where", (condition, yes, no))
        case Operation(_, operands):
            slopes = [derivative(operand, symbol) for operand in operands]
            if any(slope != ZERO for slope in slopes):
                return _chain_rule(expression, slopes)
    return ZERO


def _chain_rule(called: Operation, slopes: Sequence[Expression]) -> Expression:
    """Return the derivative of an operation from the derivatives of its operands."""
    match called.name, called.operands, slopes:
        case "+", _, (left, right):
            return left + right
        case "-", _, (left, right):
            return -right if left == ZERO else left - right
        case "neg", _, (slope,):
            return -slope
        case "*", (first, second), (left, right):
            return left * second + first * right
        case "/", (_, divisor), (above, below):
            return (above if below == ZERO else above - called * below) / divisor
        case "**", (base, exponent), (slope, in_exponent):
            if in_exponent != ZERO:
                raise InputError("a state is not allowed in an exponent; write exp(…) of it")
            lower: Expression = Operation("-", (exponent, ONE))
            lower = Number(exponent.value - 1) if isinstance(exponent, Number) else lower
            return exponent * base**lower * slope
    given = dict(zip("xyw", called.operands, strict=False))
    terms = (
        substitute(parse(text), given) * slope
        for text, slope in zip(_DERIVATIVES[called.name], slopes, strict=True)
        if slope != ZERO
    )
    return reduce(operator.add, terms)


_DERIVATIVES: dict[str, list[str]] = shipped_yaml(Path(__file__).with_name("functions.yaml"))["derivatives"]
"""Derivatives of functions by each of their operands x, y, w."""


def linear_parts(expression: Expression, linear: Collection[str]) -> dict[str, Expression]:
    """Return the factor of each linear parameter that an expression uses: z and v*abs(v) of k*z + c*v*abs(v).

    Parameters
    ----------
    expression : Expression
        Expression without ``sum``.
    linear : collection of str
        Symbols of the linear parameters.

    Raises
    ------
    InputError
        If a part of the expression is not proportional to its linear parameters. The message names the part.
    """
    inside = symbols(expression) & set(linear)
    if not inside:
        raise InputError(f"{to_text(expression)} has no linear parameter, so a fit cannot scale it")
    match expression:
        case Symbol(name):
            return {name: ONE}
        case Operation("+" | "-" as name, (left, right)):
            factors = linear_parts(left, linear)
            for symbol, part in linear_parts(right, linear).items():
                signed = part if name == "+" else -part
                factors[symbol] = factors[symbol] + signed if symbol in factors else signed
            return factors
        case Operation("neg", (operand,)):
            return {symbol: -part for symbol, part in linear_parts(operand, linear).items()}
        case Operation("*", (left, right)) if not symbols(right) & inside:
            return {symbol: part * right for symbol, part in linear_parts(left, linear).items()}
        case Operation("*", (left, right)) if not symbols(left) & inside:
            return {symbol: left * part for symbol, part in linear_parts(right, linear).items()}
        case Operation("/", (above, below)) if not symbols(below) & inside:
            return {symbol: part / below for symbol, part in linear_parts(above, linear).items()}
        case Operation("where", (condition, yes, no)) if not symbols(condition) & inside:
            branches = [{} if branch == ZERO else linear_parts(branch, linear) for branch in (yes, no)]
            return {
                symbol: Operation("where", (condition, *(branch.get(symbol, ZERO) for branch in branches)))
                for symbol in {**branches[0], **branches[1]}
            }
    wrong = ", ".join(sorted(inside))
    raise InputError(f"{to_text(expression)} is not proportional to {wrong}; declare {wrong} as nonlinear")


def never_negative(expression: Expression, positive: Collection[str]) -> bool:
    """Return whether an expression is certainly at least 0.

    Parameters
    ----------
    expression : Expression
        Expression without ``sum``.
    positive : collection of str
        Symbols that are at least 0.
    """
    match expression:
        case Number(value):
            return value >= 0
        case Symbol(name):
            return name in positive or name == "pi"
        case Operation("abs" | "sqrt" | "exp" | "hypot" | "softplus" | "smoothstep"):
            return True
        case Operation("**", (base, exponent)):
            is_even = isinstance(exponent, Number) and exponent.value % 2 == 0
            return is_even or never_negative(base, positive)
        case Operation("max", operands):
            return any(never_negative(operand, positive) for operand in operands)
        case Operation("+" | "*" | "/" | "min", operands):
            return all(never_negative(operand, positive) for operand in operands)
        case Operation("clip", (_, low, _)):
            return never_negative(low, positive)
        case Operation("where", (_, yes, no)):
            return never_negative(yes, positive) and never_negative(no, positive)
    return False


def check_powers(expression: Expression, positive: Collection[str]) -> None:
    """Reject a power of a base that may be negative unless its exponent is a whole number from 2 to 8.

    Parameters
    ----------
    expression : Expression
        Expression without ``sum``.
    positive : collection of str
        Symbols that are at least 0.

    Raises
    ------
    InputError
        If there is such a power. The message names the first one.
    """
    for part in parts(expression):
        match part:
            case Operation("**", (base, exponent)) if not (
                whole_power(exponent) or never_negative(base, positive)
            ):
                raise InputError(
                    f"{to_text(part)}: {to_text(base)} may be negative and has no such power; write abs(…) or "
                    "max(…, 0), or a whole exponent from 2 to 8"
                )
