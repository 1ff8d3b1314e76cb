"""The best linear time-invariant model from position to force, and the share of an error that no linear model explains.

Two kinds are tried, each with a constant (a sensor's zero), a spring, a dashpot and a mass:

- a Prony series, relaxing branches of non-negative stiffness on a grid of time constants from the sampling interval to the
  record's length, which approximates any passive viscoelastic material, springpots included (Park and Schapery, Int. J. Solids
  Struct. 36 (1999) 1653-1675);
- an output-error model of a few free poles, real or complex, and free residues, by separable least squares (Golub and
  Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432; Kaufman's Jacobian), without and with a pure delay.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import scipy

from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, FreeRun, decimate
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, from_log_ratio, solve_linear, to_log_ratio
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.poles import Poles, forces, relocate_poles, slope_forces
from lumbar.tissue.diagnosis.noise.periods import MIN_FULL_PERIODS, fold_periods
from lumbar.tissue.diagnosis.residuals.time_frequency import excited_lines
from lumbar.tissue.models.measured_motion import is_held
from lumbar.tissue.models.motion import JoinedMotions, Motion

ORDERS = (1, 2, 3, 4, 6)
"""Numbers of poles that are tried, in this order while the criterion falls."""
_RATES_PER_DECADE = 5
"""Number of time constants of the Prony series per decade."""
_DELAYED_ORDER = 1
"""Number of poles of the model that is also tried with a delay; higher orders approximate small delays without a delay."""
_START_DELAYS = (1.0, 4.0, 16.0)
"""Starting delays in samples."""
_MAX_DELAY = 64.0
"""Largest delay in samples: a few cycles of the fastest motion, at the rate of the search."""
_EVALUATIONS = 15
_MAX_ERROR_RATIO = 0.997
"""Largest ratio of the squared error to that of lower orders if a still higher order is to be tried."""
_MAX_SPRING_FORCE = 10.0
"""Largest force of the spring relative to the measured force, both as standard deviations."""
_MAX_SEARCH_SAMPLES = 12_000
"""Largest number of samples with which poles are searched; the other parameters are fitted to all samples."""
_LINE_WIDTH = 2.0
"""(ΣS)²/ΣS² of one sine through Hann's window."""
_ROUNDING = 1e-12
"""Share of the force's power below which an error is rounding."""
_NEIGHBOURHOOD = 9
"""Number of neighbouring excited lines over which the response is approximated by a parabola."""
_COEFFICIENTS = 3
_MIN_NOISE_RATIO = 2.0
"""Smallest ratio of the power of a residual to that of its noise for a division into linear and nonlinear parts."""


