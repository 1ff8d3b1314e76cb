"""Expressions as LaTeX and as C, and LaTeX as the MathML of a page."""

import math
import re
from collections.abc import Mapping
from pathlib import Path

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.expression import (
    COMPARISONS,
    Expression,
    Number,
    Operation,
    Symbol,
    divide,
    multiply,
    negate,
    whole_power,
)

_GREEK = {
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi", "pi",
    "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Xi", "Lambda", "Pi", "Sigma",
    "Upsilon", "Phi", "Psi", "Omega",
}  # fmt: skip


def symbol_latex(symbol: str) -> str:
    """LaTeX of a symbol: what follows the first letter, a Greek name or an underscore is its index.

    Examples
    --------
    >>> symbol_latex("Fc"), symbol_latex("tau_2"), symbol_latex("k3"), symbol_latex("v_St")
    ('F_c', '\\\\tau_2', 'k_3', 'v_{St}')
    """
    head, _, index = symbol.partition("_")
    if head not in _GREEK and len(head) > 1:
        start = next(
            (name for name in sorted(_GREEK, key=len, reverse=True) if head.startswith(name)), head[0]
        )
        head, index = start, head[len(start) :] + index
    head = f"\\{head}" if head in _GREEK else head
    return head + (f"_{index}" if len(index) == 1 else f"_{{{index}}}" if index else "")


def number_latex(text: str) -> str:
    """LaTeX of a formatted number: powers of ten instead of an ``e``.

    Examples
    --------
    >>> number_latex("1e-06"), number_latex("-2.5e+07"), number_latex("0.5")
    ('10^{-6}', '-2.5 \\\\cdot 10^{7}', '0.5')
    """
    mantissa, e, exponent = text.partition("e")
    if not e:
        return text
    power = f"10^{{{int(exponent)}}}"
    return mantissa.replace("1", power) if mantissa in ("1", "-1") else rf"{mantissa} \cdot {power}"


def latex(expression: Expression, names: Mapping[str, str]) -> str:
    """LaTeX in the part that matplotlib sets too.

    `names` holds the LaTeX of symbols; that of others is derived.

    Examples
    --------
    >>> from lumbar.tissue.models.expression import parse
    >>> latex(parse("Fc*tanh(v/vs)"), {})
    'F_c \\\\tanh(v/v_s)'
    """
    return _Latex(names).text(expression, 0)


_SUM, _SIGNED, _PRODUCT, _POWER, _ATOM = 1, 2, 3, 4, 5
_POWER_OF_TEN = re.compile(r"10\^\{-?\d+\}$")
_CALLED: dict[str, str] = shipped_yaml(Path(__file__).with_name("functions.yaml"))["latex"]
_RELATIONS = {"<": "<", "<=": r"\leq", ">": ">", ">=": r"\geq"}
_OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}


