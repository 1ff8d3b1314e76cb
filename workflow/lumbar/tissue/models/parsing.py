"""Text read as an expression by a strict whitelist.

The text is Python's notation for formulas, read by `ast.parse` and never run: ``Fc*tanh(v/vs)``.
"""

from __future__ import annotations

import ast
import math
from functools import lru_cache

from lumbar.base.errors import InputError
from lumbar.tissue.models.expression import (
    COMPARISONS,
    OPERANDS,
    Expression,
    Number,
    Operation,
    Symbol,
    parts,
)

MOST_CHARACTERS = 2000
MOST_OPERATIONS = 400
DEEPEST = 60
MOST_TERMS = 32
"""Limits of an expression: characters, operations and depth of the tree, terms of a sum."""
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_ALLOWED = f"numbers, symbols, + - * / ** ( ) and {', '.join(OPERANDS)}"


@lru_cache(maxsize=1024)
def parse(text: str) -> Expression:
    """Read an expression.

    Parameters
    ----------
    text : str
        E.g. ``"Fc*tanh(v/vs)"``.

    Raises
    ------
    InputError
        For anything that is not on the whitelist, and for what exceeds the limits: never more than one message, with
        the part of the text that it is about.

    Examples
    --------
    >>> parse("k3*z**3")
    Operation(name='*', operands=(Symbol(name='k3'), Operation(name='**', operands=(Symbol(name='z'), Number(value=3.0)))))
    """
    if not text.strip():
        raise InputError(f"{text!r} is no expression; e.g. Fc*tanh(v/vs)")
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"{len(text)} characters; at most {MOST_CHARACTERS} are read")
    try:
        # White space about it would be an indented line to Python.
        tree = ast.parse(" ".join(text.split()), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(
            f"{_shown(text)} cannot be read ({getattr(error, 'msg', 'too deep')}); allowed are {_ALLOWED}"
        ) from error
    read = _Reader(" ".join(text.split())).read(tree.body, 1)
    if isinstance(read, Operation) and read.name in COMPARISONS:
        raise InputError(f"{_shown(text)} is a comparison; it may stand in where(comparison, yes, no)")
    return read


def _shown(text: str) -> str:
    return repr(text if len(text) < 80 else f"{text[:77]}…")


class _Reader:
    """Turns Python's syntax tree into an expression, node by node."""

    def __init__(self, text: str):
        self.text = text
        self.operations = 0

    def read(self, node: ast.expr, depth: int) -> Expression:
        """Return the expression of a node, or say why there is none."""
        if depth > DEEPEST:
            raise InputError(f"{_shown(self.text)} is nested more than {DEEPEST} deep")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self._number(node, value)
            case ast.Name(id=name):
                return self._symbol(node, name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._operation("neg", (operand,), depth)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self._operation(_OPERATORS[type(op)], (left, right), depth)
            case ast.Call(func=ast.Name(id=name), args=operands, keywords=[]):
                return self._call(node, name, operands, depth)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                raise self._refused(node, "a comparison may only be the first operand of where()")
        raise self._refused(node, f"allowed are {_ALLOWED}")

    def _refused(self, node: ast.expr, allowed: str) -> InputError:
        found = ast.get_source_segment(self.text, node) or self.text
        return InputError(f"{_shown(found)} is not allowed; {allowed}")

    def _number(self, node: ast.Constant, written: float) -> Number:
        try:
            value = float(written)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self._refused(node, "numbers are finite")
        return Number(value)

    def _symbol(self, node: ast.Name, name: str) -> Symbol:
        if name in OPERANDS:
            raise self._refused(node, f"the function {name} needs operands: {name}(…)")
        if not name.isascii() or name.startswith("_"):
            raise self._refused(node, "symbols are letters a to z, digits and _, with a letter first")
        return Symbol(name)

    def _operation(self, name: str, operands, depth: int) -> Operation:
        self.operations += 1
        if self.operations > MOST_OPERATIONS:
            raise InputError(f"{_shown(self.text)} has more than {MOST_OPERATIONS} operations")
        return Operation(name, tuple(self.read(operand, depth + 1) for operand in operands))

    def _call(self, node: ast.Call, name: str, operands: list[ast.expr], depth: int) -> Operation:
        if name not in OPERANDS:
            raise self._refused(node, f"functions are {', '.join(OPERANDS)}")
        if len(operands) != OPERANDS[name]:
            raise self._refused(node, f"{name} takes {OPERANDS[name]} operands and got {len(operands)}")
        if name == "where":
            return self._choice(operands, depth)
        called = self._operation(name, operands, depth)
        if name == "sum":
            self._check_sum(node, called)
        return called

    def _choice(self, operands: list[ast.expr], depth: int) -> Operation:
        match operands[0]:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                condition = self._operation(_COMPARISONS[type(op)], (left, right), depth + 1)
                chosen = self._operation("where", operands[1:], depth)
                return Operation("where", (condition, *chosen.operands))
        raise self._refused(operands[0], "where() begins with one comparison by < <= > >=")

    def _check_sum(self, node: ast.Call, called: Operation) -> None:
        index, first, last, term = called.operands
        if not (
            isinstance(index, Symbol)
            and isinstance(first, Number)
            and isinstance(last, Number)
            and first.value.is_integer()
            and last.value.is_integer()
            and 0 <= last.value - first.value < MOST_TERMS
            and not any(isinstance(part, Operation) and part.name == "sum" for part in parts(term))
        ):
            allowed = f"sum(n, 1, 7, term): whole limits, at most {MOST_TERMS} terms, no sum in a sum"
            raise self._refused(node, allowed)
