"""An equation in space: signals are vectors, and the equation is valid in any direction.

One equation defines a mechanism along one axis and in space. In space the signals ``z v a dz`` and the force ``F`` are vectors,
parameters are numbers, and

- a product of two vectors is their scalar product, so that ``z**2`` is |z|², ``z**3`` is |z|² z and ``v*abs(v)`` is |v| v;
- ``abs`` is the length, ``sign`` the direction (0 for a vector of length 0);
- an odd function acts along its argument: ``tanh(v/vs)`` is tanh(|v|/vs) v/|v|;
- a state with a vector as rate is a vector;
- ``s`` is the length of the path; a term without any vector (a drift) has one parameter per axis.

A form that acts on the output transforms the reading of every channel of the force sensor separately. A scalar term such as
``k*z**2`` has no direction and no form in space, which is an error.
"""

import operator
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
    ONE,
    ZERO,
    Expression,
    Number,
    Operation,
    Symbol,
    operation,
    substitute,
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
    """Return the scalar product of two vectors.

    Parameters
    ----------
    left, right : tuple of Expression
        Components along every axis.
    """
    return reduce(operator.add, map(operator.mul, left, right))


def length(vector: Vector) -> Expression:
    """Return the length of a vector, with slope 0 at length 0.

    Parameters
    ----------
    vector : tuple of Expression
        Components along every axis.
    """
    return Operation("sqrt", (Operation("max", (dot(vector, vector), _MIN_SQUARE)),))


def vectorise(expression: Expression, vectors: Mapping[str, Vector]) -> Expression | Vector:
    """Convert an expression to space, to a scalar or the components of a vector: k*z**3 becomes k*(z·z)*z.

    Parameters
    ----------
    expression : Expression
        Expression along one axis, without ``sum``.
    vectors : mapping of str to tuple of Expression
        Components of the symbols that are vectors.

    Raises
    ------
    InputError
        If a part of the expression has no meaning in space. The message names the part.
    """
    match expression:
        case Symbol(name):
            return vectors.get(name, expression)
        case Operation(name, operands):
            read = [vectorise(operand, vectors) for operand in operands]
            numbers = [item for item in read if not isinstance(item, tuple)]
            if len(numbers) == len(read):
                return operation(name, *numbers)
            result = _apply_to_vectors(name, read, operands)
            if result is None:
                raise InputError(f"{to_text(expression)} has no meaning for vectors")
            return result
    return expression


