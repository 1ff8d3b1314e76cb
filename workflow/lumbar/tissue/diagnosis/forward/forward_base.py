"""Data and bases of records with the force as input: fitted by simulation, searched in the inverse problem.

In the inverse problem the motion is the input, and errors of the force are filtered by the response of the base from force to
motion. If R(z) is the force of a model with motion z and n the noise of the measured motion, the error of a true model is
R(z + n) − F ≈ (dR/dz) n; the response G ≈ (dR/dz)⁻¹ of the base turns it into n, in the unit of the motion (the weighting of
Steiglitz and McBride, IEEE Trans. Automat. Contr. 10 (1965) 461-464). Forms are linear in most parameters of the inverse problem,
so the search over all forms needs no simulation.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import get_args

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting import joint_fit
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, prepare
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, exchange_base, fit_base
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.driven_motion import linearise
from lumbar.tissue.models.measured_motion import (
    add_measured_motion,
    is_held,
    noise_of,
    remove_noise,
    resting_samples,
)
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.structure import ForceBetween, ForwardStructure, Structure

FORWARD_BASES = ("KV-mass", "KB-mass", "KV", "KB", "Burgers", "LE")
"""Bases that are tried if the force is the input."""
_SIMULATED_BASES = 2
"""Number of bases that are simulated: the best in the inverse problem."""
_MAX_SEARCH_SAMPLES = 6000
"""Largest number of samples of every record with which effects are searched."""
Response = Callable[[np.ndarray], np.ndarray]
"""Function that returns the ratio of motion and force at frequencies in Hz."""
_MIN_STIFFNESS = 1e-6
"""Smallest dynamic stiffness relative to the largest: a free mass would drift away."""
_RIGID = 10.0
"""Stiffness of a motion that does not follow the force, relative to the ratio of force and motion."""
_SEGMENTS = 8
_WEIGHTED_FITS = 3
"""Number of fits of the base, each weighted by the response of the previous fit."""
EVALUATIONS = 20
"""Largest number of evaluations of the error in a fit by simulation."""
_ZERO_SIZE = 1e-3
"""Scale of a linear parameter that starts at 0, relative to the largest linear parameter."""
_BOUND_MARGIN = 1e-3
_MAX_ZERO_SIGMAS = 4.0
"""Largest distance of the motion's zero from the mean of the samples at rest before the load, in standard errors of the mean."""
_FAILED_ERROR = 1e3
"""Error of a simulation that failed, relative to the measured motion."""


@dataclass(frozen=True, eq=False)
class ForwardData(FitData):
    """One record with the force as input: attribute `motion` contains the force, attribute `force` the motion."""

    @cached_property
    def measured_motion(self) -> Motion:
        """Measured motion, smoothed."""
        return Motion(self.motion.time, remove_noise(self.force), self.motion.sampling_time)

    @cached_property
    def zero_range(self) -> tuple[float, float] | None:
        """Range of the motion's zero by the samples at rest before the load; None if the record does not begin at rest."""
        count = resting_samples(self.motion.position, self.force)
        if not count:
            return None
        mean, error = float(np.mean(self.force[:count])), noise_of(self.force) / np.sqrt(count)
        margin = _MAX_ZERO_SIGMAS * error + 1e-6 * float(np.ptp(self.force))
        return mean - margin, mean + margin

    def scale(self, kind: str) -> float:
        """Return the size of a quantity for starting values; ``force`` is the signal that a form at the output transforms."""
        if kind in ("position", "speed", "path"):
            return self.measured_motion.scale(kind)
        return super().scale(kind)


@dataclass(frozen=True, eq=False)
class ForwardJointData(JointData):
    """Several records with the force as input that are fitted together."""

    def scale(self, kind: str) -> float:
        """Return the largest size of a quantity in any of the records."""
        return max(part.scale(kind) for part in self.parts)


