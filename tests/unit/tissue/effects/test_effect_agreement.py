"""LaTeX, NumPy and C of every form agree: LaTeX by sympy, C compiled and run."""

import re
import string

import numpy as np
import pytest
import sympy
from c_programs import NEGLIGIBLE, ON_LINUX, CModel
from effect_entries import BASE_NUMBERS, COMBINATIONS, FORM_NUMBERS, QUASI_LINEAR_NUMBERS, effect_entry
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
    """Return the symbols by LaTeX: parameters, constants, states and signals."""
    names = {item.latex or symbol_latex(item.symbol): item.symbol for item in parameters}
    names |= {symbol_latex(state): state for state in states}
    for symbol, signal in SIGNALS.items():
        names.setdefault(signal.latex or symbol, symbol)
    return {**names, "F": "F", r"\pi": "pi"}


def read_latex(text: str, names: dict[str, str]) -> sympy.Expr:
    """Return one side of an equation in sympy's symbols."""
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
    """Return the reading in which every letter of a function is a function."""
    letters = {sympy.Symbol(letter) for letter, _ in _FUNCTIONS.values()}
    readings = {item for item in getattr(read, "children", [read]) if not item.free_symbols & letters}
    assert len(readings) == 1, read
    return readings.pop()


def _numbered(term: str, number: int) -> str:
    return re.sub(r"\bn\b", str(number), re.sub(r"_n\b", f"_{number}", term))


def constant_of(text: str) -> tuple[str, float]:
    """Return LaTeX and value of a line like ``g = 9.81\\,\\mathrm{m/s^2}``."""
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
"""Forms without an equation."""
CONTACTS = {"base/KV-contact", "base/KB-contact"}
"""Bases of a tool that leaves the tissue: they have no equation and no FMU."""
EQUATIONS = {key: form for key, form in EVERY_FORM.items() if key not in HAND_WRITTEN | CONTACTS}
LONG_TO_READ = {"base/QLV-2", "base/QLV-power", "periodic_disturbance/overtones"}
"""Sympy needs seconds for each of these sums."""
CLOSED_FORMS = {"hysteresis/bouc_wen", "hysteresis/bouc_wen_general"}
STEPPED = HAND_WRITTEN | CLOSED_FORMS
"""Forms with hand-written C code; those of Bouc–Wen are closed forms of their equations."""
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
    *((base,) for base in QUASI_LINEAR_NUMBERS),
    *COMBINATIONS,
]


@pytest.fixture(scope="module")
def c_folder(tmp_path_factory):
    """Return one folder for all models: common parts are compiled a single time."""
    return tmp_path_factory.mktemp("models")


def test_list_of_hand_written_forms_is_complete():
    assert {key for key, form in EVERY_FORM.items() if form.hand_written} == HAND_WRITTEN | CONTACTS
    assert {key for key, form in EVERY_FORM.items() if form.c_solution} == CLOSED_FORMS | {
        f"base/{name}" for name in QUASI_LINEAR_NUMBERS
    }
    assert set(FORM_NUMBERS) == set(FORMS)
    in_c = {key for key, form in EVERY_FORM.items() if not form.channels and form.c_step is not None}
    assert {key for key, form in EVERY_FORM.items() if not form.channels} - in_c == CONTACTS


def evaluate_expressions(model, positions: np.ndarray, functions: dict) -> np.ndarray:
    """Return a model's response from the expression trees of its C code, on the functions of the C library."""
    motion = SampledMotion.from_positions(positions, model.sampling_time)
    force = np.zeros(len(positions))
    with np.errstate(over="ignore"):
        for term in model.terms:
            equation = term.form.parsed_equation
            parameters = (*term.form.linear, *term.form.nonlinear)
            values = {item.symbol: term.numbers[item.name] for item in parameters}
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
    """Return the states step by step; they are not coupled and start at 0."""
    signals = {"v": motion.velocity, "dz": motion.increments}
    states = {}
    for part in state.apart:
        (name,) = part.names
        step = Evaluator([portable(part.scalar_step)], functions)
        path = [np.zeros(1)]
        for k in range(1, len(motion)):
            now = {symbol: signal[k : k + 1] for symbol, signal in signals.items()}
            path += step({**values, STEP_SYMBOL: motion.sampling_time, **now, name: path[-1]})
        states[name] = np.concatenate(path)
    return states


@ON_LINUX
@pytest.mark.parametrize("structure", STRUCTURES, ids="+".join)
def test_c_code_is_its_expression_bit_for_bit(structure, functions, zig_cache, c_folder):
    model = exported(effect_entry(*structure))
    inputs = random_motion(3000, seed=4)
    response = CModel(model, c_folder, zig_cache).response(inputs)
    expected = evaluate_expressions(model.dynamics, inputs, functions)
    assert not np.any((np.abs(expected) < NEGLIGIBLE) & (expected != 0))
    np.testing.assert_array_equal(response, expected)
    plain = model.dynamics.response(inputs)
    np.testing.assert_allclose(response, plain, rtol=0, atol=1e-12 * max(1.0, np.abs(plain).max()))


@ON_LINUX
@pytest.mark.parametrize("structure", WITH_HAND_WRITTEN, ids="+".join)
def test_hand_written_c_code_equals_the_simulation(structure, zig_cache, c_folder):
    """NumPy goes from reversal to reversal, C from sample to sample."""
    model = exported(effect_entry(*structure))
    inputs = random_motion(3000, seed=4)
    response = CModel(model, c_folder, zig_cache).response(inputs)
    plain = model.dynamics.response(inputs)
    np.testing.assert_allclose(response, plain, rtol=0, atol=1e-12 * max(1.0, np.abs(plain).max()))


@pytest.mark.parametrize(
    "form",
    [
        pytest.param(form, id=key, marks=[pytest.mark.nightly] * (key in LONG_TO_READ))
        for key, form in EQUATIONS.items()
    ],
)
def test_latex_gives_the_columns_and_rates(form):
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
    assert _evaluate(read_latex(force, names), given) == pytest.approx(
        _total(equation, given), rel=1e-11, abs=1e-12
    )
    for line, (name, slope) in zip(rates, equation.slopes.items(), strict=True):
        left, right = line.split(" = ")
        assert left == rf"\dot {name}"
        rate = _evaluate(read_latex(right, names), given)
        assert rate == pytest.approx(Evaluator([slope])(given)[0], rel=1e-11, abs=1e-12)


def _evaluate(reading: sympy.Expr, given: dict) -> np.ndarray:
    used = sorted(map(str, reading.free_symbols))
    compute = sympy.lambdify([sympy.Symbol(name, real=True) for name in used], reading, "numpy")
    return np.broadcast_to(compute(*(given[name] for name in used)), 40)


def _total(equation, given: dict) -> np.ndarray:
    """Return the sum of columns times parameters, or the output of an output form."""
    columns = Evaluator(equation.columns)(given)
    if equation.transforms:
        return columns[0]
    return sum(given[item.symbol] * column for item, column in zip(equation.linear, columns, strict=True))
