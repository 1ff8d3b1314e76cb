"""The best linear time-invariant model from position to force, and how much of what a model leaves no such model explains.

What such a model explains needs no nonlinear effect. Two kinds are tried, each with a constant (a sensor's zero), a
spring, a dashpot and a mass:

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
from lumbar.tissue.diagnosis.linear.poles import Poles, forces, relocated_poles, slope_forces
from lumbar.tissue.diagnosis.noise.periods import MIN_FULL_PERIODS, fold_periods
from lumbar.tissue.diagnosis.residuals.time_frequency import excited_lines
from lumbar.tissue.models.measured_motion import is_held
from lumbar.tissue.models.motion import JoinedMotions, Motion

ORDERS = (1, 2, 3, 4, 6)
"""Numbers of poles that are tried, one after the other while the criterion falls."""
_PER_DECADE = 5
"""Time constants of the Prony series in a decade."""
_DELAYED_ORDER = 1
"""Poles of the model that is also tried behind a delay; higher orders come near small delays by themselves."""
_DELAYS = (1.0, 4.0, 16.0)
"""Starting delays in samples."""
_LONGEST_DELAY = 64.0
"""Samples: a few cycles of the fastest motion, at the rate that records are searched at."""
_EVALUATIONS = 15
_WORTHWHILE = 0.997
"""Share of the squared error that a higher order must leave at most for a still higher one to be tried."""
_LARGEST_SPRING = 10.0
"""Largest force of the spring in forces measured, both as standard deviations."""
_LONG = 12_000
"""Samples on which poles are searched at most."""
_LINE_WIDTH = 2.0
"""(ΣS)²/ΣS² of one sine through Hann's window."""
_SMALLEST = 1e-12
"""Share of the force's power below which an error is rounding."""
_NEIGHBOURHOOD = 9
"""Neighbouring excited lines over which the response is taken as a parabola."""
_DEGREES = 3
_ABOVE_NOISE = 2.0
"""Power of a residual in that of its noise, below which it holds too little to be divided."""


@dataclass(frozen=True, eq=False)
class LinearDynamics(FreeRun):
    """A fitted linear model."""

    kind: str
    """``prony``, ``rational`` or ``delayed``."""
    poles: Poles
    held: bool
    """Whether the input is held between jumps: a discrete model, without derivatives of the input."""
    linear: np.ndarray
    nonlinear: np.ndarray
    """`linear`, `nonlinear`: constant, stiffness, viscosity and mass (what of them acts), then of sections and branches;
    and what was searched with them."""
    squared_error: float
    """Sum of squared (whitened) errors over the samples of the training record that count."""
    train_rms: float = np.nan
    test_rms: float = np.nan
    """`train_rms`, `test_rms`: free-run simulation errors in the output's unit."""

    @property
    def order(self) -> int:
        """Number of poles; of a Prony series, branches that are not zero."""
        return self.poles.order

    @property
    def constant(self) -> float:
        """Force of the sensor's zero, in the output's unit."""
        return float(self.linear[0])

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation from rest at the first position, shape (samples,)."""
        return forces(motion, self.poles, self.held) @ self.linear


def linear_dynamics(experiment: Experiment) -> LinearDynamics:
    """Fit linear models of rising order to the training record and return the one that its criterion favours.

    The test records have no say. Long records are fitted at a lower rate; errors are those at the full one.
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
    """Fit an output-error model of so many free poles and free residues to a record."""
    static = _solve("rational", data, Poles(np.zeros(0), np.zeros((0, 2))), is_held(data.motion))
    return _rational(data, order, static)


def _lowest_criterion(candidates: list[LinearDynamics], data: FitData) -> LinearDynamics:
    """The candidate of the lowest information criterion (Schwarz, Ann. Statist. 6 (1978) 461-464).

    What a model of any order leaves of a nonlinear force is coloured, often a few lines: it holds fewer independent errors
    than samples, and pays for fewer parameters.
    """
    # The spring must be of the size of the forces measured. A pole slower than the record and a spring can cancel on a record
    # that begins at 0, however large both are; they do not on one that begins elsewhere.
    moved, most = np.std(data.motion.position), _LARGEST_SPRING * np.std(data.force)
    candidates = [item for item in candidates if abs(item.linear[1]) * moved <= most]
    least = min(candidates, key=lambda item: item.squared_error)
    errors = least.whitened_errors(data)
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
    yield _prony(data, held)
    best = lower = _solve("rational", data, Poles(np.zeros(0), np.zeros((0, 2))), held)
    yield best
    yield from (_solve("rational", data, replace(best.poles, direct=direct), held) for direct in (2, 3))
    lines = _excited_lines(data)
    for order in (order for order in ORDERS if order == 1 or order < lines):
        fitted = _on_all(data, partial(_rational, order=order, lower=lower))
        yield fitted
        if order == 1:
            yield _on_all(data, partial(_without_derivatives, fitted=fitted))
        if order == _DELAYED_ORDER and not held:
            yield _on_all(data, partial(_with_delay, fitted=fitted))
        if order > 2 and fitted.squared_error > _WORTHWHILE * best.squared_error:
            break
        lower = fitted
        best = min(best, fitted, key=lambda item: item.squared_error)


