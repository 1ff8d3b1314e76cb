"""Expressions as LaTeX and as C, and LaTeX as the MathML of a page."""

import math
import re
from collections.abc import Mapping
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.expression import (
    COMPARISONS,
    ONE,
    ZERO,
    Expression,
    Number,
    Operation,
    Symbol,
    whole_power,
)

_GREEK = {
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi", "pi",
    "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Xi", "Lambda", "Pi", "Sigma",
    "Upsilon", "Phi", "Psi", "Omega",
}  # fmt: skip


def symbol_latex(symbol: str) -> str:
    """Return the LaTeX of a symbol, e.g. F_c of Fc.

    Parameters
    ----------
    symbol : str
        Symbol; the part after its first letter, Greek name or underscore is an index.
    """
    head, _, index = symbol.partition("_")
    if head not in _GREEK and len(head) > 1:
        start = max((name for name in _GREEK if head.startswith(name)), key=len, default=head[0])
        head, index = start, head[len(start) :] + index
    head = f"\\{head}" if head in _GREEK else head
    return head + (f"_{index}" if len(index) == 1 else f"_{{{index}}}" if index else "")


def number_latex(text: str) -> str:
    """Return the LaTeX of a formatted number, with powers of ten instead of an ``e``: 10^{-6} of 1e-06.

    Parameters
    ----------
    text : str
        Number as Python formats it.
    """
    mantissa, e, exponent = text.partition("e")
    if not e:
        return text
    power = f"10^{{{int(exponent)}}}"
    return mantissa.replace("1", power) if mantissa in ("1", "-1") else rf"{mantissa} \cdot {power}"


def latex(expression: Expression, names: Mapping[str, str]) -> str:
    """Return the LaTeX of an expression, limited to commands that matplotlib supports.

    Parameters
    ----------
    expression : Expression
        Any expression.
    names : mapping of str to str
        LaTeX by symbol; for other symbols it is derived.
    """
    return _Latex(names).text(expression)


_SUM, _SIGNED, _PRODUCT, _POWER, _ATOM = 1, 2, 3, 4, 5
_POWER_OF_TEN = re.compile(r"10\^\{-?\d+\}$")
_FUNCTIONS: dict[str, str] = shipped_yaml(Path(__file__).with_name("functions.yaml"))["latex"]
_RELATIONS = {"<": "<", "<=": r"\leq", ">": ">", ">=": r"\geq"}
_OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}


