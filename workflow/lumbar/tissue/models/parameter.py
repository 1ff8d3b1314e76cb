"""Symbols of equations: parameters that a fit determines, constants, and signals of the motion."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import scipy

from lumbar.tissue.models.printing import symbol_latex

Scale = Literal["position", "speed", "path", "duration", "force", "time", "rate", "sampling", "one"]
"""Quantities that set the size of a nonlinear parameter."""


_TIME_SHARE = 0.2  # of sampling interval and duration, for the bounds of a time constant


@dataclass(frozen=True)
class Parameter:
    """A fitted quantity of an equation."""

    name: str
    """Name, e.g. ``"coulomb_force"``."""
    unit: str
    """Unit in terms of the output's unit ``{y}`` and the input's ``{x}``, e.g. ``"{y}/{x}^3"``."""
    symbol: str = field(default="", kw_only=True)
    """Symbol in equations, e.g. ``"Fc"``."""
    latex: str = field(default="", kw_only=True)
    """Symbol in LaTeX; by default derived from `symbol`, e.g. ``F_c``."""

    @property
    def latex_symbol(self) -> str:
        """The symbol as LaTeX."""
        return self.latex or symbol_latex(self.symbol)


@dataclass(frozen=True)
class LinearParameter(Parameter):
    """A parameter to which the force is proportional."""

    sign: int = 1
    """Allowed sign: 1 not negative, -1 not positive, 0 any."""


@dataclass(frozen=True)
class NonlinearParameter(Parameter):
    """A positive parameter on which the force depends, but not proportionally."""

    scale: Scale
    """Quantity of the record that is the unit of `low` and `high`: ``position`` (half range), ``speed``, ``path``,
    ``duration``, ``force`` (maximum of the record), ``time`` (geometric mean of sampling interval and duration), ``rate``
    (1/time), ``sampling`` (interval), ``one``."""
    low: float
    """Lower end of the range of starting values, in units of `scale`."""
    high: float
    """Upper end of the range of starting values, in units of `scale`."""
    points: int
    """Number of starting values, spaced evenly in the logarithm."""
    reach: tuple[float, float] = (0.1, 10.0)
    """Bounds of the fit, as factors of the ends of the range."""
    lines: float | None = None
    """Largest distance of a fitted frequency from its start, in lines (1/duration); None for no limit."""
    follows_record: bool = field(default=False, kw_only=True)
    """True for a time constant with starting values from two sampling intervals (or less), and with bounds from a fifth of the
    interval to a fifth of the record's duration."""
    signed: bool = field(default=False, kw_only=True)
    """True if the parameter may have either sign, like angles and couplings; a fit then searches the exponential."""
    decisive: bool = field(default=False, kw_only=True)
    """True if a value at an end of the range means that the mechanism is absent or different."""

    def decode(self, number: float) -> float:
        """Return the parameter's value from the number that a fit searches.

        Parameters
        ----------
        number : float
            Number above 0: the exponential of the value if `signed`, else the value.
        """
        return float(np.log(number)) if self.signed else number

    def encode(self, value: float) -> float:
        """Return the number that a fit searches from the parameter's value.

        Parameters
        ----------
        value : float
            Value in the parameter's unit.
        """
        return float(np.exp(value)) if self.signed else value

    def grid(self, size: float, sampling_time: float | None = None) -> np.ndarray:
        """Return at least `points` starting values that a fit searches, in increasing order.

        Parameters
        ----------
        size : float
            Size of its `scale` in the records.
        sampling_time : float, optional
            Sampling time of the records in seconds, if time constants follow the record.
        """
        low, points = self.low * size, self.points
        if self.follows_record and sampling_time and 2 * sampling_time < low:
            # Extend the range with the density of its own values.
            spacing = np.log(self.high / self.low) / max(self.points - 1, 1)
            points += int(np.ceil(np.log(low / (2 * sampling_time)) / spacing))
            low = 2 * sampling_time
        return np.geomspace(low, self.high * size, points)

    def bounds(
        self, size: float, sampling_time: float | None = None, duration: float | None = None
    ) -> tuple[float, float]:
        """Return the bounds of the fit, lower and upper.

        Parameters
        ----------
        size : float
            Size of its `scale` in the records.
        sampling_time, duration : float, optional
            Sampling time and duration of the records in seconds, if time constants follow the record.
        """
        low, high = self.low * self.reach[0] * size, self.high * self.reach[1] * size
        if self.follows_record and sampling_time and duration:
            low, high = min(low, _TIME_SHARE * sampling_time), max(high, _TIME_SHARE * duration)
        return low, high