@dataclass(frozen=True, eq=False)
class LinearDynamics(FreeRun):
    """A fitted linear model."""

    kind: str
    """Kind of model: ``prony``, ``rational`` or ``delayed``."""
    poles: Poles
    held: bool
    """True if the input is a zero-order hold: the model is discrete, without derivatives of the input."""
    linear: np.ndarray
    """Constant, stiffness, viscosity and mass (if used), then gains of sections and branches, shape (parameters,)."""
    squared_error: float
    """Sum of squared (whitened) errors over the samples of the training record that count."""
    train_rms: float = np.nan
    """Free-run simulation error on the training record, in the output's unit."""
    test_rms: float = np.nan
    """Free-run simulation error on the test records, in the output's unit."""

    @property
    def nonlinear(self) -> np.ndarray:
        """Searched parameters: the exponentials of `Poles.logarithms`."""
        return np.exp(self.poles.logarithms)

    @property
    def order(self) -> int:
        """Number of poles; for a Prony series the number of branches that are not zero."""
        return self.poles.order

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Simulate from rest at the first position, shape (samples,)."""
        return forces(motion, self.poles, self.held) @ self.linear


def linear_dynamics(experiment: Experiment) -> LinearDynamics:
    """Fit linear models of increasing order to the training record and return the model with the lowest information criterion.

    The test records have no influence. Long records are fitted at a lower rate; errors are computed at the full rate.
    """
    data = decimate(experiment.training)
    best = _lowest_criterion(list(_candidates(data)), data)
    whitened = best.whitened_errors(experiment.training)
    return replace(
        best,
        squared_error=float(whitened @ whitened),
        train_rms=best.rms(experiment.training),
        test_rms=best.rms(*experiment.tests),
    )


def rational_of_order(data: FitData, order: int) -> LinearDynamics:
    """Fit an output-error model with `order` free poles and free residues to a record."""
    without = _solve("rational", data, Poles.from_places(np.zeros(0)), is_held(data.motion))
    return _fit_rational(data, order, without)


def _lowest_criterion(candidates: list[LinearDynamics], data: FitData) -> LinearDynamics:
    """Return the candidate with the lowest information criterion (Schwarz, Ann. Statist. 6 (1978) 461-464).

    The error of a linear model of a nonlinear force is coloured and often consists of a few spectral lines. It then has fewer
    independent values than samples, and determines fewer parameters.
    """
    # The spring must be of the size of the forces measured. A pole slower than the record and a spring can cancel on a record
    # that begins at 0, however large both are; they do not on one that begins elsewhere.
    moved, most = np.std(data.motion.position), _MAX_SPRING_FORCE * np.std(data.force)
    candidates = [item for item in candidates if abs(item.linear[1]) * moved <= most]
    errors = min(candidates, key=lambda item: item.squared_error).whitened_errors(data)
    # Degrees of freedom of the variance of coloured errors: 2 (ΣS)²/(n ΣS²) a sample of the periodogram S, 1 if they are white.
    power = np.abs(np.fft.rfft(errors)) ** 2
    square = float(np.sum(power**2))
    share = min(2 * float(power.sum()) ** 2 / (len(power) * square), 1.0) if square > 0 else 1.0
    independent = max(share * len(errors), 2.0)

    def criterion(item):
        parameters = len(item.linear) + len(item.nonlinear)
        return independent * np.log(item.squared_error) + parameters * np.log(independent)

    return min(candidates, key=criterion)


def _candidates(data: FitData) -> Iterator[LinearDynamics]:
    held = is_held(data.motion)
    yield _fit_prony(data, held)
    best = lower = _solve("rational", data, Poles.from_places(np.zeros(0)), held)
    yield best
    yield from (_solve("rational", data, replace(best.poles, direct=direct), held) for direct in (2, 3))
    # A line of the spectrum determines two parameters, and so one more pole. Number of lines: (ΣS)²/ΣS² of the power
    # spectrum S of the position's steps, relative to that of a single line through the window.
    steps = np.diff(data.motion.position)
    power = np.abs(np.fft.rfft((steps - steps.mean()) * np.hanning(len(steps)))) ** 2
    lines = float(power.sum()) ** 2 / float(np.sum(power**2)) / _LINE_WIDTH
    for order in (order for order in ORDERS if order == 1 or order < lines):
        fitted = _fit_all_samples(data, partial(_fit_rational, order=order, lower=lower))
        yield fitted
        if order == 1:
            # Constant and spring only: with one pole this is the Kelvin–Boltzmann model.
            starts = [replace(fitted.poles, direct=2)]
            yield _fit_all_samples(data, partial(_fit_from, held=held, starts=starts))
        if order == _DELAYED_ORDER and not held:
            delays = np.array(_START_DELAYS) * data.motion.sampling_time
            starts = [replace(fitted.poles, delay=delay) for delay in delays.tolist()]
            yield _fit_all_samples(data, partial(_fit_from, held=held, starts=starts, kind="delayed"))
        if order > 2 and fitted.squared_error > _MAX_ERROR_RATIO * best.squared_error:
            break
        lower = fitted
        best = min(best, fitted, key=lambda item: item.squared_error)


def _fit_all_samples(data: FitData, fit: Callable[[FitData], LinearDynamics]) -> LinearDynamics:
    """Search poles with the beginning of a long record, and solve for the linear parameters with the whole record."""
    if data.size <= _MAX_SEARCH_SAMPLES:
        return fit(data)
    start = fit(data.split((data.length - data.size + _MAX_SEARCH_SAMPLES) / data.length)[0])
    return _solve(start.kind, data, start.poles, start.held)


def _rate_range(data: FitData) -> tuple[float, float]:
    """Return the lowest and highest rate (1/s) that a record can show, from its length and its sampling time."""
    return 1 / data.scale("duration"), 1 / data.motion.sampling_time


def _fit_prony(data: FitData, held: bool) -> LinearDynamics:
    low, high = _rate_range(data)
    rates = np.geomspace(low, high, 1 + round(_RATES_PER_DECADE * np.log10(high / low)))
    poles = Poles(rates, np.zeros((0, 2)))
    columns = forces(data.motion, poles, held)
    direct = columns.shape[1] - len(rates)
    linear = solve_linear(data.whiten(columns), data.whiten(data.force), (0,) + (1,) * (columns.shape[1] - 1))
    used = linear[direct:] > 0
    linear = np.concatenate([linear[:direct], linear[direct:][used]])
    return _solve("prony", data, replace(poles, rates=rates[used]), held, linear)


def _fit_rational(data: FitData, order: int, lower: LinearDynamics) -> LinearDynamics:
    """Refine poles, starting from the last iterations of relocation, or from poles of a lower order and additional poles."""
    low, high = _rate_range(data)
    more = np.geomspace(low, high, order - lower.order + 2)[1:-1]
    starts = relocate_poles(data, order, low, high, lower.held)[-2:]
    pairs = [np.roots([1.0, *section]) for section in lower.poles.sections]
    starts.append(Poles.from_places(np.concatenate([-lower.poles.rates, *pairs, -more])))
    return _fit_from(data, lower.held, starts)


def _fit_from(data: FitData, held: bool, starts: list[Poles], kind: str = "rational") -> LinearDynamics:
    """Search poles and delay from the best of some starts; linear parameters are solved for at every point."""
    start = min((_solve(kind, data, poles, held) for poles in starts), key=lambda item: item.squared_error)
    force, first = data.whiten(data.force), start.nonlinear
    # Bounds of the delay, of the coefficients of sections and of the rates.
    slow, fast = _rate_range(data)
    delay = [(1e-3 / fast, _MAX_DELAY / fast)] if start.poles.delay else []
    fast = 10 * fast
    pairs = [(0.1 * slow, 10 * fast), (slow**2, fast**2)] * len(start.poles.sections)
    bounds = np.array([*delay, *pairs, *[(slow, fast)] * len(start.poles.rates)]).reshape(-1, 2)
    low, high = (to_log_ratio(bound, first) for bound in (bounds * [1 - 1e-9, 1 + 1e-9]).T)
    unit = float(np.linalg.norm(force)) or 1.0

    def poles_at(values):
        return start.poles.moved_to(np.log(from_log_ratio(values, first)))

    @lru_cache(maxsize=1)
    def solution(numbers):
        poles = poles_at(np.frombuffer(numbers))
        design = data.whiten(forces(data.motion, poles, held))
        return poles, design, *_least_squares(design, force)

    def error(values):
        _, design, linear, _ = solution(values.tobytes())
        return (design @ linear - force) / unit

    def jacobian(values):
        poles, design, linear, basis = solution(values.tobytes())
        slopes = data.whiten(slope_forces(data.motion, poles, linear, held))
        directions = design @ basis
        return (slopes - directions @ (directions.T @ slopes)) / unit

    begin, tolerances = np.clip(np.ones(len(first)), low, high), {"xtol": 1e-5, "ftol": 1e-5, "gtol": 1e-15}
    result = scipy.optimize.least_squares(
        error, begin, jacobian, bounds=(low, high), max_nfev=_EVALUATIONS, **tolerances
    )
    refined = _solve(kind, data, poles_at(result.x), held)
    return min(refined, start, key=lambda item: item.squared_error)


def _least_squares(design: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares solution, and a basis that makes the columns orthonormal, without directions that are rounding."""
    normal = design.T @ design
    size = np.sqrt(np.diag(normal))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    used = values > 1e-13 * values[-1]
    basis = vectors[:, used] / np.sqrt(values[used]) / size[:, None]
    return basis @ (basis.T @ (design.T @ force)), basis


