"""Equation of a form, with the simulation, LaTeX and C code that follow from it; and `CStep`, the C code of any form."""

import cmath
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.tissue.models.algebra import Evaluator, linear_parts
from lumbar.tissue.models.expression import (
    COMPARISONS,
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

    The code becomes the body of a function. It may use

    - the form's linear and nonlinear parameters and the numbers of `constants`;
    - the motion that reaches the form: ``time``, ``position``, ``step`` (change of position since the sample before),
      ``velocity``, ``acceleration``, ``path``, and ``first``, true at the first sample. Derivatives are backward differences,
      because a running loop knows no later sample;
    - in output forms ``force``, the force to transform;
    - with `history`, ``earlier(now, ring, n)``, the position that reached the form n samples ago, 0 to `history`;
    - with `memory`, ``memory[i]`` of the previous sample, 0 at the start, and ``next[i]``, which the code writes;
    - the functions of ``effect_forms.h`` and ``portable_math.h``: ``sign``, ``clipped``, ``behind_gap``,
      ``portable_tanh`` …, and exact functions of the C library (``fabs``, ``sqrt``, ``floor`` …). Other functions are rejected,
      because they differ between platforms in the last bit.
    """

    value: str | tuple[str, ...]
    """Expression: the force that a parallel form adds, the position that an input form passes on, or the force into which an
    output form transforms ``force``. Parallel forms in space: one per axis, in signals such as ``position_x``."""
    statements: str = ""
    """C statements that run before `value`."""
    memory: int | Memory = 0
    """Count of numbers that the form stores from sample to sample, or a function from parameters by name to the count."""
    constants: Constants = lambda parameters, sampling_time: {}
    """Function from parameters by name and the sampling time in seconds to more numbers by name, called at export. A number
    named ``pole`` is a pole in discrete time and counts when stability is judged."""
    history: int | Memory = 0
    """Number of earlier positions that the form needs, or a function from parameters by name to this number."""

    def numbers(self, parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
        """Return all numbers that the form's C code may use, by name.

        Parameters
        ----------
        parameters : mapping of str to float
            Linear and nonlinear parameters by name.
        sampling_time : float
            Seconds.

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
        """Return the count of numbers that the form stores from sample to sample.

        Parameters
        ----------
        numbers : mapping of str to float
            Result of `numbers`.
        """
        return self.memory(numbers) if callable(self.memory) else self.memory

    def history_size(self, numbers: Mapping[str, float]) -> int:
        """Return the number of earlier positions that the form needs.

        Parameters
        ----------
        numbers : mapping of str to float
            Result of `numbers`.
        """
        return self.history(numbers) if callable(self.history) else self.history


_MIN_SLOPE = 1e-100  # of a state; below it the state rests: a vector of length 0 has a tiny slope
Solution = Callable[[Motion, np.ndarray], tuple[np.ndarray, ...]]


@dataclass(frozen=True)
class Equation:
    """An equation and the meaning of its symbols."""

    text: str
    """Expression of the force, e.g. ``"Fc*tanh(v/vs)"``."""
    transforms: bool
    """True if the equation maps a force ``F`` to the measured force, false if it adds a force."""
    linear: tuple[LinearParameter, ...]
    nonlinear: tuple[NonlinearParameter, ...]
    constants: tuple[Constant, ...]
    states: tuple[tuple[str, str], ...]
    """Symbol and rate of change of every state."""
    starts: tuple[tuple[str, str], ...] = ()
    """Symbol and start value of the states that do not start at 0."""

    @cached_property
    def force(self) -> Expression:
        """Expression of `text`, with sums written out."""
        return expand_sums(parse(self.text))

    @cached_property
    def rates(self) -> dict[str, Expression]:
        """Rate of change by state, as written."""
        return {name: expand_sums(parse(text)) for name, text in self.states}

    @property
    def slopes(self) -> dict[str, Expression]:
        """Rate of change by state, as the solver uses it."""
        return self.rates

    @cached_property
    def begin(self) -> dict[str, Expression]:
        """Start value by state."""
        return {name: expand_sums(parse(text)) for name, text in self.starts}

    @cached_property
    def columns(self) -> tuple[Expression, ...]:
        """Factor of each linear parameter; for an output form the whole equation."""
        if self.transforms:
            return (self.force,)
        factors = linear_parts(self.force, [item.symbol for item in self.linear])
        return tuple(factors[item.symbol] for item in self.linear)

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
        """Roles of the additional channels that the equation needs."""
        needed = (SIGNALS[name].channel for name in sorted(self.signals))
        return tuple(dict.fromkeys(filter(None, needed)))

    @cached_property
    def signals(self) -> set[str]:
        """Signals in the force's expression, without signals that only the states' rates use."""
        return symbols(self.force) & SIGNALS.keys()

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator([substitute(column, self._constant_values) for column in self.columns])

    def parameters(self, nonlinear: Iterable[float]) -> dict[str, float]:
        """Return nonlinear parameters and constants by symbol.

        Parameters
        ----------
        nonlinear : iterable of float
            Nonlinear parameters, in the order of the field.
        """
        values = {item.symbol: item.value for item in self.constants}
        return values | {item.symbol: value for item, value in zip(self.nonlinear, nonlinear, strict=True)}

    def forces(
        self,
        motion: OneMotion,
        nonlinear: np.ndarray,
        solution: Solution | None = None,
        force: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Return the force per linear parameter at size 1, shape (samples,) each; one transformed force for an output form.

        Parameters
        ----------
        motion : OneMotion
            Motion along one axis; a `SpatialMotion` if the equation is in space.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Nonlinear parameters, in the order of the field.
        solution : callable, optional
            Function from motion and nonlinear parameters to the states, used instead of the solver.
        force : numpy.ndarray, shape (samples,), optional
            Force that an output form transforms.
        """
        values: dict = self.parameters(nonlinear)
        if self.state is not None and solution is not None:
            values |= zip(self.slopes, solution(motion, nonlinear), strict=True)  # type: ignore[arg-type]  # of one axis
        elif self.state is not None:
            values |= self.state.trajectory(motion, values)
        values |= {name: SIGNALS[name].of(motion) for name in self.signals} | {FORCE: force}
        columns = self._evaluator(values)
        return [item if np.ndim(item) else np.full(len(motion), float(item)) for item in columns]  # type: ignore[misc]

    @cached_property
    def latex(self) -> str:
        """The equation, the equations of its states, and its constants, in LaTeX."""
        names = {name: item.latex for name, item in SIGNALS.items() if item.latex}
        names |= {item.symbol: item.latex_symbol for item in self.declared}
        parts = [latex(parse(self.text), names)]
        parts += [rf"\dot {symbol_latex(name)} = {latex(parse(text), names)}" for name, text in self.states]
        parts += [rf"{symbol_latex(name)}(0) = {latex(parse(text), names)}" for name, text in self.starts]
        parts += [
            rf"{names[item.symbol]} = {number_latex(f'{item.value:g}')}\,\mathrm{{{item.latex_unit}}}"
            for item in self.constants
        ]
        return r",\quad ".join(parts)

    @cached_property
    def _constant_values(self) -> dict[str, Expression]:
        """Constants as numbers."""
        return {item.symbol: Number(item.value) for item in self.constants}

    @cached_property
    def portable_terms(self) -> tuple[Expression, ...]:
        """Terms of the force in C code, in operations with identical bits on every platform."""
        terms = self.columns
        if not self.transforms:
            named = zip(self.linear, self.columns, strict=True)
            terms = tuple(Operation("*", (Symbol(item.symbol), column)) for item, column in named)
        return self._portable(terms)

    def _portable(self, terms: Iterable[Expression]) -> tuple[Expression, ...]:
        return tuple(portable(substitute(term, self._constant_values)) for term in terms)

    def c_step(self, solution: str = "") -> CStep | None:
        """Return the C code of one sample; None if the equation needs a channel that a running loop does not have.

        Parameters
        ----------
        solution : str, optional
            C statements that write the states of the next sample, used instead of the solver's step.
        """
        return None if self.channels else self._c_step_of([self.portable_terms], self.linear, solution)

    def _c_step_of(
        self, sums: Sequence[Sequence[Expression]], linear: Iterable[LinearParameter], solution: str = ""
    ) -> CStep:
        """Return the C code of one sum of terms, or of one sum per axis."""
        names = {item.symbol: item.name for item in (*linear, *self.nonlinear)}
        names |= {name: item.c_name for name, item in SIGNALS.items()} | {FORCE: "force"}
        names |= {name: f"next[{row}]" for row, name in enumerate(self.slopes)}
        names[STEP_SYMBOL] = STEP_SYMBOL
        shared, values = _c_lines("shared", [term for terms in sums for term in terms], names)
        steps = [solution] if solution or not self.state else self._c_state_steps(self.state, names)
        ready = iter(values)
        added = tuple(" + ".join(next(ready) for _ in terms) for terms in sums)
        statements = "\n".join(filter(None, [*steps, *shared]))
        return CStep(added if len(added) > 1 else added[0], statements, len(self.slopes), self._c_constants)

    def _c_constants(self, parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
        """Return the sampling time, and the pole of the states at rest."""
        if self.state is None:
            return {}
        values = self.parameters([parameters[item.name] for item in self.nonlinear])
        slopes = self.state.slopes_at_rest(values, sampling_time)
        constants = {STEP_SYMBOL: sampling_time}
        if np.isfinite(slopes).all() and slopes.any():
            decays = [cmath.exp(value) for value in np.linalg.eigvals(slopes) if abs(value) > _MIN_SLOPE]
            constants["pole"] = float(max(map(abs, decays), default=0.0))
        return constants

    @property
    def _c_begun(self) -> dict[str, str]:
        """Position and path at the beginning of a step, by their names in C."""
        return {"position": "(position - step)", "path": "(path - fabs(step))"}

    def _c_state_steps(self, state: StateEquation, names: Mapping[str, str]) -> list[str]:
        """Return the statements of the exponential Rosenbrock–Euler step."""
        begun = {"time": f"(time - {STEP_SYMBOL})", **self._c_begun}
        before = {symbol: begun.get(name, name) for symbol, name in names.items()}
        before |= {name: f"memory[{row}]" for row, name in enumerate(state.names)}
        start_values = self._portable(state.starts.get(name, Number(0.0)) for name in state.names)
        starts = [c_text(value, names) for value in start_values]
        if all(part.is_scalar for part in state.apart):
            steps = {part.names[0]: part.scalar_step for part in state.apart}
            shared, values = _c_lines("begun", self._portable(steps[name] for name in state.names), before)
            pairs = enumerate(zip(starts, values, strict=True))
            return [*shared, *(f"next[{row}] = first ? {start} : {value};" for row, (start, value) in pairs)]
        size, count = len(state.increments), len(state.names)
        cells = self._portable([*state.increments, *(cell for row in state.matrix for cell in row)])
        shared, values = _c_lines("begun", cells, before)
        return [
            *shared,
            f"const double increments[] = {{{', '.join(values[:size])}}};",
            f"const double matrix[] = {{{', '.join(values[size:])}}};",
            f"linearised_step({count}, {size}, increments, matrix, memory, next);",
            f"if (first) {', '.join(f'next[{row}] = {start}' for row, start in enumerate(starts))};",
        ]


def _c_lines(stem: str, trees: Sequence[Expression], names: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Return C declarations of repeated operations, and the C expressions of `trees` that use them."""
    uses: Counter = Counter()  # how many different operations use an operation; operands come first
    order: dict[Expression, None] = {}

    replaced: dict[Expression, Symbol] = {}

    def replace_shared(tree: Expression) -> Expression:
        if tree in replaced or not isinstance(tree, Operation):
            return replaced.get(tree, tree)
        return Operation(tree.name, tuple(map(replace_shared, tree.operands)))

    for tree in trees:
        _count_uses(tree, uses, order)
    known = dict(names)
    lines: list[str] = []
    for part in (part for part in order if uses[part] > 1):
        name = f"{stem}_{len(lines)}"
        lines.append(f"const double {name} = {c_text(replace_shared(part), known)};")
        known[name] = name
        replaced[part] = Symbol(name)
    return lines, [c_text(replace_shared(tree), known) for tree in trees]


def _count_uses(tree: Expression, uses: Counter, order: dict[Expression, None]) -> None:
    if not isinstance(tree, Operation):
        return
    uses[tree] += 1
    if tree in order:
        return
    for operand in tree.operands:
        _count_uses(operand, uses, order)
        # A whole power is a product, which uses its base repeatedly.
        uses[operand] += tree.name == "**" and bool(whole_power(tree.operands[1]))
    if tree.name not in COMPARISONS:
        order[tree] = None
