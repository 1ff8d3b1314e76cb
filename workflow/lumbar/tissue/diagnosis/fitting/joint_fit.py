"""Joint fit of base and effects to a record by free-run simulation error.

Linear parameters enter linearly and are eliminated (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973)
413-432); only nonlinear parameters are searched. Forms that act on the output make the problem nonlinear in all of them; then
all parameters are searched together, from the linear solution.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import scipy

from lumbar.base.progress import notify_progress
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, FreeRun
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion import JoinedMotions, Motion, SpatialMotion
from lumbar.tissue.models.parameter import NonlinearParameter
from lumbar.tissue.models.structure import Structure


@dataclass(frozen=True, eq=False)
class Fit(FreeRun):
    """A fitted model."""

    structure: Structure
    linear: np.ndarray
    nonlinear: np.ndarray
    squared_error: float
    """Sum of squared (whitened) errors over the samples that count."""
    converged: bool = True
    """Whether the optimiser reported convergence."""
    zeros: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Readings of the response's sensor at 0: one number, or one for each record that was fitted; none if the base has no zero
    (`Base.sensor_zero`)."""

    @property
    def zero(self) -> float:
        """The sensor's zero, the mean of those of the records where each has one of its own; 0 without."""
        return float(np.mean(self.zeros)) if len(self.zeros) else 0.0

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation of what the sensor reads, shape (samples,)."""
        simulated = self.structure.simulate(motion, self.linear, self.nonlinear)
        return simulated + self._zeros_along(motion, self.zeros)

    def _zeros_along(self, motion: Motion | JoinedMotions, zeros: np.ndarray) -> np.ndarray | float:
        """Zeros as a motion has them: one for all, one for each of its records, one for each axis, one for each of both."""
        if not isinstance(motion, JoinedMotions):
            return float(np.mean(zeros)) if len(zeros) else 0.0
        if isinstance(motion, SpatialMotion):
            parts = zeros.reshape(-1, len(motion.parts)).mean(axis=0)
            return np.repeat(parts, len(motion.parts[0]))
        axes = len(motion.parts[0].parts) if isinstance(motion.parts[0], SpatialMotion) else 1
        if len(zeros) != axes * len(motion.parts):
            zeros = np.tile(zeros, len(motion.parts)) if axes > 1 else np.full(len(motion.parts), self.zero)
        found = [
            np.broadcast_to(self._zeros_along(part, own), len(part))
            for part, own in zip(motion.parts, zeros.reshape(len(motion.parts), -1), strict=True)
        ]
        return np.concatenate(found)

    def sensitivities(self, data: FitData) -> np.ndarray:
        """Derivatives of the whitened simulation by linear parameters, logarithms of nonlinear ones, and the sensor's zeros.

        By central differences; the zeros, where there are any, come last.

        The result has shape (samples that count, parameters).
        """

        def simulated(linear, logarithms):
            return data.whiten(self.structure.simulate(data.motion, linear, np.exp(logarithms)))

        columns, linear, logarithms = [], self.linear, np.log(self.nonlinear)
        scale = np.abs(linear)
        steps = 1e-4 * np.where(scale > 0, scale, scale.max() or 1.0)
        for step, change in zip(steps, np.diag(steps), strict=True):
            difference = simulated(linear + change, logarithms) - simulated(linear - change, logarithms)
            columns.append(difference / (2 * step))
        for change in 1e-4 * np.eye(len(logarithms)):
            difference = simulated(linear, logarithms + change) - simulated(linear, logarithms - change)
            columns.append(difference / 2e-4)
        if self.structure.base.sensor_zero:
            columns += list(data.whiten(data.zeros).T)
        return np.stack(columns, axis=1)


def solve_linear(design: np.ndarray, force: np.ndarray, signs: tuple[int, ...]) -> np.ndarray:
    """Least squares with sign constraints, shape (linear parameters,).

    `design` has shape (samples, linear parameters), `force` (samples,). A sign of 1 means not negative, -1 not
    positive, 0 free.
    """
    columns = design.T
    # In two parts: for a matrix of few columns times itself BLAS takes several times as long.
    normal = np.concatenate([columns[:1] @ design, columns[1:] @ design])
    size = np.sqrt(normal.diagonal())
    size[size == 0] = 1.0
    normal /= size[:, None] * size
    right = (columns @ force) / size
    # A ridge far below rounding of the data keeps columns that have become equal solvable.
    normal.flat[:: len(size) + 1] += 1e-11
    free = np.linalg.solve(normal, right)
    if all(sign * value >= 0 for sign, value in zip(signs, free, strict=True)):
        return free / size
    return _solve_with_signs(normal, right, signs, free) / size


def _solve_with_signs(
    normal: np.ndarray, right: np.ndarray, signs: tuple[int, ...], free: np.ndarray
) -> np.ndarray:
    """Least squares with sign constraints, from the solution without them."""
    # Mostly those are 0 whose signs are wrong without constraints: optimal if no other sign is, nor any slope at 0.
    ways = np.array(signs)
    kept = ways * free >= 0
    linear = np.zeros(len(signs))
    linear[kept] = np.linalg.solve(normal[kept][:, kept], right[kept])
    slopes = right - normal @ linear
    if np.all(ways * linear >= 0) and np.all((ways * slopes)[~kept] <= 0):
        return linear
    return _by_active_set(normal, right, signs)


def _by_active_set(normal: np.ndarray, right: np.ndarray, signs: tuple[int, ...]) -> np.ndarray:
    """Non-negative least squares on the Cholesky factor; a free amplitude is a difference of two."""
    factor = np.linalg.cholesky(normal)
    target = np.linalg.solve(factor, right)
    expanded = [(index, 1.0) for index, sign in enumerate(signs) if sign >= 0]
    expanded += [(index, -1.0) for index, sign in enumerate(signs) if sign <= 0]
    positive, _ = scipy.optimize.nnls(
        np.stack([direction * factor[index] for index, direction in expanded], axis=1), target
    )
    linear = np.zeros(len(signs))
    for (index, direction), value in zip(expanded, positive, strict=True):
        linear[index] += direction * value
    return linear


def shape_bounds(structure: Structure, data: FitData, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds of all nonlinear parameters."""
    bounds = []
    for shape, value in zip(structure.nonlinear, start, strict=True):
        if shape.lines is not None:
            reach = shape.lines / data.motion.time[-1]
            bounds.append((max(value - reach, 0.1 * value), value + reach))
        else:
            times = data.motion.sampling_time, data.scale("duration")
            bounds.append(shape.bounds(data.scale(shape.scale), *times))
    return tuple(np.array(bounds).reshape(-1, 2).T)


