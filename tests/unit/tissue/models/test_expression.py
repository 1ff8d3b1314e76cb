"""Expressions: what is read and refused, and derivative, split and texts against sympy and NumPy."""

import numpy as np
import pytest
import sympy

from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.models.algebra import Evaluator, check_powers, derivative, linear_parts
from lumbar.tissue.models.expression import expand_sums, parse, symbols, to_text
from lumbar.tissue.models.printing import c_text, latex, portable, symbol_latex

FORMS = [form for catalogue in CATALOGUES.values() for effect in catalogue.values() for form in effect.forms]
EQUATIONS = sorted({form.equation for form in FORMS if not form.hand_written})
SMOOTH = [
    "a*b + c/d - a*c*b",
    "-a**2 + (-b)**3/(c - d)",
    "exp(-(a/b)**2)*tanh(c/d)",
    "expm1(a/b)*sinh(c) + sin(2*pi*d)*cos(a*b)",
    "arctan(a/b) + sqrt(a**2 + b**2) - softplus(c/d)",
    "hypot(a, b)/(1 + c)**2 + max(a, 0)**1.5",
    "min(a, b)*max(c, d) + abs(b - a)*sign(c)",
    "where(a < b, a*c, b*d)",
    "clip(a, -1, b)",
    "smoothstep(c/4)",
]
"""Differentiable at the points at which they are tried."""
GIVEN = {"a": 0.7, "b": -1.3, "c": 1.9, "d": 0.4}


def in_sympy(text: str) -> sympy.Expr:
    """The text as sympy reads it, with real symbols."""
    functions = {
        "abs": sympy.Abs, "min": sympy.Min, "max": sympy.Max, "arctan": sympy.atan, "sign": sympy.sign,
        "expm1": lambda x: sympy.exp(x) - 1, "softplus": lambda x: sympy.log(1 + sympy.exp(x)),
        "hypot": lambda x, y: sympy.sqrt(x**2 + y**2), "clip": lambda x, low, high: sympy.Min(sympy.Max(x, low), high),
        "smoothstep": lambda x: sympy.Piecewise((0, x < 0), (3 * x**2 - 2 * x**3, x < 1), (1, True)),
        "where": lambda condition, yes, no: sympy.Piecewise((yes, condition), (no, True)),
    }  # fmt: skip
    names = {name: sympy.Symbol(name, real=True) for name in GIVEN}
    return sympy.sympify(text, locals={**functions, **names})


def at(expression, given=GIVEN) -> float:
    return float(Evaluator([expand_sums(expression)])(given)[0])


@pytest.mark.parametrize("text", SMOOTH)
def test_values_and_derivatives_are_sympys(text):
    reading = in_sympy(text)
    points = {sympy.Symbol(name, real=True): value for name, value in GIVEN.items()}
    assert at(parse(text)) == pytest.approx(float(reading.subs(points)), rel=1e-13)
    for name in symbols(parse(text)):
        slope = reading.diff(sympy.Symbol(name, real=True)).subs(points).doit()
        assert at(derivative(parse(text), name)) == pytest.approx(float(slope), rel=1e-12, abs=1e-13)


def test_operations_keep_the_order_in_which_they_are_written():
    """Of three terms and factors no two orders round alike here."""
    for text in ("a + b + c", "a + (b + c)", "a*b*c", "a*(b*c)", "a/b*c", "a*b/c"):
        given = {"a": 0.1, "b": 0.2, "c": 0.3}
        assert at(parse(text), given) == eval(text, {}, given)  # the test's own text
    assert at(parse("a + b + c"), given) != at(parse("a + (b + c)"), given)


@pytest.mark.parametrize("text", [*SMOOTH, *EQUATIONS])
def test_what_is_written_is_read_again(text):
    assert parse(to_text(parse(text))) == parse(text)