def _excited_lines(data: FitData) -> float:
    """How many frequencies the motion holds at all: a line determines two parameters, and so one more pole at most.

    (ΣS)²/ΣS² of the power spectrum S of the position's steps, over that of a single line seen through the window.
    """
    steps = np.diff(data.motion.position)
    power = np.abs(np.fft.rfft((steps - steps.mean()) * np.hanning(len(steps)))) ** 2
    return float(power.sum()) ** 2 / float(np.sum(power**2)) / _LINE_WIDTH


def _on_all(data: FitData, fit: Callable[[FitData], LinearDynamics]) -> LinearDynamics:
    """Search poles, on the beginning of what is still long at its lower rate, and solve for the rest on all of it."""
    if data.size <= _LONG:
        return fit(data)
    settling = data.length - data.size
    found = fit(data.split((settling + _LONG) / data.length)[0])
    return _solve(found.kind, data, found.poles, found.held)


def _rates_seen(data: FitData) -> tuple[float, float]:
    """Rates (1/s) that a record can show: of its length and of its sampling."""
    return 1 / data.scale("duration"), 1 / data.motion.sampling_time


def _prony(data: FitData, held: bool) -> LinearDynamics:
    low, high = _rates_seen(data)
    rates = np.geomspace(low, high, 1 + round(_PER_DECADE * np.log10(high / low)))
    every = Poles(rates, np.zeros((0, 2)))
    columns = forces(data.motion, every, held)
    direct = columns.shape[1] - len(rates)
    linear = solve_linear(data.whiten(columns), data.whiten(data.force), (0,) + (1,) * (columns.shape[1] - 1))
    kept = linear[direct:] > 0
    poles = replace(every, rates=rates[kept])
    return _model("prony", data, poles, held, np.concatenate([linear[:direct], linear[direct:][kept]]))


def _rational(data: FitData, order: int, lower: LinearDynamics) -> LinearDynamics:
    """Refine poles from the last iterations of their relocation, or from those of a lower order and some more."""
    low, high = _rates_seen(data)
    more = np.geomspace(low, high, order - lower.order + 2)[1:-1]
    starts = relocated_poles(data, order, low, high, lower.held)[-2:]
    starts.append(Poles.of(np.concatenate([lower.poles.to_array(), -more])))
    found = [_solve("rational", data, poles, lower.held) for poles in starts]
    return _refine(data, min(found, key=lambda item: item.squared_error))


def _without_derivatives(data: FitData, fitted: LinearDynamics) -> LinearDynamics:
    """Refine the same poles with constant and spring only: with one pole this is the Kelvin–Boltzmann model."""
    return _refine(data, _solve("rational", data, replace(fitted.poles, direct=2), fitted.held))


def _with_delay(data: FitData, fitted: LinearDynamics) -> LinearDynamics:
    """Refine the same poles with a pure delay."""
    step = data.motion.sampling_time
    late = [replace(fitted.poles, delay=delay * step) for delay in _DELAYS]
    found = [_solve("delayed", data, poles, fitted.held) for poles in late]
    return _refine(data, min(found, key=lambda item: item.squared_error))


def _refine(data: FitData, start: LinearDynamics) -> LinearDynamics:
    """Search poles and delay, linear parameters solved for at each."""
    force, first = data.whiten(data.force), np.exp(start.poles.to_vector())
    low, high = (to_log_ratio(bound, first) for bound in _bounds(start.poles, *_rates_seen(data)))
    unit = float(np.linalg.norm(force)) or 1.0

    def moved(values):
        return start.poles.with_vector(np.log(from_log_ratio(values, first)))

    @lru_cache(maxsize=1)
    def solution(numbers):
        poles = moved(np.frombuffer(numbers))
        design = data.whiten(forces(data.motion, poles, start.held))
        return poles, design, *_solution(design, force)

    def error(values):
        _, design, linear, _ = solution(values.tobytes())
        return (design @ linear - force) / unit

    def jacobian(values):
        poles, design, linear, basis = solution(values.tobytes())
        slopes = data.whiten(slope_forces(data.motion, poles, linear, start.held))
        directions = design @ basis
        return (slopes - directions @ (directions.T @ slopes)) / unit

    found = scipy.optimize.least_squares(
        error,
        np.clip(np.ones(len(first)), low, high),
        jacobian,
        bounds=(low, high),
        xtol=1e-5,
        ftol=1e-5,
        gtol=1e-15,
        max_nfev=_EVALUATIONS,
    )
    refined = _solve(start.kind, data, moved(found.x), start.held)
    return min(refined, start, key=lambda item: item.squared_error)


