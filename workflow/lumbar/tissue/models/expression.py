"""Expressions as trees, read from text by a strict whitelist and written as text.

The text is Python's notation for formulas, such as ``Fc*tanh(v/vs)``, read by `ast.parse` and never run.

A tree keeps the written order of operations, so that NumPy and C round equally and no new version of a library changes numbers.
Sympy reorders terms and factors; the tests compare with it.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce

from lumbar.base.errors import InputError


class Expression:
    """A number, a symbol or an operation. Arithmetic leaves out neutral operands, such as factors 1 and terms 0."""

    __slots__ = ()

    def __add__(self, other: Expression) -> Expression:
        if self == ZERO:
            return other
        return self if other == ZERO else Operation("+", (self, other))

    def __sub__(self, other: Expression) -> Expression:
        return self if other == ZERO else Operation("-", (self, other))

    def __neg__(self) -> Expression:
        match self:
            case Number(value):
                return Number(-value if value else 0.0)
            case Operation("neg", (inner,)):
                return inner
            case Operation("*" | "/" as name, (Operation("neg", (inner,)), other)):
                return Operation(name, (inner, other))
        return Operation("neg", (self,))

    def __mul__(self, other: Expression) -> Expression:
        for one, factor in ((self, other), (other, self)):
            if one in (ZERO, ONE):
                return one if one == ZERO else factor
            if one == Number(-1.0):
                return -factor
        return Operation("*", (self, other))

    def __truediv__(self, other: Expression) -> Expression:
        return self if self == ZERO or other == ONE else Operation("/", (self, other))

    def __pow__(self, exponent: Expression) -> Expression:
        if exponent == ZERO:
            return ONE
        return self if exponent == ONE else Operation("**", (self, exponent))


@dataclass(frozen=True, slots=True)
class Number(Expression):
    """A number as written."""

    value: float


@dataclass(frozen=True, slots=True)
class Symbol(Expression):
    """A parameter, a signal or ``pi``."""

    name: str


@dataclass(frozen=True, slots=True)
class Operation(Expression):
    """An operator, a comparison or a function with its operands."""

    name: str
    """``+ - * / **``, ``neg``, a comparison, or a name of `OPERANDS`."""
    operands: tuple[Expression, ...]


ZERO, ONE = Number(0.0), Number(1.0)
OPERANDS = {
    "abs": 1, "sign": 1, "sqrt": 1, "exp": 1, "expm1": 1, "tanh": 1, "sinh": 1, "sin": 1, "cos": 1, "arctan": 1,
    "softplus": 1, "smoothstep": 1, "min": 2, "max": 2, "hypot": 2, "clip": 3, "where": 3, "sum": 4,
}  # fmt: skip
"""Functions and their number of operands.