@pytest.mark.parametrize("text", EQUATIONS)
def test_splitting_loses_nothing(text):
    """The sum of parameters times their parts is the equation, by numbers."""
    form = next(form for form in FORMS if form.equation == text)
    if not form.linear:
        return
    tree = expand_sums(parse(text))
    generator = np.random.default_rng(3)
    given = {name: generator.uniform(0.1, 2.0) for name in symbols(tree)}
    split = linear_parts(tree, [item.symbol for item in form.linear])
    total = sum(given[name] * at(part, given) for name, part in split.items())
    assert total == pytest.approx(at(tree, given), rel=1e-13)
    assert not set().union(*map(symbols, split.values())) & {item.symbol for item in form.linear}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "'' is no expression"),
        ("Fc*tanh(v/vs", "cannot be read .*'\\(' was never closed"),
        ("__import__('os').system('true')", "is not allowed; allowed are numbers, symbols"),
        ("z.real", "'z.real' is not allowed"),
        ("[z][0]", "is not allowed"),
        ("lambda: z", "is not allowed"),
        ("z % 2", "'z % 2' is not allowed"),
        ("+z", "'\\+z' is not allowed"),
        ("'z'", "is not allowed"),
        ("1j*z", "is not allowed"),
        ("1e999*z", "numbers are finite"),
        (f"{10**400}*z", "numbers are finite"),
        ("atan2(z, v)", "'atan2\\(z, v\\)' is not allowed; functions are abs, sign"),
        ("tanh(z, v)", "tanh takes 1 operands and got 2"),
        ("tanh*z", "the function tanh needs operands"),
        ("z < v", "'z < v' is not allowed; a comparison may only be"),
        ("where(z, 1, 2)", "where\\(\\) begins with one comparison"),
        ("where(0 < z < v, 1, 2)", "where\\(\\) begins with one comparison"),
        ("sum(n, 1, 1000, z)", "at most 32 terms"),
        ("sum(n, 1, 3, sum(m, 1, 3, z))", "no sum in a sum"),
        ("größe*z", "symbols are letters a to z"),
        ("z" * 3000, "3000 characters; at most 2000"),
        ("-" * 80 + "z", "nested more than 60 deep"),
        ("(" * 500 + "z" + ")" * 500, "cannot be read"),
        ("+".join(["z"] * 80), "nested more than 60 deep"),
        ("+".join(f"({'+'.join(['z'] * 30)})" for _ in range(15)), "more than 400 operations"),
    ],
)
def test_everything_else_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        parse(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("z + k*v", "z holds no linear parameter"),
        ("tanh(k*z)", r"tanh\(k\*z\) is not proportional to k"),
        ("k**2*z", r"k\*\*2 is not proportional to k"),
        ("k*c*z", r"k\*c is not proportional to c, k"),
        ("z/k", "z/k is not proportional to k"),
        ("where(k > z, k, c)", "is not proportional to c, k"),
    ],
)
def test_a_force_that_is_not_proportional_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        linear_parts(parse(text), ("k", "c"))


@pytest.mark.parametrize("text", ["z**n", "(z - a)**1.5", "sin(z)**n", "z**-1"])
def test_a_broken_power_of_what_may_be_negative_is_refused(text):
    with pytest.raises(InputError, match=r"may be negative.*write abs\(…\) or max\(…, 0\)"):
        check_powers(parse(text), {"n"})


@pytest.mark.parametrize("text", ["abs(z)**n", "max(z, 0)**1.5", "(n + z**2)**n", "z**3", "(n/(1 + n))**0.5"])
def test_other_powers_are_not(text):
    check_powers(parse(text), {"n"})


def test_a_state_in_an_exponent_is_refused():
    with pytest.raises(InputError, match="may not stand in an exponent"):
        derivative(parse("abs(z)**r"), "r")


@pytest.mark.parametrize(
    ("symbol", "expected"),
    [("Fc", "F_c"), ("tau_2", r"\tau_2"), ("tau2", r"\tau_2"), ("v_St", "v_{St}"), ("k", "k"), ("theta_e", r"\theta_e"),
     ("k_e", "k_e"), ("theta", r"\theta"), ("Gamma", r"\Gamma"), ("x12", "x_{12}"), ("pi", r"\pi")],
)  # fmt: skip
def test_symbols_as_latex(symbol, expected):
    assert symbol_latex(symbol) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a - (b - c)", "a - (b - c)"),
        ("a - (-b)", "a - (-b)"),
        ("a*(b + c)", "a (b + c)"),
        ("(a + b)/(c*d)", r"\frac{a + b}{c d}"),
        ("3*2*a", r"3 \cdot 2 a"),
        ("(a*b)**2", "(a b)^2"),
        ("where(a > 0, b, 0)*c", r"[a > 0]\,b c"),
        ("where(a > 0, b, c)", r"[a > 0]\,b + [a \leq 0]\,c"),
    ],
)
def test_latex_keeps_the_brackets_that_count(text, expected):
    assert latex(parse(text), {}) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a - (b - c)", "a - (b - c)"),
        ("-(-a)", "-(-a)"),
        ("1/2*a", "1.0 / 2.0 * a"),
        ("sin(2*pi*a*b)", "portable_sine(a * b)"),
        ("cos(a)", "portable_cosine(a / 6.283185307179586)"),
        ("exp(-a/b)", "portable_decay(a / b)"),
        ("abs(a)**b", "portable_power(fabs(a), b)"),
        ("(a + b)**2", "(a + b) * (a + b)"),
        ("c/a**2", "c / (a * a)"),
        ("where(a < b, a, -b)", "(a < b ? a : -b)"),
    ],
)
def test_c_keeps_order_and_brackets(text, expected):
    assert c_text(portable(parse(text)), dict(zip("abcd", "abcd", strict=True))) == expected
