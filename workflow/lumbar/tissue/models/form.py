"""Effects: a mechanism with one or more mathematical forms.

A model's force is composed in this order::

    motion --(input forms: delay, play)--> motion' --> base force + parallel forms' forces --(output forms)--> force

A form is one equation in the operations of `lumbar.tissue.models.expression`; its simulation, LaTeX and C code follow from it.
A parallel form is a sum of terms, each with a *linear parameter* as factor that least squares solves directly; the other
parameters are *nonlinear*: positive, and searched over decades. Output forms have nonlinear parameters only. Mechanisms that no
equation expresses (play, delay) are `HandWritten` forms.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from itertools import combinations
from typing import Any, Self

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.tissue.models.equation import CStep, Equation, Solution
from lumbar.tissue.models.equation_check import check_at_rest, check_equation
from lumbar.tissue.models.motion import OneMotion
from lumbar.tissue.models.parameter import POSITIONS, Constant, LinearParameter, NonlinearParameter


class Place(StrEnum):
    """Place of an effect on the path from position to force."""

    INPUT = "input"
    PARALLEL = "parallel"
    OUTPUT = "output"
    FRAME = "frame"
    """Place of a form that mixes the forces along several axes by a matrix."""


@dataclass(frozen=True)
class HandWritten:
    """Hand-written simulation and C code of a form that no equation expresses; the form's place decides which are needed."""

    columns: Callable[[Any, np.ndarray], list[np.ndarray]] = None  # type: ignore[assignment]
    """For parallel forms: function from motion and nonlinear parameters to a force per linear parameter, each (samples,)."""
    input_transform: Callable[[Any, np.ndarray], Any] = None  # type: ignore[assignment]
    """For input forms: function from motion and nonlinear parameters to the motion that reaches the tissue."""
    output_transform: Callable[[np.ndarray, Any, np.ndarray], np.ndarray] = None  # type: ignore[assignment]
    """For output forms: function from force, motion and nonlinear parameters to the measured force."""
    c_step: CStep | Callable[[], CStep | None] | None = None
    """C code of one sample, or a function that returns it; a form without it cannot be exported to a haptic device."""
    channels: tuple[str, ...] = ()
    """Roles of the additional channels that the simulation needs."""
    matrix: Callable[[np.ndarray], np.ndarray] | None = None
    """For forms at `FRAME`: function from nonlinear parameters to the matrix that multiplies the forces, (axes, axes)."""
    spatial: bool = False
    """True if the code is also valid for motions in space."""


