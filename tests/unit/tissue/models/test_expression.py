"""Expressions and states by differential equations: what is refused; against sympy, NumPy, a solver, closed forms and C."""

import re
from dataclasses import replace

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

from case_tables import cases
from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.models.algebra import Evaluator, check_powers, derivative, linear_parts
from lumbar.tissue.models.equation import Equation
from lumbar.tissue.models.expression import expand_sums, parse, symbols, to_text
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.parameter import Constant, LinearParameter
from lumbar.tissue.models.printing import c_text, latex, portable, symbol_latex
from lumbar.tissue.models.state_equation import StateEquation

FORMS = [form for catalogue in CATALOGUES.values() for effect in catalogue.values() for form in effect.forms]
EQUATIONS = sorted({form.equation for form in FORMS if not form.hand_written})
SMOOTH = cases(__file__, "smooth")
"""Differentiable at the points at which they are tried."""
GIVEN = {"a": 0.7, "b": -1.3, "c": 1.9, "d": 0.4}


def read_with_sympy(text: str) -> sympy.Expr:
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


def evaluate(expression, given=GIVEN) -> float:
    return float(Evaluator([expand_sums(expression)])(given)[0])


@pytest.mark.parametrize("text", SMOOTH)
def test_values_and_derivatives_match_sympy(text):
    reading = read_with_sympy(text)
    points = {sympy.Symbol(name, real=True): value for name, value in GIVEN.items()}
    assert evaluate(parse(text)) == pytest.approx(float(reading.subs(points)), rel=1e-13)
    for name in symbols(parse(text)):
        slope = reading.diff(sympy.Symbol(name, real=True)).subs(points).doit()
        assert evaluate(derivative(parse(text), name)) == pytest.approx(float(slope), rel=1e-12, abs=1e-13)


def test_operations_keep_their_written_order():
    """Three terms or factors round differently in each order here."""
    for text in ("a + b + c", "a + (b + c)", "a*b*c", "a*(b*c)", "a/b*c", "a*b/c"):
        given = {"a": 0.1, "b": 0.2, "c": 0.3}
        assert evaluate(parse(text), given) == eval(text, {}, given)  # the test's own text
    assert evaluate(parse("a + b + c"), given) != evaluate(parse("a + (b + c)"), given)


@pytest.mark.parametrize("text", [*SMOOTH, *EQUATIONS])
def test_written_content_is_read_again(text):
    assert parse(to_text(parse(text))) == parse(text)


@pytest.mark.parametrize("text", EQUATIONS)
def test_linear_parts_sum_to_equation(text):
    """The sum of parameters times their parts is the equation, by numbers."""
    form = next(form for form in FORMS if form.equation == text)
    if not form.linear:
        return
    tree = expand_sums(parse(text))
    generator = np.random.default_rng(3)
    given = {name: generator.uniform(0.1, 2.0) for name in symbols(tree)}
    split = linear_parts(tree, [item.symbol for item in form.linear])
    total = sum(given[name] * evaluate(part, given) for name, part in split.items())
    assert total == pytest.approx(evaluate(tree, given), rel=1e-13)
    assert not set().union(*map(symbols, split.values())) & {item.symbol for item in form.linear}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *cases(__file__, "refused"),
        (f"{10**400}*z", r"'10+…'.*\bfinite\b"),
        ("z" * 3000, r"\b3000\b.*\b2000\b"),
        ("(" * 500 + "z" + ")" * 500, r"'\(+…'.*parentheses"),
        ("+".join(["z"] * 80), r"'[z+]+…'.*\b60\b"),
        ("+".join(f"({'+'.join(['z'] * 30)})" for _ in range(15)), r"\b400\b"),
    ],
)
def test_forbidden_expressions_are_rejected(text, message):
    with pytest.raises(InputError, match=message):
        parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("z + k*v", r"^z .*\blinear\b"),
        ("tanh(k*z)", r"tanh\(k\*z\) .*\bk\b.*\bnonlinear\b"),
        ("k**2*z", r"k\*\*2 .*\bk\b.*\bnonlinear\b"),
        ("k*c*z", r"k\*c .*\bc, k\b.*\bnonlinear\b"),
        ("z/k", r"z/k .*\bk\b.*\bnonlinear\b"),
        ("where(k > z, k, c)", r"where\(k > z, k, c\) .*\bc, k\b.*\bnonlinear\b"),
    ],
)
def test_force_not_proportional_to_its_parameter_is_rejected(text, message):
    with pytest.raises(InputError, match=message):
        linear_parts(parse(text), ("k", "c"))