@dataclass(frozen=True, eq=False)
class FilteredForwardData(FitData):
    """A record of the inverse problem; its errors of the force are filtered to errors of the motion."""

    response: Response = np.ones_like
    """Response from force to motion."""

    def _filter(self, signal: np.ndarray) -> np.ndarray:
        """Return the motion that a force (samples first) causes, from rest."""
        length = scipy.fft.next_fast_len(2 * len(signal), real=True)
        response = self.motion.cache.compute_once(
            ("response", self.response),
            lambda: self.response(scipy.fft.rfftfreq(length, self.motion.sampling_time)),
        )
        spectrum = scipy.fft.rfft(signal, length, axis=0) * response.reshape(-1, *[1] * (signal.ndim - 1))
        return scipy.fft.irfft(spectrum, length, axis=0)[: len(signal)]

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Return the filtered and whitened signal (samples first) from the first sample that counts."""
        return super().whiten(self._filter(signal))

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Return simulated minus measured force, filtered to the motion, at the samples that count."""
        return self._about_zero(self.trim(self._filter(simulated - self.force)))


@dataclass(frozen=True, eq=False)
class FilteredForwardJointData(JointData):
    """Several records of `FilteredForwardData` that are fitted together."""

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Return the filtered errors of all records."""
        pieces = zip(self.parts, self.motion.split(simulated), strict=True)
        return np.concatenate([part.error(piece) for part, piece in pieces])


def to_inverse_problem(experiment: Experiment, response: Response) -> Experiment:
    """Convert an experiment with the force as input to an experiment with the motion as input."""
    return experiment.change_data(
        lambda data: data.convert(
            FilteredForwardData,
            motion=Motion(data.motion.time, data.measured_motion.position, data.motion.sampling_time),
            force=data.motion.position,
            response=response,
        ),
        FilteredForwardJointData,
    )


def has_spring(base: Base) -> bool:
    """Return whether a base has a force at rest."""
    by_motion, _ = linearise(base.form, np.ones(len(base.linear)), np.ones(len(base.nonlinear)))
    return bool(by_motion[0, 0])


def response_of(base: Base, linear: np.ndarray, nonlinear: np.ndarray) -> Response:
    """Return the frequency response of a base from force to motion."""
    by_motion, by_states = linearise(base.form, linear, nonlinear)

    def response(frequency: np.ndarray) -> np.ndarray:
        s = 2j * np.pi * frequency
        powers = np.array([np.ones_like(s), s, s**2])
        stiffness = by_motion[0] @ powers
        for state in range(1, len(by_states)):  # the states of a base are not coupled
            driven = by_motion[state] @ powers / (s - by_states[state, state - 1])
            stiffness = stiffness + by_states[0, state - 1] * driven
        if not has_spring(base):  # a free dashpot flows without limit in infinite time
            stiffness[0] = np.abs(stiffness[1])
        least = _MIN_STIFFNESS * np.abs(stiffness).max()
        return 1 / np.where(np.abs(stiffness) > least, stiffness, least)

    return response


def fit_inverse_problem(experiment: Experiment, base: Base) -> tuple[np.ndarray, np.ndarray]:
    """Fit a base with the motion as input; return its linear and nonlinear parameters."""
    training = experiment.training
    first = training.records[0]
    # The first weighting is the ratio of the spectra of motion and force without their phases.
    force, motion = first.motion.position, first.force
    signals, rate = np.array([force - force.mean(), motion - motion.mean()]), 1 / first.motion.sampling_time
    frequency, powers = scipy.signal.welch(signals, rate, nperseg=len(force) // _SEGMENTS)
    ratio = np.sqrt(powers[1] / np.maximum(powers[0], 1e-12 * powers[0].max()))
    ratio[powers[0] < 1e-6 * powers[0].max()] = 0.0  # noise at frequencies without force

    def response(wanted: np.ndarray) -> np.ndarray:
        return np.interp(wanted, frequency, ratio)

    for _ in range(_WEIGHTED_FITS):
        fit = joint_fit.fit_base(Structure(base), to_inverse_problem(experiment, response).training)
        linear = fit.linear
        if not linear.any():  # the motion does not follow the force
            spring = [item.name == "spring_stiffness" for item in base.linear]
            linear = np.where(spring, _RIGID * np.std(training.motion.position) / np.std(training.force), 0.0)
        response = response_of(base, linear, fit.nonlinear)
    return linear, fit.nonlinear


def prepare_forward(records: list[Record], settings: DiagnosisSettings) -> Experiment:
    """Prepare records with the force as input.

    Raises
    ------
    InputError
        For records of one session, and for the reasons of `prepare`.
    """
    if settings.session:
        raise InputError(
            "records of one session (improvement.session) are not supported with the force as input (improvement.forward), "
            "because their initial state follows from the motion. Leave session out."
        )
    measured = [add_measured_motion(record) for record in records]
    experiment = prepare(measured, **settings.preparation)
    return experiment.change_data(lambda data: data.convert(ForwardData), ForwardJointData)


def shorten(experiment: Experiment) -> Experiment:
    """Return the experiment with only the beginning of long records, which is enough for a search."""

    def short(data: FitData) -> FitData:
        return data.split(_MAX_SEARCH_SAMPLES / data.size)[0] if data.size > _MAX_SEARCH_SAMPLES else data

    is_short = max(item.size for item in (experiment.training, *experiment.tests)) <= _MAX_SEARCH_SAMPLES
    return experiment if is_short else experiment.each(short)


@dataclass(frozen=True, eq=False)
class ForwardFit(joint_fit.Fit):
    """A fitted model from force to motion."""

    structure: ForwardStructure

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Simulate the reading of the motion's sensor, shape (samples,)."""
        parts = motion.parts if isinstance(motion, JoinedMotions) else (motion,)
        zeros = self.zeros if len(self.zeros) == len(parts) else [self.zero] * len(parts)
        return np.concatenate(
            [
                self.structure.simulate(part, self.linear, self.nonlinear, zero) + zero
                for part, zero in zip(parts, zeros, strict=True)
            ]
        )

    def sensitivities(self, data: FitData) -> np.ndarray:
        """Differentiate the whitened simulation by linear parameters, logarithms of nonlinear parameters, and zeros."""
        slopes = self.structure.sensitivities(data.motion, self.linear, self.nonlinear, self.zero)
        return data.whiten(np.column_stack([slopes, data.zeros]))


