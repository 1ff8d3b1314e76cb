"""What makes an expression a force: proportional to its linear parameters, and a number for every motion."""

from __future__ import annotations

from collections.abc import Collection

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
    parts,
    symbols,
    whole_power,
    written,
)


def linear_parts(expression: Expression, linear: Collection[str]) -> dict[str, Expression]:
    """Split an expression into what each linear parameter is multiplied by.

    Parameters
    ----------
    expression : Expression
        Without ``sum``: see `expanded`.
    linear : collection of str
        Symbols of the linear parameters.

    Returns
    -------
    dict of str to Expression
        By symbol; the expression is the sum of symbol times what it is multiplied by.

    Raises
    ------
    InputError
        If the expression is not proportional to its linear parameters, with the part that is not.

    Examples
    --------
    >>> from lumbar.tissue.models.parsing import parse
    >>> linear_parts(parse("k*z + c*v*abs(v)"), ("k", "c")) == {"k": parse("z"), "c": parse("v*abs(v)")}
    True
    """
    if not symbols(expression) & set(linear):
        raise InputError(f"{written(expression)} holds no linear parameter, so that a fit could not scale it")
    match expression:
        case Symbol(name):
            return {name: Number(1.0)}
        case Operation("+" | "-" as name, (left, right)):
            found = linear_parts(left, linear)
            for symbol, part in linear_parts(right, linear).items():
                signed = part if name == "+" else negate(part)
                found[symbol] = add(found[symbol], signed) if symbol in found else signed
            return found
        case Operation("neg", (operand,)):
            return {symbol: negate(part) for symbol, part in linear_parts(operand, linear).items()}
        case Operation("*", (left, right)) if not symbols(right) & set(linear):
            return {symbol: multiply(part, right) for symbol, part in linear_parts(left, linear).items()}
        case Operation("*", (left, right)) if not symbols(left) & set(linear):
            return {symbol: multiply(left, part) for symbol, part in linear_parts(right, linear).items()}
        case Operation("/", (above, below)) if not symbols(below) & set(linear):
            return {symbol: divide(part, below) for symbol, part in linear_parts(above, linear).items()}
        case Operation("where", (condition, yes, no)) if not symbols(condition) & set(linear):
            zero = Number(0.0)
            branches = [{} if branch == zero else linear_parts(branch, linear) for branch in (yes, no)]
            return {
                symbol: Operation("where", (condition, *(branch.get(symbol, zero) for branch in branches)))
                for symbol in {**branches[0], **branches[1]}
            }
    inside = ", ".join(sorted(symbols(expression) & set(linear)))
    raise InputError(
        f"{written(expression)} is not proportional to {inside}; a parameter that the force is not proportional to is "
        "nonlinear"
    )


def never_negative(expression: Expression, positive: Collection[str]) -> bool:
    """Whether an expression is seen to be at least 0, given symbols that are."""
    match expression:
        case Number(value):
            return value >= 0
        case Symbol(name):
            return name in positive or name == "pi"
        case Operation("abs" | "sqrt" | "exp" | "hypot" | "softplus" | "smoothstep"):
            return True
        case Operation("**", (_, Number(exponent))) if exponent % 2 == 0:
            return True
        case Operation("**", (base, _)):
            return never_negative(base, positive)
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
    """Refuse powers with a broken exponent of what may be negative.

    Raises
    ------
    InputError
        With the power.
    """
    for part in parts(expression):
        match part:
            case Operation("**", (base, exponent)):
                if not whole_power(exponent) and not never_negative(base, positive):
                    raise InputError(
                        f"{written(part)}: {written(base)} may be negative, which has no such power; write abs(…) or "
                        "max(…, 0), or a whole exponent from 2 to 8"
                    )