class _Latex:
    def __init__(self, names: Mapping[str, str]):
        self.names = names

    def text(self, expression: Expression, rank: int) -> str:
        """LaTeX, in brackets where it binds less than `rank`."""
        text, own = self._text(expression)
        return f"({text})" if own < rank else text

    def _text(self, expression: Expression) -> tuple[str, int]:
        match expression:
            case Number(value):
                text = number_latex(f"{value:.12g}")
                own = _PRODUCT if "cdot" in text else _POWER if "^" in text else _ATOM
                return text, own if value >= 0 else _SUM
            case Symbol(name):
                return self.names.get(name) or symbol_latex(name), _ATOM
            case Operation("+" | "-" as name, (left, right)):
                below = _SUM if name == "+" else _PRODUCT
                second = f"({self.text(right, 0)})" if _signed(right) else self.text(right, below)
                return f"{self.text(left, _SUM)} {name} {second}", _SUM
            case Operation("neg", (operand,)):
                return f"-{self.text(operand, _PRODUCT)}", _SIGNED
            case Operation("*"):
                return self._product(expression), _PRODUCT
            case Operation("/", (above, below)):
                return self._quotient(above, below)
            case Operation("**", (base, exponent)):
                raised = self._operand(exponent)
                return self._base(base) + (f"^{raised}" if len(raised) == 1 else f"^{{{raised}}}"), _POWER
            case Operation("where", operands):
                return self._choice(*operands)  # type: ignore[arg-type]  # the first is a comparison
            case Operation("sum", (index, first, last, term)):
                limits = [self.text(part, 0) for part in (index, first, last)]
                return rf"\sum_{{{limits[0]}={limits[1]}}}^{{{limits[2]}}} {self.text(term, _PRODUCT)}", _SUM
            case Operation("hypot", operands):
                return _CALLED["hypot"].format(*map(self._base, operands)), _ATOM
            case Operation(name, (left, right)) if name in COMPARISONS:
                return f"{self.text(left, 0)} {_RELATIONS[name]} {self.text(right, 0)}", 0
            case Operation(name, operands):
                own = _POWER if name == "exp" else _ATOM
                return _CALLED[name].format(*map(self._operand, operands)), own

    def _base(self, base: Expression) -> str:
        """Base of a power; functions get brackets, for a power after a name is read as the name's."""
        simple = isinstance(base, Number | Symbol) or base.name == "abs"
        return self.text(base, _ATOM) if simple else f"({self.text(base, 0)})"

    def _product(self, product: Operation) -> str:
        """Factors side by side, numbers first; a sign stands before them all, and quotients are fractions."""
        first, *others = sorted(
            _factors(product),
            key=lambda item: 0 if isinstance(item, Number) else 1 if item == Symbol("pi") else 2,
        )
        text, *factors = [self._factor(first, _SIGNED), *(self._factor(other, _PRODUCT) for other in others)]
        for factor in factors:
            # Two numbers side by side would read as one.
            number = text[-1].isdigit() or _POWER_OF_TEN.search(text)
            joint = r" \cdot " if number and factor[0].isdigit() else " "
            text += joint + factor
        return text

    def _factor(self, factor: Expression, rank: int) -> str:
        match factor:
            case Operation("/", operands):
                return rf"\frac{{{self.text(operands[0], 0)}}}{{{self.text(operands[1], 0)}}}"
        return self.text(factor, rank)

    def _operand(self, operand: Expression) -> str:
        """Operand of a function; a sum over a symbol stays on the line."""
        match operand:
            case Operation("/", (above, Number() | Symbol() as below)):
                return f"{self.text(above, _SIGNED)}/{self.text(below, _ATOM)}"
        return self.text(operand, 0)

    def _quotient(self, above: Expression, below: Expression) -> tuple[str, int]:
        # A numerator is read as one before a slash if it is a number, a symbol, |F|, or −z.
        match above:
            case Number() | Symbol() | Operation("abs") | Operation("neg", (Number() | Symbol(),)):
                is_simple = True
            case _:
                is_simple = False
        if is_simple and isinstance(below, Number | Symbol):
            return f"{self.text(above, _SIGNED)}/{self.text(below, _ATOM)}", _PRODUCT
        return rf"\frac{{{self.text(above, 0)}}}{{{self.text(below, 0)}}}", _ATOM

    def _choice(self, condition: Operation, yes: Expression, no: Expression) -> tuple[str, int]:
        """Iverson's brackets: 1 where they hold, 0 where not."""
        zero = Number(0.0)
        other = Operation(_OPPOSITE[condition.name], condition.operands)
        terms = [
            f"[{self.text(said, 0)}]" + ("" if chosen == Number(1.0) else rf"\,{self.text(chosen, _PRODUCT)}")
            for said, chosen in ((condition, yes), (other, no))
            if chosen != zero
        ]
        return " + ".join(terms) or "0", _PRODUCT if len(terms) == 1 else _SUM


def _signed(expression: Expression) -> bool:
    """Whether the LaTeX of a term begins with a sign."""
    match expression:
        case Number(value):
            return value < 0
        case Operation("neg"):
            return True
        case Operation("+" | "-" | "*" | "/", (left, _)):
            return _signed(left)
    return False


def _factors(expression: Expression) -> list[Expression]:
    """Factors of a product and of the products in it."""
    match expression:
        case Operation("*", (left, right)):
            return [*_factors(left), *_factors(right)]
    return [expression]


TWO_PI = Operation("*", (Number(2.0), Symbol("pi")))


