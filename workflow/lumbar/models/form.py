"""What an effect is: a mechanism with one or more mathematical forms.

A model's force is composed in this order::

    motion --(input forms: delay, play)--> motion' --> base force + parallel forms' forces --(output forms)--> force

A parallel form contributes a sum of *linear parameters* times *columns*, so that they can be solved for directly (separable
least squares); what enters otherwise is a *nonlinear parameter*, positive, searched over decades. Input and output forms have
nonlinear parameters only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from lumbar.models.c_step import CStep
from lumbar.models.motion import Motion


class Place(StrEnum):
    """Where an effect acts on the way from position to force."""

    INPUT = "input"
    PARALLEL = "parallel"
    OUTPUT = "output"


@dataclass(frozen=True)
class LinearParameter:
    """A parameter the force is proportional to.

    Attributes
    ----------
    name : str
        E.g. ``"coulomb_force"``.
    unit : str
        In terms of the output's unit ``{y}`` and the input's ``{x}``, e.g. ``"{y}/{x}^3"``.
    sign : int
        1: not negative, -1: not positive, 0: any.
    """

    name: str
    unit: str
    sign: int = 1


@dataclass(frozen=True)
class NonlinearParameter:
    """A positive parameter the force depends on otherwise.

    Attributes
    ----------
    name, unit : str
        As for `LinearParameter`.
    scale : str
        Quantity that sets its size: ``position`` (half range), ``speed``, ``path``, ``duration``, ``force`` (largest
        of the record), ``time`` (1 s), ``sampling`` (interval), ``one``.
    low, high : float
        Range in which starting values are looked for, in that scale.
    points : int
        Number of starting values, spaced evenly in the logarithm.
    reach : tuple of float
        How far below and above the range the fit may go, as factors.
    lines : float or None
        For frequencies: the fit stays within this many lines (1/duration) of its start.
    """

    name: str
    unit: str
    scale: str
    low: float
    high: float
    points: int
    reach: tuple[float, float] = (0.1, 10.0)
    lines: float | None = None

    def grid(self, size: float) -> np.ndarray:
        """Return the starting values for a scale of this size."""
        return size * np.geomspace(self.low, self.high, self.points)

    def bounds(self, size: float) -> tuple[float, float]:
        """Return the bounds of the fit for a scale of this size."""
        return self.low * self.reach[0] * size, self.high * self.reach[1] * size


Columns = Callable[[Motion, np.ndarray], list[np.ndarray]]
InputTransform = Callable[[Motion, np.ndarray], Motion]
OutputTransform = Callable[[np.ndarray, Motion, np.ndarray], np.ndarray]
Starts = Callable[[Motion, np.ndarray], list[np.ndarray]]


@dataclass(frozen=True)
class Form:
    """One mathematical form of a mechanism.

    Attributes
    ----------
    name : str
        Unique within its effect, e.g. ``"cubic"``.
    equation : str
        LaTeX; what the form contributes or does.
    place : Place
    linear, nonlinear : tuple
        Parameters in the order in which `columns` and the transforms take them.
    columns : callable, optional
        Parallel forms: from motion and nonlinear parameters to one force per linear parameter, each of shape (samples,).
    input_transform, output_transform : callable, optional
        Input forms: from motion and nonlinear parameters to the motion the tissue sees. Output forms: from force, motion and
        nonlinear parameters to the measured force.
    starts : callable, optional
        Starting nonlinear parameters from the motion and the residual force, instead of the nonlinear parameters' grids.
    channels : tuple of str
        Roles of channels beside input and output that the form needs; without them it is left out of a search.
    c_step : CStep, optional
        The same in C, sample by sample; a form without it cannot be exported to a haptic device.
    """

    name: str
    equation: str
    place: Place
    linear: tuple[LinearParameter, ...] = ()
    nonlinear: tuple[NonlinearParameter, ...] = ()
    columns: Columns | None = None
    input_transform: InputTransform | None = None
    output_transform: OutputTransform | None = None
    starts: Starts | None = None
    c_step: CStep | None = None
    channels: tuple[str, ...] = ()
    effect: str = field(default="", compare=True)

    @property
    def key(self) -> str:
        """Name of effect and form, e.g. ``"hardening_stiffness/cubic"``."""
        return f"{self.effect}/{self.name}"


@dataclass(frozen=True)
class Effect:
    """A physical mechanism.

    Attributes
    ----------
    name : str
        E.g. ``"coulomb_friction"``.
    mechanism : str
        One sentence for the reader of a report.
    forms : tuple of Form
        Variants, the simplest first.
    source : str
        Reference.
    experiment : str
        Which excitation shows it best, for ties.
    accumulates : bool
        Whether it grows with time or path from each record's start, so that short records hardly show it.
    """

    name: str
    mechanism: str
    forms: tuple[Form, ...]
    source: str
    experiment: str = ""
    accumulates: bool = False

    def __post_init__(self):
        named = tuple(
            form if form.effect == self.name else Form(**{**form.__dict__, "effect": self.name})
            for form in self.forms
        )
        object.__setattr__(self, "forms", named)
