"""A model structure: a base plus effects in given forms, simulated for given parameters.

`Structure` goes from motion to force; `ForwardStructure` is driven by a force and gives the motion.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
import scipy

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.driven_motion import POINTS, Driven, ForceBalance, ForceDrive
from lumbar.tissue.models.form import Form, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.measured_motion import MEASURED
from lumbar.tissue.models.motion import JoinedMotions, Motion, OneMotion, SpatialMotion, is_held


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
        """Structure with one form more."""
        return replace(self, forms=(*self.forms, form))

    def without(self, effect: str) -> Self:
        """Structure without one effect."""
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
                seen = self._of(form.memory_key, form.input_transform, seen, parts[form.key])
        columns = self._of(self.base.memory_key, self.base.columns, seen, base)
        touching = None if self.base.touching is None else self.base.touching(seen, base)
        for form in self.forms:
            if form.place is Place.PARALLEL:
                added = self._of(form.memory_key, form.columns, seen, parts[form.key])
                columns = [*columns, *(added if touching is None else [touching * item for item in added])]
        for form in self.forms:
            if form.place is Place.FRAME:
                columns = form.mixed(columns, parts[form.key])
        return np.array(columns).T

    @staticmethod
    def _of(name: str, function: Callable, motion: OneMotion, nonlinear: np.ndarray) -> Any:
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


_BEGINNING = 50
"""Samples of the measured motion from which the state at the beginning is estimated, at most a twentieth of them; no error
counts them."""
_FEWEST = 5
_FINE = 0.4
"""Largest step, in radians of the highest frequency that holds much of the motion."""
_MOST_PARTS = 4
_BAND_POWER = 0.95
_TURNS, _AGAIN = 4, 2
"""Iterations of the state at the beginning, at first and for other parameters."""
_RIDGE = 1e-3
"""Of the state's change, relative to what the beginning tells of it: what it does not tell stays as it is."""
_STEP = 1e-6
"""Relative step of differences by parameters."""
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
        named = zip(
            (*self.balance.linear, *self.balance.nonlinear),
            (*linear, *np.concatenate([own, *acting])),
            strict=True,
        )
        return {name: float(value) for name, value in named}

    def simulate(
        self, motion: Motion | JoinedMotions, linear: np.ndarray, nonlinear: np.ndarray, zero: float = 0.0
    ) -> np.ndarray:
        """Free-run simulation of the position without its sensor's zero, shape (samples,).

        The motion is the force over time; where it has a channel `MEASURED`, the state at the beginning is estimated
        from that, with `zero` the zero of the position's sensor.
        """
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.simulate(part, linear, nonlinear, zero) for part in motion.parts])
        _, found, parts = self._driven(motion, linear, nonlinear, zero)
        return self.output(found.position[::parts], motion, nonlinear)

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
        drive, found, parts = self._driven(motion, linear, nonlinear, zero)
        values = self.parameters(linear, nonlinear)
        names = list(values)
        size = np.abs(linear).max(initial=0.0) or 1.0
        steps = [_STEP * (abs(values[name]) or size) for name in names]
        inner = drive.sensitivities(values, found, list(zip(names, steps, strict=True)))[::parts]
        position = found.position[::parts]
        change = 1e-6 * (np.abs(position).max() + 1e-300)
        outer = [self.output(position + way * change, motion, nonlinear) for way in (1, -1)]
        inner = inner * ((outer[0] - outer[1]) / (2 * change))[:, None]
        columns, count = list(inner.T[: len(linear)]), len(linear)
        index = 0
        for form in (self.base.form, *self.forms):
            for _ in form.nonlinear:
                if form.place is Place.PARALLEL:
                    columns.append(inner[:, count] * nonlinear[index])
                    count += 1
                else:
                    # By what the logarithm of the parameter changes.
                    step = 1e-4 * np.eye(len(nonlinear))[index]
                    more, less = (
                        self.simulate(motion, linear, nonlinear * np.exp(way * step), zero) for way in (1, -1)
                    )
                    columns.append((more - less) / 2e-4)
                index += 1
        return np.stack(columns, axis=1)

    @cached_property
    def _key(self) -> str:
        return " ".join([self.base.name, *(form.memory_key for form in self.forms)])

    def _driven(self, motion: Motion, linear, nonlinear, zero) -> tuple[ForceDrive, Driven, int]:
        _, parts = self.nonlinear_of(nonlinear)
        seen = motion
        for form in self.forms:
            if form.place is Place.INPUT:
                seen = self._of(form.memory_key, form.input_transform, seen, parts[form.key])
        step = motion.cache.compute_once("parts of a step", lambda: _parts_of_step(motion))
        force = seen.cache.compute_once("force at points", lambda: _at_points(seen, step))
        size = (
            motion.cache.compute_once("size of position", lambda: float(np.ptp(_measured(motion))))
            if MEASURED in motion.channels
            else 1.0
        )
        drive = ForceDrive(self.balance, force, motion.sampling_time / step, size)
        numbers = np.concatenate([linear, nonlinear, [zero]])
        found = motion.cache.compute_at(
            self._key, numbers, lambda: self._found(motion, drive, step, linear, nonlinear, zero)
        )
        return drive, found, step

    def _found(self, motion, drive, step, linear, nonlinear, zero) -> Driven:
        values = self.parameters(linear, nonlinear)
        # A search changes parameters little by little: the last motion is a good guess of the next one.
        last: dict = motion.cache.compute_once("last driven motions", dict)
        guess, start = last.get(self._key, (None, None))
        if MEASURED in motion.channels:
            if guess is None:
                guess = _as_measured(motion, step, zero, len(drive.balance.states))
            start = _estimated_start(
                drive, values, _measured(motion) - zero, motion.sampling_time, step, start
            )
        else:
            start = _at_rest(drive, values)
        found = drive.motion(values, start, guess)
        if not found.finite and guess is not None:
            found = drive.motion(values, start)
        if found.finite:
            last[self._key] = found.points, start
        return found


