"""The signature of an effect: its form simulated on a standard motion together with a standard base."""

from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

STANDARDS = {
    "tissue": ("KB", np.array([1.0, 1.0]), np.array([0.1])),
    "pendulum": ("pendulum", np.array([0.05, 0.1, 1.0]), np.zeros(0)),
}
"""Base with linear and nonlinear parameters for the pictures, by system; in arbitrary units."""
SHARE = 0.3
"""RMS of the force that a pictured effect adds, relative to the RMS of the base's force."""
RATES = (0.5, 2.0)
"""Frequencies of the standard motion, Hz."""
AXES = {"tissue": ("Position", "force"), "pendulum": ("Angle", "moment")}
"""Names of input and output by system."""
_SAMPLING_TIME = 0.01
_DURATION = 12.0
_MAX_CORNERS = 32  # of the box of nonlinear parameters, at which an equation is tried
_FREQUENCY_HZ = 0.5  # of the standard motion on which an equation must stay finite


@dataclass(frozen=True, eq=False)
class Signature:
    """Forces of one form on one motion."""

    rate: float
    """Frequency of the motion, Hz."""
    motion: Motion
    """Motion: a sine of amplitude 1 that grows from rest over its first cycle."""
    base: np.ndarray
    """Force of the base, shape (samples,)."""
    force: np.ndarray
    """Force with the effect, shape (samples,)."""

    @property
    def added_force(self) -> np.ndarray:
        """Force that the effect adds."""
        return self.force - self.base

    @property
    def last_cycle(self) -> slice:
        """Slice of the samples in the motion's last cycle, including its end."""
        return slice(-1 - round(1 / (self.rate * self.motion.sampling_time)), None)


def standard_motion(frequency: float) -> Motion:
    """Return a sine of amplitude 1 that grows from rest over its first cycle."""
    time = _SAMPLING_TIME * np.arange(round(_DURATION / _SAMPLING_TIME))
    size = np.minimum(time * frequency, 1.0)
    return Motion(time, size * np.sin(2 * np.pi * frequency * time), _SAMPLING_TIME)


def pictured_form(effect: Effect) -> Form | None:
    """Return the first form of an effect that needs no additional channels, or None."""
    return next((form for form in effect.forms if not form.channels), None)


def signatures(effect: Effect, form: Form | None = None, system: str = "tissue") -> list[Signature]:
    """Simulate an effect at the standard rates, by default in its first form without additional channels.

    Nonlinear parameters are in the middle of their starting range. Linear parameters are so large that the effect adds `SHARE`
    of the base's RMS at the lower rate; forms without linear parameters use the nearest starting value.
    """
    form, (name, linear, shapes) = form or pictured_form(effect), STANDARDS[system]
    bare = Structure(BASES[name])
    structure = bare.with_form(form)
    motions = [standard_motion(frequency) for frequency in RATES]
    bases = [bare.simulate(motion, linear, shapes) for motion in motions]
    motion, base, target = motions[0], bases[0], SHARE * _rms(bases[0])

    def scale(kind: str) -> float:
        return float(np.abs(base).max()) if kind == "force" else motion.scale(kind)

    if form.place is Place.PARALLEL:
        middle = np.array([np.sqrt(item.low * item.high) * scale(item.scale) for item in form.nonlinear])
        nonlinear = np.concatenate([shapes, middle])
        columns = np.array(form.columns(motion, middle)).T
        signs = np.array([item.sign or 1 for item in form.linear], dtype=float)
        sizes = signs / np.maximum([_rms(column) for column in columns.T], 1e-300)
        linear = np.concatenate([linear, target / _rms(columns @ sizes) * sizes])
    else:
        points = product(*(item.grid(scale(item.scale)) for item in form.nonlinear))
        candidates = [np.array([*shapes, *point]) for point in points]
        nonlinear = min(
            candidates, key=lambda item: abs(_rms(structure.simulate(motion, linear, item) - base) - target)
        )
    return [
        Signature(rate, motion, base, structure.simulate(motion, linear, nonlinear))
        for rate, motion, base in zip(RATES, motions, bases, strict=True)
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def numerical_problems(form: Form) -> list[tuple[str, str]]:
    """Return values of a form that are not finite on a standard motion, and parameters without influence on it."""
    if form.channels:
        return []
    motion = standard_motion(_FREQUENCY_HZ)
    # A constant in units of the input may limit the range in which a parameter acts, which the sine may not reach.
    has_range = any("{x}" in constant.unit for constant in form.constants)
    ends = [item.grid(1.0)[[0, -1]] for item in form.nonlinear]
    for point in islice(product(*ends), _MAX_CORNERS):
        nonlinear = np.array(point)
        with np.errstate(all="ignore"):
            if form.place is Place.OUTPUT:
                columns = [form.output_transform(2 * motion.position, motion, nonlinear)]
            else:
                columns = form.columns(motion, nonlinear)
        for values, item in zip(columns, form.linear or (None,), strict=True):
            wrong = np.flatnonzero(~np.isfinite(values))
            if len(wrong):
                at = motion.time[wrong[0]], motion.position[wrong[0]], motion.velocity[wrong[0]]
                problem = "is {} at t = {:.3g}, z = {:.3g}, v = {:.3g}".format(values[wrong[0]], *at)
                named = zip(form.nonlinear, point, strict=True)
                problem = ", ".join([problem, *(f"{item.name} = {value:g}" for item, value in named)])
                return [(problem, "it must be finite for every position and velocity")]
            if item and not values.any() and not has_range:
                return [(f"{item.name} has no influence on a sine of amplitude 1", "it must have one")]
    return []