@dataclass(frozen=True)
class Form:
    """One mathematical form of a mechanism; the equation is read and checked at its first use."""

    name: str
    """Name, unique within the effect, e.g. ``"cubic"``."""
    equation: str
    """Expression in the parameters' symbols and the signals of `lumbar.tissue.models.parameter`: the force that a parallel form
    adds, or the measured force that an output form returns for the force ``F``. LaTeX if `hand_written`."""
    place: Place
    """Place on the path from position to force; input forms are hand-written."""
    linear: tuple[LinearParameter, ...] = ()
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    """Symbol of each state and its rate of change per second."""
    start: tuple[tuple[str, str], ...] = ()
    """Symbol and start value of each state that does not start at 0: an expression in position and parameters."""
    constants: tuple[Constant, ...] = ()
    starts: Callable[[Any, np.ndarray], list[np.ndarray]] | None = None
    """Function from motion and residual force to starting nonlinear parameters, used instead of the grids."""
    solution: Solution | None = None
    """Function from motion and nonlinear parameters to the states in closed form, used instead of the solver."""
    c_solution: str = ""
    """C statements that write the states of the next sample, if the solver's step is less exact."""
    hand_written: HandWritten | None = None
    """Hand-written code that replaces the equation."""
    general: bool = False
    """True if other forms of the effect are special cases of this form; a search selects it only if their error is large."""
    one_axis: bool = False
    """True if the form has no equivalent in space."""
    essential: tuple[str, ...] = ()
    """Linear parameters that must not be 0 if the mechanism is present; by default any one suffices."""
    contradiction: Callable[[dict[str, float], Any, np.ndarray, float, float | None], str] | None = None
    """Function to a sentence on how a record contradicts the parameters (``""`` if it does not), from parameters by name,
    motion, measured force less the sensor's zero, RMS of the noise, and the excitation's period (s or None)."""
    effect: str = ""
    """Name of the form's effect; set by the effect."""
    definition: Mapping | None = field(default=None, compare=False, repr=False)
    """Content of the user's file of the effect; set by the effect."""
    axes: tuple[str, ...] = ()
    """Names of the axes along which the form acts in space; empty for one axis."""
    channel: str = ""
    """Axes of the channels that the form transforms in space, e.g. ``"y"`` or ``"xz"``; empty for all axes."""
    written: tuple[LinearParameter, ...] = ()
    """Linear parameters of the one-axis equation, if the form acts along several axes."""

    def to_space(self, axes: tuple[str, ...]) -> Self:
        """Return the form for motions along several axes.

        Parameters
        ----------
        axes : tuple of str
            Names of the axes.

        Raises
        ------
        InputError
            If the equation has no meaning in space.
        """
        if self.one_axis or (self.hand_written and not self.hand_written.spatial):
            raise InputError(f"{self.key} is defined along one axis only")
        form = replace(self, axes=axes, written=() if self.hand_written else self.linear)
        if form.hand_written:
            return form
        return replace(form, linear=form._unchecked.linear_in_space)  # type: ignore[attr-defined]  # it has axes

    def with_constants(self, values: Mapping[str, float]) -> Self:
        """Return the form with other values of its constants.

        Parameters
        ----------
        values : mapping of str to float
            Values by symbol, in the constants' units; other symbols are ignored.
        """
        given = {item for item in self.constants if values.get(item.symbol, item.value) != item.value}
        return replace(
            self,
            constants=tuple(
                replace(item, value=values[item.symbol], given=True) if item in given else item
                for item in self.constants
            ),
        )

    def check(self) -> None:
        """Raise all problems of the equation.

        Raises
        ------
        InputError
            If the equation uses undeclared symbols, is not proportional to the linear parameters, or has a value or a slope by
            position or velocity that is not finite at z = 0, v = 0.
        """
        problems = Problems(f"form {self.key.strip('/')}")
        for key, problem in self.problems():
            problems.add(key, problem)
        problems.raise_if_any()

    def problems(self) -> list[tuple[str, str]]:
        """Return the problems of the equation: the key of each, and a text on the fault and the allowed values."""
        if self.hand_written:
            return []
        if self.place is Place.INPUT:
            return [("place", "no equation transforms a motion; a form at the input is hand-written")]
        problems = check_equation(self._unchecked, bool(self.solution and self.c_solution))
        if not problems and not self.axes:
            at_rest = check_at_rest(self._unchecked)
            problems = [(key, f"form {self.name}: {problem}") for key, problem in at_rest]
        return problems

    @cached_property
    def key(self) -> str:
        """Name of effect and form, e.g. ``"hardening_stiffness/cubic"``."""
        return f"{self.effect}/{self.name}"

    @cached_property
    def memory_key(self) -> str:
        """Key of the form's forces in the cache of a motion: the form's key, and the given constants."""
        return " ".join([self.key, *(f"{item.symbol}={item.value}" for item in self.constants if item.given)])

    @cached_property
    def parsed_equation(self) -> Equation:
        """The equation, read and checked; a hand-written form has none."""
        assert not self.hand_written
        self.check()
        return self._unchecked

    @cached_property
    def _unchecked(self) -> Equation:
        fields: dict[str, Any] = {
            "text": self.equation,
            "transforms": self.place is Place.OUTPUT,
            "nonlinear": self.nonlinear,
            "constants": self.constants,
            "states": self.state,
            "starts": self.start,
        }
        if not self.axes:
            return Equation(**fields, linear=self.linear)
        from lumbar.tissue.models.spatial_equation import SpatialEquation

        return SpatialEquation(**fields, linear=self.written, axes=self.axes, channel=self.channel)

    @cached_property
    def latex(self) -> str:
        """The equation in LaTeX."""
        if self.hand_written:
            return self.equation
        return (r"F \to " if self.place is Place.OUTPUT else "") + self.parsed_equation.latex

    @property
    def text(self) -> str:
        """The equation in plain text, for terminals; the name of a hand-written form."""
        if self.hand_written:
            return self.name
        states = (f"d{name}/dt = {rate}" for name, rate in self.state)
        starts = (f"{name}(0) = {value}" for name, value in self.start)
        arrow = "F -> " if self.place is Place.OUTPUT else ""
        return ", ".join([arrow + self.equation, *states, *starts])

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Roles of the additional channels that the form needs; without them a search omits the form."""
        return self.hand_written.channels if self.hand_written else self.parsed_equation.channels

    @property
    def is_static(self) -> bool:
        """True if the form depends only on position and force: no rate, path, time, state or additional channel."""
        return not (self.hand_written or self.state) and self.parsed_equation.signals <= set(POSITIONS)

    @cached_property
    def c_step(self) -> CStep | None:
        """C code of one sample; None if the form cannot be exported to a haptic device."""
        if not self.hand_written:
            return self.parsed_equation.c_step(self.c_solution)
        written = self.hand_written.c_step
        return written() if callable(written) else written

    def columns(self, motion: OneMotion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Return the forces of a parallel form, one per linear parameter at size 1.

        They are in the force's unit per unit of the parameter, shape (samples,); in space (axes × samples,), axis by axis.

        Parameters
        ----------
        motion : OneMotion
            Motion that reaches the form.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Nonlinear parameters of the form.
        """
        if self.hand_written:
            return self.hand_written.columns(motion, nonlinear)
        return self.parsed_equation.forces(motion, nonlinear, self.solution)

    def input_transform(self, motion: OneMotion, nonlinear: np.ndarray) -> OneMotion:
        """Return the motion that reaches the tissue behind an input form.

        Parameters
        ----------
        motion : OneMotion
            Measured motion.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Nonlinear parameters of the form.
        """
        assert self.hand_written is not None  # no equation transforms a motion
        return self.hand_written.input_transform(motion, nonlinear)

    def output_transform(self, force: np.ndarray, motion: OneMotion, nonlinear: np.ndarray) -> np.ndarray:
        """Return the measured force of an output form, of the shape and unit of `force`.

        Parameters
        ----------
        force : numpy.ndarray, shape (samples,)
            Force at the tissue; in space one axis after the other, (axes × samples,).
        motion : OneMotion
            Measured motion.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Nonlinear parameters of the form.
        """
        if self.hand_written:
            return self.hand_written.output_transform(force, motion, nonlinear)
        return self.parsed_equation.forces(motion, nonlinear, self.solution, force)[0]


