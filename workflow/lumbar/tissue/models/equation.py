"""One equation of a form, from which its simulation, its LaTeX and its C code follow; and C code of a form as such."""

import cmath
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.tissue.models.algebra import Evaluator, linear_parts
from lumbar.tissue.models.expression import (
    Expression,
    Number,
    Operation,
    Symbol,
    expand_sums,
    parse,
    substitute,
    symbols,
    whole_power,
)
from lumbar.tissue.models.motion import Motion, OneMotion
from lumbar.tissue.models.parameter import (
    FORCE,
    SIGNALS,
    Constant,
    LinearParameter,
    NonlinearParameter,
    Parameter,
)
from lumbar.tissue.models.printing import c_text, latex, number_latex, portable, symbol_latex
from lumbar.tissue.models.state_equation import STEP_SYMBOL, StateEquation

Constants = Callable[[Mapping[str, float], float], dict[str, float]]
Memory = Callable[[Mapping[str, float]], int]


@dataclass(frozen=True)
class CStep:
    """C99 code of one sample of a form.

    The code becomes the body of a function. It knows by name

    - the form's linear and nonlinear parameters and what `constants` adds to them;
    - the motion that reaches the form: ``time``, ``position``, ``step`` (change of position since the sample before),
      ``velocity``, ``acceleration``, ``path``, and ``first``, true at the first sample. Derivatives are backward
      differences, for a running loop knows no later sample;
    - in output forms ``force``, which is to be transformed;
    - with `history`, ``earlier(now, ring, n)``, the position that reached the form n samples ago, 0 to `history`;
    - with `memory`, ``memory[i]`` as the sample before left it, 0 at the start, and ``next[i]``, to be written;
    - the functions of ``effect_forms.h`` and ``portable_math.h``: ``sign``, ``clipped``, ``behind_gap``,
      ``portable_tanh`` … Those of the C library that are exact (``fabs``, ``sqrt``, ``floor`` …) may be used too; the
      others are refused, because they differ between platforms in the last bit.
    """

    value: str | tuple[str, ...]
    """Expression: the force that a parallel form adds, the position that an input form passes on, the force that an output
    form makes of ``force``. Of a parallel form in space the force along every axis; signals are then ``position_x`` …."""
    statements: str = ""
    """Statements before it."""
    memory: int | Memory = 0
    """Numbers that the form keeps from sample to sample; a callable gets all parameters by name."""
    constants: Constants = lambda parameters, sampling_time: {}
    """From parameters by name and the sampling time in seconds to further numbers by name, computed at export.
    One named ``pole`` is a pole in discrete time and counts when stability is judged."""
    history: int | Memory = 0
    """Earlier positions that it needs; a callable gets all parameters by name."""

    def numbers(self, parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
        """Return all numbers that the code knows by name.

        Raises
        ------
        ValueError
            If a constant has the name of a parameter.
        """
        constants = self.constants(parameters, sampling_time)
        if taken := sorted(constants.keys() & parameters.keys()):
            raise ValueError(f"constants have names of parameters: {', '.join(taken)}")
        return {**parameters, **constants}

    def memory_size(self, numbers: Mapping[str, float]) -> int:
        """Return the numbers that the form keeps, from those that its code knows."""
        return self.memory(numbers) if callable(self.memory) else self.memory

    def history_size(self, numbers: Mapping[str, float]) -> int:
        """Return the earlier positions that it needs, from the numbers that its code knows."""
        return self.history(numbers) if callable(self.history) else self.history


_MIN_SLOPE = 1e-100  # of a state; below it the state rests: a vector of length 0 has a tiny slope
Solution = Callable[[Motion, np.ndarray], tuple[np.ndarray, ...]]


@dataclass(frozen=True)
class Equation:
    """An equation and the meaning of its symbols."""

    text: str
    """Expression of the force, e.g. ``"Fc*tanh(v/vs)"``."""
    transforms: bool
    """Whether it is the measured force for a force ``F``; else it is a force that is added."""
    linear: tuple[LinearParameter, ...]
    nonlinear: tuple[NonlinearParameter, ...]
    """`linear`, `nonlinear`: parameters."""
    constants: tuple[Constant, ...]
    states: tuple[tuple[str, str], ...]
    """Symbol and rate of change of every state."""
    starts: tuple[tuple[str, str], ...] = ()
    """Symbol and value at the start of the states that do not start at 0."""

    @cached_property
    def force(self) -> Expression:
        """The tree of the text with sums written out."""
        return expand_sums(parse(self.text))

    @cached_property
    def rates(self) -> dict[str, Expression]:
        """Rate of change by state, as the equation says it."""
        return {name: expand_sums(parse(text)) for name, text in self.states}

    @property
    def slopes(self) -> dict[str, Expression]:
        """Rate of change by state that is solved for."""
        return self.rates

    @cached_property
    def begin(self) -> dict[str, Expression]:
        """Value at the beginning by state."""
        return {name: expand_sums(parse(text)) for name, text in self.starts}

    @cached_property
    def columns(self) -> tuple[Expression, ...]:
        """Factor of each linear parameter; the whole equation of an output form."""
        if self.transforms:
            return (self.force,)
        found = linear_parts(self.force, [item.symbol for item in self.linear])
        return tuple(found[item.symbol] for item in self.linear)

    @cached_property
    def state(self) -> StateEquation | None:
        """Equations of the states, if there are any."""
        return StateEquation(self.slopes, self.begin) if self.states else None

    @property
    def declared(self) -> tuple[Parameter | Constant, ...]:
        """Parameters and constants."""
        return (*self.linear, *self.nonlinear, *self.constants)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Roles of further channels that it needs."""
        needed = (SIGNALS[name].channel for name in sorted(self.signals))
        return tuple(dict.fromkeys(filter(None, needed)))

    @cached_property
    def _signals(self) -> tuple[tuple[str, Callable], ...]:
        return tuple((name, SIGNALS[name].of) for name in sorted(self.signals))

    @property
    def signals(self) -> set[str]:
        """Signals that the force uses, without those of the states' rates."""
        return symbols(self.force) & SIGNALS.keys()

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator([substitute(column, self._constant_values) for column in self.columns])

    @cached_property
    def _nonlinear_symbols(self) -> tuple[str, ...]:
        return tuple(item.symbol for item in self.nonlinear)

    @cached_property
    def _steady(self) -> tuple[int, ...]:
        """Columns that are one number for all samples."""
        varying = {*SIGNALS, FORCE, *self.slopes}
        return tuple(index for index, column in enumerate(self.columns) if not symbols(column) & varying)

    def parameters(self, nonlinear: Iterable[float]) -> dict[str, float]:
        """Nonlinear parameters and constants by symbol."""
        named = zip(self._nonlinear_symbols, nonlinear, strict=True)
        return {**dict(named), **{item.symbol: item.value for item in self.constants}}

    def forces(
        self,
        motion: OneMotion,
        nonlinear: np.ndarray,
        solution: Solution | None = None,
        force: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Forces per linear parameter at size 1, or the transformed force; each of shape (samples,).

        `solution` is that of the states, in place of the solver's; `force` is what a form that acts on the output
        transforms.
        """
        values: dict = dict(zip(self._nonlinear_symbols, nonlinear, strict=True))
        if self.state is not None and solution is not None:
            values.update(zip(self.slopes, solution(motion, nonlinear), strict=True))  # type: ignore[arg-type]  # of one axis
        elif self.state is not None:
            values.update(self.state.trajectory(motion, self.parameters(nonlinear)))
        for name, signal in self._signals:
            values[name] = signal(motion)
        if force is not None:
            values[FORCE] = force
        found = self._evaluator(values)
        for index in self._steady:
            found[index] = np.full(len(motion), float(found[index]))
        return found  # type: ignore[return-value]  # what is one number for all samples was written out

    @cached_property
    def latex(self) -> str:
        """The equation, those of its states, and its constants, in LaTeX."""
        names = {name: item.latex for name, item in SIGNALS.items() if item.latex}
        for item in self.declared:
            names[item.symbol] = item.in_latex
        rates = [rf"\dot {symbol_latex(name)} = {latex(parse(text), names)}" for name, text in self.states]
        rates += [rf"{symbol_latex(name)}(0) = {latex(parse(text), names)}" for name, text in self.starts]
        said = [
            rf"{names[item.symbol]} = {number_latex(f'{item.value:g}')}\,\mathrm{{{item.latex_unit}}}"
            for item in self.constants
        ]
        return r",\quad ".join([latex(parse(self.text), names), *rates, *said])

    @cached_property
    def _constant_values(self) -> dict[str, Expression]:
        """Constants as numbers."""
        return {item.symbol: Number(item.value) for item in self.constants}

    @cached_property
    def portable_terms(self) -> tuple[Expression, ...]:
        """Terms that C adds up, in operations with the same bits on every platform."""
        terms = self.columns
        if not self.transforms:
            named = zip(self.linear, self.columns, strict=True)
            terms = tuple(Operation("*", (Symbol(item.symbol), column)) for item, column in named)
        return self._portable(terms)

    def _portable(self, terms: Iterable[Expression]) -> tuple[Expression, ...]:
        return tuple(portable(substitute(term, self._constant_values)) for term in terms)

    def c_step(self, solution: str = "") -> CStep | None:
        """Return the C code of one sample; None if it needs a channel that a running loop does not have.

        `solution` are statements that write the states of the next sample, instead of the solver's.
        """
        if self.channels:
            return None
        return self._c_step_of([self.portable_terms], self.linear, solution)

    def _c_step_of(
        self, sums: Sequence[Sequence[Expression]], linear: Iterable[LinearParameter], solution: str = ""
    ) -> CStep:
        """Return the C code of one sum of terms, or of one along every axis."""
        names = {item.symbol: item.name for item in (*linear, *self.nonlinear)}
        names |= {name: item.c_name for name, item in SIGNALS.items()} | {FORCE: "force"}
        names |= {name: f"next[{row}]" for row, name in enumerate(self.slopes)}
        names[STEP_SYMBOL] = STEP_SYMBOL
        shared, values = _c_lines("shared", [term for terms in sums for term in terms], names)
        steps = [solution] if solution or not self.state else self._c_state_steps(self.state, names)
        ready = iter(values)
        added = tuple(" + ".join(next(ready) for _ in terms) for terms in sums)
        statements = "\n".join(filter(None, [*steps, *shared]))
        value = added if len(added) > 1 else added[0]
        return CStep(value, statements, len(self.slopes), self._c_constants)

    def _c_constants(self, parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
        """Sampling time, and the pole of the states that follow their equations without motion."""
        if self.state is None:
            return {}
        values = self.parameters([parameters[item.name] for item in self.nonlinear])
        slopes = self.state.at_rest(values, sampling_time)
        found = {STEP_SYMBOL: sampling_time}
        if np.isfinite(slopes).all() and slopes.any():
            decays = [cmath.exp(value) for value in np.linalg.eigvals(slopes) if abs(value) > _MIN_SLOPE]
            found["pole"] = float(max(map(abs, decays), default=0.0))
        return found

    @property
    def _c_begun(self) -> dict[str, str]:
        """Position and path at the beginning of a step, by their names in C."""
        return {"position": "(position - step)", "path": "(path - fabs(step))"}

    def _c_state_steps(self, state: StateEquation, names: Mapping[str, str]) -> list[str]:
        """Statements of the exponential Rosenbrock–Euler step."""
        given = self._constant_values
        before = {name: f"memory[{row}]" for row, name in enumerate(state.names)}
        begun = {"time": f"(time - {STEP_SYMBOL})", **self._c_begun}
        starts = [
            c_text(portable(substitute(state.starts.get(name, Number(0.0)), given)), names)
            for name in state.names
        ]
        then = {symbol: begun.get(name, name) for symbol, name in names.items()} | before
        if all(part.is_scalar for part in state.apart):
            alone = {part.names[0]: part.scalar_step for part in state.apart}
            trees = [portable(substitute(alone[name], given)) for name in state.names]
            shared, values = _c_lines("begun", trees, then)
            pairs = enumerate(zip(starts, values, strict=True))
            return [*shared, *(f"next[{row}] = first ? {start} : {value};" for row, (start, value) in pairs)]
        size, count = len(state.increments), len(state.names)
        cells = [*state.increments, *(cell for row in state.matrix for cell in row)]
        shared, values = _c_lines("begun", [portable(substitute(cell, given)) for cell in cells], then)
        return [
            *shared,
            f"const double increments[] = {{{', '.join(values[:size])}}};",
            f"const double matrix[] = {{{', '.join(values[size:])}}};",
            f"linearised_step({count}, {size}, increments, matrix, memory, next);",
            f"if (first) {', '.join(f'next[{row}] = {start}' for row, start in enumerate(starts))};",
        ]


def _c_lines(stem: str, trees: Sequence[Expression], names: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """C declarations of what several operations use, and the values of the trees in terms of them."""
    uses: Counter = Counter()
    order: dict[Expression, None] = {}
    for tree in trees:
        _count_uses(tree, uses, order)
    replaced: dict[Expression, Symbol] = {}
    known = dict(names)
    lines: list[str] = []
    for part in order:
        if uses[part] > 1:
            name = f"{stem}_{len(lines)}"
            lines.append(f"const double {name} = {c_text(_substitute_shared(part, replaced), known)};")
            known[name] = name
            replaced[part] = Symbol(name)
    return lines, [c_text(_substitute_shared(tree, replaced), known) for tree in trees]


def _count_uses(tree: Expression, uses: Counter, order: dict[Expression, None]) -> None:
    """Count for every operation how many different ones use it; operands come first in the order."""
    if not isinstance(tree, Operation) or tree.name in ("<", "<=", ">", ">="):
        for operand in getattr(tree, "operands", ()):
            _count_uses(operand, uses, order)
        return
    is_product = tree.name == "**" and whole_power(tree.operands[1])
    uses[tree] += 1
    if tree in order:
        return
    for operand in tree.operands:
        _count_uses(operand, uses, order)
        if is_product and isinstance(operand, Operation):
            uses[operand] += 1
    order[tree] = None


def _substitute_shared(tree: Expression, replaced: Mapping[Expression, Symbol]) -> Expression:
    """The tree with names in place of what was computed before."""
    if tree in replaced:
        return replaced[tree]
    if isinstance(tree, Operation):
        return Operation(tree.name, tuple(_substitute_shared(operand, replaced) for operand in tree.operands))
    return tree