def _without_two_pi(angle: Expression) -> Expression | None:
    """An angle in turns, if 2π is a factor of it."""
    if angle == TWO_PI:
        return Number(1.0)
    match angle:
        case Operation("*", (left, right)):
            if (rest := _without_two_pi(left)) is not None:
                return multiply(rest, right)
            if (rest := _without_two_pi(right)) is not None:
                return multiply(left, rest)
    return None


PORTABLE = {name: f"portable_{name}" for name in ("expm1", "tanh", "sinh", "arctan", "softplus")} | {
    "abs": "fabs",
    "sqrt": "sqrt",
    "sign": "sign",
    "min": "smaller",
    "max": "larger",
    "clip": "clipped",
}
"""Operations that are one function in C."""


def portable(expression: Expression) -> Expression:
    """The expression in operations whose bits are the same on every platform: what C computes.

    Elementary functions become those of ``portable_math.h`` and of ``effect_forms.h``, whole powers products.
    """
    match expression:
        case Operation("**", (base, exponent)) if not whole_power(exponent):
            return Operation("portable_power", (portable(base), portable(exponent)))
        case Operation("exp", (operand,)):
            return Operation("portable_decay", (negate(portable(operand)),))
        case Operation("sin" | "cos" as name, (operand,)):
            wave = "portable_sine" if name == "sin" else "portable_cosine"
            turns = _without_two_pi(operand) or divide(operand, Number(2 * math.pi))
            return Operation(wave, (portable(turns),))
        case Operation("hypot", operands):
            squares = [Operation("*", (side, side)) for side in map(portable, operands)]
            return Operation("sqrt", (Operation("+", tuple(squares)),))
        case Operation(name, operands):
            return Operation(PORTABLE.get(name, name), tuple(map(portable, operands)))
    return expression


_C_RANK = {"+": 1, "-": 1, "*": 2, "/": 2}


def c_text(expression: Expression, names: Mapping[str, str], rank: int = 0) -> str:
    """C99 for what `portable` returns, with the C names of the symbols; in brackets if it binds less than `rank`."""
    match expression:
        case Number(value):
            text, own = repr(float(value)), 5 if value >= 0 else 1
        case Symbol("pi"):
            return repr(math.pi)
        case Symbol(name):
            return names[name]
        case Operation("neg", (operand,)):
            text, own = f"-{c_text(operand, names, 4)}", 3
        case Operation("**", (base, exponent)):
            factor = c_text(base, names, 3)
            text, own = " * ".join([factor] * whole_power(exponent)), 2
        case Operation("where", (condition, yes, no)):
            chosen = (c_text(part, names, 1) for part in (condition, yes, no))
            return "({} ? {} : {})".format(*chosen)
        case Operation(name, (left, right)) if name in _C_RANK:
            # The operand on the right keeps its brackets: C computes sums and products from the left.
            own = _C_RANK[name]
            text = f"{c_text(left, names, own)} {name} {c_text(right, names, own + 1)}"
        case Operation(name, (left, right)) if name in COMPARISONS:
            text, own = f"{c_text(left, names, 1)} {name} {c_text(right, names, 1)}", 1
        case Operation(name, operands):
            return f"{name}({', '.join(c_text(operand, names, 0) for operand in operands)})"
    return f"({text})" if own < rank else text


_ELEMENTS = {
    "math", "menclose", "mfrac", "mi", "mn", "mo", "mover", "mpadded", "mroot", "mrow", "mspace", "msqrt", "mstyle", "msub",
    "msubsup", "msup", "mtable", "mtd", "mtext", "mtr", "munder", "munderover",
}  # fmt: skip
_ATTRIBUTES = {"display", "displaystyle", "mathvariant", "scriptlevel", "stretchy", "width"}
"""`_ELEMENTS`, `_ATTRIBUTES`: of MathML, that a page takes from an equation: none leads anywhere."""


def equation_mathml(latex: str) -> str:
    """Return an equation as a MathML element, which HTML holds as it does text.

    Parameters
    ----------
    latex : str
        Mathematics, without dollar signs; may come from an untrusted file.

    Raises
    ------
    InputError
        If it is not LaTeX, has an unknown command, or has text or links that would become part of the page.
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