def _solve(
    kind: str, data: FitData, poles: Poles, held: bool, linear: np.ndarray | None = None
) -> LinearDynamics:
    """Return the model with these poles and, unless they are given, the best linear parameters."""
    columns, force = forces(data.motion, poles, held), data.whiten(data.force)
    if linear is None:
        linear = _least_squares(data.whiten(columns), force)[0]
    error = data.whitened_error(columns @ linear)
    squared_error = max(float(error @ error), _ROUNDING * float(force @ force))
    return LinearDynamics(kind, poles, held, linear, squared_error)


def nonlinear_share(experiment: Experiment, fit: Fit | LinearDynamics) -> float | None:
    """Return the share of a model's repeating error, without noise, that no linear model can explain.

    In the steady state a linear tissue responds to a periodic motion only at the lines of that motion, with a frequency
    response that is smooth from line to line. The rest of the mean period is nonlinear distortion (Pintelon and
    Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 4 and 7: best linear approximation, local
    polynomial method). A nonlinear force also shifts the linear approximation, so the share, from 0 to 1, is a lower bound.

    Return None if no training record repeats, if the record excites too few lines to compare neighbours, or if the error of the
    model hardly exceeds the noise.
    """
    floor = experiment.floor
    if floor is None:
        return None
    data = next(item for item in experiment.training.records if item.name == experiment.floor_from)
    position, force = data.drop_history(data.motion.position), data.drop_history(data.force)
    # Without the settled start the record may be too short.
    if len(force) * data.motion.sampling_time < MIN_FULL_PERIODS * floor.period:
        return None
    channels = {"input": Channel(position, "position", ""), "output": Channel(force, "force", "")}
    folding = fold_periods(Record(data.name, data.drop_history(data.motion.time), channels), floor.period)
    error = data.drop_history(data.force - fit.simulate(data.motion))
    position, force, error = (folding.fold(signal).mean(axis=0) for signal in (position, force, error))
    excited = excited_lines(position)
    if len(excited) < 2 * _NEIGHBOURHOOD:
        return None
    # Expected squared magnitude of the noise at the lines of the mean period's spectrum, from line 1.
    density = floor.density(np.fft.rfftfreq(folding.samples, floor.sampling_time)[1:]) / 2  # two-sided
    noise = density * folding.samples / floor.sampling_time / len(folding.rows)
    left = np.abs(np.fft.rfft(error)[1:]) ** 2
    if left.sum() < _MIN_NOISE_RATIO * noise.sum():
        return None
    distortion = distortion_power(np.fft.rfft(position), np.fft.rfft(force), excited)[1:]
    return float(np.clip((distortion.sum() - noise.sum()) / (left.sum() - noise.sum()), 0.0, 1.0))


