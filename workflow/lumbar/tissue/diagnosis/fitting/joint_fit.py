"""Joint fit of base and effects to a record by free-run simulation error.

Linear parameters are eliminated (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432) and only
nonlinear parameters are searched. With forms that act on the output the problem is nonlinear in all: all are searched.
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
    zeros: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Readings of the response's sensor at 0: one number, one number per fitted record, or none if the base has no zero of the
    sensor (`Base.sensor_zero`)."""

    @property
    def zero(self) -> float:
        """Zero of the sensor, mean over records; 0 if the base has no zero."""
        return float(np.mean(self.zeros)) if len(self.zeros) else 0.0

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Return the free-run simulation of the sensor's reading, shape (samples,)."""
        simulated = self.structure.simulate(motion, self.linear, self.nonlinear)
        return simulated + self._expand_zeros(motion, self.zeros)

    def _expand_zeros(self, motion: Motion | JoinedMotions, zeros: np.ndarray) -> np.ndarray | float:
        """Return the zero at every sample of a motion, from one zero, or zeros per record, per axis, or per record and axis."""
        if not isinstance(motion, JoinedMotions):
            return float(np.mean(zeros)) if len(zeros) else 0.0
        if isinstance(motion, SpatialMotion):
            parts = zeros.reshape(-1, len(motion.parts)).mean(axis=0)
            return np.repeat(parts, len(motion.parts[0]))
        axes = len(motion.parts[0].parts) if isinstance(motion.parts[0], SpatialMotion) else 1
        if len(zeros) != axes * len(motion.parts):
            zeros = np.tile(zeros, len(motion.parts)) if axes > 1 else np.full(len(motion.parts), self.zero)
        parts = zip(motion.parts, zeros.reshape(len(motion.parts), -1), strict=True)
        expanded = [np.broadcast_to(self._expand_zeros(part, own), len(part)) for part, own in parts]
        return np.concatenate(expanded)

    def sensitivities(self, data: FitData) -> np.ndarray:
        """Return derivatives of the whitened simulation, shape (samples that count, parameters), by central differences.

        The columns belong to linear parameters, logarithms of nonlinear parameters, and zeros of the sensor if the base has any.
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


def solve_linear(design: np.ndarray, force: np.ndarray, signs: Sequence[int]) -> np.ndarray:
    """Solve ``design @ parameters = force`` by least squares with sign constraints, shape (parameters,).

    The design has shape (samples, parameters). A sign of 1 means not negative, -1 not positive, 0 free.
    """
    columns = design.T
    # In two parts, because BLAS takes several times as long for a matrix of few columns times itself.
    normal = np.concatenate([columns[:1] @ design, columns[1:] @ design])
    size = np.sqrt(normal.diagonal())
    size[size == 0] = 1.0
    normal /= size[:, None] * size
    right = (columns @ force) / size
    # A ridge far below rounding of the data keeps columns that have become equal solvable.
    normal.flat[:: len(size) + 1] += 1e-11
    free = np.linalg.solve(normal, right)
    directions = np.array(signs)
    allowed = directions * free >= 0
    if allowed.all():
        return free / size
    # Often exactly those are 0 that have a wrong sign in the free solution: optimal if no other sign and no slope at 0 is wrong.
    linear = np.zeros(len(signs))
    linear[allowed] = np.linalg.solve(normal[allowed][:, allowed], right[allowed])
    slopes = right - normal @ linear
    if np.all(directions * linear >= 0) and np.all((directions * slopes)[~allowed] <= 0):
        return linear / size
    # Else non-negative least squares on the Cholesky factor; a free parameter is a difference of two.
    factor = np.linalg.cholesky(normal)
    expanded = [(index, 1.0) for index, sign in enumerate(signs) if sign >= 0]
    expanded += [(index, -1.0) for index, sign in enumerate(signs) if sign <= 0]
    halves = np.stack([direction * factor[index] for index, direction in expanded], axis=1)
    positive, _ = scipy.optimize.nnls(halves, np.linalg.solve(factor, right))
    linear = np.zeros(len(signs))
    for (index, direction), value in zip(expanded, positive, strict=True):
        linear[index] += direction * value
    return linear / size


def shape_bounds(structure: Structure, data: FitData, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds of all nonlinear parameters, shape (parameters,), about their starting values."""
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
    """Return starting nonlinear parameters of a form: derived by the form from a residual, or the grid of all parameters."""
    if form.starts is None:
        return combinations(form.nonlinear, data)
    motion = data.motion
    if isinstance(motion, JoinedMotions):  # the axis with the largest residual, or the longest record
        size = np.var if isinstance(motion, SpatialMotion) else len
        pieces = zip(motion.parts, motion.split(residual), strict=True)
        motion, residual = max(pieces, key=lambda piece: size(piece[1]))
    return form.starts(motion, residual)


