"""Records with the force as input for a fit, the same with the motion as input for the search, and the base that they require.

With the motion as input, every error of the force is carried through the base to the motion. If R(z) is the force of a model
with motion z, a true model leaves R(z + n) − F ≈ (dR/dz) n of the noise n in the measured motion; through the base's own
response G ≈ (dR/dz)⁻¹ that is n again, in the unit of the motion and as it was measured (the weighting of Steiglitz and McBride,
IEEE Trans. Automat. Contr. 10 (1965) 461-464). So the search over all forms, which are linear in most parameters here, needs no
simulation.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting import joint_fit
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, exchange_base, fit_base
from lumbar.tissue.models.bases import BASES, CHOSEN_BY_DATA, Base
from lumbar.tissue.models.driven_motion import linearise
from lumbar.tissue.models.measured_motion import with_measured_motion, without_noise
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.structure import ForwardStructure, Structure

FORWARD_BASES = ("KV-mass", "KB-mass", "KV", "KB", "LE")
"""Bases that are tried if the force is the input."""
_SIMULATED = 2
"""Number of bases, those that fit best with the motion as input, that are simulated."""
_LONG = 6000
"""Samples of every record on which a search is made."""
Response = Callable[[np.ndarray], np.ndarray]
"""From frequencies (Hz) to the ratio of motion and force."""
_STIFFEST = 1e-6
"""Smallest dynamic stiffness, as a share of the largest: a free mass would drift away."""
_STIFF = 10.0
"""Stiffness of what does not follow the force, relative to the ratio of force and motion."""
_SEGMENTS = 8
_TURNS = 3
"""Fits of the base, each weighted by the response of the one before."""
_OF_MOTION = ("position", "speed", "path")
EVALUATIONS = 20
"""Largest number of evaluations of the error to fit one model."""
_AT_ZERO = 1e-3
"""Size of a linear parameter that starts at 0, as a share of the largest that acts alike."""
_OFF_BOUND = 1e-3
_LOST = 1e3
"""Error of a simulation that failed, relative to the measured motion."""


@dataclass(frozen=True, eq=False)
class ForwardData(FitData):
    """One record with the force as input: attributes of `FitData`, with the force as its motion and the motion as its force."""

    @cached_property
    def measured_motion(self) -> Motion:
        """The motion, smoothed."""
        return Motion(self.motion.time, without_noise(self.force), self.motion.sampling_time)

    def scale(self, kind: str) -> float:
        """Return the size of a quantity for starting values; ``force`` is the signal that a form at the output transforms."""
        return self.measured_motion.scale(kind) if kind in _OF_MOTION else super().scale(kind)


@dataclass(frozen=True, eq=False)
class ForwardJointData(JointData):
    """Several records with the force as input that are fitted together."""

    def scale(self, kind: str) -> float:
        """Largest size in any of the records."""
        return max(part.scale(kind) for part in self.parts)


@dataclass(frozen=True, eq=False)
class CarriedData(FitData):
    """A record with the force as input, fitted with the measured motion as input; attributes of `FitData`."""

    response: Response = np.ones_like
    """Response through which errors of the force are carried to the motion."""

    def _carried(self, signal: np.ndarray) -> np.ndarray:
        """Signal (samples first) through the response, from rest."""
        length = scipy.fft.next_fast_len(2 * len(signal), real=True)
        kept = self.motion.cache.compute_once(
            ("response", self.response),
            lambda: self.response(scipy.fft.rfftfreq(length, self.motion.sampling_time)),
        )
        spectrum = scipy.fft.rfft(signal, length, axis=0)
        return scipy.fft.irfft(spectrum * kept.reshape(-1, *[1] * (signal.ndim - 1)), length, axis=0)[
            : len(signal)
        ]

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Carried and whitened signal (samples first) from the first sample that counts."""
        return super().whiten(self._carried(signal))

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Simulated less measured force, carried to the motion, over the samples that count."""
        return self._about_zero(self.trim(self._carried(simulated - self.force)))


@dataclass(frozen=True, eq=False)
class CarriedJointData(JointData):
    """Several records of `CarriedData` that are fitted together."""

    def error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of all records, each carried."""
        pieces = zip(self.parts, self.motion.split(simulated), strict=True)
        return np.concatenate([part.error(piece) for part, piece in pieces])


