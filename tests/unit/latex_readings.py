"""LaTeX of forms as sympy reads it, beside what their parameters are called."""

from __future__ import annotations

import re
import string

import sympy
from sympy.core.function import AppliedUndef
from sympy.parsing.latex import parse_latex_lark

from lumbar.tissue.models.motion import SIGNALS
from lumbar.tissue.models.printing import symbol_latex

_FUNCTIONS = {
    r"\tanh": ("T", sympy.tanh),
    r"\sinh": ("N", sympy.sinh),
    r"\sin": ("A", sympy.sin),
    r"\cos": ("B", sympy.cos),
    r"\ln": ("L", sympy.log),
    r"\arctan": ("R", sympy.atan),
    r"\mathrm{sign}": ("S", sympy.sign),
    r"\mathrm{step}": (
        "P",
        lambda x: sympy.Piecewise((0, x < 0), (1, x > 1), (3 * x**2 - 2 * x**3, True)),
    ),
}
"""Functions that sympy's grammar does not know, or reads as ``\\tan h(x)`` or ``\\sin((x) + y)`` too, under a letter that it
takes for a function."""
_LETTERS = [letter for letter in string.ascii_letters if letter not in "deif" and letter not in "TNABLRSP"]
_SUM = re.compile(r"\\sum_\{n=(\d+)\}\^\{(\d+)\} \((.*)\)$")


def latex_names(parameters, states) -> dict[str, str]:
    """Symbol by its LaTeX: parameters, constants, states and signals."""
    names = {item.latex or symbol_latex(item.symbol): item.symbol for item in parameters}
    names |= {symbol_latex(state): state for state in states}
    for symbol, signal in SIGNALS.items():
        names.setdefault(signal.latex or symbol, symbol)
    return {**names, "F": "F", r"\pi": "pi"}


def read_latex(text: str, names: dict[str, str]) -> sympy.Expr:
    """The expression of one side of an equation, in sympy's symbols."""
    if found := _SUM.match(text):
        first, last, term = found.groups()
        terms = (_numbered(term, number) for number in range(int(first), int(last) + 1))
        return sum((read_latex(numbered, names) for numbered in terms), sympy.Integer(0))
    symbols = {}
    # Its grammar knows some symbols and not others, and takes long for long ones: each is called by a letter.
    letters = iter(_LETTERS)
    for latex in sorted(names, key=len, reverse=True):
        mark = f"@{len(symbols)}@"
        text, found = re.subn(rf"(?<![A-Za-z\\@]){re.escape(latex)}(?![A-Za-z_])", mark, text)
        if found:
            letter = next(letters)
            symbols[letter] = sympy.Symbol(names[latex], real=True)
            text = text.replace(mark, f"@{letter}@")
    text = re.sub(r"@([a-zA-Z])@", r"\1", text)
    for latex, (letter, _) in _FUNCTIONS.items():
        text = text.replace(latex, letter)
    # Things side by side are multiplied; sympy's grammar also takes x (y) for a function.
    text = re.sub(r"(?<![+\-,]) (?!\\cdot|[+\-])(?<!\\cdot )", r"*", text).replace(r" \cdot ", "*")
    read = _unambiguous(parse_latex_lark(text))
    for letter, function in _FUNCTIONS.values():
        read = read.replace(
            lambda part, letter=letter: isinstance(part, AppliedUndef) and str(part.func) == letter,
            lambda part, function=function: function(*part.args),
        )
    given = {sympy.Symbol(name): symbol for name, symbol in symbols.items()} | {sympy.Symbol("e"): sympy.E}
    return read.subs(given).subs(sympy.Symbol("pi", real=True), sympy.pi)


def _unambiguous(read) -> sympy.Expr:
    """The reading in which every letter of a function is one."""
    letters = {sympy.Symbol(letter) for letter, _ in _FUNCTIONS.values()}
    readings = {item for item in getattr(read, "children", [read]) if not item.free_symbols & letters}
    assert len(readings) == 1, read
    return readings.pop()


def _numbered(term: str, number: int) -> str:
    return re.sub(r"\bn\b", str(number), re.sub(r"_n\b", f"_{number}", term))


def constant_of(text: str) -> tuple[str, float]:
    """LaTeX and value of a line like ``g = 9.81\\,\\mathrm{m/s^2}``."""
    name, value = re.fullmatch(r"(.+) = ([^\\]+)\\,\\mathrm\{.+\}", text).groups()
    return name, float(value)