def nonlinear_starts(form: Form, data: FitData, residual: np.ndarray) -> list[np.ndarray]:
    """Return the starting nonlinear parameters of a form: its own, or the grid of all its nonlinear parameters."""
    if form.starts is not None:
        return form.starts(*data.longest_record(residual))
    return combinations(form.nonlinear, data)


def combinations(parameters: Sequence[NonlinearParameter], data: FitData) -> list[np.ndarray]:
    """Return every combination of the starting values of nonlinear parameters."""
    return [np.array(point) for point in product(*_grids(parameters, data))]


def _grids(parameters: Sequence[NonlinearParameter], data: FitData) -> list[np.ndarray]:
    return [item.grid(data.scale(item.scale), data.motion.sampling_time) for item in parameters]


EVALUATIONS = 40
"""Largest number of evaluations of the error per search."""
_STEP = 1e-5
"""Step of a difference, in logarithms."""
_OFF_BOUND = 1e-3
"""Share of the logarithmic range that a start keeps from its bounds: closer to one, a search sticks to it."""


def fit(structure: Structure, data: FitData, start: np.ndarray) -> Fit:
    """Fit a structure to a record from one start of its nonlinear parameters, base first.

    The same fit is returned wherever the same is asked for.
    """
    notify_progress()
    return data.cache.compute_once((structure, start.tobytes()), lambda: _search(structure, data, start))


def _search(structure: Structure, data: FitData, start: np.ndarray) -> Fit:
    if not len(start):
        return fit_at(structure, data, start) if structure.is_linear else _search_all(structure, data, start)
    low, high = shape_bounds(structure, data, start)
    room = (high / low) ** _OFF_BOUND
    start = np.clip(start, low * room, high / room)
    search = _search_nonlinear if structure.is_linear else _search_all
    return search(structure, data, start, low, high)