@dataclass(frozen=True)
class Constant:
    """A number with a symbol in an equation."""

    symbol: str
    value: float
    unit: str
    latex: str = ""
    scale: str = ""
    """Quantity of the record that is the constant's unit in a fit, see `NonlinearParameter`; empty for a fixed value. In
    another unit the force of a power law at 1 could be far from every motion and undetermined."""
    given: bool = False
    """True if the value replaces the catalogue's value; files of models then contain it."""

    @property
    def latex_symbol(self) -> str:
        """The symbol as LaTeX."""
        return self.latex or symbol_latex(self.symbol)

    @property
    def latex_unit(self) -> str:
        """The unit as LaTeX, with ``unit`` for the units of input and output."""
        unit = "unit" if self.unit in ("{x}", "{y}") else self.unit
        return unit.format(x="unit", y="unit").replace(" ", r"\,")


@dataclass(frozen=True)
class MotionSignal:
    """A quantity of a motion with a symbol in equations."""

    meaning: str
    """Meaning of the signal, for reports and messages."""
    of: Callable[[Any], np.ndarray]
    """Function from a motion to the signal, shape (samples,)."""
    c_name: str = ""
    """Name in the C code of a form; empty if a running loop does not know the signal."""
    latex: str = ""
    """Symbol in LaTeX; empty if it equals the symbol in equations."""
    channel: str = ""
    """Role of the additional channel that the signal needs; empty if none."""


def _channel(role: str, latex: str, meaning: str) -> MotionSignal:
    return MotionSignal(meaning, lambda motion: motion.channels[role], latex=latex, channel=role)


FORCE = "F"
"""Symbol of the force that an output form transforms."""
SIGNALS = {
    "z": MotionSignal("position", lambda motion: motion.position, "position"),
    "v": MotionSignal("velocity", lambda motion: motion.velocity, "velocity"),
    "a": MotionSignal("acceleration", lambda motion: motion.acceleration, "acceleration"),
    "dz": MotionSignal(
        "change of position since the sample before", lambda motion: motion.increments, "step", r"\Delta z"
    ),
    "s": MotionSignal("path travelled", lambda motion: motion.path, "path"),
    "t": MotionSignal("time since the record's start", lambda motion: motion.time, "time"),
    "theta": MotionSignal("angle from the vertical", lambda motion: motion.position, "position", r"\theta"),
    "theta_dot": MotionSignal("angular velocity", lambda motion: motion.velocity, "velocity", r"\dot \theta"),
    "theta_ddot": MotionSignal(
        "angular acceleration", lambda motion: motion.acceleration, "acceleration", r"\ddot \theta"
    ),
    "box_held": _channel("box_held", "h", "share of the box that the hands carry"),
    "length": _channel("length", r"\ell", "distance from the pivot to the centre of mass"),
    "length_dot": MotionSignal(
        "rate of the length",  # by a quintic spline, as for the position
        lambda motion: scipy.interpolate.make_interp_spline(motion.time, motion.channels["length"], k=5)(
            motion.time, 1
        ),
        latex=r"\dot \ell",
        channel="length",
    ),
    "pivot_acceleration_x": _channel("pivot_acceleration_x", r"\ddot x_p", "the pivot's to the front"),
    "pivot_acceleration_z": _channel("pivot_acceleration_z", r"\ddot z_p", "the pivot's upwards"),
}
"""Signals by symbol; the position of a pendulum is its angle."""
AXES = ("x", "y", "z")
"""Names of axes in space."""
VECTORS = ("z", "v", "a", "dz")
"""Signals with a component along every axis in space, e.g. ``z_x``."""


def _along(axis: str, signal: MotionSignal) -> MotionSignal:
    latex = signal.latex or {"position": "z", "velocity": "v", "acceleration": "a"}[signal.c_name]
    return MotionSignal(
        f"{signal.meaning} along {axis}",
        lambda motion: signal.of(motion.along(axis)),
        f"{signal.c_name}_{axis}",
        f"{latex}_{axis}",
        f"axis {axis}",
    )


SIGNALS |= {f"{name}_{axis}": _along(axis, SIGNALS[name]) for name in VECTORS for axis in AXES}
POSITIONS = ("z", "theta", *(f"z_{axis}" for axis in AXES))
"""Symbols of the position."""
NEVER_NEGATIVE = {"s", "t"}
STEADY = {"v", "dz", "theta_dot", *(f"{name}_{axis}" for name in ("v", "dz") for axis in AXES)}
"""Signals that are constant between two samples of a position that is linear between samples."""
LINEAR = {*POSITIONS, "s", "t"}
"""Signals that are linear in time between two samples of such a position."""