def test_broken_powers_need_a_base_that_is_never_negative():
    for text in ("z**n", "(z - a)**1.5", "sin(z)**n", "z**-1"):
        with pytest.raises(InputError, match=rf"{re.escape(text)}: .*abs\(…\).*max\(…, 0\)"):
            check_powers(parse(text), {"n"})
    for text in ("abs(z)**n", "max(z, 0)**1.5", "(n + z**2)**n", "z**3", "(n/(1 + n))**0.5"):
        check_powers(parse(text), {"n"})


@pytest.mark.parametrize(
    ("equation", "state", "place"),
    [
        ("c*sqrt(abs(v))", "", r"equation: .*\bderivative\b.*\bv\b"),
        ("c*sign(v)*abs(v)**0.5", "", r"equation: .*\bderivative\b.*\bv\b"),
        ("c*sqrt(z**2)", "", r"equation: .*\bderivative\b.*\bz\b"),
        ("c*v/abs(v)", "", r"equation: .*\bvalue\b"),
        ("c*r", "sqrt(abs(v)) - r", r"state\.r: .*\bderivative\b.*\bv\b"),
    ],
)
def test_form_check_reports_infinite_values_and_slopes_at_rest(equation, state, place):
    states = (("r", state),) if state else ()
    form = Form("odd", equation, Place.PARALLEL, (LinearParameter("c", "{y}", symbol="c"),), state=states)
    with pytest.raises(InputError, match=rf"{place}.*z = 0, v = 0"):
        form.check()
    for finite in ("c*tanh(v)", "c*abs(v)*v", "c*sqrt(v**2 + 1)"):
        replace(form, equation=finite, state=()).check()


@pytest.mark.parametrize(
    ("symbol", "expected"),
    [("Fc", "F_c"), ("tau_2", r"\tau_2"), ("tau2", r"\tau_2"), ("v_St", "v_{St}"), ("k", "k"), ("theta_e", r"\theta_e"),
     ("k_e", "k_e"), ("theta", r"\theta"), ("Gamma", r"\Gamma"), ("x12", "x_{12}"), ("pi", r"\pi")],
)  # fmt: skip
def test_symbols_as_latex(symbol, expected):
    assert symbol_latex(symbol) == expected


@pytest.mark.parametrize(("text", "expected"), cases(__file__, "latex_symbol"))
def test_latex_keeps_the_brackets_that_count(text, expected):
    assert latex(parse(text), {}) == expected


def test_constants_in_latex_have_powers_of_ten():
    small = Equation(
        "e*k*z", False, (LinearParameter("k", "1", symbol="k"),), (), (Constant("e", 1e-6, "mm"),), ()
    )
    assert small.latex == r"e k z,\quad e = 10^{-6}\,\mathrm{mm}"


@pytest.mark.parametrize(("text", "expected"), cases(__file__, "in_c"))
def test_c_keeps_order_and_brackets(text, expected):
    assert c_text(portable(parse(text)), dict(zip("abcd", "abcd", strict=True))) == expected


STEP = 0.01
SOLVED = {form.key: form for effect in TISSUE.values() for form in effect.forms if form.solution is not None}


def walk(seed: int, samples: int = 400) -> np.ndarray:
    """Positions with reversals and rests."""
    generator = np.random.default_rng(seed)
    steps = generator.standard_normal(samples) * 0.1
    steps[generator.random(samples) < 0.1] = 0.0
    return np.cumsum(steps) - steps[0]


