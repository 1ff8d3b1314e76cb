"""LaTeX, NumPy and C of every form say the same: LaTeX by sympy, C compiled and run."""

import re
import string

import numpy as np
import pytest
import sympy
from c_programs import NEGLIGIBLE, ON_LINUX, CModel
from effect_entries import BASE_NUMBERS, COMBINATIONS, FORM_NUMBERS, effect_entry
from runtime_models import exported, random_motion
from sympy.core.function import AppliedUndef
from sympy.parsing.latex import parse_latex_lark

from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.models.algebra import Evaluator
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import SampledMotion
from lumbar.tissue.models.parameter import FORCE, SIGNALS
from lumbar.tissue.models.printing import portable, symbol_latex
from lumbar.tissue.models.state_equation import STEP_SYMBOL

_FUNCTIONS = {
    r"\tanh": ("T", sympy.tanh),
    r"\sinh": ("N", sympy.sinh),
    r"\sin": ("A", sympy.sin),
    r"\cos": ("B", sympy.cos),
    r"\ln": ("L", sympy.log),
    r"\arctan": ("R", sympy.atan),
    r"\mathrm{sign}": ("S", sympy.sign),
    r"\mathrm{step}": ("P", lambda x: sympy.Piecewise((0, x < 0), (1, x > 1), (3 * x**2 - 2 * x**3, True))),
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


FORMS = {form.key: form for effect in TISSUE.values() for form in effect.forms}
EVERY_FORM = {
    form.key: form
    for forms in (
        *(effect.forms for catalogue in CATALOGUES.values() for effect in catalogue.values()),
        [base.form for base in BASES.values()],
    )
    for form in forms
}
HAND_WRITTEN = {
    "hysteresis/elastoplastic", "hysteresis/iwan", "delay/pure", "backlash/play",
}  # fmt: skip
"""What no equation says."""
CONTACTS = {"base/KV-contact", "base/KB-contact"}
"""Bases of a tool that leaves the tissue: no equation says when, and no FMU holds them."""
EQUATIONS = {key: form for key, form in EVERY_FORM.items() if key not in HAND_WRITTEN | CONTACTS}
CLOSED_FORMS = {"hysteresis/bouc_wen", "hysteresis/bouc_wen_general"}
STEPPED = HAND_WRITTEN | CLOSED_FORMS
"""Whose C code is written by hand; Bouc–Wen's are the closed forms of their equations."""
ON_OUTPUT = [key for key in FORM_NUMBERS if FORMS[key].place is Place.OUTPUT]
OTHERS = [key for key in FORM_NUMBERS if key not in {*ON_OUTPUT, *STEPPED}]
STRUCTURES = [
    *((base,) for base in BASE_NUMBERS),
    *(("KB", *OTHERS[start::6]) for start in range(6)),
    *(("KB", key) for key in ON_OUTPUT),
]
"""Every form at least once, several in one model so that few need compiling; a clipped force would hide others."""
WITH_HAND_WRITTEN = [
    ("KB", *sorted(STEPPED)[:3]),
    *(("LE", key) for key in sorted(STEPPED)[3:]),
    *COMBINATIONS,
]


@pytest.fixture(scope="module")
def c_folder(tmp_path_factory):
    """Return one folder for all models: what they have in common is compiled once."""
    return tmp_path_factory.mktemp("models")


def test_what_is_written_by_hand_is_known():
    assert {key for key, form in EVERY_FORM.items() if form.hand_written} == HAND_WRITTEN | CONTACTS
    assert {key for key, form in EVERY_FORM.items() if form.c_solution} == CLOSED_FORMS
    assert set(FORM_NUMBERS) == set(FORMS)
    in_c = {key for key, form in EVERY_FORM.items() if not form.channels and form.c_step is not None}
    assert {key for key, form in EVERY_FORM.items() if not form.channels} - in_c == CONTACTS


def in_expressions(model, positions: np.ndarray, functions: dict) -> np.ndarray:
    """A model's response from the very trees that its C code is printed from, on the C library's functions."""
    motion = SampledMotion.of_positions(positions, model.sampling_time)
    force = np.zeros(len(positions))
    with np.errstate(over="ignore"):
        for term in model.terms:
            equation = term.form.parsed_equation
            values = {
                item.symbol: value
                for item, value in zip(
                    (*term.form.linear, *term.form.nonlinear), (*term.linear, *term.nonlinear), strict=True
                )
            }
            if equation.state is not None:
                values |= _states(equation.state, motion, values, functions)
            values |= {name: signal.of(motion) for name, signal in SIGNALS.items() if not signal.channel}
            values[FORCE] = force
            first, *others = Evaluator(equation.portable_terms, functions)(values)
            total = first
            for other in others:
                total = total + other
            force = total if term.form.place is Place.OUTPUT else force + total
    return force


def _states(state, motion, values, functions) -> dict[str, np.ndarray]:
    """States step by step; each is on its own and begins at 0."""
    signals = {"v": motion.velocity, "dz": motion.increments}
    found = {}
    for part in state.apart:
        (name,) = part.names
        step = Evaluator([portable(part.scalar_step)], functions)
        path = [np.zeros(1)]
        for k in range(1, len(motion)):
            now = {symbol: signal[k : k + 1] for symbol, signal in signals.items()}
            path += step({**values, STEP_SYMBOL: motion.sampling_time, **now, name: path[-1]})
        found[name] = np.concatenate(path)
    return found


@ON_LINUX
@pytest.mark.parametrize("structure", STRUCTURES, ids="+".join)
def test_c_code_is_its_expression_bit_for_bit(structure, functions, zig_cache, c_folder):
    model = exported(effect_entry(*structure))
    inputs = random_motion(3000, seed=4)
    found = CModel(model, c_folder, zig_cache).response(inputs)
    expected = in_expressions(model.dynamics, inputs, functions)
    assert not np.any((np.abs(expected) < NEGLIGIBLE) & (expected != 0))
    np.testing.assert_array_equal(found, expected)
    plain = model.dynamics.response(inputs)
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-12 * max(1.0, np.abs(plain).max()))


