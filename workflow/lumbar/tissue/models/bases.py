"""Base models that effects are added to: linear in all parameters but their time constants."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.form import Form, HandWritten, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.motion import SUBSTEPS, Motion
from lumbar.tissue.models.operators import relaxation, surface_of_branch, surface_of_dashpot

_RESPONSES = {"tissue": "F", "pendulum": "M"}  # symbol of the response of a base of each system


@dataclass(frozen=True)
class Base:
    """A base model."""

    form: Form
    """Equation of the whole force; the form has the thesis's name, e.g. ``"KB"``."""
    system: str = "tissue"
    """``tissue`` or ``pendulum``: the catalogue of effects depends on it."""
    sensor_zero: bool = True
    """True if the sensor of the response has an unknown zero, so that every fit has a constant. A pendulum's moment is computed;
    a constant in it would be physical."""
    touching: Callable[[Any, np.ndarray], np.ndarray] | None = None
    """Function from motion and nonlinear parameters to contact at every sample (bool, shape (samples,)), for a free tool, which
    meets the tissue at position 0 and never pulls. Effects add force only in contact."""
    definition: Mapping | None = field(default=None, compare=False, repr=False)
    """Content of the file of a user-defined base."""
    spatial: Any = None
    """Base in space, a `lumbar.tissue.models.space.SpatialBase` or `PlaneContact`; None along one axis."""

    @property
    def name(self) -> str:
        """Name of the base's form."""
        return self.form.name

    @property
    def linear(self) -> tuple[LinearParameter, ...]:
        """Parameters to which the force is proportional."""
        return self.form.linear

    @property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """Parameters on which the force depends otherwise."""
        return self.form.nonlinear

    @cached_property
    def memory_key(self) -> Hashable:
        """Key of the base's forces in the cache of a motion."""
        return self.name if self.spatial is None else (self.name, self.spatial)

    @property
    def contact(self) -> bool:
        """True for a free tool, which is not fastened to the tissue."""
        return self.touching is not None

    @property
    def is_quasi_linear(self) -> bool:
        """True for a nonlinear elastic response times a reduced relaxation (`QUASI_LINEAR`)."""
        return self.name in QUASI_LINEAR

    @property
    def is_user_defined(self) -> bool:
        """True if the base is user-defined, from any input to any response."""
        return self.definition is not None

    @property
    def text(self) -> str:
        """The equation in plain text."""
        return f"{'y' if self.is_user_defined else _RESPONSES[self.system]} = {self.form.text}"

    @property
    def latex(self) -> str:
        """The equation in LaTeX."""
        return f"{'y' if self.is_user_defined else _RESPONSES[self.system]} = {self.form.latex}"