def _apply_to_vectors(
    name: str, read: Sequence[Expression | Vector], operands: Sequence[Expression]
) -> Expression | Vector | None:
    """Return the result of an operation on vectors; None if the operation has no meaning for vectors."""
    match name, *read:
        case "+" | "-", tuple(first), tuple(second):
            return tuple(map(operator.add if name == "+" else operator.sub, first, second))
        case "*", tuple(first), tuple(second):
            return dot(first, second)
        case ("*", tuple(vector), number) | ("*", number, tuple(vector)):
            return tuple(number * item for item in vector)  # type: ignore[misc,operator]  # it is an expression
        case "/", tuple(vector), Expression() as number:
            return tuple(item / number for item in vector)
        case "**", tuple(vector), Number() if exponent := whole_power(operands[1]):
            even = dot(vector, vector) ** Number(float(exponent // 2))
            return tuple(even * item for item in vector) if exponent % 2 else even
        case "hypot", one, other:
            sizes: list = [length(item) if isinstance(item, tuple) else item for item in (one, other)]
            return Operation("hypot", tuple(sizes))
        case "where", Expression() as condition, tuple(yes), tuple(no):
            return tuple(Operation("where", (condition, *pair)) for pair in zip(yes, no, strict=True))
        case _, tuple(vector):
            return _apply_to_vector(name, vector)
    return None


def _apply_to_vector(name: str, vector: Vector) -> Expression | Vector | None:
    """Return the result of a function of one vector; None if the function has no meaning for vectors."""
    size = length(vector)
    match name:
        case "neg":
            return tuple(map(operator.neg, vector))
        case "abs":
            return size
        case "cos":  # even: a number
            return Operation("cos", (size,))
        case "sign" | "tanh" | "sinh" | "sin" | "arctan":  # odd: along its argument
            value = ONE if name == "sign" else Operation(name, (size,))
            return tuple(value * (item / size) for item in vector)
    return None


def element(name: str, axes: Sequence[str], row: int, column: int) -> str:
    """Return the name of an element of a symmetric matrix, equal on both sides of its diagonal.

    Parameters
    ----------
    name : str
        Name of the matrix.
    axes : sequence of str
        Names of the axes.
    row, column : int
        Row and column of the element, from 0.
    """
    first, second = sorted((row, column))
    return f"{name}_{axes[first]}{axes[second]}"


@dataclass(frozen=True)
class SpatialEquation(Equation):
    """An equation in space; forces are one axis after the other, shape (axes × samples,)."""

    axes: tuple[str, ...] = ()
    """Names of the axes."""
    channel: str = ""
    """Axis of the only channel that the equation transforms; empty for all."""

    def _components(self, name: str) -> Vector:
        return tuple(Symbol(f"{name}_{axis}") for axis in self.axes)

    @cached_property
    def vectors(self) -> dict[str, Vector]:
        """Components of the symbols that are vectors: signals, and states with a vector as rate of change."""
        vectors = {name: self._components(name) for name in VECTORS}
        for _ in self.rates:
            # A state may depend on another one: known vectors decide which states are vectors.
            for name, rate in self.rates.items():
                if name not in vectors and symbols(rate) & vectors.keys():
                    known = vectors | {name: self._components(name)}
                    vectors = known if isinstance(vectorise(rate, known), tuple) else vectors
        return vectors

    @cached_property
    def slopes(self) -> dict[str, Expression]:
        """Rate of change by state, and by component if the state is a vector.

        Raises
        ------
        InputError
            If a rate has no meaning for vectors.
        """
        slopes: dict[str, Expression] = {}
        for name, rate in self.rates.items():
            read = vectorise(rate, self.vectors)
            if isinstance(read, tuple) is not (name in self.vectors):
                raise InputError(f"the rate of {name}, {to_text(rate)}, has no meaning for vectors")
            if isinstance(read, tuple):
                slopes |= {f"{name}_{axis}": part for axis, part in zip(self.axes, read, strict=True)}
            else:
                slopes[name] = read
        return slopes

    @cached_property
    def begin(self) -> dict[str, Expression]:
        """Start value by state; in space always empty.

        Raises
        ------
        InputError
            If a state has a start value.
        """
        if self.starts:
            raise InputError(f"state {self.starts[0][0]} has a start value, which has no form in space")
        return {}

    @cached_property
    def _linear_forces(self) -> tuple[tuple[LinearParameter, Vector], ...]:
        """Linear parameters in space, each with its force at size 1 along every axis."""
        forces: list[tuple[LinearParameter, Vector]] = []
        components = set().union(*(map(symbols, chain(*self.vectors.values()))))
        for item, column in zip(self.linear, self.columns, strict=True):
            read = vectorise(column, self.vectors)
            if isinstance(read, tuple):
                forces.append((item, read))
                continue
            if symbols(read) & components:
                raise InputError(f"{to_text(column)} has no direction in space")
            # A term without direction, such as a drift, has one parameter per axis.
            for axis in self.axes:
                along = tuple(read if axis == other else ZERO for other in self.axes)
                forces.append(
                    (replace(item, name=f"{item.name}_{axis}", symbol=f"{item.symbol}_{axis}"), along)
                )
        return tuple(forces)

    @cached_property
    def signals(self) -> set[str]:
        """Signals in the force's expression, without signals that only the states' rates use."""
        if self.transforms:
            return super().signals
        parts = chain(*(vector for _, vector in self._linear_forces))
        return set().union(*map(symbols, parts)) & SIGNALS.keys()

    @cached_property
    def _evaluator(self) -> Evaluator:
        if self.transforms:
            return super()._evaluator
        return Evaluator(
            [substitute(part, self._constant_values) for _, vector in self._linear_forces for part in vector]
        )

    def forces(
        self,
        motion: OneMotion,
        nonlinear: np.ndarray,
        solution: Solution | None = None,
        force: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Return the force per linear parameter at size 1, or one transformed force, by axis, shape (axes × samples,) each.

        Parameters
        ----------
        motion : OneMotion
            Motion along the axes, a `SpatialMotion`.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Nonlinear parameters, in the order of the field.
        solution : callable, optional
            Function from the motion along one axis and nonlinear parameters to the states, used if the axes are independent.
        force : numpy.ndarray, shape (axes × samples,), optional
            Force that an output form transforms.
        """
        assert isinstance(motion, SpatialMotion)
        values: dict = self.parameters(nonlinear)
        if force is not None:
            # The readings of the channels for the forces along their axes.
            pieces = motion.split(force)
            for row, (axis, part) in enumerate(zip(self.axes, motion.parts, strict=True)):
                if self.channel in ("", axis):
                    # Path is that in space, other signals are those along the axis.
                    along = {name: SIGNALS[name].of(motion if name == "s" else part) for name in self.signals}
                    (reading,) = self._evaluator({**values, **along, FORCE: pieces[row]})
                    pieces[row] = np.broadcast_to(reading, len(part))
            return [np.concatenate(pieces)]
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
        """Return the states at every sample, in closed form if the states of the axes are independent of each other."""
        if solution is None or not self._are_axes_independent:
            if not all(part.smooth for part in motion.parts):  # in straight lines from sample to sample
                return state.trajectory(motion, self.parameters(nonlinear))
            # A smooth motion may turn between two samples: follow it in smaller steps.
            fine = motion.cache.compute_once(
                "in steps between samples", lambda: motion.each(lambda part: part.finer)
            )
            states = state.trajectory(fine, self.parameters(nonlinear))
            return {name: values[::SUBSTEPS] for name, values in states.items()}
        states = {}
        for axis, part in zip(self.axes, motion.parts, strict=True):
            solved = part.cache.compute_at(
                "states in closed form", nonlinear, partial(solution, part, nonlinear)
            )
            states |= {f"{name}_{axis}": value for (name, _), value in zip(self.states, solved, strict=True)}
        return states

    @cached_property
    def _are_axes_independent(self) -> bool:
        return all(
            not symbols(rate)
            & {f"{name}_{other}" for name in self.vectors for other in self.axes if other != axis}
            for axis in self.axes
            for name, rate in self.slopes.items()
            if name.endswith(f"_{axis}")
        )

    def c_step(self, solution: str = "") -> CStep | None:
        """Return the C code of one sample, with a value per axis; an output form has one value for all channels.

        Parameters
        ----------
        solution : str, optional
            Statements of the states along one axis, which are ignored.
        """
        if self.transforms:
            return super().c_step()
        sums = [
            self._portable(
                Operation("*", (Symbol(item.symbol), vector[row]))
                for item, vector in self._linear_forces
                if vector[row] != ZERO
            )
            for row in range(len(self.axes))
        ]
        return self._c_step_of(sums, (item for item, _ in self._linear_forces))

    def c_step_by_matrices(self) -> CStep:
        """Return the C code with a symmetric matrix for every linear parameter; `element` names its elements."""
        names, sums = [], []
        for row in range(len(self.axes)):
            terms: list[Expression] = []
            for item, vector in self._linear_forces:
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

    @property
    def linear_in_space(self) -> tuple[LinearParameter, ...]:
        """Linear parameters in space; a term without direction has one per axis.

        Raises
        ------
        InputError
            If a part of the equation has no meaning in space. The message names the part.
        """
        if not self.transforms:
            _ = self.begin, self.slopes
            return tuple(item for item, _ in self._linear_forces)
        if self.states or symbols(self.force) & {*VECTORS, *COMPARISONS}:
            raise InputError(f"{self.text} of one channel depends on a motion that is a vector")
        return self.linear
