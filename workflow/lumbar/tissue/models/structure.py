"""Model structures: a base plus effects in given forms, simulated for given parameters.

`Structure` computes the force from a motion; `ForwardStructure` computes the motion from a force.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, Self, TypeVar

import numpy as np
import scipy

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.driven_motion import POINTS, DrivenMotion, ForceBalance, ForceDrive
from lumbar.tissue.models.form import Form, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.measured_motion import MEASURED, resting_samples
from lumbar.tissue.models.motion import AnyMotion, JoinedMotions, Motion, SpatialMotion


@dataclass(frozen=True)
class Structure:
    """A base and the forms of added effects; parameters are in the order base, then form by form."""

    base: Base
    forms: tuple[Form, ...] = ()

    @cached_property
    def linear(self) -> tuple[LinearParameter, ...]:
        """All linear parameters."""
        return self.base.linear + tuple(item for form in self.forms for item in form.linear)

    @cached_property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """All nonlinear parameters."""
        return self.base.nonlinear + tuple(item for form in self.forms for item in form.nonlinear)

    @cached_property
    def signs(self) -> tuple[int, ...]:
        """Sign constraint of every linear parameter."""
        return tuple(item.sign for item in self.linear)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return tuple(form.effect for form in self.forms)

    @property
    def is_linear(self) -> bool:
        """True if the force is linear in all linear parameters: no form acts on the output."""
        return all(form.place is not Place.OUTPUT for form in self.forms)

    def with_form(self, form: Form) -> Self:
        """Return the structure with one more form.

        Parameters
        ----------
        form : Form
            Form of an effect that the structure lacks; it is added last.
        """
        return replace(self, forms=(*self.forms, form))

    def nonlinear_of(self, nonlinear: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Split the nonlinear parameters into the parameters of the base and, by key, of each form.

        Parameters
        ----------
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`.
        """
        position = len(self.base.nonlinear)
        parts = {}
        for form in self.forms:
            parts[form.key] = nonlinear[position : position + len(form.nonlinear)]
            position += len(form.nonlinear)
        return nonlinear[: len(self.base.nonlinear)], parts

    def design(self, motion: AnyMotion, nonlinear: np.ndarray) -> np.ndarray:
        """Return the forces at linear parameters of 1, without output forms, (samples, parameters); in space axis by axis.

        Parameters
        ----------
        motion : AnyMotion
            Motion of one record or several.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`.
        """
        if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
            return np.concatenate([self.design(part, nonlinear) for part in motion.parts])
        base, parts = self.nonlinear_of(nonlinear)
        motion = self._apply_input_forms(motion, parts)
        columns = _compute_cached(self.base.memory_key, self.base.form.columns, motion, base)
        touching = None if self.base.touching is None else self.base.touching(motion, base)
        for form in self.forms:
            if form.place is Place.PARALLEL:
                added = _compute_cached(form.memory_key, form.columns, motion, parts[form.key])
                columns = [*columns, *(added if touching is None else [touching * item for item in added])]
        for form in self.forms:
            if form.place is Place.FRAME:
                # The forces along the axes, as a rotated or coupled sensor reads them.
                assert form.hand_written is not None and form.hand_written.matrix is not None
                matrix = form.hand_written.matrix(parts[form.key])
                columns = [(matrix @ item.reshape(len(matrix), -1)).ravel() for item in columns]
        return np.array(columns).T

    def _apply_input_forms(self, motion: Any, parts: Mapping[str, np.ndarray]) -> Any:
        for form in self.forms:
            if form.place is Place.INPUT:
                motion = _compute_cached(form.memory_key, form.input_transform, motion, parts[form.key])
        return motion

    def output(self, force: np.ndarray, motion: AnyMotion, nonlinear: np.ndarray) -> np.ndarray:
        """Return the measured force, of the shape and unit of `force`.

        Parameters
        ----------
        force : numpy.ndarray, shape (samples,)
            Force at the tissue; in space one axis after the other.
        motion : AnyMotion
            Motion of one record or several.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters of the field `nonlinear`.
        """
        if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
            pieces = zip(motion.split(force), motion.parts, strict=True)
            return np.concatenate([self.output(piece, part, nonlinear) for piece, part in pieces])
        _, parts = self.nonlinear_of(nonlinear)
        for form in self.forms:
            if form.place is Place.OUTPUT:
                force = form.output_transform(force, motion, parts[form.key])
        return force

    def simulate(self, motion: AnyMotion, linear: np.ndarray, nonlinear: np.ndarray) -> np.ndarray:
        """Simulate the measured force as a free run, shape (samples,); in space one axis after the other.

        Parameters
        ----------
        motion : AnyMotion
            Motion of one record or several.
        linear, nonlinear : numpy.ndarray, shape (parameters,)
            Parameters of the fields `linear` and `nonlinear`.
        """
        return self.output(self.design(motion, nonlinear) @ linear, motion, nonlinear)