def straight(positions: np.ndarray, sampling_time: float = STEP) -> Motion:
    """Motion in straight lines between samples."""
    return Motion(np.arange(len(positions)) * sampling_time, positions, sampling_time, smooth=False)


def equations(**slopes: str) -> StateEquation:
    return StateEquation({name: expand_sums(parse(text)) for name, text in slopes.items()})


def solved(state: StateEquation, motion: Motion, slope, values: dict) -> np.ndarray:
    """States by Runge and Kutta between samples, where nothing has a kink; shape (states, samples)."""
    result = [np.zeros(len(state.names))]
    for k in range(len(motion) - 1):
        velocity = motion.increments[k + 1] / motion.sampling_time

        def rate(time, r, k=k, velocity=velocity):
            position = motion.position[k] + velocity * time
            path = motion.path[k] + abs(velocity) * time
            return slope(r, position, velocity, motion.time[k] + time, path, **values)

        step = (0, motion.sampling_time)
        result.append(solve_ivp(rate, step, result[-1], "DOP853", rtol=1e-11, atol=1e-13).y[:, -1])
    return np.array(result).T


CASES = {
    "maxwell": ({"q": "v - q/tau"}, lambda r, z, v, t, s, tau: [v - r[0] / tau], {"tau": 0.03}),
    "dahl": ({"r": "v/d*(1 - r*sign(v))"}, lambda r, z, v, t, s, d: [v / d * (1 - r[0] * np.sign(v))], {"d": 0.2}),
    "zener in positions": ({"q": "(k*z - q)/tau"}, lambda r, z, v, t, s, k, tau: [(k * z - r[0]) / tau], {"k": 2.0, "tau": 0.05}),
    "two branches, coupled": (
        {"p": "v - p/tau + q/T", "q": "p/T - q/tau + t - s"},
        lambda r, z, v, t, s, tau, T: [v - r[0] / tau + r[1] / T, r[0] / T - r[1] / tau + t - s],
        {"tau": 0.05, "T": 0.3},
    ),
    "an oscillator": (
        {"x": "y", "y": "w**2*(z - x) - 2*w*c*y"},
        lambda r, z, v, t, s, w, c: [r[1], w**2 * (z - r[0]) - 2 * w * c * r[1]],
        {"w": 40.0, "c": 0.2},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_linear_equations_are_solved_exactly(case):
    texts, slope, values = CASES[case]
    state, motion = equations(**texts), straight(walk(1))
    result = state.trajectory(motion, values)
    expected = solved(state, motion, slope, values)
    for name, wanted in zip(state.names, expected, strict=True):
        assert np.abs(result[name] - wanted).max() < 1e-9 * np.abs(expected).max()


NONLINEAR = {
    "stiffening branch": (
        {"q": "v - q/tau*(1 + (q/q_1)**2)"},
        lambda r, z, v, t, s, tau, q_1: [v - r[0] / tau * (1 + (r[0] / q_1) ** 2)],
        {"tau": 0.05, "q_1": 0.2},
    ),
    "two states": (
        {"p": "v - sinh(p/c)/tau", "q": "(p*p - q)/tau + z"},
        lambda r, z, v, t, s, tau, c: [v - np.sinh(r[0] / c) / tau, (r[0] * r[0] - r[1]) / tau + z],
        {"tau": 0.05, "c": 0.3},
    ),
}


@pytest.mark.parametrize("case", NONLINEAR)
def test_other_equations_are_solved_to_the_second_order(case):
    """Every halving of the step divides the error by four."""
    texts, slope, values = NONLINEAR[case]
    state = equations(**texts)
    coarse = straight(walk(2, 200))
    expected = solved(state, coarse, slope, values)
    errors = [
        np.abs(solve_in_finer_steps(state, coarse, values, parts) - expected).max() / np.abs(expected).max()
        for parts in (4, 8, 16)
    ]
    assert errors[0] < 0.02
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.6)
    assert errors[1] / errors[2] == pytest.approx(4, abs=0.4)


def solve_in_finer_steps(state: StateEquation, motion: Motion, values: dict, parts: int) -> np.ndarray:
    """States at the samples of a motion, computed in `parts` steps between two of them."""
    time = np.arange((len(motion) - 1) * parts + 1) / parts
    fine = straight(np.interp(time, np.arange(len(motion)), motion.position), STEP / parts)
    return np.array(list(state.trajectory(fine, values).values()))[:, ::parts]


def test_an_iteration_that_does_not_end_falls_back_to_steps():
    """A state that jumps between two branches: Newton's linearisation sees no slope."""
    state, motion = equations(r="v*c*where(r > 0, -1, 1) + where(r > 0.1, -c, 0)"), straight(walk(4))
    known = {"c": 300.0, **state._between(motion)}
    result = state.trajectory(motion, {"c": 300.0})["r"]
    np.testing.assert_array_equal(result, state.solve_stepwise(known, len(motion) - 1)[0])


@pytest.mark.parametrize(
    ("key", "numbers"),
    [
        *((key, (0.15, 0.7)) for key in SOLVED),
        *(("hysteresis/bouc_wen_general", (0.15, w)) for w in (0.01, 0.5, 1.0, 1.1875)),
        ("hysteresis/bouc_wen_general", (1.5, 2.5)),
    ],
)
def test_closed_forms_solve_their_equations(key, numbers):
    """For the same straight lines: exact where the equation is linear, else to the step's second order."""
    form, motion = SOLVED[key], straight(walk(5))
    nonlinear = np.array(numbers)[: len(form.nonlinear)]
    values = {item.symbol: value for item, value in zip(form.nonlinear, nonlinear, strict=True)}
    closed = np.array(form.solution(motion, nonlinear))
    state = form.parsed_equation.state
    result = np.array(list(state.trajectory(motion, values).values()))
    if state.is_linear:
        assert np.abs(result - closed).max() < 1e-12 * np.abs(closed).max()
        return
    errors = [np.abs(result - closed).max()]
    errors += [
        np.abs(solve_in_finer_steps(state, motion, values, parts) - closed).max() for parts in (10, 100)
    ]
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.02 * errors[1]


def test_independent_equations_are_solved_separately():
    state = equations(q="v - q/tau", r="(s - q*r)/tau", u="(z - u)/tau", p="v - p*abs(p)/tau")
    assert [part.names for part in state.apart] == [("q", "r"), ("u",), ("p",)]
    motion, values = straight(walk(3)), {"tau": 0.3}
    result = state.trajectory(motion, values)
    together = state.solve_stepwise({**values, **state._between(motion)}, len(motion) - 1)
    assert list(result) == list(state.names)
    for path, reference in zip(result.values(), together, strict=True):
        assert path == pytest.approx(reference, abs=1e-9 * np.abs(reference).max())


def test_bistable_state_matches_ode_solver():
    """Between its places of rest it runs away from any guess by e^4 in ten samples: no iteration over the record ends."""
    time = np.arange(1200) * STEP / 10
    position = 4 * np.sin(2 * np.pi * 1.3 * time) + 1.5 * np.cos(2 * np.pi * 3.1 * time + 0.4)
    motion = straight(position - position[0], STEP / 10)
    state = equations(u="(z + u*(1 - (u/w)**2))/tau")
    values = {"w": 1.5, "tau": 0.025}

    def slope(u, position, velocity, time, path, w, tau):
        return (position + u * (1 - (u / w) ** 2)) / tau

    result = state.trajectory(motion, values)["u"]
    truth = solved(state, motion, slope, values)[0]
    assert np.ptp(np.sign(truth)) == 2
    assert np.abs(result - truth).max() < 2e-3 * np.abs(truth).max()


def test_unbounded_state_ends_in_nan():
    result = equations(r="exp(r)*(1 + abs(z)) + sin(r)").trajectory(straight(walk(5)), {})["r"]
    assert np.isfinite(result[:5]).all() and not np.isfinite(result[-1])