def fit_by_simulation(
    experiment: Experiment,
    structure: ForwardStructure,
    linear: np.ndarray,
    nonlinear: np.ndarray,
    zero: float = 0.0,
    evaluations: int = EVALUATIONS,
) -> Candidate:
    """Fit a structure by the error of its simulation, from one start of its parameters and of the zero of the motion's sensor.

    The motion of the experiment's data is the force, their force the motion. The error is evaluated at most `evaluations` times.
    """
    data = experiment.training
    signs = np.array(structure.signs, dtype=int)
    size = np.where(linear != 0, np.abs(linear), _ZERO_SIZE * (np.abs(linear).max(initial=0.0) or 1.0))
    extent = float(np.std(data.force))
    count, shapes, zeros = len(linear), len(nonlinear), data.zeros.shape[1]
    low = high = np.zeros(0)
    if shapes:
        low, high = joint_fit.shape_bounds(structure, data, nonlinear)
        margin = (high / low) ** _BOUND_MARGIN
        nonlinear = np.clip(nonlinear, low * margin, high / margin)

    zero_low, zero_high = _zero_bounds(data, structure.base)
    lower = np.concatenate(
        [np.where(signs > 0, 0.0, -np.inf), joint_fit.to_log_ratio(low, nonlinear), zero_low / extent]
    )
    upper = np.concatenate(
        [np.where(signs < 0, 0.0, np.inf), joint_fit.to_log_ratio(high, nonlinear), zero_high / extent]
    )
    known = np.isfinite(zero_low)
    zeros_at_start = np.where(
        known, 0.5 * (np.where(known, zero_low, 0) + np.where(known, zero_high, 0)), zero
    )
    start = np.concatenate([linear / size, np.ones(shapes), zeros_at_start / extent])
    start = np.clip(start, lower + 1e-9, upper - 1e-9)

    def fit_at(vector, squared_error: float = np.inf, converged: bool = True) -> ForwardFit:
        shape = joint_fit.from_log_ratio(vector[count : count + shapes], nonlinear)
        zero = vector[count + shapes :] * extent
        return ForwardFit(structure, vector[:count] * size, shape, squared_error, converged, zero)

    @lru_cache(maxsize=1)
    def error_of(numbers: bytes) -> np.ndarray:
        errors = fit_at(np.frombuffer(numbers)).whitened_errors(data) / extent
        # The error of a failed simulation is larger than any other.
        return errors if np.isfinite(errors).all() else np.full(len(errors), _FAILED_ERROR)

    def jacobian(vector):
        slopes = fit_at(vector).sensitivities(data)
        scale = np.concatenate([size, np.ones(shapes), np.full(zeros, extent)]) / extent
        return np.where(np.isfinite(slopes), slopes, 0.0) * scale

    result = scipy.optimize.least_squares(
        lambda vector: error_of(vector.tobytes()), start, jac=jacobian, bounds=(lower, upper), x_scale="jac",
        xtol=1e-6, ftol=1e-7, gtol=1e-15, max_nfev=evaluations,
    )  # fmt: skip
    return evaluate(fit_at(result.x, 2 * float(result.cost) * extent**2, bool(result.status > 0)), experiment)