def fit_at(structure: Structure, data: FitData, nonlinear: np.ndarray, converged: bool = True) -> Fit:
    """Solve for the linear parameters at given nonlinear parameters; no form acts on the output."""
    design = _with_zero(structure, data, structure.design(data.motion, nonlinear))
    force = data.whiten(data.force)
    linear = solve_linear(design, force, _signs(structure, data))
    error = force - design @ linear
    return _fit_of(structure, linear, nonlinear, error, converged)


def _with_zero(structure: Structure, data: FitData, design: np.ndarray) -> np.ndarray:
    """Whitened columns that count, the sensor's zeros last."""
    if structure.base.sensor_zero:
        design = np.concatenate([design.T, data.zeros.T]).T  # column by column in memory
    return data.whiten(design)


def _signs(structure: Structure, data: FitData) -> tuple[int, ...]:
    """Sign constraints of the linear parameters and of the sensor's zeros."""
    return (*structure.signs, *[0] * data.zeros.shape[1]) if structure.base.sensor_zero else structure.signs


def _of_zeros(structure: Structure, data: FitData, linear: np.ndarray) -> np.ndarray | float:
    """What the sensor's zeros, behind the linear parameters, add to the simulation."""
    return data.zeros @ linear[len(structure.linear) :] if structure.base.sensor_zero else 0.0


def _fit_of(
    structure: Structure, linear: np.ndarray, nonlinear: np.ndarray, error: np.ndarray, converged: bool
) -> Fit:
    """Fit from its linear parameters with the sensor's zero behind them."""
    count = len(structure.linear)
    return Fit(structure, linear[:count], nonlinear, float(error @ error), converged, linear[count:])


def _least_squares(error, jacobian, start, low, high, **tolerances):
    """Least squares of an error in few parameters, by scipy on the triangular factor of Jacobian and error.

    Rotated by the other factor they are as many numbers as there are parameters, and one; cost, gradient and singular values,
    which is all that the search looks at, stay the same.

    `error` goes from parameters to the error, shape (samples,); `jacobian` from parameters and the error there to its
    derivatives, shape (samples, parameters). The search is the same in every unit: it divides by the first error, and what
    it asks of the gradient's size alone is left out.
    """
    least, rotated, unit = np.inf, np.empty(0), float(np.linalg.norm(error(start))) or 1.0

    def fun(vector):
        nonlocal least, rotated
        found = error(vector)
        square = float(found @ found) / unit**2
        if square > least * (1 + 1e-9):  # no step is made there: the size alone counts
            return np.append(np.zeros(len(vector)), np.sqrt(square))
        least = min(least, square)
        rotated = np.linalg.qr(np.column_stack([jacobian(vector, found), found]) / unit, mode="r")
        return rotated[:, -1]

    return scipy.optimize.least_squares(
        fun,
        start,
        jac=lambda _: rotated[:, :-1],
        bounds=(low, high),
        gtol=1e-15,
        max_nfev=EVALUATIONS,
        **tolerances,
    )


def _search_nonlinear(structure, data, start, low, high) -> Fit:
    start = np.asarray(start)
    low, high = to_log_ratio(low, start), to_log_ratio(high, start)
    force, signs = data.whiten(data.force), _signs(structure, data)

    def error(vector):
        design = _with_zero(structure, data, structure.design(data.motion, from_log_ratio(vector, start)))
        return design @ solve_linear(design, force, signs) - force

    def jacobian(vector, at):
        moved = vector + _STEP * np.diag(np.where(vector + _STEP <= high, 1.0, -1.0))
        return np.column_stack([(error(item) - at) / (item - vector).sum() for item in moved])

    found = _least_squares(error, jacobian, np.ones(len(start)), low, high, xtol=1e-7, ftol=1e-9)
    return fit_at(structure, data, from_log_ratio(found.x, start), found.status > 0)


def to_log_ratio(values, start: np.ndarray) -> np.ndarray:
    """1 + log(p/p₀): no unit moves it, and a step or tolerance that is a share of it is one of p."""
    return 1.0 + np.log(np.asarray(values) / start)


