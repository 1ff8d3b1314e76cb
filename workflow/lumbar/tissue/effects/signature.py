"""The signature of an effect's force: its form simulated on a standard motion together with a standard base."""

from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Effect, Form, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure


@dataclass(frozen=True)
class Standard:
    """A base with the parameters of its picture, in arbitrary units."""

    base: str
    linear: tuple[float, ...]
    nonlinear: tuple[float, ...]


STANDARDS = {
    "tissue": Standard("KB", (1.0, 1.0), (0.1,)),
    "pendulum": Standard("pendulum", (0.05, 0.1, 1.0), ()),
}
"""Base of the pictures by system."""
SHARE = 0.3
"""RMS of the force that a pictured effect adds, as a share of the tissue's own."""
RATES = (0.5, 2.0)
"""Frequencies of the standard motion, Hz."""
AXES = {"tissue": ("Position", "force"), "pendulum": ("Angle", "moment")}
"""By system: what is moved, and what answers."""
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
    """A sine of amplitude 1 whose size grows over the first cycle."""
    base: np.ndarray
    """Shape (samples,): force of the tissue alone."""
    force: np.ndarray
    """Shape (samples,): with the effect."""

    @property
    def added_force(self) -> np.ndarray:
        """Force that the effect adds."""
        return self.force - self.base

    @property
    def last_cycle(self) -> slice:
        """Samples of the motion's last cycle, its end included."""
        return slice(-1 - round(1 / (self.rate * self.motion.sampling_time)), None)


def standard_motion(frequency: float) -> Motion:
    """Sine of amplitude 1 that grows from rest over its first cycle."""
    time = _SAMPLING_TIME * np.arange(round(_DURATION / _SAMPLING_TIME))
    size = np.minimum(time * frequency, 1.0)
    return Motion(time, size * np.sin(2 * np.pi * frequency * time), _SAMPLING_TIME)


def pictured_form(effect: Effect) -> Form | None:
    """First form of an effect that the standard motion can show; None where all need further channels."""
    return next((form for form in effect.forms if not form.channels), None)


def signatures(effect: Effect, form: Form | None = None, system: str = "tissue") -> list[Signature]:
    """Simulate an effect, by default in its first form that needs no further channel, at the standard rates.

    Nonlinear parameters are taken from the middle of their starting range, linear ones so that the effect adds `SHARE`
    of the base's RMS at the lower rate; of forms without linear parameters the starting value that comes
    nearest to it is taken.
    """
    form, standard = form or pictured_form(effect), STANDARDS[system]
    bare = Structure(BASES[standard.base])
    structure = bare.with_form(form)
    motions = [standard_motion(frequency) for frequency in RATES]
    own = np.array(standard.linear), np.array(standard.nonlinear)
    bases = [bare.simulate(motion, *own) for motion in motions]
    linear, nonlinear = _pictured(structure, form, standard, motions[0], bases[0])
    return [
        Signature(rate, motion, base, structure.simulate(motion, linear, nonlinear))
        for rate, motion, base in zip(RATES, motions, bases, strict=True)
    ]


def _pictured(
    structure: Structure, form: Form, standard: Standard, motion: Motion, base: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Linear and nonlinear parameters of the picture."""
    wanted = SHARE * _rms(base)
    if form.place is Place.PARALLEL:
        middle = [
            np.sqrt(shape.low * shape.high) * _scale(shape.scale, motion, base) for shape in form.nonlinear
        ]
        nonlinear = np.concatenate([standard.nonlinear, middle])
        directions = np.array([linear_parameter.sign or 1 for linear_parameter in form.linear], dtype=float)
        columns = np.array(form.columns(motion, np.array(middle))).T
        sizes = directions / np.maximum([_rms(column) for column in columns.T], 1e-300)
        scale = wanted / _rms(columns @ sizes)
        return np.concatenate([standard.linear, scale * sizes]), nonlinear
    best = None
    for point in product(*(shape.grid(_scale(shape.scale, motion, base)) for shape in form.nonlinear)):
        nonlinear = np.array([*standard.nonlinear, *point])
        force = structure.simulate(motion, np.array(standard.linear), nonlinear)
        distance = abs(_rms(force - base) - wanted)
        if best is None or distance < best[0]:
            best = (distance, nonlinear)
    return np.array(standard.linear), best[1]


def _scale(kind: str, motion: Motion, base: np.ndarray) -> float:
    return float(np.abs(base).max()) if kind == "force" else motion.scale(kind)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def numerical_problems(form: Form) -> list[tuple[str, str]]:
    """Numbers that are not finite on a standard motion, and parameters that do nothing there."""
    if form.channels:
        return []
    motion = standard_motion(_FREQUENCY_HZ)
    # such a constant says where a parameter acts, which may be nowhere within the sine
    may_lie_beyond = any("{x}" in constant.unit for constant in form.constants)
    force = 2 * motion.position
    ends = [item.grid(1.0)[[0, -1]] for item in form.nonlinear]
    for point in islice(product(*ends), _MAX_CORNERS):
        nonlinear = np.array(point)
        with np.errstate(all="ignore"):
            if form.place is Place.OUTPUT:
                found = [form.output_transform(force, motion, nonlinear)]
            else:
                found = form.columns(motion, nonlinear)
        for values, item in zip(found, form.linear or (None,), strict=True):
            wrong = np.flatnonzero(~np.isfinite(values))
            given = ", ".join(
                f"{item.name} = {value:g}" for item, value in zip(form.nonlinear, point, strict=True)
            )
            if len(wrong):
                at = motion.time[wrong[0]], motion.position[wrong[0]], motion.velocity[wrong[0]]
                said = "is {} at t = {:.3g}, z = {:.3g}, v = {:.3g}".format(values[wrong[0]], *at)
                said += f", {given}" if given else ""
                return [(said, "it must be finite for every position and velocity")]
            if item and not values.any() and not may_lie_beyond:
                return [(f"{item.name} has no influence on a sine of amplitude 1", "it must have one")]
    return []