def _compute_cached(name: Hashable, function: Callable, motion: Any, nonlinear: np.ndarray) -> Any:
    return motion.cache.compute_at(name, nonlinear, lambda: function(motion, nonlinear))


def forces_of(form: Form, motion: AnyMotion, nonlinear: np.ndarray) -> np.ndarray:
    """Return the forces that a parallel form adds, one per linear parameter at size 1, shape (samples, linear parameters).

    Parameters
    ----------
    form : Form
        Parallel form.
    motion : AnyMotion
        Motion of one record or several.
    nonlinear : numpy.ndarray, shape (nonlinear parameters,)
        Nonlinear parameters of the form.
    """
    if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
        return np.concatenate([forces_of(form, part, nonlinear) for part in motion.parts])
    return np.stack(form.columns(motion, nonlinear), axis=1)


_MAX_START_SAMPLES, _MIN_START_SAMPLES = 50, 5
"""Largest and smallest number of samples for the estimate of the start state, else 1/20 of the record; errors omit them."""
_MAX_STEP_RAD = 0.4  # at the upper edge of the band that contains _BAND_POWER of the motion's power
_BAND_POWER = 0.95
_MAX_STEPS = 4  # from sample to sample
_FIRST_ITERATIONS, _NEXT_ITERATIONS = 4, 2  # of the state at the start, for the first and later parameters
_START_RIDGE = 1e-3  # relative to the information in the first samples; without influence a state stays
_RELATIVE_STEP = 1e-6  # of differences by parameters
_Any = TypeVar("_Any", LinearParameter, NonlinearParameter)


def _swap_units(item: _Any) -> _Any:
    """Return a parameter with the unit for a model with the force as input."""
    return replace(item, unit=item.unit.replace("{x}", "{?}").replace("{y}", "{x}").replace("{?}", "{y}"))


ForceBetween = Literal["held", "straight", "smooth"]
"""Course of a force between samples: the value of the sample before, a straight line, or a cubic spline."""