def from_log_ratio(vector: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Parameters of `to_log_ratio`."""
    return start * np.exp(vector - 1.0)


def _search_all(structure, data, start, low=(), high=()) -> Fit:
    """Search all parameters together: the output forms' derivative by differences, the rest by columns."""
    force = data.whiten(data.force)
    count = len(structure.nonlinear)
    inner = Structure(
        structure.base, tuple(form for form in structure.forms if form.place is not Place.OUTPUT)
    )
    keep = _inner_nonlinear(structure)
    signs = np.array(_signs(structure, data))
    first = solve_linear(
        _with_zero(structure, data, inner.design(data.motion, np.asarray(start)[keep])), force, tuple(signs)
    )
    size = np.maximum(np.abs(first), 1e-3 * np.abs(first).max() or 1.0)
    start = np.asarray(start)
    amplitudes = len(structure.linear)

    def parts(vector):
        return from_log_ratio(vector[:count], start), vector[count:] * size

    def error(vector):
        nonlinear, linear = parts(vector)
        simulated = structure.simulate(data.motion, linear[:amplitudes], nonlinear)
        return data.whiten(simulated + _of_zeros(structure, data, linear)) - force

    def jacobian(vector, _):
        nonlinear, linear = parts(vector)
        design = structure.design(data.motion, nonlinear)
        _, slope = _output_slope(structure, data, design, linear[:amplitudes], nonlinear)
        columns = [
            (error(vector + _STEP * unit) - error(vector - _STEP * unit)) / (2 * _STEP)
            for unit in np.eye(len(vector))[:count]
        ]
        by_amplitude = _with_zero(structure, data, slope) * size
        return np.column_stack([*columns, by_amplitude])

    lower = np.concatenate([to_log_ratio(low, start), np.where(signs > 0, -1e-9, -np.inf)])
    upper = np.concatenate([to_log_ratio(high, start), np.where(signs < 0, 1e-9, np.inf)])
    vector = np.concatenate(
        [np.ones(count), np.clip(first / size, lower[count:] + 1e-9, upper[count:] - 1e-9)]
    )
    found = _least_squares(error, jacobian, vector, lower, upper, xtol=1e-8, ftol=1e-9)
    nonlinear, linear = parts(found.x)
    linear = np.where(signs > 0, np.maximum(linear, 0), np.where(signs < 0, np.minimum(linear, 0), linear))
    residual = error(np.concatenate([found.x[:count], linear / size]))
    return _fit_of(structure, linear, nonlinear, residual, found.status > 0)


def _inner_nonlinear(structure: Structure) -> list[int]:
    """Indices of the nonlinear parameters that do not belong to output forms."""
    keep = list(range(len(structure.base.nonlinear)))
    position = len(keep)
    for form in structure.forms:
        if form.place is not Place.OUTPUT:
            keep.extend(range(position, position + len(form.nonlinear)))
        position += len(form.nonlinear)
    return keep


def fit_base(structure: Structure, data: FitData, acting: Sequence[float] = ()) -> Fit:
    """Fit a structure from the starting values of its base's nonlinear parameters; return the best.

    From every combination of them; of a base of one's own with many parameters from points that fill their ranges (Sobol,
    USSR Comput. Math. Math. Phys. 7 (1967) 86-112). `acting` are the nonlinear parameters of the structure's effects, none of
    which may act on the output.
    """
    grids, refined = _grids(structure.base.nonlinear, data), 2
    if math.prod(map(len, grids)) <= _MOST_COMBINATIONS:
        starts = [np.array(point) for point in product(*grids)]
    else:
        from scipy.stats.qmc import Sobol

        low, high = (np.log([grid[end] for grid in grids]) for end in (0, -1))
        points = Sobol(len(grids), rng=0).random(_MOST_COMBINATIONS)
        starts, refined = list(np.exp(low + (high - low) * points)), _REFINED
    found = []
    for start in starts:
        with suppress(ValueError, np.linalg.LinAlgError):  # a start that diverges is left out
            notify_progress()
            found.append(fit_at(structure, data, np.append(start, acting)))
    ranked = sorted(found, key=lambda item: item.squared_error)
    return min(
        (fit(structure, data, item.nonlinear) for item in ranked[:refined]),
        key=lambda item: item.squared_error,
    )


_MOST_COMBINATIONS = 256
"""Largest number of combinations of starting values of a base."""
_REFINED = 6
"""Starts that are refined where not every combination was tried."""


def screen(previous: Fit, form: Form, data: FitData) -> list[tuple[float, np.ndarray]]:
    """Squared error of every starting value of a form added to a fitted model, best first.

    The model's own nonlinear parameters are kept; linear ones are solved for together (parallel and input forms) or kept (output
    forms, which only transform the force).
    """
    return data.cache.compute_once((previous, form), lambda: _errors_of_starts(previous, form, data))


def _errors_of_starts(previous: Fit, form: Form, data: FitData) -> list[tuple[float, np.ndarray]]:
    residual = data.force - previous.simulate(data.motion)
    structure = previous.structure.with_form(form)
    found = []
    for start in nonlinear_starts(form, data, residual):
        nonlinear = np.concatenate([previous.nonlinear, start])
        if form.place is Place.FRAME:
            # It begins where it changes nothing: what it can do is seen where it ends.
            fitted = fit(structure, data, nonlinear)
            squared, start = fitted.squared_error, fitted.nonlinear[len(previous.nonlinear) :]
        elif structure.is_linear:
            squared = fit_at(structure, data, nonlinear).squared_error
        else:
            linear = linear_with_new(previous, form)
            squared = _linearised_error(structure, data, linear, nonlinear, previous.zeros)
        found.append((squared, start))
    return sorted(found, key=lambda item: item[0])


def _linearised_error(
    structure: Structure, data: FitData, linear: np.ndarray, nonlinear: np.ndarray, zeros: np.ndarray
) -> float:
    """Return the squared error after one Gauss–Newton step in the linear parameters, without signs, for output forms.

    Without the step every form that adds a force would have the same error: it starts at amplitude 0.
    """
    inner, slope = _output_slope(structure, data, structure.design(data.motion, nonlinear), linear, nonlinear)
    simulated = structure.output(inner, data.motion, nonlinear)
    error = data.whiten(simulated + _of_zeros(structure, data, np.append(linear, zeros)) - data.force)
    columns = _with_zero(structure, data, slope)
    return float(np.sum((error - columns @ np.linalg.lstsq(columns, error, rcond=1e-9)[0]) ** 2))


def _output_slope(
    structure: Structure, data: FitData, design: np.ndarray, linear: np.ndarray, nonlinear: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force before the output forms, and derivative of the measured force by the linear parameters."""
    inner = design @ linear
    step = 1e-6 * (np.abs(inner).max() or 1.0)
    above, below = (structure.output(inner + sign * step, data.motion, nonlinear) for sign in (1, -1))
    return inner, ((above - below) / (2 * step))[:, None] * design


def linear_with_new(previous: Fit, form: Form) -> np.ndarray:
    """Linear parameters of a fitted model with those of a new form at 0."""
    return np.concatenate([previous.linear, np.zeros(len(form.linear))])


def add(previous: Fit, form: Form, data: FitData, starts: int = 1) -> Fit:
    """Refit a model with one form more, jointly, from the best starting values.

    A parallel form contains the smaller model, at amplitude 0: its fit is never worse. If the optimiser ends above the
    smaller model, that one is returned, not converged.

    An input or output form contains the smaller model only in the limit of a parameter (no play, no delay, saturation at
    an infinite force), beyond its bounds. Its fit may therefore be worse, with the parameter at a bound; if no parameter is at
    one, it has not converged.

    The best `starts` of the starting values are refined.
    """
    structure = previous.structure.with_form(form)
    best = min(
        (
            fit(structure, data, np.concatenate([previous.nonlinear, start]))
            for _, start in screen(previous, form, data)[:starts]
        ),
        key=lambda item: item.squared_error,
    )
    if best.squared_error <= previous.squared_error * (1 + 1e-6):
        return best
    new = best.nonlinear[len(previous.nonlinear) :]
    if form.place is Place.PARALLEL:
        nonlinear = np.concatenate([previous.nonlinear, new])
        linear = linear_with_new(previous, form)
        return replace(previous, structure=structure, linear=linear, nonlinear=nonlinear, converged=False)
    low, high = (bound[len(previous.nonlinear) :] for bound in shape_bounds(structure, data, best.nonlinear))
    bounded = np.any((new <= low * (1 + _AT_BOUND)) | (new >= high * (1 - _AT_BOUND)))
    return replace(best, converged=best.converged and bool(bounded))


_AT_BOUND = 1e-3
"""Relative distance within which a parameter counts as at its bound."""
