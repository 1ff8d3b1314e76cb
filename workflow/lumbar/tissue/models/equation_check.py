"""Check of an equation: its symbols, proportionality to its linear parameters, finite values and slopes at rest."""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.models.algebra import Evaluator, check_powers, derivative
from lumbar.tissue.models.equation import Equation
from lumbar.tissue.models.expression import OPERANDS, Operation, expand_sums, parse, parts, symbols
from lumbar.tissue.models.parameter import FORCE, LINEAR, NEVER_NEGATIVE, POSITIONS, SIGNALS, STEADY
from lumbar.tissue.models.state_equation import MOST_STATES, STEP_SYMBOL

Faults = list[tuple[str, str]]
"""Faults: key in the form's file, and a text on the fault and the allowed values."""
_SYMBOL = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_RESERVED = {*SIGNALS, *OPERANDS, FORCE, "pi", STEP_SYMBOL}
_SLOPE_SIGNALS = ("z", "v", "theta", "theta_dot")
"""Signals with respect to which an equation needs a finite slope at rest."""
_FINITE = "write tanh(v/vs) for sign(v), sqrt(v**2 + e**2) for abs(v) in a root or a divisor, and do not divide by 0 at rest"


def check_equation(equation: Equation, solved: bool = False) -> Faults:
    """Return the faults in the text of an equation or in its symbols.

    Parameters
    ----------
    equation : Equation
        Equation as written, not yet read.
    solved : bool, optional
        True if the states have a closed form, in C too; then there may be any number.
    """
    declared = [item.symbol for item in equation.declared] + [name for name, _ in equation.states]
    faults: Faults = [("symbol", fault) for fault in _wrong_declarations(declared)]
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
            faults.append((key, str(error)))
    for key, tree in trees.items():
        faults += [(key, fault) for fault in _unknown_symbols(equation, declared, key, symbols(tree))]
    if len(equation.states) > MOST_STATES and not solved:
        faults.append(("state", f"{len(equation.states)} states; at most {MOST_STATES} are allowed"))
    if faults:
        return faults
    # Unused declarations, and a force that is not proportional to its linear parameters.
    used = symbols(equation.force).union(*map(symbols, (*equation.slopes.values(), *equation.begin.values())))
    faults = [("symbol", f"{symbol} is declared and never used") for symbol in declared if symbol not in used]
    if equation.transforms and equation.linear:
        faults.append(("equation", "a form that acts on the output has nonlinear parameters only"))
    elif not faults:
        try:
            _ = equation.columns, equation.state and equation.state.matrix
        except InputError as error:
            faults.append(("equation", str(error)))
    return faults


def _wrong_declarations(declared: list[str]) -> Iterator[str]:
    """Report names of parameters, constants and states that are not symbols, reserved, or declared several times."""
    for symbol, count in Counter(declared).items():
        if not _SYMBOL.fullmatch(symbol):
            yield f"{symbol!r} is not a symbol; letters a to z, digits and _ are allowed, a letter first"
        elif symbol in _RESERVED:
            meaning = SIGNALS[symbol].meaning if symbol in SIGNALS else "a name of its own"
            yield f"{symbol} is reserved: {meaning}; choose another name"
        if count > 1:
            yield f"{symbol} is declared {count} times; once is allowed"


def _unknown_symbols(equation: Equation, declared: list[str], key: str, used: set[str]) -> list[str]:
    """Report symbols of one expression that are unknown, or not allowed at this place."""
    known = {*declared, *SIGNALS, *((FORCE,) if equation.transforms else ())}
    signals = ", ".join(name for name, item in SIGNALS.items() if not item.channel)
    allowed = f"parameters and states {', '.join(declared) or '(none)'} and the signals {signals}"
    faults = [f"unknown symbol {symbol}; known are the {allowed}" for symbol in sorted(used - known)]
    if key == "equation":
        return faults
    linear = sorted(used & {item.symbol for item in equation.linear})
    faults += [f"{symbol} is linear; a state knows nonlinear parameters only" for symbol in linear]
    if key.endswith(".start"):
        unknown = {*SIGNALS, *equation.slopes} - {*POSITIONS}
        reason = "is not known at the start; there are position, nonlinear parameters and constants"
    else:
        channels = {name for name, item in SIGNALS.items() if item.channel}
        unknown = {"a", "theta_ddot", *channels} - STEADY - LINEAR
        reason = "is not known between samples; a state may not use it"
    return faults + [f"{symbol} {reason}" for symbol in sorted(used & unknown)]


def check_at_rest(equation: Equation) -> Faults:
    """Return values and slopes that are not finite at z = 0, v = 0; fits and exported models evaluate them there.

    Parameters are in the middle of their starting range; fitted powers are 2, since a proposed law may have a power below 1.
    Path, time, force and additional channels are 1.

    Parameters
    ----------
    equation : Equation
        Equation along one axis without faults of `check_equation`.
    """
    at_rest = {name for name, item in SIGNALS.items() if item.c_name not in ("path", "time", "")}
    values = {name: 0.0 if name in at_rest else 1.0 for name in (FORCE, *SIGNALS)}
    values |= equation.parameters(float(np.sqrt(item.low * item.high)) for item in equation.nonlinear)
    trees = [("equation", column) for column in equation.columns]
    trees += [(f"state.{name}", rate) for name, rate in equation.slopes.items()]
    operations = (part for _, tree in trees for part in parts(tree) if isinstance(part, Operation))
    powers = set().union(*(symbols(part.operands[1]) for part in operations if part.name == "**"))
    powers -= {item.symbol for item in equation.constants}
    values |= dict.fromkeys(powers & values.keys() - at_rest, 2.0)
    arrays: dict[str, Any] = {name: np.array([value]) for name, value in values.items()}
    arrays |= {name: np.zeros(1) for name in equation.slopes}
    faults = []
    with np.errstate(all="ignore"):
        arrays |= dict(zip(equation.begin, Evaluator(list(equation.begin.values()))(arrays), strict=True))
        for key, tree in trees:
            checked = {"value": tree}
            for name in filter(symbols(tree).__contains__, _SLOPE_SIGNALS):
                with suppress(InputError):  # the symbol is in an exponent
                    checked[f"derivative by {name}"] = derivative(tree, name)
            numbers = zip(checked, Evaluator(list(checked.values()))(arrays), strict=True)
            wrong = [label for label, number in numbers if not np.isfinite(number).all()]
            if wrong:
                faults.append((key, f"the {wrong[0]} is not finite at z = 0, v = 0; {_FINITE}"))
    return faults