softplus(x) is ln(1 + e^x), smoothstep(x) is 3x² − 2x³ between 0 and 1 and constant outside, clip(x, low, high) is x within
its limits, where(condition, yes, no) selects, sum(n, 1, 7, term) adds the terms for n from 1 to 7, with ``A_n`` as ``A_1`` ….
"""
VECTOR_OPERATION_ALIASES = {"norm": "abs", "dot": "*"}
"""Operation by each name for vectors."""
COMPARISONS = ("<", "<=", ">", ">=")


_ARITHMETIC: dict[str, Callable[..., Expression]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "neg": operator.neg,
}


def operation(name: str, *operands: Expression) -> Expression:
    """Return an operation without neutral operands.

    Parameters
    ----------
    name : str
        Name as in `Operation`.
    *operands : Expression
        Operands, in the written order.
    """
    return _ARITHMETIC[name](*operands) if name in _ARITHMETIC else Operation(name, operands)


def parts(expression: Expression) -> Iterator[Expression]:
    """Yield all parts of an expression, operands first, and the expression itself.

    Parameters
    ----------
    expression : Expression
        Any expression.
    """
    if isinstance(expression, Operation):
        for operand in expression.operands:
            yield from parts(operand)
    yield expression


def symbols(expression: Expression) -> set[str]:
    """Return the names of the symbols in an expression except ``pi``.

    Parameters
    ----------
    expression : Expression
        Any expression.
    """
    return {part.name for part in parts(expression) if isinstance(part, Symbol)} - {"pi"}


def substitute(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """Return the expression with other expressions in place of symbols.

    Parameters
    ----------
    expression : Expression
        Any expression.
    values : mapping of str to Expression
        Replacements by symbol; other symbols stay.
    """
    match expression:
        case Symbol(name):
            return values.get(name, expression)
        case Operation(name, operands):
            return operation(name, *(substitute(operand, values) for operand in operands))
    return expression


def expand_sums(expression: Expression) -> Expression:
    """Return the expression with every ``sum`` replaced by its terms.

    Parameters
    ----------
    expression : Expression
        Any expression.
    """
    match expression:
        case Operation("sum", (Symbol(index), Number(first), Number(last), term)):
            indexed = [name for name in symbols(term) if name.endswith(f"_{index}")]
            terms = []
            for number in range(int(first), int(last) + 1):
                named = {name: Symbol(f"{name.removesuffix(index)}{number}") for name in indexed}
                terms.append(substitute(term, {**named, index: Number(float(number))}))
            return reduce(operator.add, map(expand_sums, terms))
        case Operation(name, operands):
            return operation(name, *map(expand_sums, operands))
    return expression


def whole_power(exponent: Expression) -> int:
    """Return the exponent of a power that is computed as a product; 0 for other powers.

    Parameters
    ----------
    exponent : Expression
        Exponent of the power: a whole number from 2 to 8 makes it a product.
    """
    if isinstance(exponent, Number) and exponent.value.is_integer() and 2 <= exponent.value <= 8:
        return int(exponent.value)
    return 0


_RANK = {"+": 1, "-": 1, "*": 2, "/": 2, "neg": 3, "**": 4}


def to_text(expression: Expression, rank: int = 0) -> str:
    """Return the expression as text that `parse` reads.

    Parameters
    ----------
    expression : Expression
        Any expression.
    rank : int, optional
        Text that binds less strongly is in brackets: 1 for a sum, 2 for a product, 3 for a sign, 4 for a power.
    """
    match expression:
        case Number(value):
            text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
            return f"({text})" if value < 0 and rank > 1 else text
        case Symbol(name):
            return name
        case Operation("neg", (operand,)):
            text, bound = f"-{to_text(operand, 3)}", 3
        case Operation("**", (base, exponent)):
            text, bound = f"{to_text(base, 5)}**{to_text(exponent, 3)}", 4
        case Operation(name, (left, right)) if name in _RANK:
            bound = _RANK[name]
            gap = " " if bound == 1 else ""
            text = f"{to_text(left, bound)}{gap}{name}{gap}{to_text(right, bound + 1)}"
        case Operation(name, (left, right)) if name in COMPARISONS:
            text, bound = f"{to_text(left, 1)} {name} {to_text(right, 1)}", 0
        case Operation(name, operands):
            return f"{name}({', '.join(to_text(operand, 0) for operand in operands)})"
    return f"({text})" if bound < rank else text


MAX_CHARACTERS, MAX_OPERATIONS, MAX_DEPTH, MAX_TERMS = 2000, 400, 60, 32
"""Limits of an expression: characters, operations and depth of the tree, terms of a sum."""
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_ALLOWED = f"numbers, symbols, + - * / ** ( ) and {', '.join(OPERANDS)}"


@lru_cache(maxsize=1024)
def parse(text: str) -> Expression:
    """Read an expression, for example ``"Fc*tanh(v/vs)"``.

    Parameters
    ----------
    text : str
        Formula in Python's notation; may come from an untrusted file.

    Raises
    ------
    InputError
        If a part of the text is not on the whitelist or exceeds the limits. The message names the first such part.

    Examples
    --------
    >>> parse("k3*z**3")
    Operation(name='*', operands=(Symbol(name='k3'), Operation(name='**', operands=(Symbol(name='z'), Number(value=3.0)))))
    """
    text = " ".join(text.split())  # leading white space would be an indented line to Python
    if not text:
        raise InputError("'' is not an expression; write e.g. Fc*tanh(v/vs)")
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"{len(text)} characters; at most {MAX_CHARACTERS} are read")
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = getattr(error, "msg", "too deep")
        raise InputError(f"{_quote(text)} cannot be read ({reason}); allowed are {_ALLOWED}") from error
    read = _Reader(text).read(tree.body, 1)
    if isinstance(read, Operation) and read.name in COMPARISONS:
        raise InputError(
            f"{_quote(text)} is a comparison, allowed as first operand of where(comparison, yes, no) only"
        )
    return read


def _quote(text: str) -> str:
    return repr(text if len(text) < 80 else f"{text[:77]}…")


class _Reader:
    """Converts Python's syntax tree into an expression, node by node."""

    def __init__(self, text: str):
        self.text = text
        self.operations = 0

    def read(self, node: ast.expr, depth: int) -> Expression:
        """Return the expression of a node, or raise the reason why it is not allowed."""
        if depth > MAX_DEPTH:
            raise InputError(f"{_quote(self.text)} is nested more than {MAX_DEPTH} deep")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self._number(node, value)
            case ast.Name(id=name):
                if name in OPERANDS:
                    raise self._error(node, f"the function {name} needs operands: {name}(…)")
                if not name.isascii() or name.startswith("_"):
                    raise self._error(node, "symbols are letters a to z, digits and _, with a letter first")
                return Symbol(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._operation("neg", (operand,), depth)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self._operation(_OPERATORS[type(op)], (left, right), depth)
            case ast.Call(func=ast.Name(id=name), args=operands, keywords=[]):
                return self._call(node, name, operands, depth)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                raise self._error(node, "a comparison may only be the first operand of where()")
        raise self._error(node, f"allowed are {_ALLOWED}")

    def _error(self, node: ast.expr, allowed: str) -> InputError:
        source = ast.get_source_segment(self.text, node) or self.text
        return InputError(f"{_quote(source)} is not allowed; {allowed}")

    def _number(self, node: ast.expr, value: float) -> Number:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._error(node, "numbers are finite")
        return Number(number)

    def _operation(self, name: str, operands, depth: int) -> Operation:
        self.operations += 1
        if self.operations > MAX_OPERATIONS:
            raise InputError(f"{_quote(self.text)} has more than {MAX_OPERATIONS} operations")
        return Operation(name, tuple(self.read(operand, depth + 1) for operand in operands))

    def _call(self, node: ast.Call, name: str, operands: list[ast.expr], depth: int) -> Operation:
        count = {**OPERANDS, "norm": 1, "dot": 2}.get(name)
        if count is None:
            raise self._error(node, f"functions are {', '.join((*OPERANDS, *VECTOR_OPERATION_ALIASES))}")
        if len(operands) != count:
            raise self._error(node, f"{name} takes {count} operands and got {len(operands)}")
        if name == "where":
            match operands[0]:
                case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                    condition = self._operation(_COMPARISONS[type(op)], (left, right), depth + 1)
                    branches = self._operation("where", operands[1:], depth)
                    return Operation("where", (condition, *branches.operands))
            raise self._error(operands[0], "where() begins with one comparison by < <= > >=")
        read = self._operation(VECTOR_OPERATION_ALIASES.get(name, name), operands, depth)
        match read:
            case Operation("sum", (Symbol(), Number(first), Number(last), term)) if (
                first.is_integer()
                and last.is_integer()
                and 0 <= last - first < MAX_TERMS
                and not any(isinstance(part, Operation) and part.name == "sum" for part in parts(term))
            ):
                return read
            case Operation("sum"):
                allowed = f"sum(n, 1, 7, term): whole limits, at most {MAX_TERMS} terms, no sum in a sum"
                raise self._error(node, allowed)
        return read