def with_motion_as_input(experiment: Experiment, response: Response) -> Experiment:
    """Return an experiment with the force as input, prepared with the motion as input."""

    def exchange(data: ForwardData) -> CarriedData:
        moved = data.measured_motion
        motion = Motion(moved.time, moved.position, moved.sampling_time)
        return CarriedData(
            name=data.name,
            motion=motion,
            force=data.motion.position,
            whitening=data.whitening,
            settling=data.settling,
            has_own_zero=data.has_own_zero,
            response=response,
        )

    return experiment.change_data(exchange, CarriedJointData)


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
        least = _STIFFEST * np.abs(stiffness).max()
        return 1 / np.where(np.abs(stiffness) > least, stiffness, least)

    return response


def measured_response(data: FitData) -> Response:
    """Return the ratio of the spectra of motion and force without their phases, for a first weighting."""
    force, motion = data.motion.position, data.force
    rate = 1 / data.motion.sampling_time
    frequency, powers = scipy.signal.welch(
        np.array([force - force.mean(), motion - motion.mean()]), rate, nperseg=len(force) // _SEGMENTS
    )
    ratio = np.sqrt(powers[1] / np.maximum(powers[0], 1e-12 * powers[0].max()))
    # At frequencies without force the ratio is noise.
    ratio[powers[0] < 1e-6 * powers[0].max()] = 0.0
    return lambda wanted: np.interp(wanted, frequency, ratio)


def fit_with_motion_as_input(experiment: Experiment, base: Base) -> tuple[np.ndarray, np.ndarray]:
    """Fit a base with the motion as input; return its linear and nonlinear parameters."""
    training = experiment.training
    first = training.records[0]
    response = measured_response(first)
    for _ in range(_TURNS):
        found = joint_fit.fit_base(Structure(base), with_motion_as_input(experiment, response).training)
        linear = found.linear
        if not linear.any():  # without a material, what does not follow the force is stiff
            spring = [item.name == "spring_stiffness" for item in base.linear]
            linear = np.where(spring, _STIFF * np.std(training.motion.position) / np.std(training.force), 0.0)
        response = response_of(base, linear, found.nonlinear)
    return linear, found.nonlinear


def prepare_forward(records: list[Record], settings: DiagnosisSettings) -> Experiment:
    """Prepare records with the force as input.

    Raises
    ------
    InputError
        As `prepare`; for records of one session.
    """
    if settings.session:
        raise InputError(
            "records of one session (improvement.session) are not supported with the force as input (improvement.forward): each "
            "begins in the state that its own motion tells; leave session out"
        )
    seen = [with_measured_motion(record) for record in records]

    def forward(data: FitData) -> ForwardData:
        return ForwardData(
            name=data.name,
            motion=data.motion,
            force=data.force,
            whitening=data.whitening,
            settling=data.settling,
            has_own_zero=data.has_own_zero,
        )

    return Experiment.prepare_unrepaired(seen, settings, records=tuple(seen)).change_data(
        forward, ForwardJointData
    )


def shorten(experiment: Experiment) -> Experiment:
    """Return the beginnings of long records, enough for a search; the same experiment if none is longer."""

    def short(data: FitData) -> FitData:
        return data.split(_LONG / data.size)[0] if data.size > _LONG else data

    if max(item.size for item in (experiment.training, *experiment.tests)) <= _LONG:
        return experiment
    return experiment.each(short)


