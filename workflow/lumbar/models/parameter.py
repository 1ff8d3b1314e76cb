"""Parameters of equations: what a force is proportional to, what it depends on otherwise, and constants."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lumbar.models.printing import symbol_latex

SCALES = ("position", "speed", "path", "duration", "force", "time", "sampling", "one")
"""Quantities that set the size of a nonlinear parameter."""


@dataclass(frozen=True)
class Parameter:
    """A quantity of an equation that a fit finds.

    Attributes
    ----------
    name : str
        E.g. ``"coulomb_force"``.
    unit : str
        In terms of the output's unit ``{y}`` and the input's ``{x}``, e.g. ``"{y}/{x}^3"``.
    symbol : str
        How equations call it, e.g. ``"Fc"``.
    latex : str
        Its LaTeX; without, it follows from the symbol: ``F_c``.
    """

    name: str
    unit: str
    symbol: str = field(default="", kw_only=True)
    latex: str = field(default="", kw_only=True)

    @property
    def in_latex(self) -> str:
        """The symbol as LaTeX."""
        return self.latex or symbol_latex(self.symbol)


@dataclass(frozen=True)
class LinearParameter(Parameter):
    """A parameter the force is proportional to.

    Attributes
    ----------
    name, unit, symbol, latex : str
        As for `Parameter`.
    sign : int
        1: not negative, -1: not positive, 0: any.
    """

    sign: int = 1


@dataclass(frozen=True)
class NonlinearParameter(Parameter):
    """A positive parameter the force depends on otherwise.

    Attributes
    ----------
    name, unit, symbol, latex : str
        As for `Parameter`.
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


@dataclass(frozen=True)
class Constant:
    """A number that an equation calls by a symbol.

    Attributes
    ----------
    symbol, unit, latex : str
        As for `Parameter`.
    value : float
    """

    symbol: str
    value: float
    unit: str
    latex: str = ""

    @property
    def in_latex(self) -> str:
        """The symbol as LaTeX."""
        return self.latex or symbol_latex(self.symbol)

    @property
    def latex_unit(self) -> str:
        """The unit as LaTeX; the input's and the output's own are called unit."""
        unit = "unit" if self.unit in ("{x}", "{y}") else self.unit
        return unit.format(x="unit", y="unit").replace(" ", r"\,")