class _Latex:
    def __init__(self, names: Mapping[str, str]):
        self.names = names

    def text(self, expression: Expression, rank: int = 0) -> str:
        """Return the LaTeX, in brackets if the expression binds less strongly than `rank`."""
        text, bound = self._text(expression)
        return f"({text})" if bound < rank else text

    def _text(self, expression: Expression) -> tuple[str, int]:
        """Return the LaTeX and its binding strength."""
        match expression:
            case Number(value):
                text = number_latex(f"{value:.12g}")
                rank = _PRODUCT if "cdot" in text else _POWER if "^" in text else _ATOM
                return text, rank if value >= 0 else _SUM
            case Symbol(name):
                return self.names.get(name) or symbol_latex(name), _ATOM
            case Operation("+" | "-" as name, (left, right)):
                below = _SUM if name == "+" else _PRODUCT
                second = f"({self.text(right)})" if _signed(right) else self.text(right, below)
                return f"{self.text(left, _SUM)} {name} {second}", _SUM
            case Operation("neg", (operand,)):
                return f"-{self.text(operand, _PRODUCT)}", _SIGNED
            case Operation("*"):
                return self._product(expression), _PRODUCT
            case Operation("/", (above, below)):
                # A numerator is read as one before a slash if it is a number, a symbol, |F|, or −z.
                inner = above.operands[0] if isinstance(above, Operation) and above.name == "neg" else above
                is_simple = isinstance(inner, Number | Symbol) or getattr(above, "name", "") == "abs"
                if is_simple and isinstance(below, Number | Symbol):
                    return f"{self.text(above, _SIGNED)}/{self.text(below, _ATOM)}", _PRODUCT
                return rf"\frac{{{self.text(above)}}}{{{self.text(below)}}}", _ATOM
            case Operation("**", (base, exponent)):
                raised = self._operand(exponent)
                return self._base(base) + (f"^{raised}" if len(raised) == 1 else f"^{{{raised}}}"), _POWER
        assert isinstance(expression, Operation)
        return self._function(expression)

    def _function(self, function: Operation) -> tuple[str, int]:
        """Return the LaTeX of a function or comparison, and its binding strength."""
        match function:
            case Operation("where", (Operation() as condition, yes, no)):
                # Iverson's brackets: 1 if the condition is true, 0 if not.
                other = Operation(_OPPOSITE[condition.name], condition.operands)
                terms = [
                    f"[{self.text(case)}]" + (rf"\,{self.text(value, _PRODUCT)}" if value != ONE else "")
                    for case, value in ((condition, yes), (other, no))
                    if value != ZERO
                ]
                return " + ".join(terms) or "0", _PRODUCT if len(terms) == 1 else _SUM
            case Operation("sum", (index, first, last, term)):
                limits = [self.text(part) for part in (index, first, last)]
                return rf"\sum_{{{limits[0]}={limits[1]}}}^{{{limits[2]}}} {self.text(term, _PRODUCT)}", _SUM
            case Operation("hypot", operands):
                return _FUNCTIONS["hypot"].format(*map(self._base, operands)), _ATOM
            case Operation(name, (left, right)) if name in COMPARISONS:
                return f"{self.text(left)} {_RELATIONS[name]} {self.text(right)}", 0
        rank = _POWER if function.name == "exp" else _ATOM
        return _FUNCTIONS[function.name].format(*map(self._operand, function.operands)), rank

    def _base(self, base: Expression) -> str:
        """Return the LaTeX of a power's base; functions get brackets, since an exponent would seem to belong to the name."""
        is_simple = isinstance(base, Number | Symbol) or getattr(base, "name", "") == "abs"
        return self.text(base, _ATOM) if is_simple else f"({self.text(base)})"

    def _product(self, product: Operation) -> str:
        """Return the LaTeX of a product: a common sign, numbers, then other factors; quotients are fractions."""
        text = ""
        order = {Number: 0, Symbol: 2, Operation: 2}
        factors = sorted(_factors(product), key=lambda item: 1 if item == Symbol("pi") else order[type(item)])
        for number, factor in enumerate(factors):
            match factor:
                case Operation("/", (above, below)):
                    added = rf"\frac{{{self.text(above)}}}{{{self.text(below)}}}"
                case _:
                    added = self.text(factor, _PRODUCT if number else _SIGNED)
            # Two numbers side by side would read as one.
            is_number = number and (text[-1].isdigit() or _POWER_OF_TEN.search(text))
            text += (r" \cdot " if is_number and added[0].isdigit() else " " * bool(number)) + added
        return text

    def _operand(self, operand: Expression) -> str:
        """Return the LaTeX of a function's operand; a quotient by a symbol is written with a slash."""
        match operand:
            case Operation("/", (above, Number() | Symbol() as below)):
                return f"{self.text(above, _SIGNED)}/{self.text(below, _ATOM)}"
        return self.text(operand)


def _signed(expression: Expression) -> bool:
    """Return whether the LaTeX of a term begins with a sign."""
    match expression:
        case Number(value):
            return value < 0
        case Operation("neg"):
            return True
        case Operation("+" | "-" | "*" | "/", (left, _)):
            return _signed(left)
    return False


def _factors(expression: Expression) -> list[Expression]:
    """Return the factors of a product and of the products in it."""
    match expression:
        case Operation("*", (left, right)):
            return [*_factors(left), *_factors(right)]
    return [expression]


TWO_PI = Operation("*", (Number(2.0), Symbol("pi")))


def _strip_two_pi(angle: Expression) -> Expression | None:
    """Return an angle divided by 2π if it has this factor, else None."""
    if angle == TWO_PI:
        return ONE
    match angle:
        case Operation("*", (left, right)):
            first = _strip_two_pi(left)
            second = _strip_two_pi(right) if first is None else None
            if first is not None or second is not None:
                return (left if first is None else first) * (right if second is None else second)
    return None


PORTABLE = {name: f"portable_{name}" for name in ("expm1", "tanh", "sinh", "arctan", "softplus")} | {
    "abs": "fabs",
    "sqrt": "sqrt",
    "sign": "sign",
    "min": "smaller",
    "max": "larger",
    "clip": "clipped",
}
"""C function of each operation that is a single function in C."""