def combinations(parameters: Sequence[NonlinearParameter], data: FitData) -> list[np.ndarray]:
    """Return every combination of the starting values of nonlinear parameters."""
    return [np.array(point) for point in product(*_grids(parameters, data))]


def _grids(parameters: Sequence[NonlinearParameter], data: FitData) -> list[np.ndarray]:
    return [item.grid(data.scale(item.scale), data.motion.sampling_time) for item in parameters]


_MAX_EVALUATIONS = 40
"""Largest number of evaluations of the error per search."""
_STEP = 1e-5
"""Step of a difference, in logarithms."""
_MIN_BOUND_DISTANCE = 1e-3
"""Smallest distance of a start from a bound, as a share of the logarithmic range: a closer search stays at the bound."""
_AT_BOUND = 1e-3
"""Relative distance from a bound within which a parameter counts as at the bound."""
_MAX_COMBINATIONS, _REFINED_STARTS = 256, 6
"""Largest number of combinations of starting values of a base; number of starts that are refined if a base has more."""
_OTHER_STARTS = 12
"""Number of starting values of a form of which every second one is refined if the best one leads to a bound of the model's
parameters."""


def fit(structure: Structure, data: FitData, start: np.ndarray) -> Fit:
    """Fit a structure to a record from one start of its nonlinear parameters, base first; repeated fits come from a cache."""
    notify_progress()

    def search() -> Fit:
        if structure.is_linear and not len(start):
            return fit_at(structure, data, start)
        low, high = shape_bounds(structure, data, start)
        margin = (high / low) ** _MIN_BOUND_DISTANCE
        method = _search_nonlinear if structure.is_linear else _search_all
        return method(structure, data, np.clip(start, low * margin, high / margin), low, high)

    return data.cache.compute_once((structure, start.tobytes()), search)


def fit_at(structure: Structure, data: FitData, nonlinear: np.ndarray, converged: bool = True) -> Fit:
    """Solve for the linear parameters at given nonlinear parameters; no form may act on the output."""
    design = _append_zeros(structure, data, structure.design(data.motion, nonlinear))
    force = data.whiten(data.force)
    linear = solve_linear(design, force, _signs(structure, data))
    error, count = force - design @ linear, len(structure.linear)
    return Fit(structure, linear[:count], nonlinear, float(error @ error), converged, linear[count:])


def _append_zeros(structure: Structure, data: FitData, design: np.ndarray) -> np.ndarray:
    """Return the whitened columns at samples that count, with the sensor's zeros last."""
    if structure.base.sensor_zero:
        design = np.concatenate([design.T, data.zeros.T]).T  # column by column in memory
    return data.whiten(design)


def _signs(structure: Structure, data: FitData) -> tuple[int, ...]:
    """Return the sign constraints of the linear parameters and of the sensor's zeros."""
    return (*structure.signs, *[0] * data.zeros.shape[1]) if structure.base.sensor_zero else structure.signs


def _least_squares(error, jacobian, start, low, high, **tolerances):
    """Minimize the squares of an error in few parameters, by scipy on the triangular factor of Jacobian and error.

    The factor has one row more than there are parameters, and the same cost, gradient and singular values. The error is divided
    by its norm at the start, and the size of the gradient does not stop the search: the result does not depend on units. `error`
    is a function of the parameters, shape (samples,); `jacobian` of parameters and error, shape (samples, parameters).
    """
    least, rotated, unit = np.inf, np.empty(0), float(np.linalg.norm(error(start))) or 1.0

    def reduced_error(vector):
        nonlocal least, rotated
        values = error(vector)
        square = float(values @ values) / unit**2
        if square > least * (1 + 1e-9):  # no step is made to this point: only the size counts
            return np.append(np.zeros(len(vector)), np.sqrt(square))
        least = min(least, square)
        rotated = np.linalg.qr(np.column_stack([jacobian(vector, values), values]) / unit, mode="r")
        return rotated[:, -1]

    return scipy.optimize.least_squares(
        reduced_error,
        start,
        jac=lambda _: rotated[:, :-1],
        bounds=(low, high),
        gtol=1e-15,
        max_nfev=_MAX_EVALUATIONS,
        **tolerances,
    )