def _zero_bounds(data: FitData, base: Base) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds of the motion's zeros, shape (zeros,): by rests before the load, or 0 if any position is in equilibrium."""
    ranges = [item.zero_range for item in data.records]
    known = [item for item in ranges if item is not None]
    if len(known) < len(ranges) or not known:
        low, high = (-1e-9, 1e-9) if not has_spring(base) else (-np.inf, np.inf)
    elif data.zeros.shape[1] == len(known):
        return tuple(np.array(known).T)
    else:
        low, high = min(item[0] for item in known), max(item[1] for item in known)
    return np.full(data.zeros.shape[1], low), np.full(data.zeros.shape[1], high)


def resume_fit(experiment: Experiment, model: Candidate, evaluations: int = EVALUATIONS) -> Candidate:
    """Fit a model to an experiment from its parameters fitted to another experiment."""
    fit = model.fit
    return fit_by_simulation(experiment, fit.structure, fit.linear, fit.nonlinear, fit.zero, evaluations)


def choose_forward_base(experiment: Experiment, name: str) -> Candidate:
    """Fit by simulation the named base, or the base of `FORWARD_BASES` that explains all records best.

    The course of the force between samples is straight, or held for a command that jumps; another one must explain the records
    significantly better.

    Raises
    ------
    InputError
        For a base with contact.
    """
    between: ForceBetween = "held" if is_held(experiment.training.motion) else "straight"
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact or BASES[name].system != "tissue":
            raise InputError(
                f"base {name} is not available with the force as input. Use one of {', '.join(FORWARD_BASES)}."
            )
        return choose_between([simulate_base(experiment, BASES[name], between)], experiment)
    # All are weighted by the response of the first, which has all elements of the others but a second relaxation.
    first = BASES[FORWARD_BASES[0]]
    inverse = to_inverse_problem(experiment, response_of(first, *fit_inverse_problem(experiment, first)))
    ranked = sorted(FORWARD_BASES, key=lambda name: fit_base(BASES[name], inverse).score)
    fits = [simulate_base(experiment, BASES[name], between) for name in ranked[:_SIMULATED_BASES]]
    return choose_between(fits, experiment)


def choose_between(models: list[Candidate], experiment: Experiment) -> Candidate:
    """Return the best model, with the course of the force between samples that explains the records best.

    Parameters
    ----------
    models : list of Candidate
        Models with one course, for forward records.
    experiment : Experiment
        The records.
    """

    def best_of(items: list[Candidate]) -> Candidate:
        return min(items, key=lambda item: item.score if np.isfinite(item.score) else np.inf)

    best = best_of(models)
    for between in get_args(ForceBetween):
        if between != models[0].fit.structure.force_between:
            other = exchange_between(best, between, experiment)
            if other.score < best.score - TIED:
                models = [exchange_between(item, between, experiment) for item in models]
                best = best_of([other, *models])
    return best


def exchange_between(model: Candidate, between: ForceBetween, experiment: Experiment) -> Candidate:
    """Refit a model with another course of the force between samples.

    Parameters
    ----------
    model : Candidate
        The model.
    between : str
        The course: ``held``, ``straight`` or ``smooth``.
    experiment : Experiment
        The records.
    """
    structure = replace(model.fit.structure, force_between=between)
    return resume_fit(experiment, replace(model, fit=replace(model.fit, structure=structure)))


def simulate_base(experiment: Experiment, base: Base, between: ForceBetween) -> Candidate:
    """Fit a base with the motion as input, then by simulation from the parameters of that fit."""
    structure = ForwardStructure(base, force_between=between)
    return fit_by_simulation(experiment, structure, *fit_inverse_problem(experiment, base))


def better_base(model: Candidate, inverse: Experiment) -> Base | None:
    """Return a base that explains the records better in the inverse problem, with the same effects; None without such a base."""
    present = model.fit.structure.base
    bases = [present, *(BASES[name] for name in FORWARD_BASES if name != present.name)]
    best = min(bases, key=lambda base: exchange_base(model, base, inverse).score)
    return None if best is present else best
