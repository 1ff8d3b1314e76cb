"""Derivatives of expressions, as expressions."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

from lumbar.base.errors import InputError
from lumbar.tissue.models.expression import (
    Expression,
    Number,
    Operation,
    Symbol,
    add,
    divide,
    multiply,
    negate,
    power,
    substituted,
    subtract,
)
from lumbar.tissue.models.parsing import parse


def derivative(expression: Expression, symbol: str) -> Expression:
    """Derivative by one symbol; at a kink that of one side.

    Raises
    ------
    InputError
        If the symbol stands in an exponent.

    Examples
    --------
    >>> derivative(parse("v/d*(1 - r*sign(v))"), "r") == parse("v/d*-sign(v)")
    True
    """
    match expression:
        case Symbol(name):
            return Number(float(name == symbol))
        case Operation("where", (condition, yes, no)):
            return _chosen(condition, derivative(yes, symbol), derivative(no, symbol))
        case Operation(name, operands):
            inner = [derivative(operand, symbol) for operand in operands]
            if all(slope == Number(0.0) for slope in inner):
                return Number(0.0)
            return _OPERATOR_DERIVATIVES.get(name, _function_derivative)(expression, *inner)
    return Number(0.0)


def _chosen(condition: Expression, yes: Expression, no: Expression) -> Expression:
    return yes if yes == no else Operation("where", (condition, yes, no))


def _quotient_derivative(quotient: Operation, above: Expression, below: Expression) -> Expression:
    divisor = quotient.operands[1]
    if below == Number(0.0):
        return divide(above, divisor)
    return divide(subtract(above, multiply(quotient, below)), divisor)


def _power_derivative(raised: Operation, slope: Expression, in_exponent: Expression) -> Expression:
    base, exponent = raised.operands
    if in_exponent != Number(0.0):
        raise InputError("a state may not stand in an exponent; write exp(…) of it")
    lower = (
        Number(exponent.value - 1)
        if isinstance(exponent, Number)
        else Operation("-", (exponent, Number(1.0)))
    )
    return multiply(multiply(exponent, power(base, lower)), slope)


_OPERATOR_DERIVATIVES: dict[str, Callable[..., Expression]] = {
    "+": lambda _, left, right: add(left, right),
    "-": lambda _, left, right: negate(right) if left == Number(0.0) else subtract(left, right),
    "neg": lambda _, slope: negate(slope),
    "*": lambda product, left, right: add(
        multiply(left, product.operands[1]), multiply(product.operands[0], right)
    ),
    "/": _quotient_derivative,
    "**": _power_derivative,
}
_FUNCTION_DERIVATIVES = {
    "abs": ("sign(x)",),
    "sign": ("0",),
    "sqrt": ("1/(2*sqrt(x))",),
    "exp": ("exp(x)",),
    "expm1": ("expm1(x) + 1",),
    "tanh": ("1 - tanh(x)**2",),
    "sinh": ("sqrt(1 + sinh(x)**2)",),
    "sin": ("cos(x)",),
    "cos": ("-sin(x)",),
    "arctan": ("1/(1 + x**2)",),
    "softplus": ("(1 + tanh(x/2))/2",),
    "smoothstep": ("6*clip(x, 0, 1)*(1 - clip(x, 0, 1))",),
    "hypot": ("x/hypot(x, y)", "y/hypot(x, y)"),
    "max": ("where(x > y, 1, 0)", "where(x > y, 0, 1)"),
    "min": ("where(x < y, 1, 0)", "where(x < y, 0, 1)"),
    "clip": (
        "where(x < y, 0, where(x > w, 0, 1))",
        "where(x < y, 1, 0)",
        "where(x > w, 1, 0)",
    ),
}
"""By each operand x, y, w."""


def _function_derivative(called: Operation, *inner: Expression) -> Expression:
    given = dict(zip("xyw", called.operands, strict=False))
    terms = (
        multiply(substituted(parse(text), given), slope)
        for text, slope in zip(_FUNCTION_DERIVATIVES[called.name], inner, strict=True)
        if slope != Number(0.0)
    )
    return reduce(add, terms)
