r"""Differential equations of the states of a form, for a position that is linear between samples.

The step from sample to sample is the exponential Rosenbrock–Euler step (Hochbruck and Ostermann, Acta Numerica 19 (2010)
209-286, section 2.4)::

    r⁺ = r + h φ₁(hJ) f(r),    φ₁(x) = (eˣ − 1)/x,    J = ∂f/∂r,

exact for equations that are linear in the states and of second order for others. Equations in position, path or time get a
clock as an additional state, which makes them autonomous. NumPy solves all samples together by Newton's method (each iteration
solves a banded linear system), but a single state with a clock sample by sample. C computes one step per sample.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat

import numpy as np
import scipy

from lumbar.tissue.models.algebra import MATH, NUMPY, Evaluator, derivative
from lumbar.tissue.models.expression import (
    COMPARISONS,
    ONE,
    ZERO,
    Expression,
    Operation,
    Symbol,
    parts,
    symbols,
)
from lumbar.tissue.models.motion import OneMotion, SpatialMotion
from lumbar.tissue.models.parameter import AXES, LINEAR, POSITIONS, SIGNALS, STEADY

MOST_STATES = 6
"""Largest number of states of one form; with a clock, ``LARGEST_SYSTEM`` of ``effect_forms.h``."""
STEP_SYMBOL = "sampling_time"
"""Symbol of the time from sample to sample in the equations of a step."""
_MAX_ITERATIONS = 40
_MAX_SLOPE = 50.0  # exponent of a state that diverges in one step; no larger one, so that nothing overflows
_MIN_EXPONENT = 1e-4  # below it φ₂ is its series: a difference would have no digits left
_TOLERANCE = 1e-13  # largest change in Newton's last iteration, relative to the largest state
_TERMS = 14  # of φ₁'s series for matrices of a norm up to 1/2: the rest is below rounding
_STEP = Symbol(STEP_SYMBOL)
_ALONG = {f"_{axis}" for axis in AXES}


def _step_of(position: str) -> str:
    """Return the symbol of the change of a position from sample to sample."""
    return "d" + position if position[1:] in _ALONG else "dz"


_RATES: dict[str, Expression] = {
    **{symbol: Symbol(_step_of(symbol)) for symbol in POSITIONS},
    "s": Operation("abs", (Symbol("dz"),)),
    "t": _STEP,
}
"""Change from sample to sample, by signal, for signals that are linear between samples."""


def phi1(x):
    """Return (eˣ − 1)/x, 1 at 0.

    Parameters
    ----------
    x : array_like
        Numbers of any shape; the result has the same shape.
    """
    is_zero = np.equal(x, 0.0)
    return np.where(is_zero, 1.0, np.expm1(x) / np.where(is_zero, 1.0, x))


STEP_FUNCTIONS = {**NUMPY, "phi1": phi1}


@dataclass(frozen=True)
class StateEquation:
    """Differential equations of a form's states."""

    slopes: Mapping[str, Expression]
    """Rate of change per second by state."""
    starts: Mapping[str, Expression] = field(default_factory=dict)
    """Start values by state, as expressions in parameters and the position at the start; 0 for other states."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Symbols of the states."""
        return tuple(self.slopes)

    @cached_property
    def apart(self) -> "list[StateEquation]":
        """The equations, split into groups with states that are independent of each other."""
        groups: list[set[str]] = []
        for name, slope in self.slopes.items():
            known = {name} | (symbols(slope) & set(self.names))
            touched = [group for group in groups if group & known]
            groups = [group for group in groups if not group & known] + [known.union(*touched)]
        return [
            StateEquation({name: slope for name, slope in self.slopes.items() if name in group}, self.starts)
            for group in groups
        ]

    @cached_property
    def signals(self) -> set[str]:
        """Signals in the equations."""
        return set().union(*map(symbols, self.slopes.values())) & SIGNALS.keys()

    @cached_property
    def has_clock(self) -> bool:
        """True if an equation uses signals that change between two samples."""
        return bool(self.signals & LINEAR)

    @cached_property
    def is_scalar(self) -> bool:
        """True if a step can be written as one expression."""
        return len(self.slopes) == 1 and not self.has_clock

    @cached_property
    def is_linear(self) -> bool:
        """True if a step is linear in the states."""
        cells = [slope for row in self._jacobian for slope in row]
        inner = (part for slope in self.slopes.values() for part in parts(slope))
        jumps = [
            part for part in inner if isinstance(part, Operation) and part.name in ("sign", *COMPARISONS)
        ]
        return not any(symbols(part) & set(self.names) for part in (*cells, *jumps))

    @cached_property
    def _jacobian(self) -> list[list[Expression]]:
        return [[derivative(slope, name) for name in self.names] for slope in self.slopes.values()]

    @cached_property
    def increments(self) -> list[Expression]:
        """Change in a step with constant slopes: h f, and 1 for the clock."""
        clock: list[Expression] = [ONE] if self.has_clock else []
        return [_STEP * slope for slope in self.slopes.values()] + clock

    @cached_property
    def matrix(self) -> list[list[Expression]]:
        """Derivatives of the increments by states and clock."""
        rows = [[_STEP * slope for slope in row] for row in self._jacobian]
        if not self.has_clock:
            return rows
        for row, slope in zip(rows, self.slopes.values(), strict=True):
            by_clock: Expression = ZERO
            for signal in sorted(self.signals & LINEAR):
                by_clock = by_clock + derivative(slope, signal) * _RATES[signal]
            row.append(_STEP * by_clock)
        return [*rows, [ZERO] * (len(rows) + 1)]

    @cached_property
    def scalar_step(self) -> Expression:
        """The state after a step, for equations with `is_scalar`."""
        (name, slope), ((jacobian,),) = *self.slopes.items(), self._jacobian
        stretch = Operation("phi1", (_STEP * jacobian,))
        gain = _STEP if jacobian == ZERO else _STEP * stretch
        return Symbol(name) + gain * slope

    def slopes_at_rest(self, values: Mapping[str, float], sampling_time: float) -> np.ndarray:
        """Return the derivatives of the increments of states (rows) by states (columns) without motion, shape (states, states).

        Parameters
        ----------
        values : mapping of str to float
            Parameters and constants by symbol.
        sampling_time : float
            Seconds.
        """
        given = dict.fromkeys((*self.names, *self.signals), 0.0)
        rows = [Evaluator(row, STEP_FUNCTIONS) for row in self._jacobian]
        with np.errstate(all="ignore"):
            return sampling_time * np.array(
                [row({**values, **given, STEP_SYMBOL: sampling_time}) for row in rows], float
            )

    def trajectory(self, motion: OneMotion, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Return the states at every sample, by symbol, shape (samples,); not finite from the sample at which they diverge.

        Parameters
        ----------
        motion : OneMotion
            Motion along one axis or several.
        values : mapping of str to float
            Parameters and constants by symbol.
        """
        if len(self.apart) > 1:
            paths = {
                name: path for part in self.apart for name, path in part.trajectory(motion, values).items()
            }
            return {name: paths[name] for name in self.names}
        steps = len(motion.time) - 1
        trees = [self.starts.get(name, ZERO) for name in self.names]
        places = {name: SIGNALS[name].of(motion)[0] for name in _position_signals(motion)}
        with np.errstate(all="ignore"):
            begin = np.array(Evaluator(trees, STEP_FUNCTIONS)({**values, **places}), float)
        known = {**values, **self._between(motion)}
        one = len(self.names) == 1
        # With a clock, two of Newton's iterations take longer than all samples one by one.
        by_newton = self.is_linear or not (one and self.has_clock)
        # Several states step by step take far longer than an iteration: the last ones are a good guess.
        near = {} if one or self.is_linear else motion.cache.compute_once("states found last", dict)
        guesses = [near[self.names], None] if self.names in near else [None]
        tried = (self._newton(known, steps, begin, guess) for guess in guesses if by_newton)
        states = next((path for path in tried if path is not None), None)
        if states is None:
            states = (self._solve_in_numbers if one else self.solve_stepwise)(known, steps, begin=begin)
        if np.isfinite(states).all():
            near[self.names] = states
        return dict(zip(self.names, states, strict=True))

    def _between(self, motion: OneMotion) -> dict[str, np.ndarray | float]:
        """Return the signals at the beginning of every step."""
        signals: dict[str, np.ndarray | float] = {STEP_SYMBOL: motion.sampling_time}
        for symbol in {*self.signals, *map(_step_of, _position_signals(motion))}:
            if symbol in STEADY:
                part = motion.along(symbol[-1]) if isinstance(motion, SpatialMotion) else motion
                step = part.increments[1:]
                signals[symbol] = step if symbol.startswith("d") else step / motion.sampling_time
            else:
                signals[symbol] = SIGNALS[symbol].of(motion)[:-1]
        return signals

    @cached_property
    def _step_evaluator(self) -> Evaluator:
        if self.is_scalar:
            return Evaluator([self.scalar_step, self.matrix[0][0]], STEP_FUNCTIONS)
        return Evaluator([*self.increments, *(cell for row in self.matrix for cell in row)], STEP_FUNCTIONS)

    def _step(self, values: Mapping, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, (states, steps), and derivatives by states before it, (states, states, steps)."""
        cells = self._step_evaluator(values)
        if self.is_scalar:
            after, exponent = cells
            return np.broadcast_to(after, (1, steps)), np.broadcast_to(np.exp(exponent), (1, 1, steps))
        size, states = len(self.increments), len(self.names)
        numbers = np.array([np.broadcast_to(value, steps) for value in cells], dtype=float)
        increments = numbers[:size].T[..., None]
        matrix = numbers[size:].reshape(size, size, steps).transpose(2, 0, 1)
        stretch = _phi1_of_steps(matrix, states)
        after = np.array([values[name] for name in self.names]) + (stretch @ increments)[:, :states, 0].T
        return after, (np.eye(size) + matrix @ stretch)[:, :states, :states].transpose(1, 2, 0)

    def _newton(
        self, known: Mapping, steps: int, begin: np.ndarray, guess: np.ndarray | None
    ) -> np.ndarray | None:
        """Return the states at all samples, shape (states, steps + 1), from a `guess`; None if the iteration does not end."""
        # Begin with constant states; linearise every step; solve all steps as one banded system.
        states = np.repeat(begin[:, None], steps + 1, axis=1) if guess is None else guess
        with np.errstate(all="ignore"):
            for _ in range(_MAX_ITERATIONS):
                before = states[:, :-1]
                after, slopes = self._step({**known, **dict(zip(self.names, before, strict=True))}, steps)
                driven = after - np.einsum("ijk,jk->ik", slopes, before)
                if not (np.isfinite(driven).all() and np.isfinite(slopes).all()):
                    return None
                driven[:, 0] += slopes[:, :, 0] @ begin
                try:
                    solved = _recursion(slopes, driven)
                except np.linalg.LinAlgError:  # slopes so large that the system overflows
                    return None
                if not np.isfinite(solved).all():
                    return None
                solved[:, 0] = begin
                change = np.abs(solved - states).max()
                states = solved
                if self.is_linear or change <= _TOLERANCE * np.abs(states).max():
                    return states
        return None

    def _solve_in_numbers(self, known: Mapping, steps: int, begin: np.ndarray) -> np.ndarray:
        """Solve for one state sample by sample with plain numbers, forty times as fast as with arrays of length 1.

        With a clock the step is φ₁(x) h f + φ₂(x) g, x = hJ, with the derivative g of h f by the clock.
        """
        evaluate = Evaluator([self.increments[0], *self.matrix[0]], MATH)
        constants = {name: float(value) for name, value in known.items() if not np.ndim(value)}
        series = {name: np.asarray(value).tolist() for name, value in known.items() if np.ndim(value)}
        (symbol,) = self.names
        path = [state := float(begin[0])]
        for now in zip(*series.values(), strict=True) if series else repeat((), steps):
            try:
                values = {**constants, **dict(zip(series, now, strict=True)), symbol: state}
                added, slope, *by_clock = map(float, evaluate(values))
            except (OverflowError, ValueError):  # beyond the largest number; NumPy would return inf or nan
                break
            slope = min(slope, _MAX_SLOPE)
            first = math.expm1(slope) / slope if slope else 1.0
            second = (first - 1.0) / slope if abs(slope) > _MIN_EXPONENT else 0.5 + slope / 6
            state += first * added + (second * by_clock[0] if by_clock else 0.0)
            path.append(state)
        return np.array([path + [math.nan] * (steps + 1 - len(path))])

    def solve_stepwise(self, known: Mapping, steps: int, begin: np.ndarray | float = 0.0) -> np.ndarray:
        """Solve for the states step by step as in C; shape (states, steps + 1).

        Parameters
        ----------
        known : mapping of str to float or numpy.ndarray, shape (steps,)
            Parameters, and signals at the beginning of every step, by symbol.
        steps : int
            Number of steps.
        begin : float or numpy.ndarray, shape (states,), optional
            Start values.
        """
        states = np.zeros((len(self.names), steps + 1))
        states[:, 0] = begin
        series = {name: value for name, value in known.items() if np.ndim(value)}
        with np.errstate(all="ignore"):
            for k in range(steps):
                now = {name: value[k : k + 1] for name, value in series.items()}
                before = {name: states[row, k : k + 1] for row, name in enumerate(self.names)}
                states[:, k + 1] = self._step({**known, **now, **before}, 1)[0][:, 0]
        return states


def _position_signals(motion: OneMotion) -> tuple[str, ...]:
    """Return the symbols of the motion's positions."""
    if isinstance(motion, SpatialMotion):
        return tuple(f"z_{name}" for name in motion.names)
    return tuple(name for name in POSITIONS if name[1:] not in _ALONG)


def _phi1_of_steps(matrix: np.ndarray, states: int) -> np.ndarray:
    """Return φ₁ of matrices, shape (steps, size, size), for a number of states (`states`) and perhaps a clock.

    Linear equations have constant derivatives A by the states. For them φ₁([[A, c], [0, 0]]) = [[φ₁(A), φ₂(A) c], [0, 1]], and
    φ₂ is part of φ₁([[A, I], [0, 0]]) (Al-Mohy and Higham, SIAM J. Sci. Comput. 33 (2011) 488-511, theorem 2.1), so that one
    matrix is enough.
    """
    by_states, by_clock = matrix[:, :states, :states], matrix[:, :states, states:]
    if not (by_states == by_states[:1]).all():
        return _matrix_phi1(matrix)
    whole = np.zeros((1, 2 * states, 2 * states))
    whole[0, :states] = np.hstack([by_states[0], np.eye(states)])
    phi1_and_2 = _matrix_phi1(whole)[0, :states]
    result = np.zeros_like(matrix)
    result[:, :states, :states] = phi1_and_2[:, :states]
    result[:, :states, states:] = phi1_and_2[:, states:] @ by_clock
    result[:, states:, states:] = 1.0
    return result


def _matrix_phi1(matrix: np.ndarray) -> np.ndarray:
    """Return φ₁ of matrices, shape (steps, size, size), by the series for a fraction of the matrix and repeated doubling."""
    identity = np.eye(matrix.shape[-1])
    norm = np.abs(matrix).sum(axis=2).max(initial=0.0)
    halvings = max(0, int(np.ceil(np.log2(norm))) + 1) if np.isfinite(norm) and norm > 0 else 0
    small = matrix / 2.0**halvings
    result = np.broadcast_to(identity, matrix.shape)
    for order in range(_TERMS, 1, -1):
        result = identity + small @ result / order
    for _ in range(halvings):
        result = 0.5 * (2 * identity + small @ result) @ result
        small = 2 * small
    return result


def _recursion(slopes: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """Solve rₖ = Sₖ rₖ₋₁ + dₖ from r₀ = 0: shapes (states, states, steps), (states, steps), (states, steps + 1)."""
    states, steps = driven.shape
    right = np.concatenate([np.zeros(states), driven.T.ravel()])
    solved = scipy.linalg.solve_banded(
        (2 * states - 1, 0),
        step_bands(slopes),
        right,
        overwrite_ab=True,
        overwrite_b=True,
        check_finite=False,
    )
    return solved.reshape(steps + 1, states).T


def step_bands(slopes: np.ndarray) -> np.ndarray:
    """Return the lower bands of the system yₖ − Sₖ yₖ₋₁ as in LAPACK, diagonal first, shape (2 * size, size * (steps + 1)).

    Parameters
    ----------
    slopes : numpy.ndarray, shape (size, size, steps)
        S of every step.
    """
    size, _, steps = slopes.shape
    bands = np.zeros((2 * size, size * (steps + 1)))
    bands[0] = 1.0
    for row, column in np.ndindex(size, size):
        bands[size + row - column, column : size * steps : size] = -slopes[row, column]
    return bands
