r"""Motion of a model that is driven by a force: R(z, ż, z̈, r, t) = F(t), ṙ = ρ(z, ż, r), with or without a mass.

Collocation at Radau's three points (Radau IIA, order 5, stiffly accurate: Hairer and Wanner, Solving Ordinary Differential
Equations II (1996), section IV.5), which also solves a balance without mass (section VI.1) and damps stiff parts. Newton's
method solves a window of many steps: each iteration solves the linearised steps and joins them by a linear recursion. The
leading converged steps are kept; if the other steps do not converge, the window is shortened. The balance R follows from the
equations of the base and of every form.
"""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.tissue.models.algebra import Evaluator, derivative
from lumbar.tissue.models.expression import Expression, Number, Symbol, parse, substitute, symbols
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.parameter import SIGNALS
from lumbar.tissue.models.state_equation import step_bands

MOTION = ("z", "v", "a")
"""Symbols of position, velocity and acceleration."""
_KNOWN = {*MOTION, "s", "t"}  # signals that a simulation from force to motion has


def can_be_simulated(form: Form) -> bool:
    """Return whether a parallel form can be part of a balance of forces: it is an equation in signals of the simulation.

    The states must start at 0, since the position at the start is unknown.

    Parameters
    ----------
    form : Form
        Any form; the result is False for a form that is not parallel.
    """
    if form.hand_written or form.place is not Place.PARALLEL or form.start:
        return False
    equation = form.parsed_equation
    trees = (equation.force, *equation.slopes.values())
    try:
        for symbol in (*MOTION, *equation.slopes):
            _ = [derivative(tree, symbol) for tree in trees]
    except InputError:  # a state or the motion in an exponent
        return False
    return set().union(*map(symbols, trees)) & SIGNALS.keys() <= _KNOWN