def portable(expression: Expression) -> Expression:
    """Convert an expression to operations that give identical bits in C on every platform.

    Elementary functions become functions of ``portable_math.h`` and ``effect_forms.h``; whole powers become products.

    Parameters
    ----------
    expression : Expression
        Expression without ``sum``.
    """
    match expression:
        case Operation("**", (base, exponent)) if not whole_power(exponent):
            return Operation("portable_power", (portable(base), portable(exponent)))
        case Operation("exp", (operand,)):
            return Operation("portable_decay", (-portable(operand),))
        case Operation("sin" | "cos" as name, (operand,)):
            wave = "portable_sine" if name == "sin" else "portable_cosine"
            turns = _strip_two_pi(operand) or operand / Number(2 * math.pi)
            return Operation(wave, (portable(turns),))
        case Operation("hypot", operands):
            squares = [Operation("*", (side, side)) for side in map(portable, operands)]
            return Operation("sqrt", (Operation("+", tuple(squares)),))
        case Operation(name, operands):
            return Operation(PORTABLE.get(name, name), tuple(map(portable, operands)))
    return expression


_C_RANK = {"+": 1, "-": 1, "*": 2, "/": 2}


def c_text(expression: Expression, names: Mapping[str, str], rank: int = 0) -> str:
    """Return an expression as C99.

    Parameters
    ----------
    expression : Expression
        Result of `portable`.
    names : mapping of str to str
        C names of all symbols except ``pi``.
    rank : int, optional
        Text that binds less strongly is in brackets: 1 for a sum, 2 for a product, 3 for a sign.
    """
    match expression:
        case Number(value):
            text, bound = repr(float(value)), 5 if value >= 0 else 1
        case Symbol("pi"):
            return repr(math.pi)
        case Symbol(name):
            return names[name]
        case Operation("neg", (operand,)):
            text, bound = f"-{c_text(operand, names, 4)}", 3
        case Operation("**", (base, exponent)):
            text, bound = " * ".join([c_text(base, names, 3)] * whole_power(exponent)), 2
        case Operation("where", (condition, yes, no)):
            return "({} ? {} : {})".format(*(c_text(part, names, 1) for part in (condition, yes, no)))
        case Operation(name, (left, right)) if name in _C_RANK:
            # The operand on the right keeps its brackets: C computes sums and products from the left.
            bound = _C_RANK[name]
            text = f"{c_text(left, names, bound)} {name} {c_text(right, names, bound + 1)}"
        case Operation(name, (left, right)) if name in COMPARISONS:
            text, bound = f"{c_text(left, names, 1)} {name} {c_text(right, names, 1)}", 1
        case Operation(name, operands):
            return f"{name}({', '.join(c_text(operand, names, 0) for operand in operands)})"
    return f"({text})" if bound < rank else text


_ELEMENTS = {
    "math", "menclose", "mfrac", "mi", "mn", "mo", "mover", "mpadded", "mroot", "mrow", "mspace", "msqrt", "mstyle", "msub",
    "msubsup", "msup", "mtable", "mtd", "mtext", "mtr", "munder", "munderover",
}  # fmt: skip
_ATTRIBUTES = {"display", "displaystyle", "mathvariant", "scriptlevel", "stretchy", "width"}
"""Attributes of MathML that a page accepts from an equation; like the elements above, none of them is a link."""


def equation_mathml(latex: str) -> str:
    """Return an equation as a MathML element for HTML.

    Parameters
    ----------
    latex : str
        Mathematics without dollar signs; may come from an untrusted file.

    Raises
    ------
    InputError
        If the text is not LaTeX, has an unknown command, or has text or links that would become part of the page.
    """
    from xml.etree import ElementTree

    from latex2mathml.converter import convert

    try:
        element = ElementTree.fromstring(convert(" ".join(latex.split())))
    except Exception as error:  # the converter's own errors share no class of theirs
        raise InputError(f"equation {latex!r} is not in LaTeX that can be set: {error!r}") from error
    for part in element.iter():
        part.tag = part.tag.rpartition("}")[2]
        part.attrib = {name: value for name, value in part.attrib.items() if name in _ATTRIBUTES}
        if part.tag not in _ELEMENTS or "\\" in (part.text or ""):
            raise InputError(f"equation {latex!r} is not in LaTeX that can be set: {part.text or part.tag}")
    return ElementTree.tostring(element, "unicode")
