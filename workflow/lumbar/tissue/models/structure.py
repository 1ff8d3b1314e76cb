"""A model structure: a base plus effects in given forms, simulated for given parameters.

`Structure` goes from motion to force; `ForwardStructure` is driven by a force and gives the motion.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Self, TypeVar

import numpy as np
import scipy

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.driven_motion import POINTS, Driven, ForceBalance, ForceDrive
from lumbar.tissue.models.form import Form, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.measured_motion import MEASURED, is_held
from lumbar.tissue.models.motion import JoinedMotions, Motion, OneMotion, SpatialMotion


@dataclass(frozen=True)
class Structure:
    """A base and the forms of the effects added to it, in the order in which they were added.

    Linear and nonlinear parameters are ordered base first, then form by form.
    """

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
        """Sign constraint of every amplitude."""
        return tuple(item.sign for item in self.linear)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return tuple(form.effect for form in self.forms)

    @property
    def is_linear(self) -> bool:
        """Whether the force is linear in all linear parameters: no form acts on the output."""
        return all(form.place is not Place.OUTPUT for form in self.forms)

    def with_form(self, form: Form) -> Self:
        """Return the structure with one more form."""
        return replace(self, forms=(*self.forms, form))

    def without(self, effect: str) -> Self:
        """Return the structure without one effect."""
        return replace(self, forms=tuple(form for form in self.forms if form.effect != effect))

    def nonlinear_of(self, nonlinear: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Split all nonlinear parameters into the base's and those of each form by its key."""
        position = len(self.base.nonlinear)
        parts = {}
        for form in self.forms:
            parts[form.key] = nonlinear[position : position + len(form.nonlinear)]
            position += len(form.nonlinear)
        return nonlinear[: len(self.base.nonlinear)], parts

    def design(self, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
        """Force of every amplitude at size 1, before output forms; shape (samples, linear parameters)."""
        if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
            return np.concatenate([self.design(part, nonlinear) for part in motion.parts])
        base, parts = self.nonlinear_of(nonlinear)
        seen: OneMotion = motion
        for form in self.forms:
            if form.place is Place.INPUT:
                seen = self._cached(form.memory_key, form.input_transform, seen, parts[form.key])
        columns = self._cached(self.base.memory_key, self.base.form.columns, seen, base)
        touching = None if self.base.touching is None else self.base.touching(seen, base)
        for form in self.forms:
            if form.place is Place.PARALLEL:
                added = self._cached(form.memory_key, form.columns, seen, parts[form.key])
                columns = [*columns, *(added if touching is None else [touching * item for item in added])]
        for form in self.forms:
            if form.place is Place.FRAME:
                # The forces along the axes, as a turned or coupled sensor reads them.
                assert form.hand_written is not None and form.hand_written.matrix is not None
                matrix = form.hand_written.matrix(parts[form.key])
                columns = [(matrix @ item.reshape(len(matrix), -1)).ravel() for item in columns]
        return np.array(columns).T

    @staticmethod
    def _cached(name: Hashable, function: Callable, motion: OneMotion, nonlinear: np.ndarray) -> Any:
        return motion.cache.compute_at(name, nonlinear, lambda: function(motion, nonlinear))

    def output(self, force: np.ndarray, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
        """Measured force from the force at the tissue, shape (samples,)."""
        if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
            pieces = zip(motion.split(force), motion.parts, strict=True)
            return np.concatenate([self.output(piece, part, nonlinear) for piece, part in pieces])
        _, parts = self.nonlinear_of(nonlinear)
        for form in self.forms:
            if form.place is Place.OUTPUT:
                force = form.output_transform(force, motion, parts[form.key])
        return force

    def simulate(
        self, motion: Motion | JoinedMotions, linear: np.ndarray, nonlinear: np.ndarray
    ) -> np.ndarray:
        """Free-run simulation of the measured force, shape (samples,)."""
        return self.output(self.design(motion, nonlinear) @ linear, motion, nonlinear)


def forces_of(form: Form, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
    """Forces that a parallel form adds, one per amplitude at size 1; shape (samples, linear parameters)."""
    if isinstance(motion, JoinedMotions) and not isinstance(motion, SpatialMotion):
        return np.concatenate([forces_of(form, part, nonlinear) for part in motion.parts])
    return np.stack(form.columns(motion, nonlinear), axis=1)


_MAX_START_SAMPLES, _MIN_START_SAMPLES = 50, 5
"""Samples of the measured motion from which the state at the start is estimated, at most a twentieth of them; no error counts
them."""
_MAX_STEP_RAD = 0.4  # at the highest frequency that holds much of the motion
_MAX_STEPS = 4  # from sample to sample
_BAND_POWER = 0.95
_FIRST_ITERATIONS, _NEXT_ITERATIONS = 4, 2
"""Iterations of the state at the start, at first and for other parameters."""
_START_RIDGE = 1e-3
"""Of a change of the state, relative to the information in the first samples: a state that they do not show stays as it is."""
_RELATIVE_STEP = 1e-6  # of differences by parameters
_Any = TypeVar("_Any", LinearParameter, NonlinearParameter)


@dataclass(frozen=True)
class ForwardStructure(Structure):
    """Base and forms; the motion that is given to it is a force, as the position of a `Motion`, and it gives a position.

    Effects at the output transform the position, effects at the input the force. Units keep their meaning: of the input
    ``{x}`` (a force here) and of the output ``{y}``.
    """

    @cached_property
    def linear(self) -> tuple[LinearParameter, ...]:
        """All linear parameters."""
        return tuple(map(_exchanged, super().linear))

    @cached_property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """All nonlinear parameters; those of forms at the output are of the position already."""
        found = [*map(_exchanged, self.base.nonlinear)]
        for form in self.forms:
            found += [item if form.place is Place.OUTPUT else _exchanged(item) for item in form.nonlinear]
        return tuple(found)

    @property
    def is_linear(self) -> bool:
        """A motion is never linear in the parameters."""
        return False

    @cached_property
    def balance(self) -> ForceBalance:
        """Forces of base and parallel forms."""
        return ForceBalance((self.base.form, *(form for form in self.forms if form.place is Place.PARALLEL)))

    def parameters(self, linear: np.ndarray, nonlinear: np.ndarray) -> dict[str, float]:
        """Parameters by the balance's symbols."""
        own, parts = self.nonlinear_of(nonlinear)
        acting = [parts[form.key] for form in self.forms if form.place is Place.PARALLEL]
        values = (*linear, *np.concatenate([own, *acting]))
        named = zip(self.balance.parameters, values, strict=True)
        return {name: float(value) for name, value in named}

    def simulate(
        self, motion: Motion | JoinedMotions, linear: np.ndarray, nonlinear: np.ndarray, zero: float = 0.0
    ) -> np.ndarray:
        """Free-run simulation of the position without its sensor's zero, shape (samples,).

        The motion is the force over time. If it has a channel `MEASURED`, the state at the start is estimated from that, with
        `zero` the zero of the position's sensor.
        """
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.simulate(part, linear, nonlinear, zero) for part in motion.parts])
        drive, driven = self._driven(motion, linear, nonlinear, zero)
        return self.output(driven.position[:: drive.parts], motion, nonlinear)

    def sensitivities(
        self, motion: Motion | JoinedMotions, linear: np.ndarray, nonlinear: np.ndarray, zero: float = 0.0
    ) -> np.ndarray:
        """Derivatives of the position by linear parameters and logarithms of nonlinear ones, shape (samples, parameters)."""
        if isinstance(motion, JoinedMotions):
            return np.concatenate(
                [self.sensitivities(part, linear, nonlinear, zero) for part in motion.parts]
            )
        numbers = np.concatenate([linear, nonlinear, [zero]])
        return motion.cache.compute_at(
            f"slopes of {self._key}", numbers, lambda: self._sensitivities(motion, linear, nonlinear, zero)
        )

    def _sensitivities(self, motion, linear, nonlinear, zero) -> np.ndarray:
        drive, driven = self._driven(motion, linear, nonlinear, zero)
        values = self.parameters(linear, nonlinear)
        # By the parameters of the balance, from the linearised equations along the motion.
        size = np.abs(linear).max(initial=0.0) or 1.0
        steps = [(name, _RELATIVE_STEP * (abs(value) or size)) for name, value in values.items()]
        inner = drive.sensitivities(values, driven, steps)[:: drive.parts]
        # Effects at the output change the position afterwards.
        position = driven.position[:: drive.parts]
        change = 1e-6 * (np.abs(position).max() + 1e-300)
        outer = [self.output(position + way * change, motion, nonlinear) for way in (1, -1)]
        inner = inner * ((outer[0] - outer[1]) / (2 * change))[:, None]
        # Nonlinear parameters by their logarithms; those of the input and the output by differences of the simulation.
        columns, of_balance = list(inner.T[: len(linear)]), iter(inner.T[len(linear) :])
        places = [form.place for form in (self.base.form, *self.forms) for _ in form.nonlinear]
        for place, value, step in zip(places, nonlinear, 1e-4 * np.eye(len(nonlinear)), strict=True):
            if place is Place.PARALLEL:
                columns.append(next(of_balance) * value)
            else:
                more, less = (
                    self.simulate(motion, linear, nonlinear * np.exp(way * step), zero) for way in (1, -1)
                )
                columns.append((more - less) / 2e-4)
        return np.stack(columns, axis=1)

    @cached_property
    def _key(self) -> str:
        return " ".join([self.base.name, *(form.memory_key for form in self.forms)])

    def _driven(self, motion: Motion, linear, nonlinear, zero) -> tuple[ForceDrive, Driven]:
        """Balance with the force that drives it, and the motion that it gives."""
        _, parts = self.nonlinear_of(nonlinear)
        force = motion
        for form in self.forms:
            if form.place is Place.INPUT:
                force = self._cached(form.memory_key, form.input_transform, force, parts[form.key])
        steps = motion.cache.compute_once("steps per sample", lambda: _steps_per_sample(motion))
        measured = motion.channels.get(MEASURED)
        drive = ForceDrive(
            self.balance,
            force.cache.compute_once("force at points", lambda: _force_at_points(force, steps)),
            motion.sampling_time / steps,
            1.0 if measured is None else float(np.ptp(measured)),
            steps,
        )
        numbers = np.concatenate([linear, nonlinear, [zero]])
        compute = partial(self._motion, motion, drive, self.parameters(linear, nonlinear), zero)
        return drive, motion.cache.compute_at(self._key, numbers, compute)

    def _motion(self, motion: Motion, drive: ForceDrive, values: dict[str, float], zero: float) -> Driven:
        # A search changes parameters little by little: the last motion is a good guess of the next one.
        last: dict = motion.cache.compute_once("last driven motions", dict)
        guess, start = last.get(self._key, (None, None))
        measured = motion.channels.get(MEASURED)
        if measured is None:
            start = _start_at_rest(drive, values)
        else:
            if guess is None:
                # The measured motion with states at rest: what friction makes of its speed is nearly right.
                points = motion.cache.compute_once("measured", lambda: _at_points(measured, drive.parts))
                rest = np.zeros((len(drive.balance.states), *points.shape))
                guess = np.concatenate([(points - zero)[None], rest])
            start = _estimated_start(drive, values, measured - zero, motion.sampling_time, start)
        driven = drive.motion(values, start, guess)
        if not driven.finite and guess is not None:
            driven = drive.motion(values, start)
        if driven.finite:
            last[self._key] = driven.points, start
        return driven


def _exchanged(item: _Any) -> _Any:
    """Return a parameter with the unit for a model whose input is the force."""
    swapped = item.unit.replace("{x}", "{?}").replace("{y}", "{x}").replace("{?}", "{y}")
    return replace(item, unit=swapped)


def _steps_per_sample(motion: Motion) -> int:
    """Return the number of steps from sample to sample that are small for the frequencies of the motion."""
    signal = motion.channels.get(MEASURED, motion.position)
    power = np.cumsum(np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2)
    edge = np.searchsorted(power, _BAND_POWER * power[-1]) / len(signal)
    return int(np.clip(np.ceil(2 * np.pi * edge / _MAX_STEP_RAD), 1, _MAX_STEPS))


def _at_points(signal: np.ndarray, parts: int) -> np.ndarray:
    """Signal at the collocation points of every step, by a cubic spline through its samples."""
    samples = (np.arange(parts * (len(signal) - 1))[:, None] + POINTS) / parts
    return scipy.interpolate.make_interp_spline(np.arange(len(signal)), signal, k=3)(samples)


def _force_at_points(force: Motion, parts: int) -> np.ndarray:
    """Force at the collocation points of every step: a force that is held between jumps as it is."""
    if is_held(force):
        return np.repeat(force.position[:-1], parts)[:, None] * np.ones(len(POINTS))
    return _at_points(force.position, parts)


def _start_at_rest(drive: ForceDrive, values: dict[str, float]) -> np.ndarray:
    """Position at which the first force is balanced without motion, by Newton's method; 0 if the base has no stiffness there."""
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


def _estimated_start(drive, values, measured, sampling_time, start=None) -> np.ndarray:
    """State at the start with which the simulation follows the first measured samples, by Gauss and Newton."""
    count = max(min(_MAX_START_SAMPLES, len(measured) // 20), _MIN_START_SAMPLES)
    count = min(count, len(measured) - 1)
    measured = measured[: count + 1]
    iterations = _NEXT_ITERATIONS
    if start is None:
        # Position and velocity of a straight line through the first samples, states at rest.
        iterations = _FIRST_ITERATIONS
        start = np.zeros(2 + len(drive.balance.states))
        near = min(_MIN_START_SAMPLES, count)
        slope, _ = np.polyfit(sampling_time * np.arange(near + 1), measured[: near + 1], 1)
        start[:2] = measured[0], slope
    first = replace(drive, force=drive.force[: count * drive.parts])
    best, least, guess = start, np.inf, None
    for _ in range(iterations):
        driven = first.motion(values, start, guess)
        if not driven.finite:
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