def _join_channels(form: Form, single: Sequence[Form]) -> Form:
    """Return the form with separate parameters for several channels; each of the forms `single` transforms one channel."""
    channels = "".join(one.channel for one in single)

    def transform(force: np.ndarray, motion: OneMotion, values: np.ndarray) -> np.ndarray:
        for one, parameters in zip(single, values.reshape(len(single), -1), strict=True):
            force = one.output_transform(force, motion, parameters)
        return force

    def c_step() -> CStep | None:
        step = form.c_step
        if step is None or not isinstance(step.value, str) or step.statements:
            return None
        values = [f"force[{row}]" for row in range(len(form.axes))]
        for axis in channels:
            row = form.axes.index(axis)
            values[row] = re.sub(r"\bforce\b", values[row], step.value)
            for item in form.nonlinear:
                values[row] = re.sub(rf"\b{item.name}\b", f"{item.name}_{axis}", values[row])
        return CStep(tuple(values))

    return replace(
        form,
        name=f"{form.name}_{channels}",
        channel=channels,
        general=True,
        equation=form.latex,
        nonlinear=tuple(
            replace(item, name=f"{item.name}_{axis}", symbol=f"{item.symbol}_{axis}", points=_CHANNEL_POINTS)
            for axis in channels
            for item in form.nonlinear
        ),
        hand_written=HandWritten(output_transform=transform, c_step=c_step, spatial=True),
    )


_CHANNEL_POINTS = 3  # starting values of a parameter that every channel has


@dataclass(frozen=True)
class Effect:
    """A physical mechanism."""

    name: str
    """Name, e.g. ``"coulomb_friction"``."""
    mechanism: str
    """Description of the mechanism in one sentence, for reports."""
    forms: tuple[Form, ...]
    """Forms of the mechanism, the simplest first."""
    source: str
    """Reference to the literature, or the user's file."""
    experiment: str = ""
    """Excitation that shows the effect best; reports name it if effects are tied."""
    sensors: str = ""
    """Part of the measuring chain that looks the same in the records, in one sentence."""
    accumulates: bool = False
    """True if the effect grows with time or path from the start of a record, so that short records hardly show it."""
    unrepeated: bool = False
    """True if the effect has its own clock, independent of the excitation."""
    linear: bool = False
    """True if a linear time-invariant model stays linear and time-invariant with the effect."""
    rate_independent: bool = False
    """True if the force depends on the path travelled, not on the speed."""
    rival: bool = False
    """True if the effect is never searched for, only compared with similar selected effects."""
    definition: Mapping | None = field(default=None, compare=False, repr=False)
    """Content of the user's file with the effect, stored in files of models; None for effects of the catalogue."""

    def to_space(self, axes: tuple[str, ...]) -> tuple[Self | None, dict[str, str]]:
        """Return the effect in space (None without usable forms), and the reasons why forms are unusable, by key.

        Parameters
        ----------
        axes : tuple of str
            Names of the axes.
        """
        forms, reasons = [], {}
        for form in self.forms:
            try:
                forms.append(read := form.to_space(axes))
                if form is self.forms[0] and form.place is Place.OUTPUT:
                    # One channel of a sensor may be at its limit while the others are not, or several, each at its own.
                    single = [replace(read, name=f"{form.name}_{axis}", channel=axis) for axis in axes]
                    groups = (combinations(single, count) for count in range(2, len(axes) + 1))
                    forms += [*single, *(_join_channels(read, some) for group in groups for some in group)]
            except InputError as error:
                reasons[form.key] = str(error)
        return (self.with_forms(forms) if forms else None), reasons

    def with_forms(self, forms: Iterable[Form]) -> Self:
        """Return the effect with other forms.

        Parameters
        ----------
        forms : iterable of Form
            At least one.
        """
        return replace(self, forms=tuple(forms))

    @property
    def changes(self) -> bool:
        """True if the effect makes the periods of an excitation differ."""
        return self.accumulates or self.unrepeated

    def __post_init__(self):
        named = {"effect": self.name, "definition": self.definition}
        object.__setattr__(self, "forms", tuple(replace(form, **named) for form in self.forms))