def _exchanged(item: _Any) -> _Any:
    """A parameter with its unit as of a model whose input is the force."""
    swapped = item.unit.replace("{x}", "{?}").replace("{y}", "{x}").replace("{?}", "{y}")
    return replace(item, unit=swapped)


def _measured(motion: Motion) -> np.ndarray:
    return motion.channels[MEASURED]


def _parts_of_step(motion: Motion) -> int:
    """How many steps are taken from sample to sample."""
    signal = motion.channels.get(MEASURED, motion.position)
    power = np.cumsum(np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2)
    edge = np.searchsorted(power, _BAND_POWER * power[-1]) / len(signal)
    return int(np.clip(np.ceil(2 * np.pi * edge / _FINE), 1, _MOST_PARTS))


def _at_points(motion: Motion, parts: int) -> np.ndarray:
    """Force at the collocation points of every step: as it is between jumps where it is held, else by a cubic spline."""
    steps = parts * (len(motion) - 1)
    if is_held(motion):
        return np.repeat(motion.position[:-1], parts)[:, None] * np.ones(len(POINTS))
    samples = (np.arange(steps)[:, None] + POINTS) / parts
    return scipy.interpolate.make_interp_spline(np.arange(len(motion)), motion.position, k=3)(samples)


def _at_rest(drive: ForceDrive, values: dict[str, float]) -> np.ndarray:
    """Position at which the first force is balanced without motion, from the slope there; 0 where nothing holds it."""
    states = len(drive.balance.states)
    start = np.zeros(2 + states)
    for _ in range(20):
        known = {
            **values,
            **dict.fromkeys(drive.balance.states, 0.0),
            "z": start[0],
            "v": 0.0,
            "a": 0.0,
            "t": 0.0,
        }
        force, slopes = drive.balance.slopes(known, ())
        if not slopes[0, 0] > 0:
            return np.zeros(2 + states)
        change = (drive.force[0, 0] - force[0]) / slopes[0, 0]
        start[0] += change
        if abs(change) <= 1e-9 * abs(start[0]):
            break
    return start if np.isfinite(start).all() else np.zeros(2 + states)


def _as_measured(motion: Motion, parts: int, zero: float, states: int) -> np.ndarray:
    """Measured motion at the collocation points, states at rest: what friction makes of its speed is nearly right."""

    def at_points() -> np.ndarray:
        samples = (np.arange(parts * (len(motion) - 1))[:, None] + POINTS) / parts
        return scipy.interpolate.make_interp_spline(np.arange(len(motion)), _measured(motion), k=3)(samples)

    position = motion.cache.compute_once("measured at points", at_points) - zero
    return np.concatenate([position[None], np.zeros((states, *position.shape))])


def _estimated_start(drive, values, measured, sampling_time, parts, start=None) -> np.ndarray:
    """State at the beginning with which the simulation follows the measured motion there, by Gauss and Newton."""
    count = min(max(min(_BEGINNING, len(measured) // 20), _FEWEST), len(measured) - 1)
    measured = measured[: count + 1]
    turns = _AGAIN
    if start is None:
        start = np.zeros(2 + len(drive.balance.states))
        turns = _TURNS
        near = min(_FEWEST, count)
        slope, _ = np.polyfit(sampling_time * np.arange(near + 1), measured[: near + 1], 1)
        start[:2] = measured[0], slope
    begun = replace(drive, force=drive.force[: count * parts])
    best, least = start, np.inf
    guess = None
    for _ in range(turns):
        found = begun.motion(values, start, guess)
        if not found.finite:
            break
        guess = found.points
        error = measured - found.position[::parts]
        square = float(error @ error)
        if square >= least * (1 - 1e-6):
            best = start if square < least else best
            break
        best, least = start, square
        columns = begun.sensitivities(values, found, [], by_start=True)[::parts]
        size = np.sqrt(np.sum(columns**2, axis=0))
        if not np.isfinite(size).all():
            break
        scaled = columns / np.where(size > 0, size, 1.0)
        normal = scaled.T @ scaled + _RIDGE * np.eye(len(start))
        start = start + np.linalg.solve(normal, scaled.T @ error) / np.where(size > 0, size, np.inf)
    return best