@dataclass(frozen=True)
class ForceBalance:
    """Balance of forces of a model that is driven by a force."""

    pieces: tuple[Form, ...]
    """The base as a form, then the parallel forms of effects."""

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Symbols of the linear parameters, piece by piece, then of the nonlinear parameters."""
        pieces = list(enumerate(self.pieces))
        linear = [_indexed(item.symbol, index) for index, form in pieces for item in form.linear]
        return (*linear, *(_indexed(item.symbol, index) for index, form in pieces for item in form.nonlinear))

    @cached_property
    def _substitutions(self) -> list[dict[str, Expression]]:
        """For each piece: constants and indexed symbols, by the symbols of the piece."""
        substitutions: list[dict[str, Expression]] = []
        for index, form in enumerate(self.pieces):
            names = [item.symbol for item in (*form.linear, *form.nonlinear)] + [
                name for name, _ in form.state
            ]
            constants: dict[str, Expression] = {item.symbol: Number(item.value) for item in form.constants}
            substitutions.append(constants | {name: Symbol(_indexed(name, index)) for name in names})
        return substitutions

    @cached_property
    def force(self) -> Expression:
        """The balance R, with separate symbols for each piece."""
        terms = [
            names[item.symbol] * substitute(column, names)
            for form, names in zip(self.pieces, self._substitutions, strict=True)
            for item, column in zip(form.linear, form.parsed_equation.columns, strict=True)
        ]
        return reduce(operator.add, terms)

    @cached_property
    def rates(self) -> dict[str, Expression]:
        """Rate of change of every state; if an equation uses the path travelled, it is a state."""
        rates = {
            _indexed(name, index): substitute(slope, self._substitutions[index])
            for index, form in enumerate(self.pieces)
            for name, slope in form.parsed_equation.slopes.items()
        }
        if "s" in set().union(*map(symbols, (self.force, *rates.values()))):
            rates["s"] = parse("abs(v)")
        return rates

    @property
    def states(self) -> tuple[str, ...]:
        """Symbols of the states."""
        return tuple(self.rates)

    @cached_property
    def _evaluators(self) -> tuple[Evaluator, Evaluator]:
        """Evaluators of R and the states' rates: without and with derivatives."""
        trees = (self.force, *self.rates.values())
        slopes = (derivative(tree, name) for tree in trees for name in (*MOTION, *self.states))
        return Evaluator(trees), Evaluator([*trees, *slopes])

    def values(self, known: Mapping[str, np.ndarray | float], shape: tuple[int, ...]) -> np.ndarray:
        """Return R (unit of the force) and the states' rates (per second), shape (1 + states, *shape).

        Parameters
        ----------
        known : mapping of str to array_like
            Values of all symbols, each of a shape that broadcasts to `shape`.
        shape : tuple of int
            Shape of one result.
        """
        return np.array([np.broadcast_to(item, shape) for item in self._evaluators[0](known)], dtype=float)

    def slopes(
        self, known: Mapping[str, np.ndarray | float], shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return R and the states' rates as `values` does, and their derivatives by z, ż, z̈ and the states.

        The derivatives have shape (1 + states, 3 + states, *shape).

        Parameters
        ----------
        known : mapping of str to array_like
            Values of all symbols, each of a shape that broadcasts to `shape`.
        shape : tuple of int
            Shape of one result.
        """
        count = 1 + len(self.states)
        numbers = np.array([np.broadcast_to(item, shape) for item in self._evaluators[1](known)], dtype=float)
        return numbers[:count], numbers[count:].reshape(count, len(MOTION) + count - 1, *shape)


def linearise(
    form: Form, linear: Sequence[float], nonlinear: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the slopes of force (row 0) and states' rates of a base at 0: by z, ż, z̈, and by states, (1 + states, states).

    Parameters
    ----------
    form : Form
        Equation of the base.
    linear, nonlinear : sequence of float
        Parameters of the base, in the form's order and units.
    """
    balance = ForceBalance((form,))
    known = dict(zip(balance.parameters, (*linear, *nonlinear), strict=True))
    known |= dict.fromkeys(("z", "v", "a", "s", "t", *balance.states), 0.0)
    with np.errstate(all="ignore"):
        _, slopes = balance.slopes(known, ())
    return slopes[:, : len(MOTION)], slopes[:, len(MOTION) :]


def _indexed(symbol: str, index: int) -> str:
    """Return the indexed symbol of a piece, because two forms may use the same symbol."""
    return f"{symbol}__{index}"


_ROOT = np.sqrt(6.0)
POINTS = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])
"""Collocation points, as fractions of a step."""
_INTEGRAL = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
_RATE = np.linalg.inv(_INTEGRAL)
"""Matrix from the changes between a step's beginning and its points to the derivatives at the points, per step."""
_SUM = _RATE.sum(axis=1)
_RATE2, _SUM2 = _RATE @ _RATE, _RATE @ _SUM
_STAGES = len(POINTS)
_MAX_ITERATIONS = 14  # then only converged steps are kept, and fewer steps are taken together
_MAX_DAMPED_ITERATIONS = 40  # of a single step
_DAMPING_FACTORS = 0.5 ** np.arange(12)
_WINDOW_DIVISOR = 8  # of the number of steps taken together, after a failure
_MAX_FAILURES = 10  # at the first step
_FAILURES_PER_STEP = 0.05  # friction that sticks now and then costs one failure each time
_TANGENT_ITERATIONS = 3  # every third iteration is Newton's own, the others use secants over the speed
_TOLERANCE = 1e-7  # largest change of the position in the last iteration, relative to its size
_WINDOW_STEPS = 400  # taken together without a guess


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """A simulated motion."""

    position: np.ndarray
    """Position at the ends of the steps, shape (steps + 1,)."""
    velocity: np.ndarray
    """Velocity at the ends of the steps, shape (steps + 1,)."""
    states: np.ndarray
    """States at the ends of the steps, shape (states, steps + 1)."""
    points: np.ndarray
    """Position and states at the collocation points, shape (1 + states, steps, 3)."""

    @property
    def is_finite(self) -> bool:
        """True if the simulation succeeded."""
        return bool(np.isfinite(self.points).all())