@dataclass(frozen=True, eq=False)
class ForwardFit(joint_fit.Fit):
    """A fitted model from force to motion; attributes of `Fit`."""

    structure: ForwardStructure

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation of what the sensor of the motion reads, shape (samples,)."""
        parts = motion.parts if isinstance(motion, JoinedMotions) else (motion,)
        zeros = self.zeros if len(self.zeros) == len(parts) else [self.zero] * len(parts)
        return np.concatenate(
            [
                self.structure.simulate(part, self.linear, self.nonlinear, zero) + zero
                for part, zero in zip(parts, zeros, strict=True)
            ]
        )

    def sensitivities(self, data: FitData) -> np.ndarray:
        """Derivatives of the whitened simulation by linear parameters, logarithms of nonlinear ones, and the zeros."""
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
    size = np.where(linear != 0, np.abs(linear), _AT_ZERO * (np.abs(linear).max(initial=0.0) or 1.0))
    extent = float(np.std(data.force))
    count, shapes, zeros = len(linear), len(nonlinear), data.zeros.shape[1]
    low, high = joint_fit.shape_bounds(structure, data, nonlinear) if shapes else (np.zeros(0), np.zeros(0))
    room = (high / low) ** _OFF_BOUND if shapes else 1.0
    nonlinear = np.clip(nonlinear, low * room, high / room)
    lower = np.concatenate(
        [np.where(signs > 0, 0.0, -np.inf), joint_fit.to_log_ratio(low, nonlinear), np.full(zeros, -np.inf)]
    )
    upper = np.concatenate(
        [np.where(signs < 0, 0.0, np.inf), joint_fit.to_log_ratio(high, nonlinear), np.full(zeros, np.inf)]
    )
    start = np.concatenate([linear / size, np.ones(shapes), np.full(zeros, zero / extent)])
    start = np.clip(start, lower + 1e-9, upper - 1e-9)

    def trial(vector) -> ForwardFit:
        return ForwardFit(
            structure, vector[:count] * size, joint_fit.from_log_ratio(vector[count : count + shapes], nonlinear), np.inf, True,
            vector[count + shapes :] * extent,
        )  # fmt: skip

    @lru_cache(maxsize=1)
    def error_of(numbers: bytes) -> np.ndarray:
        errors = trial(np.frombuffer(numbers)).whitened_errors(data) / extent
        # The error of a failed simulation is larger than any other.
        return errors if np.isfinite(errors).all() else np.full(len(errors), _LOST)

    def jacobian(vector):
        slopes = trial(vector).sensitivities(data)
        scale = np.concatenate([size, np.ones(shapes), np.full(zeros, extent)]) / extent
        return np.where(np.isfinite(slopes), slopes, 0.0) * scale

    found = scipy.optimize.least_squares(
        lambda vector: error_of(vector.tobytes()), start, jac=jacobian, bounds=(lower, upper), x_scale="jac",
        xtol=1e-6, ftol=1e-7, gtol=1e-15, max_nfev=evaluations,
    )  # fmt: skip
    squared_error, converged = 2 * float(found.cost) * extent**2, bool(found.status > 0)
    return evaluate(replace(trial(found.x), squared_error=squared_error, converged=converged), experiment)


def resume_fit(experiment: Experiment, model: Candidate, evaluations: int = EVALUATIONS) -> Candidate:
    """Fit a model to an experiment from where a fit to another one has ended."""
    fit = model.fit
    return fit_by_simulation(experiment, fit.structure, fit.linear, fit.nonlinear, fit.zero, evaluations)


def choose_forward_base(experiment: Experiment, name: str) -> Candidate:
    """Fit the base with a name, or the one of `FORWARD_BASES` that explains all records best, by simulation.

    Raises
    ------
    InputError
        For a base with contact.
    """
    if name != CHOSEN_BY_DATA:
        if BASES[name].contact or BASES[name].system != "tissue":
            known = ", ".join(FORWARD_BASES)
            raise InputError(f"base {name}: records with the force as input know the bases {known}")
        return simulate_base(experiment, BASES[name])
    # All are weighted by the response of the first, which has all elements of the others but a second relaxation.
    first = BASES[FORWARD_BASES[0]]
    seen = with_motion_as_input(experiment, response_of(first, *fit_with_motion_as_input(experiment, first)))
    ranked = sorted(FORWARD_BASES, key=lambda name: fit_base(BASES[name], seen).score)
    found = [simulate_base(experiment, BASES[name]) for name in ranked[:_SIMULATED]]
    return min(found, key=lambda item: item.score if np.isfinite(item.score) else np.inf)


def simulate_base(experiment: Experiment, base: Base) -> Candidate:
    """Fit a base with the motion as input, and from there by simulation."""
    return fit_by_simulation(experiment, ForwardStructure(base), *fit_with_motion_as_input(experiment, base))


def better_base(model: Candidate, seen: Experiment) -> Base | None:
    """Return the base that explains the records better with the same effects and the motion as input, or None.

    A missing effect may have been mistaken for a relaxation or a mass.
    """
    own = model.fit.structure.base
    bases = [own, *(BASES[name] for name in FORWARD_BASES if name != own.name)]
    best = min(bases, key=lambda base: exchange_base(model, base, seen).score)
    return None if best is own else best