def distortion_power(inputs: np.ndarray, outputs: np.ndarray, excited: np.ndarray) -> np.ndarray:
    """Return the power of an output's spectrum that the best linear approximation does not explain, noise included.

    Parameters
    ----------
    inputs, outputs : numpy.ndarray, shape (lines,)
        Complex spectra of a mean period.
    excited : numpy.ndarray
        Indices of the lines of the input, at least `_NEIGHBOURHOOD`.

    Returns
    -------
    numpy.ndarray, shape (lines,)
        Squared magnitude in the unit of the spectrum; at excited lines the estimate from their neighbourhood.
    """
    power = np.abs(outputs) ** 2
    for index, line in enumerate(excited):
        first = min(max(index - _NEIGHBOURHOOD // 2, 0), len(excited) - _NEIGHBOURHOOD)
        near = excited[first : first + _NEIGHBOURHOOD]
        distance = (near - line) / max(near[-1] - near[0], 1)
        columns = inputs[near, None] * distance[:, None] ** np.arange(_COEFFICIENTS)
        fitted = columns @ np.linalg.lstsq(columns, outputs[near], rcond=1e-12)[0]
        power[line] = np.sum(np.abs(outputs[near] - fitted) ** 2) / (_NEIGHBOURHOOD - _COEFFICIENTS)
    return power