@dataclass(frozen=True, eq=False)
class ForceDrive:
    """A balance of forces and the force that drives it."""

    balance: ForceBalance
    force: np.ndarray
    """Force at the collocation points of every step, shape (steps, 3)."""
    step: float
    """Duration of a step in seconds."""
    size: float
    """Typical size of the positions."""
    parts: int = 1
    """Number of steps from sample to sample."""

    def motion(
        self, parameters: Mapping[str, float], start: np.ndarray, guess: np.ndarray | None = None
    ) -> DrivenMotion:
        """Simulate from a start; the result is not finite if no motion solves the equations.

        Parameters
        ----------
        parameters : mapping of str to float
            Values by the balance's symbols.
        start : numpy.ndarray, shape (2 + states,)
            Position, velocity and states at the beginning.
        guess : numpy.ndarray, shape (1 + states, steps, 3), optional
            First values of the iteration.
        """
        steps, states = len(self.force), len(self.balance.states)
        points = np.zeros((1 + states, steps, _STAGES)) if guess is None else guess.copy()
        begun, first, failures = np.asarray(start, dtype=float), 0, 0
        together = min(steps, _WINDOW_STEPS) if guess is None else steps
        with np.errstate(all="ignore"):
            while first < steps:
                last = min(first + together, steps)
                window = slice(first, last)
                if failures or guess is None:  # a failed iteration leaves no useful guess
                    points[:, window] = np.concatenate([begun[:1], begun[2:]])[:, None, None]
                solved, good = self._iterate(parameters, begun, points[:, window], window)
                points[:, first : first + good] = solved[:, :good]
                if good:
                    begun = self._ends(solved[:, :good], begun)[:, -1]
                    first += good
                if first < last:
                    failures += 1
                    fewer = together // _WINDOW_DIVISOR
                    together = max(min(fewer, 2 * good) if good else fewer, 1)
                    allowed = _MAX_FAILURES + _FAILURES_PER_STEP * first
                    if failures > allowed or (not good and last - first <= 1):
                        points[:] = np.nan
                        break
                elif together < _WINDOW_STEPS:
                    together *= 2
        ends = self._ends(points, np.asarray(start, dtype=float))
        return DrivenMotion(ends[0], ends[1], ends[2:], points)

    def _iterate(self, parameters, begun, points, window) -> tuple[np.ndarray, int]:
        """Return the points after Newton's iterations over a window, and the number of leading steps that converged."""
        good = 0
        for number in range(1, 1 + (_MAX_ITERATIONS if len(points[0]) > 1 else _MAX_DAMPED_ITERATIONS)):
            # Beyond its knee, friction has no slope: tangents overshoot, secants do not.
            secant = len(points[0]) > 1 and number % _TANGENT_ITERATIONS > 0
            local, slope, driven = self._linearise(parameters, begun, points, window, secant=secant)
            joined = recursion(slope, driven)[:, :, 0]
            change = local[..., 0] + np.einsum("kij,kj->ki", local[..., 1:], joined[:-1])
            change = change.reshape(len(change), -1, _STAGES).transpose(1, 0, 2)
            share = 1.0 if len(points[0]) > 1 else self._damping(parameters, begun, points, change, window)
            points = points + share * change
            is_broken = ~(np.isfinite(points).all(axis=(0, 2)))
            is_settled = np.abs(change[0]).max(axis=1) <= _TOLERANCE * self.size
            wrong = np.flatnonzero(is_broken | ~is_settled)
            good = len(is_settled) if not len(wrong) else int(wrong[0])
            if not len(wrong) or is_broken.all():
                break
            points[:, is_broken] = 0.0
        return points, good

    def _damping(self, parameters, begun, points, change, window) -> float:
        """Return a factor at which Newton's change lowers the residual; with sticking friction full changes alternate."""

        def size(factor: float) -> float:
            trial = points + factor * change
            values = self.balance.values(self._known(parameters, begun, trial, window), trial.shape[1:])
            return float(np.abs(self._residual(values, trial, begun, window)).sum())

        here = size(0.0)
        return next((factor for factor in _DAMPING_FACTORS if size(factor) < here), 1.0)

    def _ends(self, points: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return position, velocity and states at the beginning and after every step, shape (2 + states, steps + 1)."""
        position = np.append(start[0], points[0, :, -1])
        speed = (points[0] @ _RATE[-1] - _SUM[-1] * position[:-1]) / self.step
        states = np.column_stack([start[2:], points[1:, :, -1]])
        return np.vstack([position, np.append(start[1], speed), states])

    def _known(self, parameters, begun, points, window) -> dict:
        """Return the values of all symbols at the collocation points."""
        before = self._ends(points, begun)[:, :-1]
        speed = (points[0] @ _RATE.T - before[0][:, None] * _SUM) / self.step
        acceleration = (speed @ _RATE.T - before[1][:, None] * _SUM) / self.step
        time = self.step * (np.arange(window.start, window.stop)[:, None] + POINTS)
        named = dict(zip(self.balance.states, points[1:], strict=True))
        return {**parameters, **named, "z": points[0], "v": speed, "a": acceleration, "t": time}

    def _residual(self, values, points, begun, window) -> np.ndarray:
        """Return the residual of the equations, shape (steps, 1 + states, 3)."""
        before = self._ends(points, begun)[2:, :-1]
        rates = (points[1:] @ _RATE.T - before[:, :, None] * _SUM) / self.step
        return np.concatenate([values[:1] - self.force[window], rates - values[1:]]).transpose(1, 0, 2)

    def _linearise(
        self, parameters, begun, points, window, right_sides: np.ndarray | None = None, secant: bool = False
    ):
        """Linearise every step. Return its changes by right-hand side and by start, and slope and constant of the recursion.

        `right_sides`, shape (steps, 1 + states, 3, columns), replace the residual of the equations. If `secant`, the slope of the
        force by the speed is that from rest if it is larger.
        """
        known = self._known(parameters, begun, points, window)
        steps, count, rate = points.shape[1], len(points), 1 / self.step
        values, slopes = self.balance.slopes(known, points.shape[1:])
        if secant:
            resting = self.balance.values({**known, "v": 0.0}, points.shape[1:])
            slopes[0, 1] = np.fmax(slopes[0, 1], (values[0] - resting[0]) / known["v"])
        if right_sides is None:
            right_sides = self._residual(values, points, begun, window)[..., None]
        by_z, by_v, by_a, by_r = slopes[:, 0], slopes[:, 1], slopes[:, 2], slopes[:, 3:]
        # Equations of a step by its unknowns, z and the states at the three points, and by z, ż and the states at its start.
        matrix = np.zeros((steps, count, _STAGES, count, _STAGES))
        start = np.zeros((steps, count, _STAGES, count + 1))
        each = np.arange(_STAGES)
        for row in range(count):
            # Row 0 is R − F, the others are ṙ − ρ. Velocity and acceleration at the points follow from the positions there.
            sign = -1.0 if row else 1.0
            block = rate * by_v[row][:, :, None] * _RATE + rate**2 * by_a[row][:, :, None] * _RATE2
            block[:, each, each] += by_z[row]
            matrix[:, row, :, 0, :] = sign * block
            start[:, row, :, 0] = -sign * (rate * by_v[row] * _SUM + rate**2 * by_a[row] * _SUM2)
            start[:, row, :, 1] = -sign * rate * by_a[row] * _SUM
            for column in range(1, count):
                matrix[:, row, each, column, each] += sign * by_r[row, column - 1]
            if row:
                matrix[:, row, :, row, :] += rate * _RATE
                start[:, row, :, row + 1] -= rate * _SUM
        # Solve every step for its right-hand sides and for its start.
        size, columns = count * _STAGES, right_sides.shape[-1]
        whole = np.concatenate(
            [right_sides.reshape(steps, size, columns), start.reshape(steps, size, count + 1)], axis=2
        )
        try:
            local = -np.linalg.solve(matrix.reshape(steps, size, size), whole)
        except np.linalg.LinAlgError:
            local = np.full(whole.shape, np.nan)
        # Position, velocity and states at the end of a step, which are the start of the next one.
        last = slice(_STAGES - 1, None, _STAGES)
        ends = np.insert(local[:, last], 1, rate * (_RATE[-1] @ local[:, :_STAGES]), axis=1)
        driven, slope = ends[..., :columns], ends[..., columns:]
        slope[:, 1, 0] -= rate * _SUM[-1]
        return local, slope, driven

    def sensitivities(
        self,
        parameters: Mapping[str, float],
        motion: DrivenMotion,
        changes: list[tuple[str, float]],
        by_start: bool = False,
    ) -> np.ndarray:
        """Return the derivatives of the position by parameters, and by position, velocity and states at the start.

        Shape (steps + 1, derivatives): one column per change; with `by_start` also for position, velocity and every state.

        Parameters
        ----------
        parameters : mapping of str to float
            Values by the balance's symbols.
        motion : DrivenMotion
            Result of `motion` for these parameters.
        changes : list of (str, float)
            Symbol of each parameter, and the step for central differences of the equations (not of the motion).
        by_start : bool, optional
            True if derivatives by the start follow the derivatives by parameters.
        """
        steps, count = len(self.force), len(motion.points)
        start = np.concatenate([[motion.position[0], motion.velocity[0]], motion.states[:, 0]])
        window = slice(0, steps)
        known = self._known(parameters, start, motion.points, window)
        right_sides = np.zeros((steps, count, _STAGES, len(changes)))
        sign = np.array([1.0] + [-1.0] * (count - 1))[:, None, None]
        with np.errstate(all="ignore"):
            for column, (name, step) in enumerate(changes):
                more, less = (
                    self.balance.values({**known, name: parameters[name] + change}, motion.points.shape[1:])
                    for change in (step, -step)
                )
                right_sides[..., column] = (sign * (more - less) / (2 * step)).transpose(1, 0, 2)
            _, slope, driven = self._linearise(parameters, start, motion.points, window, right_sides)
            first = np.zeros((count + 1, len(changes)))
            if by_start:
                driven = np.concatenate([driven, np.zeros((steps, count + 1, count + 1))], axis=2)
                first = np.concatenate([first, np.eye(count + 1)], axis=1)
            return recursion(slope, driven, first)[:, 0]


def recursion(slope: np.ndarray, driven: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
    """Solve yₖ₊₁ = Sₖ yₖ + dₖ for several right-hand sides; shape (steps + 1, size, columns).

    The result is NaN at and after the first step that is not finite.

    Parameters
    ----------
    slope : numpy.ndarray, shape (steps, size, size)
        S of every step.
    driven : numpy.ndarray, shape (steps, size, columns)
        d of every step and right-hand side.
    first : numpy.ndarray, shape (size, columns), optional
        y₀; 0 by default.
    """
    steps, size, columns = driven.shape
    bands = step_bands(slope.transpose(1, 2, 0))
    right = np.concatenate([np.zeros((1, size, columns)) if first is None else first[None], driven])
    right = right.reshape(size * (steps + 1), columns)
    if not (np.isfinite(bands).all() and np.isfinite(right).all()):
        # Solve the steps before the first one that is not finite; the later ones are unknown.
        is_wrong = ~(np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(driven).all(axis=(1, 2)))
        whole = int(np.argmax(is_wrong)) if is_wrong.any() else 0
        result = np.full((steps + 1, size, columns), np.nan)
        result[0] = right[:size]
        if whole:
            result[: whole + 1] = recursion(slope[:whole], driven[:whole], first)
        return result
    # Forward substitution without pivoting: the large slopes of sticking friction would lead to a zero pivot.
    solved, _ = scipy.linalg.lapack.dtbtrs(bands, right, uplo="L", diag="U")
    return solved.reshape(steps + 1, size, columns)