def _bounds(poles: Poles, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    delay = [(1e-3 / high, _LONGEST_DELAY / high)] if poles.delay else []
    high = 10 * high
    pairs = [(0.1 * low, 10 * high), (low**2, high**2)] * len(poles.sections)
    bounds = np.array([*delay, *pairs, *[(low, high)] * len(poles.rates)]).reshape(-1, 2)
    return bounds[:, 0] * (1 - 1e-9), bounds[:, 1] * (1 + 1e-9)


def _solution(design: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares, and a basis that makes the columns orthonormal; directions that rounding hides are left out."""
    normal = design.T @ design
    size = np.sqrt(np.diag(normal))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    kept = values > 1e-13 * values[-1]
    basis = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return basis @ (basis.T @ (design.T @ force)), basis


def _solve(kind: str, data: FitData, poles: Poles, held: bool) -> LinearDynamics:
    columns = forces(data.motion, poles, held)
    return _model(kind, data, poles, held, _solution(data.whiten(columns), data.whiten(data.force))[0])


def _model(kind: str, data: FitData, poles: Poles, held: bool, linear: np.ndarray) -> LinearDynamics:
    found = LinearDynamics(kind, poles, held, linear, np.exp(poles.to_vector()), np.inf)
    error, force = found.whitened_errors(data), data.whiten(data.force)
    return replace(found, squared_error=max(float(error @ error), _SMALLEST * float(force @ force)))


def nonlinear_share(experiment: Experiment, fit: Fit | LinearDynamics) -> float | None:
    """Return the share of a model's repeating error, without noise, that no linear model can explain.

    In the steady state a linear tissue answers a periodic motion at the lines of that motion only, and there with a frequency
    response that is smooth from line to line. The rest of the mean period is nonlinear distortion (Pintelon and
    Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 4 and 7: best linear approximation, local
    polynomial method). A nonlinear force also shifts the linear approximation: its distortion is less than all it does.

    The share, from 0 to 1, is a lower bound; None if no training record repeats, if it excites too few lines to
    compare neighbours, or if the model leaves hardly more than noise.
    """
    floor = experiment.floor
    if floor is None:
        return None
    data = next(item for item in experiment.training.records if item.name == experiment.floor_from)
    if (
        len(data.drop_history(data.force)) * data.motion.sampling_time < MIN_FULL_PERIODS * floor.period
    ):  # the settled start left out
        return None
    channels = {
        "input": Channel(data.drop_history(data.motion.position), "position", ""),
        "output": Channel(data.drop_history(data.force), "force", ""),
    }
    folding = fold_periods(Record(data.name, data.drop_history(data.motion.time), channels), floor.period)
    error = data.force - fit.simulate(data.motion)
    position, force, error = (
        folding.fold(data.drop_history(signal)).mean(axis=0)
        for signal in (data.motion.position, data.force, error)
    )
    excited = excited_lines(position)
    if len(excited) < 2 * _NEIGHBOURHOOD:
        return None
    # Expected squared magnitude of the noise at the lines of the mean period's spectrum, from line 1 on.
    frequency = np.fft.rfftfreq(folding.samples, floor.sampling_time)[1:]
    density = floor.density(frequency) / 2  # two-sided
    noise = density * folding.samples / floor.sampling_time / len(folding.rows)
    left = np.abs(np.fft.rfft(error)[1:]) ** 2
    if left.sum() < _ABOVE_NOISE * noise.sum():
        return None
    distortion = distortion_power(np.fft.rfft(position), np.fft.rfft(force), excited)[1:]
    share = (distortion.sum() - noise.sum()) / (left.sum() - noise.sum())
    return float(np.clip(share, 0.0, 1.0))


def distortion_power(inputs: np.ndarray, outputs: np.ndarray, excited: np.ndarray) -> np.ndarray:
    """Power at every line of an output's spectrum that the best linear approximation does not explain, noise included.

    The power is a squared magnitude in the unit of the spectrum, shape (lines,); at excited lines the estimate from
    their neighbourhood. `inputs` and `outputs` are complex spectra of a mean period, shape (lines,); `excited` are the
    lines of the input, at least `_NEIGHBOURHOOD`.
    """
    power = np.abs(outputs) ** 2
    for index, line in enumerate(excited):
        first = min(max(index - _NEIGHBOURHOOD // 2, 0), len(excited) - _NEIGHBOURHOOD)
        near = excited[first : first + _NEIGHBOURHOOD]
        distance = (near - line) / max(near[-1] - near[0], 1)
        columns = inputs[near, None] * distance[:, None] ** np.arange(_DEGREES)
        fitted = columns @ np.linalg.lstsq(columns, outputs[near], rcond=1e-12)[0]
        power[line] = np.sum(np.abs(outputs[near] - fitted) ** 2) / (_NEIGHBOURHOOD - _DEGREES)
    return power