def _search_nonlinear(structure, data, start, low, high) -> Fit:
    """Search the nonlinear parameters; the linear parameters are solved for at every point."""
    low, high = to_log_ratio(low, start), to_log_ratio(high, start)
    force, signs = data.whiten(data.force), _signs(structure, data)

    def error(vector):
        nonlinear = from_log_ratio(vector, start)
        design = _append_zeros(structure, data, structure.design(data.motion, nonlinear))
        return design @ solve_linear(design, force, signs) - force

    def jacobian(vector, at):
        moved = vector + _STEP * np.diag(np.where(vector + _STEP <= high, 1.0, -1.0))
        return np.column_stack([(error(item) - at) / (item - vector).sum() for item in moved])

    result = _least_squares(error, jacobian, np.ones(len(start)), low, high, xtol=1e-7, ftol=1e-9)
    return fit_at(structure, data, from_log_ratio(result.x, start), result.status > 0)


def to_log_ratio(values, start: np.ndarray) -> np.ndarray:
    """Return 1 + log(p/p₀), which has no unit; a relative step of p is an equal step of this value."""
    return 1.0 + np.log(np.asarray(values) / start)


def from_log_ratio(vector: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the parameters with these values of `to_log_ratio`."""
    return start * np.exp(vector - 1.0)


def _search_all(structure, data, start, low, high) -> Fit:
    """Search all parameters together; only derivatives by parameters of output forms are computed as differences."""
    force = data.whiten(data.force)
    count, amplitudes = len(structure.nonlinear), len(structure.linear)
    # The linear parameters start from their solution without the output forms.
    base, parts = structure.nonlinear_of(start)
    inner_forms = tuple(form for form in structure.forms if form.place is not Place.OUTPUT)
    inner_start = np.concatenate([base, *(parts[form.key] for form in inner_forms)])
    inner = Structure(structure.base, inner_forms)
    signs = np.array(_signs(structure, data))
    columns = _append_zeros(structure, data, inner.design(data.motion, inner_start))
    first = solve_linear(columns, force, signs)
    size = np.maximum(np.abs(first), 1e-3 * np.abs(first).max() or 1.0)

    def unpack(vector):
        return from_log_ratio(vector[:count], start), vector[count:] * size

    def error(vector):
        nonlinear, linear = unpack(vector)
        simulated = structure.simulate(data.motion, linear[:amplitudes], nonlinear)
        zeros = data.zeros @ linear[amplitudes:] if structure.base.sensor_zero else 0.0
        return data.whiten(simulated + zeros) - force

    def jacobian(vector, _):
        nonlinear, linear = unpack(vector)
        _, slope = _output_slope(structure, data, linear[:amplitudes], nonlinear)
        steps = _STEP * np.eye(len(vector))[:count]
        differences = [(error(vector + step) - error(vector - step)) / (2 * _STEP) for step in steps]
        return np.column_stack([*differences, _append_zeros(structure, data, slope) * size])

    lower = np.concatenate([to_log_ratio(low, start), np.where(signs > 0, -1e-9, -np.inf)])
    upper = np.concatenate([to_log_ratio(high, start), np.where(signs < 0, 1e-9, np.inf)])
    inside = np.clip(first / size, lower[count:] + 1e-9, upper[count:] - 1e-9)
    vector = np.concatenate([np.ones(count), inside])
    result = _least_squares(error, jacobian, vector, lower, upper, xtol=1e-8, ftol=1e-9)
    nonlinear, linear = unpack(result.x)
    linear = np.where(signs > 0, np.maximum(linear, 0), np.where(signs < 0, np.minimum(linear, 0), linear))
    left = error(np.concatenate([result.x[:count], linear / size]))
    squared, zeros = float(left @ left), linear[amplitudes:]
    return Fit(structure, linear[:amplitudes], nonlinear, squared, result.status > 0, zeros)


def fit_base(structure: Structure, data: FitData, acting: Sequence[float] = ()) -> Fit:
    """Return the best fit from all combinations of starting values of the base's nonlinear parameters.

    If a user-defined base has too many combinations, points that fill the ranges are tried (Sobol, USSR Comput. Math. Math. Phys.
    7 (1967) 86-112). `acting` are the nonlinear parameters of the structure's effects; no effect may act on the output.
    """
    grids, refined = _grids(structure.base.nonlinear, data), 2
    if math.prod(map(len, grids)) <= _MAX_COMBINATIONS:
        starts = combinations(structure.base.nonlinear, data)
    else:
        from scipy.stats.qmc import Sobol

        low, high = (np.log([grid[end] for grid in grids]) for end in (0, -1))
        points = Sobol(len(grids), rng=0).random(_MAX_COMBINATIONS)
        starts, refined = list(np.exp(low + (high - low) * points)), _REFINED_STARTS
    fits = []
    for start in starts:
        notify_progress()
        with suppress(ValueError, np.linalg.LinAlgError):  # a start that diverges is left out
            fits.append(fit_at(structure, data, np.append(start, acting)))
    ranked = sorted(fits, key=lambda item: item.squared_error)[:refined]
    return min((fit(structure, data, item.nonlinear) for item in ranked), key=lambda item: item.squared_error)


def screen(previous: Fit, form: Form, data: FitData) -> list[tuple[float, np.ndarray]]:
    """Return the squared error of every starting value of a form added to a fitted model, best first.

    The model's nonlinear parameters are fixed; the linear ones are solved for again, with output forms by one linearised step.
    """

    def errors_of_starts() -> list[tuple[float, np.ndarray]]:
        residual = data.force - previous.simulate(data.motion)
        structure = previous.structure.with_form(form)
        errors = []
        for start in nonlinear_starts(form, data, residual):
            nonlinear = np.concatenate([previous.nonlinear, start])
            if form.place is Place.FRAME:
                # The form changes nothing at its start: its effect shows at the end of a search.
                fitted = fit(structure, data, nonlinear)
                squared, start = fitted.squared_error, fitted.nonlinear[len(previous.nonlinear) :]
            elif structure.is_linear:
                squared = fit_at(structure, data, nonlinear).squared_error
            else:
                # One Gauss–Newton step in the linear parameters, without signs: without it every form that adds a force would
                # have the same error, because it starts at amplitude 0.
                inner, slope = _output_slope(structure, data, linear_with_new(previous, form), nonlinear)
                zeros = data.zeros @ previous.zeros if structure.base.sensor_zero else 0.0
                simulated = structure.output(inner, data.motion, nonlinear)
                error = data.whiten(simulated + zeros - data.force)
                columns = _append_zeros(structure, data, slope)
                step = np.linalg.lstsq(columns, error, rcond=1e-9)[0]
                squared = float(np.sum((error - columns @ step) ** 2))
            errors.append((squared, start))
        return sorted(errors, key=lambda item: item[0])

    return data.cache.compute_once((previous, form), errors_of_starts)


def _output_slope(
    structure: Structure, data: FitData, linear: np.ndarray, nonlinear: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the force before the output forms, and the derivative of the measured force by the linear parameters."""
    design = structure.design(data.motion, nonlinear)
    inner = design @ linear
    step = 1e-6 * (np.abs(inner).max() or 1.0)
    above, below = (structure.output(inner + sign * step, data.motion, nonlinear) for sign in (1, -1))
    return inner, ((above - below) / (2 * step))[:, None] * design


def linear_with_new(previous: Fit, form: Form) -> np.ndarray:
    """Return the linear parameters of a fitted model, extended by the parameters of a new form at 0."""
    return np.concatenate([previous.linear, np.zeros(len(form.linear))])


def add(previous: Fit, form: Form, data: FitData) -> Fit:
    """Refit a model with one more form, jointly, from its best starting value.

    If this moves a parameter of the model to a bound, e.g. a relaxation time that the form should have, other starting values
    are tried. A model with a parallel form includes the smaller model: if the optimiser ends with a larger error, the smaller
    model is returned as not converged. With another form a fit may be worse, and has then converged if a parameter is at a
    bound.
    """
    structure = previous.structure.with_form(form)
    starts = [np.concatenate([previous.nonlinear, start]) for _, start in screen(previous, form, data)]
    best, count = fit(structure, data, starts[0]), len(previous.nonlinear)
    if (_is_at_bound(best, data)[:count] & ~_is_at_bound(previous, data)).any():
        others = (fit(structure, data, start) for start in starts[1:_OTHER_STARTS:2])
        best = min([best, *others], key=lambda item: item.squared_error)
    if best.squared_error <= previous.squared_error * (1 + 1e-6):
        return best
    new = best.nonlinear[count:]
    if form.place is Place.PARALLEL:
        nonlinear = np.concatenate([previous.nonlinear, new])
        linear = linear_with_new(previous, form)
        return replace(previous, structure=structure, linear=linear, nonlinear=nonlinear, converged=False)
    is_bounded = bool(_is_at_bound(best, data)[count:].any())
    return replace(best, converged=best.converged and is_bounded)


def _is_at_bound(fitted: Fit, data: FitData) -> np.ndarray:
    """Return True for each nonlinear parameter at a bound, shape (parameters,)."""
    low, high = shape_bounds(fitted.structure, data, fitted.nonlinear)
    return (fitted.nonlinear <= low * (1 + _AT_BOUND)) | (fitted.nonlinear >= high * (1 - _AT_BOUND))