def elongation(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the elongation of each Maxwell branch's spring in the unit of the position, shape (samples,).

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    nonlinear : numpy.ndarray, shape (branches,)
        Relaxation times in seconds.
    """
    return tuple(relaxation(motion, time) for time in nonlinear)


_MIN_CORNER_RATIO = 6.0
"""Smallest ratio of the largest second difference of a position to their RMS if it has corners, e.g. ramps and holds."""


def _exponential(motion: Motion, length: float) -> Motion:
    """Return a motion with the position z replaced by Fung's exponential, sign(z)(e^(|z|/length) − 1).

    A position with corners is linear between samples. The motion's spline slows down before it rests: the exponential enlarges
    this.
    """

    def respond(position: np.ndarray) -> np.ndarray:
        return np.sign(position) * np.expm1(np.abs(position) / length)

    def compute() -> Motion:
        between = motion.between
        if motion.smooth:
            bends = np.abs(np.diff(motion.position, 2))
            if bends.max(initial=0) <= _MIN_CORNER_RATIO * np.sqrt(np.mean(bends**2)):
                between = motion.finer.position
            else:
                samples = np.arange(len(motion))
                finer = np.arange(1 + (len(motion) - 1) * SUBSTEPS) / SUBSTEPS
                between = np.interp(finer, samples, motion.position)
        response = respond(motion.position)
        return motion.replace_position(response, None if between is None else respond(between))

    return motion.cache.compute_at("Fung's exponential", np.array([length]), compute)


def _quasi_linear(times: Callable[[np.ndarray], Sequence[float]], c_times: Sequence[str]) -> dict[str, Any]:
    """Return the states of a quasi-linear base in closed form, in Python and C.

    They are exact for an elastic response that is linear between samples.

    Parameters
    ----------
    times : callable
        Function from the nonlinear parameters after the length to the relaxation times in seconds.
    c_times : sequence of str
        The relaxation times in C.
    """

    def solution(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, ...]:
        response = _exponential(motion, nonlinear[0])
        return tuple(relaxation(response, time) for time in times(nonlinear[1:]))

    lines = [
        "const double before = position - step;",
        "const double increment = sign(position) * portable_expm1(fabs(position) / hardening_length)",
        "    - sign(before) * portable_expm1(fabs(before) / hardening_length);",
    ]
    for row, time in enumerate(c_times):
        decay = f"-sampling_time / ({time})"
        lines.append(
            f"next[{row}] = (1.0 + portable_expm1({decay})) * memory[{row}] + phi1({decay}) * increment;"
        )
    return {"solution": solution, "c_solution": "\n".join(lines)}


def _branch_contact(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force of KB in contact divided by its spring stiffness, and True while the tool touches the tissue."""
    ratio, time_constant = nonlinear

    def compute() -> tuple[np.ndarray, np.ndarray]:
        dashpot, touching = surface_of_branch(motion, 1.0 / (1.0 + ratio), time_constant)
        return touching * ((1.0 + ratio) * motion.position - ratio * dashpot), touching

    return motion.cache.compute_at("branch in contact", nonlinear, compute)


def _dashpot_contact(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force of KV in contact divided by its spring stiffness, and True while the tool touches the tissue."""

    def compute() -> tuple[np.ndarray, np.ndarray]:
        surface, touching = surface_of_dashpot(motion, nonlinear[0])
        return touching * (surface + nonlinear[0] * motion.velocity), touching

    return motion.cache.compute_at("dashpot in contact", nonlinear, compute)


_HAND_WRITTEN = {
    "KV-contact": HandWritten(columns=lambda motion, nonlinear: [_dashpot_contact(motion, nonlinear)[0]]),
    "KB-contact": HandWritten(columns=lambda motion, nonlinear: [_branch_contact(motion, nonlinear)[0]]),
}
_POWER_LAW_BRANCHES = 10  # each is four times as slow as the one before
_SOLUTIONS: dict[str, dict[str, Any]] = {
    "Maxwell": {"solution": elongation},
    "KB": {"solution": elongation},
    "KB-mass": {"solution": elongation},
    "Burgers": {"solution": elongation},
    "QLV": _quasi_linear(tuple, ["relaxation_time"]),
    "QLV-2": _quasi_linear(tuple, ["relaxation_time_1", "relaxation_time_2"]),
    "QLV-power": _quasi_linear(
        lambda nonlinear: [4**n * nonlinear[0] for n in range(_POWER_LAW_BRANCHES)],
        [f"{4**n} * shortest_time" for n in range(_POWER_LAW_BRANCHES)],
    ),
}
_TOUCHING: dict[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "LE-contact": lambda motion, nonlinear: motion.position > 0,
    "KV-contact": lambda motion, nonlinear: _dashpot_contact(motion, nonlinear)[1],
    "KB-contact": lambda motion, nonlinear: _branch_contact(motion, nonlinear)[1],
}


def _base(name: str, equation: str, parameters: Mapping, state: Mapping | None = None, **facts) -> Base:
    """Return a base of ``bases.yaml`` with its hand-written parts."""
    linear, nonlinear = [], []
    for symbol, item in parameters.items():
        if "scale" in item:
            nonlinear.append(NonlinearParameter(symbol=symbol, **item | {"reach": tuple(item["reach"])}))
        else:
            linear.append(LinearParameter(symbol=symbol, **item))
    form = Form(
        name,
        equation,
        Place.PARALLEL,
        tuple(linear),
        tuple(nonlinear),
        state=tuple((state or {}).items()),
        **_SOLUTIONS.get(name, {}),
        hand_written=_HAND_WRITTEN.get(name),
        effect="base",
    )
    return Base(form, touching=_TOUCHING.get(name), **facts)


_DEFINITIONS = shipped_yaml(Path(__file__).with_suffix(".yaml"))["bases"]
BASES = {name: _base(name, **definition) for name, definition in _DEFINITIONS.items()}
"""Base models by name.

KB is the Kelvin–Boltzmann model: a spring parallel to a Maxwell branch. Bases with ``-contact`` are for a free tool, with
positions relative to the surface. The pendulum is Eq. 4.1: M is the moment that the subject exerts at the pivot, positive with
the angle θ from the vertical (not centred). The data decide the sign of its gravity moment: m g ℓ > 0 if θ is measured from
straight down (hanging, as published), −m g ℓ < 0 if from straight up (inverted).
"""


QUASI_LINEAR = ("QLV", "QLV-2", "QLV-power")
"""Bases of quasi-linear viscoelasticity (Fung 1993, section 7.6), those with fewer states first."""
LENGTH = "hardening_length"
"""Name of the parameter of a quasi-linear base beyond which its elastic response is nonlinear."""
CHOSEN_BY_DATA = "auto"
"""Value of the base setting with which the data decide the base of a tissue."""