@ON_LINUX
@pytest.mark.parametrize("structure", WITH_HAND_WRITTEN, ids="+".join)
def test_c_code_by_hand_is_the_catalogues_simulation(structure, zig_cache, c_folder):
    """Both are written by hand, in different ways: NumPy from reversal to reversal, C sample by sample."""
    model = exported(effect_entry(*structure))
    inputs = random_motion(3000, seed=4)
    found = CModel(model, c_folder, zig_cache).response(inputs)
    plain = model.dynamics.response(inputs)
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-12 * max(1.0, np.abs(plain).max()))


@pytest.mark.parametrize("form", EQUATIONS.values(), ids=lambda form: form.key)
def test_latex_is_the_simulation(form):
    """What sympy reads in the LaTeX gives the numbers of the columns, and the rates of the states."""
    equation = form.parsed_equation
    items = (*form.linear, *form.nonlinear, *form.constants)
    names = latex_names(items, [name for name, _ in form.state])
    force, *lines = form.latex.removeprefix(r"F \to ").split(r",\quad ")
    rates, constants = lines[: len(form.state)], lines[len(form.state) :]
    assert {names[name]: value for name, value in map(constant_of, constants)} == {
        item.symbol: item.value for item in form.constants
    }
    generator = np.random.default_rng(7)
    every = sorted({item.symbol for item in items} | {name for name, _ in form.state} | {*SIGNALS, FORCE})
    given = {name: generator.uniform(-1.5, 1.5, 40) for name in every}
    for item in (*form.nonlinear, *form.constants):
        given[item.symbol] = np.full(40, getattr(item, "value", 0.8))
    for name in ("t", "s", "box_held", "length"):
        given[name] = np.abs(given[name])
    assert _of(read_latex(force, names), given) == pytest.approx(
        _total(equation, given), rel=1e-11, abs=1e-12
    )
    for line, (name, slope) in zip(rates, equation.slopes.items(), strict=True):
        left, right = line.split(" = ")
        assert left == rf"\dot {name}"
        found = _of(read_latex(right, names), given)
        assert found == pytest.approx(Evaluator([slope])(given)[0], rel=1e-11, abs=1e-12)


def _of(reading: sympy.Expr, given: dict) -> np.ndarray:
    used = sorted(map(str, reading.free_symbols))
    compute = sympy.lambdify([sympy.Symbol(name, real=True) for name in used], reading, "numpy")
    return np.broadcast_to(compute(*(given[name] for name in used)), 40)


def _total(equation, given: dict) -> np.ndarray:
    """The columns times their parameters; of an output form what it makes of the force."""
    columns = Evaluator(equation.columns)(given)
    if equation.transforms:
        return columns[0]
    return sum(given[item.symbol] * column for item, column in zip(equation.linear, columns, strict=True))
