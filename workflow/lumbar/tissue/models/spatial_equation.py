"""An equation read in space: its signals are vectors, and it holds in any direction.

One equation says one mechanism, along one axis or along several. In space the signals ``z v a dz`` and the force ``F`` are
vectors, parameters are numbers, and

- a product of two vectors is their scalar product, so that ``z**2`` is |z|², ``z**3`` is |z|² z and ``v*abs(v)`` is |v| v;
- ``abs`` is the length, ``sign`` the direction (none of a vector of length 0);
- an odd function acts along its argument: ``tanh(v/vs)`` is tanh(|v|/vs) v/|v|;
- a state whose rate is a vector is one;
- ``s`` is the length of the way; a term without any vector (a drift) has a parameter of its own in every axis.

A form that acts on the output transforms the reading of every channel of the force sensor separately. A term that is not a vector
(``k*z**2``: in which direction?) has no form in space, which is an error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from itertools import chain

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.models.algebra import Evaluator
from lumbar.tissue.models.equation import CStep, Equation, Solution
from lumbar.tissue.models.expression import (
    COMPARISONS,
    Expression,
    Number,
    Operation,
    Symbol,
    add,
    divide,
    multiply,
    negate,
    operation,
    power,
    substitute,
    subtract,
    symbols,
    to_text,
    whole_power,
)
from lumbar.tissue.models.motion import SUBSTEPS, OneMotion, SpatialMotion
from lumbar.tissue.models.parameter import FORCE, SIGNALS, VECTORS, LinearParameter
from lumbar.tissue.models.state_equation import StateEquation

Vector = tuple[Expression, ...]
_MIN_SQUARE = Number(1e-300)  # square of the length of a vector that has a direction


def dot(left: Vector, right: Vector) -> Expression:
    """Scalar product."""
    return reduce(add, (multiply(one, other) for one, other in zip(left, right, strict=True)))


def length(vector: Vector) -> Expression:
    """Length of a vector; of no length it has a slope too, 0."""
    return Operation("sqrt", (Operation("max", (dot(vector, vector), _MIN_SQUARE)),))


def in_space(expression: Expression, vectors: Mapping[str, Vector]) -> Expression | Vector:
    """Read an expression in space: `vectors` are the components of its symbols that are vectors.

    Raises
    ------
    InputError
        If a part of it means nothing in space, with this part.

    Examples
    --------
    >>> from lumbar.tissue.models.expression import parse
    >>> [to_text(part) for part in in_space(parse("k*z**3"), {"z": (Symbol("z_x"), Symbol("z_y"))})]
    ['k*((z_x*z_x + z_y*z_y)*z_x)', 'k*((z_x*z_x + z_y*z_y)*z_y)']
    """
    match expression:
        case Symbol(name):
            return vectors.get(name, expression)
        case Operation(name, operands):
            read = [in_space(operand, vectors) for operand in operands]
            numbers = [item for item in read if not isinstance(item, tuple)]
            if len(numbers) == len(read):
                return operation(name, *numbers)
            found = _of_vectors(name, read, operands)
            if found is None:
                raise InputError(f"{to_text(expression)} has no meaning for vectors")
            return found
    return expression


def _of_vectors(
    name: str, read: Sequence[Expression | Vector], operands: Sequence[Expression]
) -> Expression | Vector | None:
    """An operation on vectors; None if it has no meaning for them."""
    match name, *read:
        case "+" | "-", tuple(first), tuple(second):
            return tuple(map(add if name == "+" else subtract, first, second))
        case "*", tuple(first), tuple(second):
            return dot(first, second)
        case ("*", tuple(vector), number) | ("*", number, tuple(vector)):
            return tuple(multiply(number, item) for item in vector)  # type: ignore[arg-type]
        case "/", tuple(vector), (Number() | Symbol() | Operation()) as number:
            return tuple(divide(item, number) for item in vector)
        case "**", tuple(vector), Number() if exponent := whole_power(operands[1]):
            even = power(dot(vector, vector), Number(float(exponent // 2)))
            return tuple(multiply(even, item) for item in vector) if exponent % 2 else even
        case "hypot", one, other:
            sizes: list = [length(item) if isinstance(item, tuple) else item for item in (one, other)]
            return Operation("hypot", tuple(sizes))
        case "where", (Number() | Symbol() | Operation()) as condition, tuple(yes), tuple(no):
            return tuple(Operation("where", (condition, *pair)) for pair in zip(yes, no, strict=True))
        case "neg", tuple(vector):
            return tuple(map(negate, vector))
        case "abs", tuple(vector):
            return length(vector)
        case "cos", tuple(vector):  # even: a number
            return Operation("cos", (length(vector),))
        case "sign" | "tanh" | "sinh" | "sin" | "arctan", tuple(vector):  # odd: along its argument
            size = length(vector)
            value = Number(1.0) if name == "sign" else Operation(name, (size,))
            return tuple(multiply(value, divide(item, size)) for item in vector)
    return None


def element(name: str, axes: Sequence[str], row: int, column: int) -> str:
    """Name of an element of a symmetric matrix: the same on both sides of its diagonal."""
    first, second = sorted((row, column))
    return f"{name}_{axes[first]}{axes[second]}"


def _components(name: str, axes: Sequence[str]) -> Vector:
    return tuple(Symbol(f"{name}_{axis}") for axis in axes)


@dataclass(frozen=True)
class SpatialEquation(Equation):
    """An equation read in space; forces stand one axis after the other, shape (axes × samples,)."""

    axes: tuple[str, ...] = ()
    """Names of the axes."""
    channel: str = ""
    """The axis whose channel alone is transformed; empty for all."""

    @cached_property
    def vectors(self) -> dict[str, Vector]:
        """Components of the symbols that are vectors: signals, and states whose rate of change is one."""
        found = {name: _components(name, self.axes) for name in VECTORS}
        for _ in self.rates:
            # A state may depend on another one: known vectors decide which states are vectors.
            for name, rate in self.rates.items():
                if name not in found and symbols(rate) & found.keys():
                    known = found | {name: _components(name, self.axes)}
                    found = known if isinstance(in_space(rate, known), tuple) else found
        return found

    @cached_property
    def slopes(self) -> dict[str, Expression]:
        """Rate of change by state; of a state that is a vector by component."""
        found: dict[str, Expression] = {}
        for name, rate in self.rates.items():
            read = in_space(rate, self.vectors)
            if isinstance(read, tuple) is not (name in self.vectors):
                raise InputError(f"the rate of {name}, {to_text(rate)}, has no meaning for vectors")
            if isinstance(read, tuple):
                found |= {f"{name}_{axis}": part for axis, part in zip(self.axes, read, strict=True)}
            else:
                found[name] = read
        return found

    @cached_property
    def begin(self) -> dict[str, Expression]:
        """Value at the beginning by state."""
        if self.starts:
            raise InputError(f"state {self.starts[0][0]} with a start of its own has no form in space")
        return {}

    @cached_property
    def _read(self) -> tuple[tuple[LinearParameter, Vector], ...]:
        """Linear parameters in space, each with the force of size 1 along every axis."""
        found: list[tuple[LinearParameter, Vector]] = []
        for item, column in zip(self.linear, self.columns, strict=True):
            read = in_space(column, self.vectors)
            if isinstance(read, tuple):
                found.append((item, read))
                continue
            components = set().union(*(map(symbols, chain(*self.vectors.values()))))
            if symbols(read) & components:
                raise InputError(f"{to_text(column)} has no direction in space")
            zero = Number(0.0)
            for axis in self.axes:
                own = replace(item, name=f"{item.name}_{axis}", symbol=f"{item.symbol}_{axis}")
                found.append((own, tuple(read if axis == other else zero for other in self.axes)))
        return tuple(found)

    @property
    def signals(self) -> set[str]:
        """Signals that the force uses, without those of the states' rates."""
        if self.transforms:
            return super().signals
        parts = chain(*(vector for _, vector in self._read))
        return set().union(*map(symbols, parts)) & SIGNALS.keys()

    @cached_property
    def _evaluator(self) -> Evaluator:
        if self.transforms:
            return super()._evaluator
        return Evaluator(
            [substitute(part, self._constant_values) for _, vector in self._read for part in vector]
        )

    def forces(
        self,
        motion: OneMotion,
        nonlinear: np.ndarray,
        solution: Solution | None = None,
        force: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Forces per linear parameter at size 1, or the transformed force; each of shape (axes × samples,)."""
        assert isinstance(motion, SpatialMotion)
        if force is not None:
            return [self._transformed(motion, nonlinear, force)]
        values: dict = self.parameters(nonlinear)
        if self.state is not None:
            values |= self._states(self.state, motion, nonlinear, solution)
        values |= {name: SIGNALS[name].of(motion) for name in self.signals}
        samples, count = len(motion.time), len(self.axes)
        with np.errstate(over="ignore"):
            rows = [np.broadcast_to(value, samples) for value in self._evaluator(values)]
        return [np.concatenate(rows[row : row + count]) for row in range(0, len(rows), count)]

    def _states(
        self, state: StateEquation, motion: SpatialMotion, nonlinear: np.ndarray, solution: Solution | None
    ) -> dict[str, np.ndarray]:
        """States at every sample: in closed form where those of an axis know nothing of another one."""
        names = [name for name, _ in self.states]
        if solution is None or not self._apart:
            if not all(part.smooth for part in motion.parts):  # in straight lines from sample to sample
                return state.trajectory(motion, self.parameters(nonlinear))
            # What turns between two samples is followed there.
            fine = motion.cache.compute_once(
                "in steps between samples", lambda: motion.each(lambda part: part.finer)
            )
            found = state.trajectory(fine, self.parameters(nonlinear))
            return {name: values[::SUBSTEPS] for name, values in found.items()}
        found = {}
        for axis, part in zip(self.axes, motion.parts, strict=True):
            solved = part.cache.compute_at(
                "states in closed form", nonlinear, partial(solution, part, nonlinear)
            )
            found |= {f"{name}_{axis}": value for name, value in zip(names, solved, strict=True)}
        return found

    @cached_property
    def _apart(self) -> bool:
        """Whether the states of one axis are independent of the other axes."""
        return all(
            not symbols(rate)
            & {f"{name}_{other}" for name in self.vectors for other in self.axes if other != axis}
            for axis in self.axes
            for name, rate in self.slopes.items()
            if name.endswith(f"_{axis}")
        )

    def _transformed(self, motion: SpatialMotion, nonlinear: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return the readings of the channels for the forces along their axes."""
        values: dict = self.parameters(nonlinear)
        pieces = []
        for axis, part, piece in zip(self.axes, motion.parts, motion.split(force), strict=True):
            if self.channel not in ("", axis):
                pieces.append(piece)
                continue
            # Path is that in space, other signals are those along the axis.
            own = {name: SIGNALS[name].of(motion if name == "s" else part) for name in self.signals}
            (read,) = self._evaluator({**values, **own, FORCE: piece})
            pieces.append(np.broadcast_to(read, len(part)))
        return np.concatenate(pieces)

    def c_step(self, solution: str = "") -> CStep | None:
        """Return the C code of one sample, with a value along every axis; an output form has one value for every channel.

        `solution` is that of one axis, and is ignored.
        """
        if self.transforms:
            return super().c_step()
        sums = [
            self._portable(
                Operation("*", (Symbol(item.symbol), vector[row]))
                for item, vector in self._read
                if vector[row] != Number(0.0)
            )
            for row in range(len(self.axes))
        ]
        return self._c_step_of(sums, (item for item, _ in self._read))

    def c_step_by_matrices(self) -> CStep:
        """Return the C code with a symmetric matrix for every linear parameter; `element` gives the names of its elements."""
        names, sums = [], []
        for row in range(len(self.axes)):
            terms: list[Expression] = []
            for item, vector in self._read:
                for column, part in enumerate(vector):
                    name = element(item.name, self.axes, row, column)
                    names.append(LinearParameter(name, "", symbol=name))
                    terms.append(Operation("*", (Symbol(name), part)))
            sums.append(self._portable(terms))
        return self._c_step_of(sums, names)

    @property
    def _c_begun(self) -> dict[str, str]:
        squares = " + ".join(f"step_{axis} * step_{axis}" for axis in self.axes)
        begun = {f"position_{axis}": f"(position_{axis} - step_{axis})" for axis in self.axes}
        return {**begun, "path": f"(path - sqrt({squares}))"}

    def linear_in_space(self) -> tuple[LinearParameter, ...]:
        """Linear parameters in space: those of a term without direction once in every axis.

        Raises
        ------
        InputError
            With the part of the equation that means nothing in space.
        """
        if not self.transforms:
            _ = self.begin, self.slopes
            return tuple(item for item, _ in self._read)
        if self.states or symbols(self.force) & {*VECTORS, *COMPARISONS}:
            raise InputError(f"{self.text} of one channel hangs on a motion that is a vector")
        return self.linear