@dataclass(frozen=True)
class ForwardStructure(Structure):
    """Base and forms driven by a force. The force is the ``position`` of the given `Motion`; the result is a position.

    Effects at the output transform the position, effects at the input the force. In units, ``{x}`` is the unit of the input
    (here a force), and ``{y}`` the unit of the output.
    """

    force_between: ForceBetween = "smooth"
    """Course of the force between samples."""

    @cached_property
    def linear(self) -> tuple[LinearParameter, ...]:
        """All linear parameters."""
        return tuple(map(_swap_units, super().linear))

    @cached_property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """All nonlinear parameters; the units of forms at the output are already for a position."""
        forms = (self.base.form, *self.forms)
        items = ((form, item) for form in forms for item in form.nonlinear)
        return tuple(item if form.place is Place.OUTPUT else _swap_units(item) for form, item in items)

    @property
    def is_linear(self) -> bool:
        """False: a motion is never linear in the parameters."""
        return False

    @cached_property
    def balance(self) -> ForceBalance:
        """Forces of base and parallel forms."""
        return ForceBalance((self.base.form, *(form for form in self.forms if form.place is Place.PARALLEL)))

    def parameters(self, linear: np.ndarray, nonlinear: np.ndarray) -> dict[str, float]:
        """Return the parameters by the balance's symbols.

        Parameters
        ----------
        linear, nonlinear : numpy.ndarray, shape (parameters,)
            Parameters of the fields `linear` and `nonlinear`.
        """
        base, parts = self.nonlinear_of(nonlinear)
        parallel = [parts[form.key] for form in self.forms if form.place is Place.PARALLEL]
        values = map(float, (*linear, *np.concatenate([base, *parallel])))
        return dict(zip(self.balance.parameters, values, strict=True))

    def simulate(
        self, motion: AnyMotion, linear: np.ndarray, nonlinear: np.ndarray, zero: float = 0.0
    ) -> np.ndarray:
        """Simulate the position, less its sensor's zero, as a free run, shape (samples,); not finite if there is no solution.

        Parameters
        ----------
        motion : AnyMotion
            Force over time, of one record or several. A channel `MEASURED` is used to estimate the state at the start.
        linear, nonlinear : numpy.ndarray, shape (parameters,)
            Parameters of the fields `linear` and `nonlinear`.
        zero : float, optional
            Zero of the position's sensor in the output's unit, subtracted from `MEASURED`.
        """
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.simulate(part, linear, nonlinear, zero) for part in motion.parts])
        drive, driven = self._drive(motion, linear, nonlinear, zero)
        return self.output(driven.position[:: drive.parts], motion, nonlinear)

    def sensitivities(
        self, motion: AnyMotion, linear: np.ndarray, nonlinear: np.ndarray, zero: float = 0.0
    ) -> np.ndarray:
        """Return the position's derivatives by linear parameters and logarithms of nonlinear ones, shape (samples, parameters).

        Parameters
        ----------
        motion : AnyMotion
            Force over time, of one record or several.
        linear, nonlinear : numpy.ndarray, shape (parameters,)
            Parameters of the fields `linear` and `nonlinear`.
        zero : float, optional
            Zero of the position's sensor in the output's unit.
        """
        if isinstance(motion, JoinedMotions):
            return np.concatenate(
                [self.sensitivities(part, linear, nonlinear, zero) for part in motion.parts]
            )
        numbers = np.concatenate([linear, nonlinear, [zero]])
        return motion.cache.compute_at(
            f"slopes of {self._key}", numbers, lambda: self._sensitivities(motion, linear, nonlinear, zero)
        )

    def _sensitivities(self, motion, linear, nonlinear, zero) -> np.ndarray:
        drive, driven = self._drive(motion, linear, nonlinear, zero)
        values = self.parameters(linear, nonlinear)
        # By the parameters of the balance, from the linearised equations along the motion.
        size = np.abs(linear).max(initial=0.0) or 1.0
        steps = [(name, _RELATIVE_STEP * (abs(value) or size)) for name, value in values.items()]
        slopes = drive.sensitivities(values, driven, steps)[:: drive.parts]
        # Effects at the output change the position afterwards.
        position = driven.position[:: drive.parts]
        change = 1e-6 * (np.abs(position).max() + 1e-300)
        more, less = (self.output(position + sign * change, motion, nonlinear) for sign in (1, -1))
        slopes = slopes * ((more - less) / (2 * change))[:, None]
        # Nonlinear parameters by their logarithms; those of the input and the output by differences of the simulation.
        columns, balance_columns = list(slopes.T[: len(linear)]), iter(slopes.T[len(linear) :])
        places = [form.place for form in (self.base.form, *self.forms) for _ in form.nonlinear]
        for place, value, step in zip(places, nonlinear, 1e-4 * np.eye(len(nonlinear)), strict=True):
            if place is Place.PARALLEL:
                columns.append(next(balance_columns) * value)
            else:
                more, less = (
                    self.simulate(motion, linear, nonlinear * np.exp(sign * step), zero) for sign in (1, -1)
                )
                columns.append((more - less) / 2e-4)
        return np.stack(columns, axis=1)

    @cached_property
    def _key(self) -> str:
        return " ".join([self.force_between, self.base.name, *(form.memory_key for form in self.forms)])

    def _drive(self, motion: Motion, linear, nonlinear, zero) -> tuple[ForceDrive, DrivenMotion]:
        """Return the balance with the force that drives it, and the resulting motion."""
        force = self._apply_input_forms(motion, self.nonlinear_of(nonlinear)[1])
        measured = motion.channels.get(MEASURED)

        def steps_per_sample() -> int:
            signal = motion.position if measured is None else measured
            power = np.cumsum(np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2)
            edge = np.searchsorted(power, _BAND_POWER * power[-1]) / len(signal)
            return int(np.clip(np.ceil(2 * np.pi * edge / _MAX_STEP_RAD), 1, _MAX_STEPS))

        steps = motion.cache.compute_once("steps per sample", steps_per_sample)
        points = force.cache.compute_once(
            ("force at points", self.force_between),
            lambda: _interpolate(force.position, steps, self.force_between),
        )
        size = 1.0 if measured is None else float(np.ptp(measured))
        drive = ForceDrive(self.balance, points, motion.sampling_time / steps, size, steps)
        numbers = np.concatenate([linear, nonlinear, [zero]])
        compute = partial(self._motion, motion, drive, self.parameters(linear, nonlinear), zero)
        return drive, motion.cache.compute_at(self._key, numbers, compute)

    def _motion(self, motion: Motion, drive: ForceDrive, values: dict, zero: float) -> DrivenMotion:
        # A search changes parameters in small steps: the last motion is a good guess of the next one.
        last: dict = motion.cache.compute_once("last driven motions", dict)
        guess, start = last.get(self._key, (None, None))
        measured = motion.channels.get(MEASURED)
        if measured is None:
            start = _balance_at_rest(drive, values)
        else:
            rests = motion.cache.compute_once("rests", lambda: resting_samples(motion.position, measured) > 0)
            if guess is None:
                # The measured motion with states at rest: the friction at its speed is nearly right.
                points = motion.cache.compute_once("measured", lambda: _interpolate(measured, drive.parts))
                rest = np.zeros((len(drive.balance.states), *points.shape))
                guess = np.concatenate([(points - zero)[None], rest])
            start = (
                np.zeros(2 + len(drive.balance.states))
                if rests
                else _estimate_start(drive, values, measured - zero, motion.sampling_time, start)
            )
        driven = drive.motion(values, start, guess)
        if driven.is_finite:
            last[self._key] = driven.points, start
        return driven


