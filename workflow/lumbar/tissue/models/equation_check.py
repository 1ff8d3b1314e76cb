"""The check of an equation: its symbols, proportionality to its linear parameters, finite values and slopes at rest."""

import re
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.models.algebra import Evaluator, check_powers, derivative
from lumbar.tissue.models.equation import Equation
from lumbar.tissue.models.expression import OPERANDS, Expression, Operation, expand_sums, parse, symbols
from lumbar.tissue.models.parameter import FORCE, LINEAR, NEVER_NEGATIVE, POSITIONS, SIGNALS, STEADY
from lumbar.tissue.models.state_equation import MOST_STATES, STEP_SYMBOL

Found = list[tuple[str, str]]
"""Problems: the key of the form's file, and what is wrong there and what is allowed."""
_SYMBOL = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_RESERVED = {*SIGNALS, *OPERANDS, FORCE, "pi", STEP_SYMBOL}
_SLOPE_SIGNALS = ("z", "v", "theta", "theta_dot")
"""Signals by which an equation needs a finite slope at rest."""


def check_equation(equation: Equation) -> Found:
    """Return what is wrong with the text of an equation, or with its symbols; empty if it can be used."""
    declared = [item.symbol for item in equation.declared] + [name for name, _ in equation.states]
    found = _check_declared(declared)
    # Read every expression; a power with a broken exponent needs a base that is never negative.
    positive = {
        item.symbol for item in (*equation.nonlinear, *equation.linear) if getattr(item, "sign", 1) > 0
    }
    positive |= NEVER_NEGATIVE | {item.symbol for item in equation.constants if item.value >= 0}
    texts = {"equation": equation.text}
    texts |= {f"state.{name}": text for name, text in equation.states}
    texts |= {f"state.{name}.start": text for name, text in equation.starts}
    trees = {}
    for key, text in texts.items():
        try:
            trees[key] = expand_sums(parse(text))
            check_powers(trees[key], positive)
        except InputError as error:
            found.append((key, str(error)))
    for key, tree in trees.items():
        found += _check_used(equation, declared, key, tree)
    if len(equation.states) > MOST_STATES:
        found.append(("state", f"{len(equation.states)} states; at most {MOST_STATES} are allowed"))
    if found:
        return found
    # Unused declarations, and a force that is not proportional to its linear parameters.
    used = symbols(equation.force).union(*map(symbols, (*equation.slopes.values(), *equation.begin.values())))
    found = [("symbol", f"{symbol} is declared and never used") for symbol in declared if symbol not in used]
    if equation.transforms and equation.linear:
        found.append(("equation", "a form that acts on the output has nonlinear parameters only"))
    elif not found:
        try:
            _ = equation.columns, equation.state and equation.state.matrix
        except InputError as error:
            found.append(("equation", str(error)))
    return found


def _check_declared(declared: list[str]) -> Found:
    """Names of parameters, constants and states: symbols, not reserved, each declared a single time."""
    found = []
    for symbol, count in Counter(declared).items():
        if not _SYMBOL.fullmatch(symbol):
            found.append(("symbol", f"{symbol!r} is no symbol; letters a to z, digits and _, a letter first"))
        elif symbol in _RESERVED:
            meaning = SIGNALS[symbol].meaning if symbol in SIGNALS else "a name of its own"
            found.append(("symbol", f"{symbol} is taken: {meaning}; call it otherwise"))
        if count > 1:
            found.append(("symbol", f"{symbol} is declared {count} times; once is allowed"))
    return found


def _check_used(equation: Equation, declared: list[str], key: str, tree: Expression) -> Found:
    """Symbols of one expression that are not known, or not known at this place."""
    used = symbols(tree)
    known = {*declared, *SIGNALS, *((FORCE,) if equation.transforms else ())}
    signals = ", ".join(name for name, item in SIGNALS.items() if not item.channel)
    found = [
        (
            key,
            f"unknown symbol {symbol}; known are the parameters and states "
            f"{', '.join(declared) or '(none)'} and the signals {signals}",
        )
        for symbol in sorted(used - known)
    ]
    if key == "equation":
        return found
    linear = sorted(used & {item.symbol for item in equation.linear})
    found += [(key, f"{symbol} is linear; a state knows nonlinear parameters only") for symbol in linear]
    if key.endswith(".start"):
        unknown = {*SIGNALS, *equation.slopes} - {*POSITIONS}
        reason = "is not known at the start; there are position, nonlinear parameters and constants"
    else:
        channels = {name for name, item in SIGNALS.items() if item.channel}
        unknown = {"a", "theta_ddot", *channels} - STEADY - LINEAR
        reason = "is not known between samples; a state may not use it"
    return found + [(key, f"{symbol} {reason}") for symbol in sorted(used & unknown)]


def check_at_rest(equation: Equation) -> Found:
    """Return values and slopes that are not finite at z = 0, v = 0; fits and exported models evaluate them there.

    Parameters are in the middle of their starting range. Fitted powers are 2, for a proposed law may have one
    below 1. Path, time, force and further channels are 1.
    """
    at_rest = {name for name, item in SIGNALS.items() if item.c_name not in ("path", "time", "")}
    values = {name: 0.0 if name in at_rest else 1.0 for name in (FORCE, *SIGNALS)}
    values |= equation.parameters(float(np.sqrt(item.low * item.high)) for item in equation.nonlinear)
    trees = [("equation", column) for column in equation.columns]
    trees += [(f"state.{name}", rate) for name, rate in equation.slopes.items()]
    powers = set().union(*(_exponent_symbols(tree) for _, tree in trees))
    powers -= {item.symbol for item in equation.constants}
    values |= dict.fromkeys(powers & values.keys() - at_rest, 2.0)
    arrays: dict[str, Any] = {name: np.array([value]) for name, value in values.items()}
    arrays |= {name: np.zeros(1) for name in equation.slopes}
    with np.errstate(all="ignore"):
        begin = Evaluator(list(equation.begin.values()))(arrays)
        arrays |= dict(zip(equation.begin, begin, strict=True))
        return [(key, problem) for key, tree in trees if (problem := _problem_at_rest(tree, arrays))]


def _exponent_symbols(tree: Expression) -> set[str]:
    """Symbols in the exponents of an expression."""
    match tree:
        case Operation("**", (base, exponent)):
            return symbols(exponent) | _exponent_symbols(base)
        case Operation(_, operands):
            return set().union(*map(_exponent_symbols, operands))
    return set()


def _problem_at_rest(tree: Expression, values: Mapping[str, Any]) -> str:
    """Which value or derivative of an expression is not finite, and what to write instead; "" if all are finite."""
    trees = {"value": tree}
    for name in _SLOPE_SIGNALS:
        with suppress(InputError):  # the symbol is in an exponent
            if name in symbols(tree):
                trees[f"derivative by {name}"] = derivative(tree, name)
    for label, number in zip(trees, Evaluator(list(trees.values()))(values), strict=True):
        if not np.isfinite(number).all():
            return (
                f"the {label} is not finite at z = 0, v = 0; write tanh(v/vs) for sign(v), sqrt(v**2 + e**2) for abs(v) "
                "in a root or a divisor, and divide by nothing that is 0 at rest"
            )
    return ""