def _interpolate(signal: np.ndarray, parts: int, between: ForceBetween = "smooth") -> np.ndarray:
    """Return a signal with a course between samples at the collocation points of every step."""
    if between == "held":
        return np.repeat(signal[:-1], parts)[:, None] * np.ones(len(POINTS))
    samples = (np.arange(parts * (len(signal) - 1))[:, None] + POINTS) / parts
    degree = 1 if between == "straight" else 3
    return scipy.interpolate.make_interp_spline(np.arange(len(signal)), signal, k=degree)(samples)


def _balance_at_rest(drive: ForceDrive, values: dict[str, float]) -> np.ndarray:
    """Return the position that balances the first force at rest, by Newton's method; 0 if the base has no stiffness there."""
    start = np.zeros(2 + len(drive.balance.states))
    known = {**values, **dict.fromkeys((*drive.balance.states, "v", "a", "t"), 0.0)}
    for _ in range(20):
        force, slopes = drive.balance.slopes({**known, "z": start[0]}, ())
        if not slopes[0, 0] > 0:
            return np.zeros_like(start)
        change = (drive.force[0, 0] - force[0]) / slopes[0, 0]
        start[0] += change
        if abs(change) <= 1e-9 * abs(start[0]):
            break
    return start if np.isfinite(start).all() else np.zeros_like(start)


def _estimate_start(drive, values, measured, sampling_time, start=None) -> np.ndarray:
    """Fit the state at the start to the first measured samples by the Gauss–Newton method."""
    count = min(max(min(_MAX_START_SAMPLES, len(measured) // 20), _MIN_START_SAMPLES), len(measured) - 1)
    measured = measured[: count + 1]
    iterations = _NEXT_ITERATIONS
    if start is None:
        # Position and velocity of a straight line through the first samples, states at rest.
        iterations = _FIRST_ITERATIONS
        start = np.zeros(2 + len(drive.balance.states))
        near = min(_MIN_START_SAMPLES, count)
        slope, _ = np.polyfit(sampling_time * np.arange(near + 1), measured[: near + 1], 1)
        start[:2] = measured[0], slope
    force = drive.force[: count * drive.parts]
    first = ForceDrive(drive.balance, force, drive.step, drive.size, drive.parts)
    best, least, guess = start, np.inf, None
    for _ in range(iterations):
        driven = first.motion(values, start, guess)
        if not driven.is_finite:
            break
        guess = driven.points
        error = measured - driven.position[:: drive.parts]
        square = float(error @ error)
        if square >= least * (1 - 1e-6):
            best = start if square < least else best
            break
        best, least = start, square
        # One step of ridge regression in columns of size 1; a state without influence stays as it is.
        columns = first.sensitivities(values, driven, [], by_start=True)[:: drive.parts]
        size = np.sqrt(np.sum(columns**2, axis=0))
        if not np.isfinite(size).all():
            break
        scaled = columns / np.where(size > 0, size, 1.0)
        normal = scaled.T @ scaled + _START_RIDGE * np.eye(len(start))
        start = start + np.linalg.solve(normal, scaled.T @ error) / np.where(size > 0, size, np.inf)
    return best
